//! Wavefront OBJ with its MTL libraries. The crate `tobj` reads both. The code here cleans the text before, builds the
//! scene from the result, and reports each repair with its line. `docs/import-obj.md` describes the steps.
//!
//! The format is three decades old, and programs write it differently. So a fault in one statement invalidates only
//! that statement.

mod assemble;
mod bake;
mod clean;
mod clean_mtl;
mod closed;
mod convert;
mod groups;
mod map;
mod mtl;
mod plain;
mod read;
mod repair;
mod tally;
mod text;
mod textures;

use crate::error::InputError;
use crate::import::image_store::ImageStore;
use crate::import::options::{ImportOptions, Imported};
use crate::import::recorded::recorded;
use crate::import::warnings::Warnings;
use crate::input::Role;
use crate::loader::AssetLoader;
use assemble::Assembly;
use convert::{Converted, convert, default_material};
use dunkelfeld_geometry::{DAffine3, Mesh};
use dunkelfeld_scene::{Instance, Material, MeshPart, SceneBuilder, Surface, Volume};
use mtl::Mtl;
use read::{Parsed, Refused};
use std::collections::HashMap;
use std::path::Path;
use tally::Tally;
use textures::{Textures, load_beside};

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
/// | `disp`, `refl`, `decal`, `-t`, `-cc`, `-type` | ignored with a warning |
/// | `Ka`, `map_Ka`, `sharpness`, `-boost`, `-blendu`, `-blendv`, `-texres` | ignored |
/// | `-o`, `-s`, `-clamp`, `-mm`, `-imfchan`, `-colorspace` | honoured |
///
/// # Errors
/// If the file cannot be read, is no text, is beyond the limits, or contains no visible face.
pub fn load_obj(path: &Path, options: &ImportOptions) -> Result<Imported, InputError> {
    let loader = AssetLoader::new(path, options.limits);
    let result = import(path, options, &loader);
    recorded(loader, result)
}

/// [`load_obj`] without the list of the input files.
fn import(path: &Path, options: &ImportOptions, loader: &AssetLoader) -> Result<Imported, InputError> {
    let bytes = loader.read_scene()?;
    let refuse = |problem: &str, help: &str| InputError::new(path, "the file", problem, help);
    let Some((source, note)) = text::decode(bytes) else {
        return Err(refuse("holds binary data and is no OBJ text", "export the scene as Wavefront OBJ or glTF"));
    };
    if u32::try_from(source.len()).is_err() {
        return Err(refuse("is larger than 4 GiB", "split it, or export it as glTF"));
    }

    let mut warnings = Warnings::new(path);
    let mut tally = Tally::default();
    if let Some(note) = note {
        tally.note(note);
    }
    let too_large = || {
        let most = options.limits.geometry_bytes >> 20;
        let problem = format!("its meshes need more than {most} MiB");
        refuse(&problem, "reduce the meshes, or raise the import limits")
    };
    let parsed = read::read(&source, options.limits.geometry_bytes, &mut tally).map_err(|refused| match refused {
        Refused::TooLarge => too_large(),
        Refused::Line(line, reason) => {
            let problem = format!("cannot be read as an OBJ statement: {reason}");
            InputError::new(
                path,
                format!("line {line}"),
                problem,
                "correct or delete the line, or export the mesh again",
            )
        }
    })?;
    drop(source);
    let assembly = assemble::assemble(&parsed, &mut tally);
    tally.report("", &mut warnings);
    if assembly.parts.is_empty() {
        return Err(nothing_to_see(path, &parsed, warnings));
    }
    let bytes: u64 = assembly.parts.iter().map(|p| mesh_bytes(&p.mesh)).sum();
    if bytes > options.limits.geometry_bytes {
        return Err(too_large());
    }

    let libraries = Libraries::load(&parsed, loader, &mut warnings);
    measure_images(path, options, &parsed, &libraries, &assembly)?;
    let store = ImageStore::decoding(&options.limits);
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
        let name = match parsed.objects.get(part.object as usize) {
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
    loader.take_remarks().into_iter().for_each(|(place, message)| warnings.push(place, message));
    scene.materials = materials.list;
    scene.images = materials.textures.store.into_images();
    Ok(Imported { scene, warnings: warnings.finish(), ..Imported::default() })
}

/// Sums the images of all materials in use from their headers, before decoding.
fn measure_images(
    path: &Path,
    options: &ImportOptions,
    parsed: &Parsed,
    libraries: &Libraries,
    assembly: &Assembly,
) -> Result<(), InputError> {
    // Files are read again when they are decoded, and their faults are reported then.
    let loader = AssetLoader::new(path, options.limits);
    let mut ignored = Warnings::new(path);
    let textures = Textures::new(&loader, ImageStore::measuring(&options.limits));
    let mut materials = Materials::new(parsed, libraries, textures);
    for part in &assembly.parts {
        materials.find(part.material, part.closed, &mut ignored);
    }
    materials.textures.store.check(path)
}

/// The error for a file without a usable face. It lists the first repairs as reasons.
fn nothing_to_see(path: &Path, parsed: &Parsed, warnings: Warnings) -> InputError {
    let mut problem = match (parsed.positions.len(), parsed.faces.len()) {
        (0, 0) => "holds no vertices and no faces".to_string(),
        (n, 0) if parsed.dropped_faces > 0 => {
            format!("holds {} and {}, of which none can be used", vertices(n), faces(parsed.dropped_faces))
        }
        (n, 0) => format!("holds {} but no face", vertices(n)),
        (_, n) => format!("holds {}, of which none can be used", faces(n + parsed.dropped_faces)),
    };
    for warning in warnings.finish().iter().take(2) {
        problem.push_str(&format!("; {warning}"));
    }
    let has_faces = parsed.dropped_faces + parsed.faces.len() > 0;
    let help = if has_faces {
        "correct the faces (`f` statements), or export the mesh again"
    } else {
        "export a polygon mesh (`f` statements)"
    };
    InputError::new(path, "the file", problem, help)
}

fn vertices(n: usize) -> String {
    if n == 1 { "1 vertex".into() } else { format!("{n} vertices") }
}

fn faces(n: usize) -> String {
    if n == 1 { "1 face".into() } else { format!("{n} faces") }
}

fn mesh_bytes(mesh: &Mesh) -> u64 {
    let vertex = |v: usize, size: usize| (v * size) as u64;
    vertex(mesh.triangles.len(), 12)
        + vertex(mesh.positions.len() + mesh.normals.len(), 12)
        + vertex(mesh.uvs[0].len(), 8)
        + vertex(mesh.colors.len(), 16)
}

/// The materials of all libraries.
struct Libraries {
    /// With the folder of the library, relative to the OBJ.
    materials: Vec<(Mtl, String)>,
    /// By name as written.
    exact: HashMap<String, usize>,
    /// By name without comment, case and doubled spaces.
    loose: HashMap<String, usize>,
}

impl Libraries {
    fn load(parsed: &Parsed, loader: &AssetLoader, warnings: &mut Warnings) -> Self {
        let mut libraries = Self { materials: Vec::new(), exact: HashMap::new(), loose: HashMap::new() };
        let mut loaded: Vec<&str> = Vec::new();
        for (line, names) in &parsed.libraries {
            if !loaded.contains(&names.as_str()) {
                loaded.push(names);
                libraries.load_statement(*line, names, loader, warnings);
            }
        }
        libraries
    }

    /// `mtllib` allows several names, and names may contain spaces. First the whole text is tried as one name, then the
    /// pieces that end in `.mtl`, then the words.
    fn load_statement(&mut self, line: u32, names: &str, loader: &AssetLoader, warnings: &mut Warnings) {
        let place = format!("line {line}");
        let names = text::without_comment(names);
        if self.load_file(names, &place, loader, warnings).is_ok() {
            return;
        }
        let mut missing = Vec::new();
        let mut found = false;
        for piece in split_names(names) {
            if piece == names {
                missing.push(piece);
            } else if self.load_file(piece, &place, loader, warnings).is_ok() {
                found = true;
            } else {
                missing.push(piece);
            }
        }
        // A library beside the OBJ with its own name, or the named one with the usual extension, is probably the
        // intended one.
        if !found {
            let stem = |name: &str| format!("{}.mtl", name.rsplit_once('.').map_or(name, |(stem, _)| stem));
            let own = loader.scene_file().file_stem().unwrap_or_default().to_string_lossy().into_owned();
            for guess in [stem(names), format!("{own}.mtl")] {
                if guess != names && self.load_file(&guess, &place, loader, warnings).is_ok() {
                    warnings
                        .push(&place, format!("the material library \"{names}\" cannot be read; \"{guess}\" is used"));
                    return;
                }
            }
        }
        for name in missing {
            warnings.push(&place, format!("the material library \"{name}\" cannot be read; its materials become grey"));
        }
    }

    fn load_file(
        &mut self,
        name: &str,
        place: &str,
        loader: &AssetLoader,
        warnings: &mut Warnings,
    ) -> Result<(), String> {
        let found = load_beside(loader, "", name, Role::MaterialLibrary)?;
        let path = found.instead.as_deref().unwrap_or(name).replace('\\', "/");
        if found.instead.is_some() {
            warnings.push(place, format!("the material library \"{name}\" is not there; \"{path}\" is used"));
        }
        let (source, note) = text::decode(found.bytes).ok_or("holds binary data")?;
        let mut tally = Tally::default();
        if let Some(note) = note {
            tally.note(note);
        }
        let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
        for material in mtl::read(&source, &mut tally)? {
            let id = self.materials.len();
            // Of several materials with the same name, the first is used.
            self.exact.entry(material.name.clone()).or_insert(id);
            self.loose.entry(loosely(&material.name)).or_insert(id);
            self.materials.push((material, folder.to_string()));
        }
        tally.report(&path, warnings);
        Ok(())
    }

    fn find(&self, name: &str) -> Option<usize> {
        self.exact.get(name).or_else(|| self.loose.get(&loosely(name))).copied()
    }
}

/// Pieces of a list of file names: up to a word that ends in `.mtl`, else word by word.
fn split_names(names: &str) -> Vec<&str> {
    let lower = names.to_ascii_lowercase();
    let mut pieces = Vec::new();
    let mut start = 0;
    for (i, _) in lower.match_indices(".mtl") {
        let end = i + ".mtl".len();
        let at_word_end = lower.get(end..).is_none_or(|rest| rest.is_empty() || rest.starts_with(char::is_whitespace));
        if at_word_end && end > start {
            pieces.push(names[start..end].trim());
            start = end;
        }
    }
    pieces.extend(names[start..].split_whitespace());
    pieces
}

fn loosely(name: &str) -> String {
    text::without_comment(name).split_whitespace().collect::<Vec<_>>().join(" ").to_lowercase()
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
        let name = self.parsed.materials.get(id as usize).map_or("", String::as_str);
        let Converted { mut material, refracts } = match self.libraries.find(name) {
            Some(found) => {
                let (mtl, folder) = &self.libraries.materials[found];
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
        if !has_maps(material) {
            return;
        }
        if mesh.uvs[0].is_empty() {
            let message = format!("has maps, but object \"{object}\" has no texture coordinates; it shows one texel");
            warnings.push(format!("material \"{}\"", material.name), message);
        } else if material.normal_texture.is_some() {
            let uv = mesh.uvs[0].clone();
            crate::import::tangents::generate(mesh, &uv);
        }
    }
}

/// White light passes two interfaces and must have the filter's colour behind them. So each interface has the square
/// root of it.
fn make_solid(material: &mut Material) {
    let share = material.transmission;
    let tinted = material.base_color.map(|v| v.max(0.0).sqrt());
    material.base_color = material.base_color.lerp(tinted, share);
    material.surface = Surface::Solid(Volume::default());
}

fn has_maps(m: &Material) -> bool {
    let colors = [
        &m.base_color_texture,
        &m.normal_texture,
        &m.emission_texture,
        &m.specular_color_texture,
        &m.sheen_color_texture,
    ];
    let scalars = [
        &m.alpha_texture,
        &m.metallic_texture,
        &m.roughness_texture,
        &m.clearcoat_texture,
        &m.clearcoat_roughness_texture,
    ];
    colors.iter().any(|t| t.is_some()) || scalars.iter().any(|t| t.is_some())
}
