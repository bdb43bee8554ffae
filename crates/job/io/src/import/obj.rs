//! Wavefront OBJ with its MTL libraries. The crate `tobj` reads both. A statement that it refuses or misreads is an
//! error with its line. The code here builds the scene from the result. `docs/import.md` describes the steps.

mod assemble;
mod bake;
mod closed;
mod convert;
mod groups;
mod map;
mod mtl;
mod read;
mod tally;
mod text;
mod textures;

use crate::error::InputError;
use crate::import::guard::guarded;
use crate::import::image_store::ImageStore;
use crate::import::mesh_file::without_mark;
use crate::import::options::{ImportOptions, Imported};
use crate::import::recorded::recorded;
use crate::import::warnings::Warnings;
use crate::input::Role;
use crate::loader::AssetLoader;
use convert::{Converted, convert, default_material};
use dunkelfeld_geometry::{DAffine3, Mesh};
use dunkelfeld_scene::{Instance, Material, MeshPart, SceneBuilder, Surface, Volume};
use mtl::Mtl;
use read::Parsed;
use std::collections::HashMap;
use std::path::Path;
use tally::Tally;
use textures::{Textures, load_beside};

const RE_EXPORT: &str = "correct the line, or export the mesh again, as OBJ from another program or as glTF";

/// Reads an OBJ file, its MTL libraries and their images. All must be in the folder of the OBJ or below.
///
/// Coordinates are metres, right-handed. OBJ has no unit, no camera and no light except emissive materials. Each `o` or
/// `g` becomes an instance of that name (`o/g` if a group is in an object). Polygons may be concave. Corners without a
/// normal get the angle-weighted mean of the faces of their smoothing group (Thürmer and Wüthrich 1998), or the normal
/// of the face if smoothing is off. Vertex colours are interpreted as sRGB (as Blender writes them), MTL colours as
/// linear. A file far from its own origin is stored around its centre.
///
/// | MTL | becomes |
/// |---|---|
/// | `Kd`, `map_Kd` | base colour; 0.8 where absent, white where absent or black beside a map |
/// | `Ks`, `map_Ks` | strength (its largest channel) and colour of the dielectric reflection; none under `illum` 0 and 1, or where absent; with PBR keys or transmission ignored, since `Ni` gives the reflection |
/// | `illum` 3, 8 with `Ks` above `Kd` | a metal of colour `Ks` |
/// | `Ns`, `map_Ns` | GGX alpha sqrt(2 / (Ns + 2)), roughness its square root; 0.5 where absent |
/// | `Ni` | index of refraction; 1.5 where absent, or at most 1 on an opaque material |
/// | `illum` 4, 6, 7, 9 | transmission 1 - `d`; under 6 and 7 with `d` 1 the largest channel of `Tf` (or 1); tinted by `Tf`; sharp unless `Pr` is given. A *closed* mesh of it is a solid that refracts, an open one a thin sheet |
/// | `d`, `Tr`, `map_d` otherwise | stochastic coverage (`d` wins over `Tr`; of a map alpha if it has any, else red) |
/// | `Ke`, `map_Ke` | emitted radiance \[W/(m^2 sr)\] of the front side |
/// | `Pr`, `Pm`, `Pc`, `Pcr` and their maps | roughness, metallic, clear coat and its roughness |
/// | `Ps`, `map_Ps` | sheen colour |
/// | `aniso`, `anisor` | anisotropy; its rotation in turns |
/// | `norm` | normal map, x and y scaled by `-bm` |
/// | `map_Bump`, `bump` | normal map made from heights: at `-bm 1` white lies 1/100 of the image's width above black; an image that evidently holds normals is used as such |
/// | `disp`, `refl`, `decal` and other keys, `-t`, `-mm`, `-cc`, `-type`, `-imfchan`, `-colorspace` | ignored with a warning |
/// | `Ka`, `map_Ka`, `-boost`, `-blendu`, `-blendv`, `-texres` | ignored |
/// | `-o`, `-s`, `-clamp` | honoured |
///
/// # Errors
/// If the file cannot be read, is no text, is beyond the limits, or contains no visible face.
pub fn load_obj(path: &Path, options: &ImportOptions) -> Result<Imported, InputError> {
    let loader = AssetLoader::new(path, options.limits);
    let result = guarded(path, "the file", || import(path, options, &loader));
    recorded(loader, result)
}

/// [`load_obj`] without the list of the input files.
fn import(path: &Path, options: &ImportOptions, loader: &AssetLoader) -> Result<Imported, InputError> {
    let bytes = loader.read_scene()?;
    let refuse = |problem: &str, help: &str| InputError::of_file(path, problem, help);
    without_mark(&bytes, path)?;
    let Some(source) = text::decode(bytes) else {
        return Err(refuse("holds binary data and is no OBJ text", "export the scene as Wavefront OBJ or glTF"));
    };
    if u32::try_from(source.len()).is_err() {
        return Err(refuse("is larger than 4 GiB", "split it, or export it as glTF"));
    }

    let mut warnings = Warnings::new(path);
    let mut tally = Tally::default();
    let most = options.limits.geometry_bytes;
    let parsed = read::read(source, path, most, &mut tally)?;
    let libraries = Libraries::load(&parsed, loader, &mut warnings)?;
    let refracts = |material: u32| {
        let name = parsed.groups.materials.list.get(material as usize);
        let mtl = name.and_then(|name| libraries.materials.get(*libraries.by_name.get(name)?));
        mtl.is_some_and(|(mtl, _)| convert::transmission(mtl).is_some())
    };
    let assembly = assemble::assemble(&parsed, refracts, &mut tally);
    tally.report(&mut warnings);
    if assembly.parts.is_empty() {
        return Err(nothing_to_see(path, &parsed, warnings));
    }
    let bytes: u64 = assembly.parts.iter().map(|p| mesh_bytes(&p.mesh)).sum();
    if bytes > most {
        return Err(too_large(path, most));
    }

    let store = ImageStore::new(&options.limits);
    let mut materials = Materials::new(&parsed, &libraries, Textures::new(loader, store));
    let mut scene = SceneBuilder {
        name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        ..SceneBuilder::default()
    };
    let to_world = DAffine3::from_translation(assembly.origin);
    let mut last_object = None;
    for mut part in assembly.parts {
        let material = materials.find(part.material, part.closed, &mut warnings);
        // Faces before any name belong to an object too, which a job can name.
        let name = match parsed.groups.objects.list.get(part.object as usize) {
            Some(name) if !name.is_empty() => name.clone(),
            _ => format!("object {}", part.object),
        };
        let name = name.as_str();
        materials.check_mesh(material, name, &mut part.mesh, &mut warnings);
        scene.meshes.push(MeshPart { name: name.to_string(), mesh: part.mesh.into(), material, ..MeshPart::default() });
        let mesh = scene.meshes.len() - 1;
        match scene.instances.last_mut() {
            Some(instance) if last_object == Some(part.object) => instance.meshes.push(mesh),
            _ => scene.instances.push(Instance {
                name: name.to_string(),
                meshes: vec![mesh],
                to_world,
                motion: Default::default(),
            }),
        }
        last_object = Some(part.object);
    }
    materials.textures.store.check(path)?;
    scene.materials = materials.list;
    scene.images = materials.textures.store.into_images();
    Ok(Imported { scene, warnings: warnings.finish(), ..Imported::default() })
}

fn too_large(path: &Path, most: u64) -> InputError {
    let problem = format!("its meshes need more than {} MiB", most >> 20);
    InputError::of_file(path, problem, "reduce the meshes, or raise the import limits")
}

/// The error for a file without a usable face. It lists the first warnings as reasons.
fn nothing_to_see(path: &Path, parsed: &Parsed, warnings: Warnings) -> InputError {
    let (problem, help) = match parsed.faces.is_empty() {
        true => ("holds no face", "export a polygon mesh (`f` statements)"),
        false => ("none of its faces can be used", RE_EXPORT),
    };
    let mut problem = problem.to_owned();
    for warning in warnings.finish().iter().take(2) {
        problem.push_str(&format!("; {warning}"));
    }
    InputError::of_file(path, problem, help)
}

fn mesh_bytes(mesh: &Mesh) -> u64 {
    let vertex = |v: usize, size: usize| (v * size) as u64;
    vertex(mesh.triangles.len(), 12)
        + vertex(mesh.positions.len() + mesh.normals.len(), 12)
        + vertex(mesh.uvs[0].len(), 8)
        + vertex(mesh.colors.len(), 16)
}

/// The materials of all libraries.
#[derive(Default)]
struct Libraries {
    /// With the folder of the library, relative to the OBJ.
    materials: Vec<(Mtl, String)>,
    by_name: HashMap<String, usize>,
}

impl Libraries {
    /// Reads all libraries. A missing one is a warning.
    fn load(parsed: &Parsed, loader: &AssetLoader, warnings: &mut Warnings) -> Result<Self, InputError> {
        let mut libraries = Self::default();
        let mut loaded: Vec<&str> = Vec::new();
        for (line, names) in &parsed.groups.libraries {
            if loaded.contains(&names.as_str()) {
                continue;
            }
            loaded.push(names);
            // `mtllib` allows several names, and names may contain spaces: first the whole text is tried as one name.
            let words = || names.split_whitespace().filter(|word| word != names);
            if libraries.load_file(names, loader, warnings)? {
                continue;
            }
            let mut missing: Vec<&str> = Vec::new();
            for name in words() {
                if !libraries.load_file(name, loader, warnings)? {
                    missing.push(name);
                }
            }
            if missing.len() == words().count() {
                missing = vec![names];
            }
            for name in missing {
                let message = format!("the material library \"{name}\" cannot be read; its materials become grey");
                warnings.push(format!("line {line}"), message);
            }
        }
        Ok(libraries)
    }

    /// `false` if the file is not there.
    fn load_file(&mut self, name: &str, loader: &AssetLoader, warnings: &mut Warnings) -> Result<bool, InputError> {
        let Ok(bytes) = load_beside(loader, "", name, Role::MaterialLibrary) else { return Ok(false) };
        let path = name.replace('\\', "/");
        let file = loader.scene_file().with_file_name(&path);
        without_mark(&bytes, &file)?;
        let refuse = |place: String, problem: String| InputError::new(&file, place, problem, RE_EXPORT);
        let source = text::decode(bytes).ok_or_else(|| refuse("the file".into(), "holds binary data".into()))?;
        let materials = mtl::read(&source, &path, warnings).map_err(|(line, reason)| {
            refuse(format!("line {line}"), format!("cannot be read as an MTL statement: {reason}"))
        })?;
        let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
        for material in materials {
            // Of several materials with the same name, the first is used.
            self.by_name.entry(material.name.clone()).or_insert(self.materials.len());
            self.materials.push((material, folder.to_string()));
        }
        Ok(true)
    }
}

/// The scene's materials, converted when first used.
struct Materials<'a> {
    parsed: &'a Parsed,
    libraries: &'a Libraries,
    textures: Textures<'a>,
    list: Vec<Material>,
    /// From the OBJ's material and "is a solid" to the scene's material.
    known: HashMap<(u32, bool), usize>,
    /// Does the OBJ's material refract?
    refracts: HashMap<u32, bool>,
}

impl<'a> Materials<'a> {
    fn new(parsed: &'a Parsed, libraries: &'a Libraries, textures: Textures<'a>) -> Self {
        Self { parsed, libraries, textures, list: Vec::new(), known: HashMap::new(), refracts: HashMap::new() }
    }

    /// Index of the scene's material for an OBJ material on a closed or an open mesh. A refracting material on both
    /// kinds becomes two materials of the same name.
    fn find(&mut self, id: u32, closed: bool, warnings: &mut Warnings) -> usize {
        let refracts = self.refracts.get(&id).copied();
        if let Some(index) = refracts.and_then(|r| self.known.get(&(id, r && closed))) {
            return *index;
        }
        let name = self.parsed.groups.materials.list.get(id as usize).map_or("", String::as_str);
        let Converted { mut material, refracts } = match self.libraries.by_name.get(name) {
            Some(found) => {
                let (mtl, folder) = &self.libraries.materials[*found];
                convert(mtl, folder, &mut self.textures, warnings)
            }
            None => {
                if !name.is_empty() {
                    warnings.push(
                        format!("material \"{name}\""),
                        "is not defined in any material library; it becomes grey",
                    );
                }
                Converted { material: default_material(name), refracts: false }
            }
        };
        if refracts && closed {
            make_solid(&mut material);
        } else if refracts {
            let message = "refracts, but is on a mesh that is not closed; there it is a thin sheet";
            warnings.push(format!("material \"{name}\""), message);
        }
        self.list.push(material);
        self.known.insert((id, refracts && closed), self.list.len() - 1);
        self.refracts.insert(id, refracts);
        self.list.len() - 1
    }

    /// Adds the tangents that the material of a mesh needs, and warns of maps without coordinates.
    fn check_mesh(&self, material: usize, object: &str, mesh: &mut Mesh, warnings: &mut Warnings) {
        let Some(material) = self.list.get(material) else { return };
        if material.textures().next().is_none() {
            return;
        }
        if mesh.uvs[0].is_empty() {
            let message = format!("has maps, but object \"{object}\" has no texture coordinates; it shows one texel");
            warnings.push(format!("material \"{}\"", material.name), message);
        } else if material.normal_map.texture.is_some() {
            let uv = mesh.uvs[0].clone();
            crate::import::tangents::generate(mesh, &uv);
        }
    }
}

/// White light passes two interfaces and must have the filter's colour behind them. So each interface has the square
/// root of it.
fn make_solid(material: &mut Material) {
    let color = &mut material.base_color.factor;
    *color = color.lerp(color.map(|v| v.max(0.0).sqrt()), material.transmission.factor);
    material.surface = Surface::Solid(Volume::default());
}
