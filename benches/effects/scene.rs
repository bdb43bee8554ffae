//! The measured scenes: a plain scene, and the same scene with one effect in use, so weakly that the image stays.

use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, RigidMotion, Vec2, Vec3, Vec4};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{
    AlphaMode, Aperture, ColorEncoding, Effect, EmissionProfile, Environment, EnvironmentSource, Finish, HeightField,
    Image, ImageId, LightProfile, LineScan, Material, Opening, Process, PunctualKind, PunctualLight, Scene,
    SceneBuilder, Shutter, Surface, Texels, Texture, Volume,
};
use std::sync::Arc;

/// Parameters that put an effect in use and change nothing: small, and far above the rounding of f32 beside one.
const FAINT: f32 = 1e-6;

/// Boxes along each side of the floor: 81 of 12 triangles each.
const BOXES: usize = 9;

/// The measured cases.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Case {
    /// The plain scene as it is.
    Plain,
    /// The plain scene with an effect in use.
    Effect(Effect),
    /// The same without it: techniques only, whose price depends on what they are used for.
    Without(Effect),
}

impl Case {
    /// All cases: the plain scene, the effects, and techniques left out.
    pub(crate) fn all() -> Vec<Self> {
        let effects = Effect::ALL.into_iter().map(Self::Effect);
        let without = Effect::ALL.into_iter().filter(|e| e.is_technique()).map(Self::Without);
        std::iter::once(Self::Plain).chain(effects).chain(without).collect()
    }

    /// Its name, the argument of the measuring program.
    pub(crate) fn name(self) -> String {
        match self {
            Self::Plain => "plain".into(),
            Self::Effect(effect) => effect.name().into(),
            Self::Without(effect) => format!("without-{}", effect.name()),
        }
    }

    /// Builds the scene.
    pub(crate) fn scene(self) -> Result<Scene, String> {
        let mut builder = plain();
        if let Self::Effect(effect) | Self::Without(effect) = self {
            put_in_use(&mut builder, effect)?;
        }
        if let Self::Without(effect) = self
            && !builder.leave_out(effect)
        {
            return Err(format!("{} cannot be left out", effect.name()));
        }
        Ok(builder.build().map_err(|e| e.to_string())?.0)
    }
}

/// Grey matt and metal boxes between three walls, under three rectangular panels.
fn plain() -> SceneBuilder {
    let mut b = SceneBuilder::default();
    let matt = Material {
        name: "matt".into(),
        base_color: Rgb::splat(0.6).into(),
        roughness: 0.6.into(),
        ..Material::default()
    };
    let metal = Material { name: "metal".into(), metallic: 1.0.into(), roughness: 0.3.into(), ..matt.clone() };
    let panel = Material { name: "panel".into(), emission: Rgb::splat(4.0).into(), ..matt.clone() };
    let [matt, metal, panel] = [matt, metal, panel].map(|m| b.add_material(m));
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z);
    let corner = Vec3::new(-1.0, -1.0, 0.0);
    for (name, mesh) in [
        ("floor", faces(&[[corner, x, y]])),
        ("left", faces(&[[corner, y, z]])),
        ("back", faces(&[[corner + y, x, z]])),
        ("right", faces(&[[corner + x + y, -y, z]])),
    ] {
        b.add_object(name, mesh, matt);
    }
    for i in 0..BOXES * BOXES {
        let (column, row) = (i % BOXES, i / BOXES);
        let pitch = 2.0 / BOXES as f32;
        let height = 0.1 + 0.3 * ((i * 29) % 17) as f32 / 16.0;
        let low = corner + pitch * Vec3::new(column as f32 + 0.2, row as f32 + 0.2, 0.0);
        let body = cuboid(low, low + Vec3::new(0.6 * pitch, 0.6 * pitch, height));
        b.add_object("box", body, if (column + row) % 2 == 0 { matt } else { metal });
    }
    for at in [-0.8, -0.2, 0.4] {
        let low = Vec3::new(at, 0.2 * at, 1.0);
        b.add_object("panel", faces(&[[low, Vec3::Y * 0.4, Vec3::X * 0.4]]), panel);
    }
    b.add_camera("camera", DVec3::new(0.3, -2.4, 1.7), DVec3::new(0.0, 0.0, 0.1), 0.8);
    b
}

/// Rectangles of two triangles each, from corner and edges; their front is on the side of the edges' product. Each has
/// vertices of its own.
fn faces(rectangles: &[[Vec3; 3]]) -> Mesh {
    let mut mesh = Mesh::default();
    for &[corner, u, v] in rectangles {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([corner, corner + u, corner + u + v, corner + v]);
        mesh.uvs[0].extend([Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]);
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    mesh
}

/// A closed box.
fn cuboid(low: Vec3, high: Vec3) -> Mesh {
    let size = high - low;
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    faces(&[[low, y, x], [low + z, x, y], [low, x, z], [low + y, z, x], [low, z, y], [low + x, y, z]])
}

/// Puts an effect in use.
fn put_in_use(b: &mut SceneBuilder, effect: Effect) -> Result<(), String> {
    let clear = |volume: Volume, roughness: f32| Material {
        name: "clear".into(),
        transmission: 1.0.into(),
        roughness: roughness.into(),
        surface: Surface::Solid(volume),
        ..Material::default()
    };
    let volume = Volume::default();
    match effect {
        Effect::Textures => {
            let white = texture(b, [1.0; 3]);
            b.materials.iter_mut().for_each(|m| m.base_color.texture = Some(white));
        }
        Effect::VertexColors => {
            for part in &mut b.meshes {
                let mesh = Arc::make_mut(&mut part.mesh);
                mesh.colors = vec![Vec4::ONE; mesh.positions.len()];
            }
        }
        Effect::NormalMaps => {
            let flat = texture(b, [0.5, 0.5, 1.0]);
            b.materials.iter_mut().for_each(|m| m.normal_map.texture = Some(flat));
        }
        Effect::SmoothNormals => {
            for mesh in b.meshes.iter_mut().map(|part| Arc::make_mut(&mut part.mesh)) {
                let normals = (0..mesh.positions.len())
                    .map(|v| dunkelfeld_geometry::geometric_normal(&mesh.corners(v / 4 * 2)))
                    .collect();
                mesh.normals = normals;
            }
        }
        Effect::Coverage => {
            let texture = texture(b, [1.0; 3]);
            for m in &mut b.materials {
                m.alpha_mode = AlphaMode::Blend;
                m.alpha.texture = Some(texture);
            }
        }
        Effect::ThinSheets => b.materials[0].transmission.factor = FAINT,
        Effect::DiffuseTransmission => b.materials[0].diffuse_transmission.share.factor = FAINT,
        Effect::SmoothRefraction => hide(b, &clear(volume, 0.0), 1),
        Effect::RoughRefraction => hide(b, &clear(volume, 0.3), 1),
        Effect::Nesting => hide(b, &clear(volume, 0.0), 2),
        Effect::Absorption => hide(b, &clear(Volume { absorption: Rgb::WHITE, ..volume }, 0.0), 1),
        Effect::Scattering => hide(b, &clear(Volume { scattering: Rgb::WHITE, ..volume }, 0.0), 1),
        Effect::Anisotropy => b.materials.iter_mut().for_each(|m| m.anisotropy.strength.factor = FAINT),
        Effect::Finish => {
            let finish = Finish { process: Process::Grained { size: 1e-4 }, mean_deviation: 1e-12, seed: 0 };
            b.materials.iter_mut().for_each(|m| m.height = Some(HeightField::Finish(finish)));
        }
        Effect::Sheen => b.materials.iter_mut().for_each(|m| m.sheen.color.factor = Rgb::splat(FAINT)),
        Effect::Clearcoat => b.materials.iter_mut().for_each(|m| m.clearcoat.strength.factor = FAINT),
        Effect::EnergyCompensation => b.energy_compensation = true,
        Effect::FiniteAperture => {
            let opening = Opening::Radius(1e-6);
            b.cameras[0].lens.aperture = Some(Aperture { opening, focus_distance: 2.5, blades: None });
        }
        Effect::Distortion => b.cameras[0].lens.distortion.radial[0] = 1e-9,
        Effect::LensBlur => b.cameras[0].lens.spread = Some(0.55),
        Effect::Motion => {
            b.instances[4 + BOXES * BOXES / 2].motion = RigidMotion::linear(DVec3::X * 1e-6);
            b.shutter = Some(Shutter::Frame { exposure: 1e-3 });
        }
        Effect::LineScan => {
            let (period, exposure) = (1e-3, 1e-3);
            b.shutter = Some(Shutter::Lines(LineScan {
                period,
                exposure,
                stages: 1,
                jitter: 0.0,
                line: 0.5,
                rows: 64,
                in_turn: 1,
            }));
        }
        Effect::Environment => {
            let source = EnvironmentSource::Constant(Rgb::splat(1e-9));
            b.environment = Some(Environment { source, rotation: 0.0 });
        }
        Effect::PunctualLights => lamp(b, PunctualKind::Point { intensity: Rgb::splat(1e-9) }),
        Effect::LightProfiles => {
            let profile = LightProfile::new("lamp", &[0.0, 90.0], &[0.0], vec![1.0, 0.5]).map_err(|e| e.to_string())?;
            b.profiles.push(profile);
            lamp(b, PunctualKind::Profile { profile: 0, scale: Rgb::splat(1e-9) });
        }
        Effect::EmissionProfiles => {
            b.materials[2].emission_profile = EmissionProfile::CosinePower { exponent: FAINT };
        }
        Effect::ManyLights => {
            for mesh in b.meshes.iter_mut().filter(|part| part.material == 2).map(|part| Arc::make_mut(&mut part.mesh))
            {
                let [corner, u, v] = [mesh.positions[0], 0.2 * Vec3::Y * 0.4, 0.2 * Vec3::X * 0.4];
                let piece = |k: usize| [corner + (k % 5) as f32 * u + (k / 5) as f32 * v, u, v];
                *mesh = faces(&(0..25).map(piece).collect::<Vec<_>>());
            }
        }
        Effect::Color => b.materials[0].base_color.factor.b *= 1.0 - FAINT,
        // The plain scene has three lights, and the bench trains for this case only.
        Effect::EveryLight | Effect::LearnedRoulette => {}
        Effect::CoverConnection => {
            let (low, size) = (inside_the_middle(b, 0.3), inside_the_middle(b, 0.7) - inside_the_middle(b, 0.3));
            let plate = cuboid(low, low + Vec3::new(size.x, size.y, 0.1 * size.x));
            let clear = b.add_material(clear(volume, 0.0));
            b.add_object("hidden", plate, clear);
        }
    }
    Ok(())
}

/// A texture of one texel.
fn texture(b: &mut SceneBuilder, texel: [f32; 3]) -> Texture {
    b.images.push(Image { name: "texel".into(), width: 1, height: 1, texels: Texels::RgbF32(vec![texel]).into() });
    Texture::new(ImageId(b.images.len() as u32 - 1), ColorEncoding::Linear)
}

/// Adds a light without extent above the middle.
fn lamp(b: &mut SceneBuilder, kind: PunctualKind) {
    let to_world = DAffine3::from_translation(DVec3::new(0.0, 0.0, 0.9));
    b.lights.push(PunctualLight { name: "lamp".into(), to_world, kind });
}

/// Adds boxes of a clear material, which overlap each other, inside the closed box in the middle: no ray gets there.
fn hide(b: &mut SceneBuilder, material: &Material, count: usize) {
    let clear = b.add_material(material.clone());
    for k in 0..count {
        let start = 0.2 + 0.2 * k as f32;
        let body = cuboid(inside_the_middle(b, start), inside_the_middle(b, start + 0.4));
        b.add_object("hidden", body, clear);
    }
}

/// A point of the diagonal of the box in the middle, from its lowest corner at 0 to its highest at 1.
fn inside_the_middle(b: &SceneBuilder, share: f32) -> Vec3 {
    // After floor and walls.
    let corners = &b.meshes[4 + BOXES * BOXES / 2].mesh.positions;
    let low = corners.iter().copied().fold(Vec3::INFINITY, Vec3::min);
    let high = corners.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    low + (high - low) * share
}
