//! glTF 2.0 (.gltf and .glb): from the JSON and its buffers to a [`SceneBuilder`].
//!
//! The crate `gltf` reads the container and types the JSON: a file that it refuses is refused, with line and column.
//! `extensions` reads the data without types in the crate. Every offset, count and index is checked before its use, so
//! that a hostile file causes an error and not a panic. Data that a viewer could still show is used, with a warning.
//!
//! `container` (GLB, buffers), `document` (JSON) -> `nodes` (hierarchy) -> `accessor`, `primitive`, `deform`, `tangents`
//! (meshes), `material`, `texture` (surfaces), `light`, `hints` (lights and cameras). `validate` explains refusals.

mod accessor;
mod animation;
mod container;
mod deform;
mod document;
mod extensions;
mod hints;
mod light;
mod material;
mod nodes;
mod primitive;
mod reader;
mod texture;

use crate::error::InputError;
use crate::import::image_store::ImageStore;
use crate::import::options::{ImportOptions, Imported};
use crate::import::recorded::recorded;
use crate::import::warnings::Warnings;
use crate::loader::AssetLoader;
use accessor::{Accessors, Stored};
use animation::Channels;
use container::Asset;
use deform::{Deformation, Pose};
use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, Mesh, RigidMotion};
use dunkelfeld_scene::{Camera, Instance, MeshPart, PunctualLight, SceneBuilder};
use extensions::Instancing;
use gltf::json::Index;
use gltf::json::extensions::scene::khr_lights_punctual::Light;
use nodes::{Hierarchy, is_invertible, node_place};
use std::collections::BTreeMap;
use std::path::Path;
use texture::Textures;

/// Reads a glTF 2.0 file. The bytes, not the extension, distinguish `.glb` from `.gltf`.
///
/// Lengths are metres, as in glTF. Photometric values become radiometric by
/// [`LUMENS_PER_WATT`](crate::import::options::LUMENS_PER_WATT). Meshes remain in object space and are stored once, for
/// any number of nodes. Morphs and skins are baked in their default pose. Nodes have the pose of the first animation at
/// [`ImportOptions::animation_time`], and objects have the velocity that they have there.
///
/// # Errors
/// If the file or one of its buffers cannot be read, the JSON is malformed, an extension is required that is not
/// supported, a limit is exceeded, or no mesh of the file can be used.
pub fn load_gltf(path: &Path, options: &ImportOptions) -> Result<Imported, InputError> {
    let loader = AssetLoader::new(path, options.limits);
    let result = import(path, options, &loader);
    recorded(loader, result)
}

/// [`load_gltf`] without the list of the input files.
fn import(path: &Path, options: &ImportOptions, loader: &AssetLoader) -> Result<Imported, InputError> {
    let mut warnings = Warnings::new(path);
    let asset = Asset::load(loader, &mut warnings)?;
    let accessors = Accessors::new(&asset);
    let (hierarchy, motions) = hierarchy(path, options, &asset, &accessors, &mut warnings)?;
    let mut importer = Importer {
        path,
        asset: &asset,
        accessors: &accessors,
        textures: Textures::new(&asset, &accessors, loader, ImageStore::new(&options.limits)),
        options,
        warnings,
        motions,
        scene: SceneBuilder::default(),
        materials: BTreeMap::new(),
        meshes: BTreeMap::new(),
        poses: BTreeMap::new(),
        geometry_bytes: 0,
        first_fault: None,
    };
    importer.run(&hierarchy)?;
    importer.textures.store.check(path)?;
    let mut scene = importer.scene;
    scene.images = importer.textures.store.into_images();
    Ok(Imported { scene, warnings: importer.warnings.finish(), ..Imported::default() })
}

/// The node hierarchy at the time of the animation, and the motion of each node (`None` if it is not rigid). There are no
/// motions without an animation.
fn hierarchy(
    path: &Path,
    options: &ImportOptions,
    asset: &Asset,
    accessors: &Accessors<'_>,
    warnings: &mut Warnings,
) -> Result<(Hierarchy, Vec<Option<RigidMotion>>), InputError> {
    let document = &asset.document;
    let rest: &Vec<_> = &document.untyped.nodes.iter().map(|node| node.transform.clone()).collect();
    let nodes = document.root.nodes.len();
    let channels = Channels::new(&document.animations, nodes, accessors, options.animation_time, warnings);
    let Some(channels) = channels else {
        return Ok((nodes::resolve(document, rest, options.scene, path, warnings)?, Vec::new()));
    };
    let now = nodes::resolve(document, &channels.transforms(rest), options.scene, path, warnings)?;
    let Some([(from, before), (to, after)]) = channels.around(rest) else { return Ok((now, Vec::new())) };
    // Faults of the hierarchy are those of the pose.
    let mut ignored = Warnings::new(path);
    let mut at = |transforms: &[_]| nodes::resolve(document, transforms, options.scene, path, &mut ignored);
    let (before, after) = (at(&before)?, at(&after)?);
    let motion = |i: usize| animation::motion(&before.to_world[i], &now.to_world[i], &after.to_world[i], to - from);
    let motions = (0..now.to_world.len()).map(motion).collect();
    Ok((now, motions))
}

/// The key of a baked mesh: mesh, skin, and the bits of the morph weights of the node.
type MeshKey = (usize, Option<usize>, Option<Vec<u32>>);

struct Importer<'a> {
    path: &'a Path,
    asset: &'a Asset,
    accessors: &'a Accessors<'a>,
    textures: Textures<'a>,
    options: &'a ImportOptions,
    warnings: Warnings,
    /// Motions of the nodes; empty without an animation.
    motions: Vec<Option<RigidMotion>>,
    scene: SceneBuilder,
    /// Index in the file (`None`: the default material) to index in the scene.
    materials: BTreeMap<Option<usize>, usize>,
    meshes: BTreeMap<MeshKey, Vec<usize>>,
    poses: BTreeMap<usize, Option<Pose>>,
    geometry_bytes: u64,
    /// The first primitive that could not be used.
    first_fault: Option<(String, String)>,
}

impl Importer<'_> {
    fn run(&mut self, hierarchy: &Hierarchy) -> Result<(), InputError> {
        self.scene.name = self.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        for index in &hierarchy.shown {
            self.node(*index, &hierarchy.to_world)?;
        }
        hints::lost_lights(&self.asset.document, hierarchy, &mut self.warnings);
        let unit = self.options.emissive_unit;
        hints::dark_emission(&self.scene, &self.asset.document, unit, &mut self.warnings);
        if self.scene.instances.is_empty() {
            if let Some((place, fault)) = self.first_fault.take() {
                let help = "export the file again: its data does not fit its description";
                return Err(InputError::new(self.path, place, format!("{fault}; no mesh is left to show"), help));
            }
            self.warnings.push("scene", "there is no mesh to show");
        }
        Ok(())
    }

    fn node(&mut self, index: usize, to_world: &[DAffine3]) -> Result<(), InputError> {
        let document = &self.asset.document;
        let node = &document.root.nodes[index];
        let place = node_place(document, index);
        let transform = to_world[index];
        let light = node.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref()).map(|l| l.light.value());
        let placeable = transform.is_finite();
        if !placeable && (node.mesh.is_some() || node.camera.is_some() || light.is_some()) {
            self.warnings.push(&place, "its transform is not finite; what it carries is left out");
            return Ok(());
        }
        if let Some(mesh) = node.mesh {
            self.instance(index, mesh.value(), to_world, &place)?;
        }
        if let Some(camera) = node.camera.map(|c| c.value()) {
            self.camera(camera, node.name.as_deref(), transform, &place);
        }
        if let Some(light) = light {
            self.light(light, node.name.as_deref(), transform, &place);
        }
        Ok(())
    }

    fn camera(&mut self, index: usize, node_name: Option<&str>, to_world: DAffine3, place: &str) {
        let Some(source) = self.asset.document.root.cameras.get(index) else {
            return self.warnings.push(place, format!("its camera {index} does not exist"));
        };
        let name = name(&[node_name, source.name.as_deref()], "camera", index);
        if !is_invertible(&to_world) {
            return self.warnings.push(place, "its transform has no inverse; the camera is left out");
        }
        let place = format!("camera {index} \"{name}\"");
        if let Some((projection, aspect)) = light::camera(source, &place, &mut self.warnings) {
            self.scene.cameras.push(Camera { name, to_world, projection, aspect, ..Camera::default() });
        }
    }

    fn light(&mut self, index: usize, node_name: Option<&str>, to_world: DAffine3, place: &str) {
        let document = &self.asset.document;
        let lights: &[Light] = document.root.as_ref();
        let Some(source) = lights.get(index) else {
            return self.warnings.push(place, format!("its light {index} does not exist"));
        };
        let name = name(&[node_name, source.name.as_deref()], "light", index);
        if to_world.transform_vector3(DVec3::Z).length_squared() == 0.0 {
            return self.warnings.push(place, "its scale is 0; the light is left out");
        }
        let place = format!("light {index} \"{name}\"");
        if let Some(kind) = light::light(source, &place, &mut self.warnings) {
            self.scene.lights.push(PunctualLight { name, to_world, kind });
        }
    }

    /// Adds the instances of a mesh: one, or those of EXT_mesh_gpu_instancing.
    fn instance(&mut self, node: usize, mesh: usize, to_world: &[DAffine3], place: &str) -> Result<(), InputError> {
        let document = &self.asset.document;
        let source = &document.root.nodes[node];
        let Some(mesh_source) = document.root.meshes.get(mesh) else {
            self.warnings.push(place, format!("its mesh {mesh} does not exist"));
            return Ok(());
        };
        let skin = source.skin.map(|s| s.value()).filter(|s| self.prepare_pose(*s, to_world));
        // A skinned mesh is at the position of its joints. Its node's transform is ignored (glTF 2.0, section 3.7.3).
        let origin = skin.and_then(|s| self.poses.get(&s)?.as_ref().map(|p| p.origin));
        let transform = origin.map_or(to_world[node], DAffine3::from_translation);
        let placements = match document.untyped.nodes.get(node).and_then(|n| n.extensions.instancing.as_ref()) {
            Some(instancing) => self.placements(instancing, place),
            None => vec![DAffine3::IDENTITY],
        };
        self.charge((placements.len() * size_of::<Instance>()) as u64, place)?;
        let meshes = self.mesh(mesh, skin, source.weights.as_deref())?;
        if meshes.is_empty() {
            return Ok(());
        }
        let motion = match self.motions.get(node) {
            None => RigidMotion::default(),
            // The place of a skinned mesh follows from its joints.
            Some(_) if skin.is_some() => RigidMotion::default(),
            Some(Some(motion)) => *motion,
            Some(None) => {
                self.warnings
                    .push(place, "its animation changes its shape, so that it is at rest while the sensor is exposed");
                RigidMotion::default()
            }
        };
        let name = name(&[source.name.as_deref(), mesh_source.name.as_deref()], "mesh", mesh);
        let mut flattened = 0;
        for placement in placements {
            let to_world = transform * placement;
            if is_invertible(&to_world) {
                self.scene.instances.push(Instance { name: name.clone(), meshes: meshes.clone(), to_world, motion });
            } else {
                flattened += 1;
            }
        }
        if flattened > 0 {
            let fault = "its transform flattens the mesh (scale 0) or is not finite";
            self.warnings.push(place, format!("{fault}; it is left out"));
            self.first_fault.get_or_insert((place.to_owned(), fault.into()));
        }
        Ok(())
    }

    /// The transforms of EXT_mesh_gpu_instancing, relative to the node.
    fn placements(&mut self, source: &Instancing, place: &str) -> Vec<DAffine3> {
        let attribute = |name: &str| source.attributes.get(name).map(Index::value);
        let read = || -> Result<Vec<DAffine3>, String> {
            let three = |name| attribute(name).map(|a| self.accessors.vectors::<3>(a, Stored::Float)).transpose();
            let (translations, scales) = (three("TRANSLATION")?, three("SCALE")?);
            let rotations =
                attribute("ROTATION").map(|a| self.accessors.vectors::<4>(a, Stored::Quantized)).transpose()?;
            let counts = [&translations, &scales].map(|v| v.as_ref().map(Vec::len));
            let counts: Vec<_> = counts.into_iter().chain([rotations.as_ref().map(Vec::len)]).flatten().collect();
            let count = counts.first().copied().unwrap_or(1);
            if counts.iter().any(|c| *c != count) {
                return Err("the attributes differ in length".into());
            }
            let vector = |list: &Option<Vec<[f32; 3]>>, i: usize, default: DVec3| {
                let value = list.as_ref().and_then(|l| l.get(i));
                value.map_or(default, |v| DVec3::from_array(v.map(f64::from)))
            };
            let rotation = |i: usize| {
                let value = rotations.as_ref().and_then(|l| l.get(i)).map(|q| DQuat::from_array(q.map(f64::from)));
                value.filter(|q| q.length() > 0.0 && q.is_finite()).map_or(DQuat::IDENTITY, DQuat::normalize)
            };
            Ok((0..count)
                .map(|i| {
                    let (t, s) = (vector(&translations, i, DVec3::ZERO), vector(&scales, i, DVec3::ONE));
                    DAffine3::from_scale_rotation_translation(s, rotation(i), t)
                })
                .collect())
        };
        read().unwrap_or_else(|e| {
            self.warnings.push(place, format!("EXT_mesh_gpu_instancing cannot be used, the mesh is placed once: {e}"));
            vec![DAffine3::IDENTITY]
        })
    }

    /// Computes a skin's pose once; `false` if it cannot be used.
    fn prepare_pose(&mut self, index: usize, to_world: &[DAffine3]) -> bool {
        if let Some(pose) = self.poses.get(&index) {
            return pose.is_some();
        }
        let pose = match self.asset.document.root.skins.get(index) {
            Some(skin) => Pose::new(self.accessors, skin, to_world),
            None => Err("it does not exist".into()),
        };
        let pose = pose
            .map_err(|e| self.warnings.push(format!("skin {index}"), format!("{e}; meshes stay in their bind pose")))
            .ok();
        self.poses.entry(index).or_insert(pose).is_some()
    }

    /// The parts of a mesh in its default pose, read at the first use.
    fn mesh(&mut self, index: usize, skin: Option<usize>, weights: Option<&[f32]>) -> Result<Vec<usize>, InputError> {
        let key = (index, skin, weights.map(|w| w.iter().map(|v| v.to_bits()).collect()));
        if let Some(parts) = self.meshes.get(&key) {
            return Ok(parts.clone());
        }
        let document = &self.asset.document;
        let source = &document.root.meshes[index];
        let mesh_name = name(&[source.name.as_deref()], "mesh", index);
        let weights = weights.or(source.weights.as_deref()).unwrap_or_default();
        let mut parts = Vec::new();
        for (i, primitive) in source.primitives.iter().enumerate() {
            let place = format!("mesh {index} \"{mesh_name}\", primitive {i}");
            let material = self.material(primitive.material.map(|m| m.value()), &place);
            let pose = skin.and_then(|s| self.poses.get(&s)).and_then(Option::as_ref);
            let deformation = Deformation { weights, skin: pose };
            let read = primitive::read_primitive(self.accessors, primitive, &deformation, &place, &mut self.warnings);
            let mut mesh = match read {
                Ok(Some(mesh)) => mesh,
                Ok(None) => continue,
                Err(fault) => {
                    self.warnings.push(&place, format!("it is left out: {fault}"));
                    self.first_fault.get_or_insert((place, fault));
                    continue;
                }
            };
            self.complete(&mut mesh, material, &place);
            self.charge(primitive::mesh_bytes(&mesh), &place)?;
            let name = if source.primitives.len() > 1 { format!("{mesh_name} #{i}") } else { mesh_name.clone() };
            parts.push(self.scene.meshes.len());
            self.scene.meshes.push(MeshPart { name, mesh: mesh.into(), material, ..MeshPart::default() });
        }
        self.meshes.insert(key, parts.clone());
        Ok(parts)
    }

    /// Adds the tangents that the material needs, and warns of missing texture coordinates.
    fn complete(&mut self, mesh: &mut Mesh, material: usize, place: &str) {
        let material = &self.scene.materials[material];
        let missing = |set: u8| mesh.uvs.get(usize::from(set)).is_none_or(Vec::is_empty);
        if let Some(texture) = material.textures().find(|t| missing(t.uv_set)) {
            let message = format!("its material has a texture on TEXCOORD_{}, which is absent", texture.uv_set);
            self.warnings.push(place, message);
        }
        let directional = material.normal_map.texture.or(material.anisotropy.strength.texture);
        let is_anisotropic = material.anisotropy.strength.factor != 0.0;
        if !mesh.tangents.is_empty() || (directional.is_none() && !is_anisotropic) {
            return;
        }
        let set = directional.map_or(0, |t| usize::from(t.uv_set));
        let uv = mesh.uvs.get(set).map(Vec::as_slice).unwrap_or_default();
        let uv: Vec<_> = match directional {
            Some(t) => uv.iter().map(|uv| texture::apply_transform(&t.transform, *uv)).collect(),
            None => uv.to_vec(),
        };
        if uv.is_empty() {
            self.warnings.push(place, "it has no tangents and none can be computed without texture coordinates");
        } else if !crate::import::tangents::generate(mesh, &uv) {
            self.warnings.push(place, "it has no tangents and none can be computed: too many triangles share a vertex");
        } else if is_anisotropic {
            let message = format!("it has no TANGENT; its anisotropy takes its direction from TEXCOORD_{set}");
            self.warnings.push(place, message);
        }
    }

    /// The scene's index of a material of the file.
    fn material(&mut self, index: Option<usize>, place: &str) -> usize {
        let document = &self.asset.document;
        let index = index.filter(|i| {
            let exists = *i < document.root.materials.len();
            if !exists {
                self.warnings.push(place, format!("its material {i} does not exist; the default takes its place"));
            }
            exists
        });
        if let Some(known) = self.materials.get(&index) {
            return *known;
        }
        let material = match index.and_then(|i| material::Source::new(document, i)) {
            None => material::default_material(),
            Some(source) => {
                let place = source.place();
                let mut reader = reader::Reader { place, textures: &mut self.textures, warnings: &mut self.warnings };
                material::convert(&source, self.options.emissive_unit, &mut reader)
            }
        };
        let id = self.scene.materials.len();
        self.scene.materials.push(material);
        self.materials.insert(index, id);
        id
    }

    fn charge(&mut self, bytes: u64, place: &str) -> Result<(), InputError> {
        self.geometry_bytes = self.geometry_bytes.saturating_add(bytes);
        let most = self.options.limits.geometry_bytes;
        if self.geometry_bytes <= most {
            return Ok(());
        }
        let problem = format!("the meshes and instances need more than the {} MiB allowed", most >> 20);
        Err(InputError::new(self.path, place, problem, "simplify the scene, or raise the import limits"))
    }
}

/// The first name that is not empty, else kind and number.
fn name(candidates: &[Option<&str>], kind: &str, index: usize) -> String {
    let named = candidates.iter().flatten().find(|n| !n.trim().is_empty());
    named.map_or_else(|| format!("{kind} {index}"), |n| (*n).to_owned())
}
