//! Validation of a scene before it is compiled, and repair of damaged data.

use crate::build::builder::{EnvironmentSource, PunctualKind, SceneBuilder};
use crate::build::error::BuildError;
use crate::build::report::BuildReport;
use crate::camera::check_camera;
use crate::camera::shutter::Shutter;
use crate::material::Material;
use crate::material::texture::{Image, Texels};
use dunkelfeld_geometry::Mesh;
use dunkelfeld_radiometry::Rgb;
use std::sync::Arc;

/// Longest time of an exposure \[s\].
const MAX_SECONDS: f64 = 1e6;

/// Checks that every index is in range and that every image has all its texels.
pub(crate) fn check_indices(builder: &SceneBuilder) -> Result<(), BuildError> {
    let check = |place: &dyn Fn() -> String, what: &'static str, index: usize, count: usize| {
        if index < count { Ok(()) } else { Err(BuildError::BadIndex { place: place(), what, index, count }) }
    };
    for (i, m) in builder.meshes.iter().enumerate() {
        check(&|| mesh_place(i, &m.name), "material", m.material, builder.materials.len())?;
    }
    for instance in &builder.instances {
        for &mesh in &instance.meshes {
            check(&|| format!("object \"{}\"", instance.name), "mesh", mesh, builder.meshes.len())?;
        }
    }
    for m in &builder.materials {
        for texture in m.textures() {
            check(&|| format!("material \"{}\"", m.name), "image", texture.image.0 as usize, builder.images.len())?;
        }
    }
    for light in &builder.lights {
        if let PunctualKind::Profile { profile, .. } = light.kind {
            check(&|| format!("light \"{}\"", light.name), "profile", profile, builder.profiles.len())?;
        }
    }
    if let Some(EnvironmentSource::Image { image, .. }) = builder.environment.as_ref().map(|e| &e.source) {
        check(&|| "the environment".into(), "image", image.0 as usize, builder.images.len())?;
    }
    for image in &builder.images {
        if image.width == 0 || image.height == 0 || image.texels.len() != image.width as usize * image.height as usize {
            return Err(BuildError::BadValue {
                place: format!("image \"{}\"", image.name),
                problem: format!("{} texels do not fill {} x {}", image.texels.len(), image.width, image.height),
            });
        }
    }
    Ok(())
}

/// Checks that the numbers of materials, lights and cameras are in their ranges.
pub(crate) fn check_values(builder: &SceneBuilder) -> Result<(), BuildError> {
    builder.materials.iter().try_for_each(check_material)?;
    for light in &builder.lights {
        let place = || format!("light \"{}\"", light.name);
        let (PunctualKind::Point { intensity: strength }
        | PunctualKind::Spot { intensity: strength, .. }
        | PunctualKind::Directional { irradiance: strength }
        | PunctualKind::Sun { irradiance: strength, .. }
        | PunctualKind::Profile { scale: strength, .. }) = light.kind;
        require(is_radiance(strength), place, "its strength must be finite and not negative")?;
        require(light.to_world.is_finite(), place, "its transform must be finite")?;
        if let PunctualKind::Spot { inner, outer, .. } = light.kind {
            require(inner.is_finite() && outer.is_finite(), place, "its cone must be finite")?;
        }
        if let PunctualKind::Sun { half_angle, .. } = light.kind {
            let fits = half_angle > 0.0 && half_angle <= std::f32::consts::FRAC_PI_2;
            require(fits, place, "its angular diameter must lie between 0 and 180 degrees")?;
        }
    }
    for (i, part) in builder.meshes.iter().enumerate() {
        let is_radius = part.edge_radius >= 0.0 && part.edge_radius.is_finite();
        require(is_radius, || mesh_place(i, &part.name), "its edge radius must be finite and not negative")?;
    }
    check_motion(builder)?;
    for camera in &builder.cameras {
        check_camera(camera).map_err(|problem| BuildError::BadValue {
            place: format!("camera \"{}\"", camera.name),
            problem: problem.into(),
        })?;
    }
    if let Some(environment) = &builder.environment {
        let place = || "the environment".to_string();
        let (EnvironmentSource::Constant(strength) | EnvironmentSource::Image { scale: strength, .. }) =
            environment.source;
        require(is_radiance(strength), place, "its radiance must be finite and not negative")?;
        require(environment.rotation.is_finite(), place, "its rotation must be finite")?;
    }
    Ok(())
}

/// Checks shutter and motions.
fn check_motion(builder: &SceneBuilder) -> Result<(), BuildError> {
    for instance in &builder.instances {
        let place = || format!("object \"{}\"", instance.name);
        require(instance.motion.is_finite(), place, "its motion must be finite, with an axis of unit length")?;
        let emits = |&m: &usize| builder.materials[builder.meshes[m].material].emits();
        let is_lit = builder.moves(instance) && instance.meshes.iter().any(emits);
        require(
            !is_lit,
            place,
            "it emits light and moves, but lights must be at rest; leave out its motion, or its emission",
        )?;
    }
    let is_time = |t: f64| t > 0.0 && t <= MAX_SECONDS;
    match builder.shutter {
        None => Ok(()),
        Some(Shutter::Frame { exposure }) => {
            require(is_time(exposure), || "the shutter".into(), "its exposure must be above 0 and at most 1e6 s")
        }
        Some(Shutter::Lines(lines)) => {
            let place = || "the line scan".to_string();
            require(is_time(lines.period), place, "its period must be above 0 and at most 1e6 s")?;
            let fits = lines.exposure > 0.0 && lines.exposure <= lines.period;
            require(fits, place, "its exposure must be above 0 and at most the period of a line")?;
            require((1..=1024).contains(&lines.stages), place, "it must have 1 to 1024 stages")?;
            let fits = lines.jitter >= 0.0 && lines.jitter <= lines.period;
            require(fits, place, "the deviation of its lines must lie between 0 and the period of a line")?;
            require((0.0..=1.0).contains(&lines.line), place, "its line must lie between 0 and 1")?;
            require(lines.rows >= 1, place, "it must have a row")
        }
    }
}

fn check_material(m: &Material) -> Result<(), BuildError> {
    let place = || format!("material \"{}\"", m.name);
    require(is_radiance(m.emission.factor), place, "the emission must be finite and not negative")?;
    let mut copy = m.clone();
    let (colors, numbers, _) = copy.parameters();
    require(colors.iter().all(|c| c.factor.is_finite()), place, "colours must be finite")?;
    require(!m.unlit || is_radiance(m.base_color.factor), place, "an unlit colour must not be negative")?;
    require(m.ior.is_finite() && m.ior > 0.0, place, "the index of refraction must be finite and above 0")?;
    require(m.emission_profile.is_valid(), place, "the emission profile must have angles in its range")?;
    if let Some(height) = &m.height {
        require(height.is_valid(), place, "the lengths of its heights must be above 0, and directions not zero")?;
        require(m.is_opaque(), place, "heights need a surface that no light passes")?;
    }
    let is_grain = m.anisotropy.grain.is_none_or(|grain| grain.is_valid());
    require(is_grain, place, "the direction of a grain must not be zero")?;
    let others = [m.normal_map.scale, m.specular.tint, m.sheen.roughness, m.anisotropy.rotation];
    let mut factors = numbers.iter().map(|number| number.factor).chain(others);
    require(factors.all(f32::is_finite), place, "factors must be finite")
}

fn require(fits: bool, place: impl Fn() -> String, problem: &str) -> Result<(), BuildError> {
    if fits { Ok(()) } else { Err(BuildError::BadValue { place: place(), problem: problem.into() }) }
}

/// Finite, and negative in no channel.
fn is_radiance(v: Rgb) -> bool {
    v.is_finite() && v.to_array().iter().all(|c| *c >= 0.0)
}

/// Sets texels that are not finite or negative to zero. One of them would make every pixel invalid that samples it.
pub(crate) fn repair_texels(images: &mut [Image], report: &mut BuildReport) {
    for image in images {
        let is_sound = match &*image.texels {
            Texels::RgbF32(texels) => texels.iter().flatten().all(|&v| is_usable(v)),
            Texels::GrayF32(texels) => texels.iter().flatten().all(|&v| is_usable(v)),
            _ => true,
        };
        if is_sound {
            continue;
        }
        let count = match Arc::make_mut(&mut image.texels) {
            Texels::RgbF32(texels) => blacken(texels),
            Texels::GrayF32(texels) => blacken(texels),
            _ => continue,
        };
        if count > 0 {
            let place = format!("image \"{}\"", image.name);
            report.note(place, format!("has {count} texels that are negative or not finite; they count as black"));
        }
    }
}

fn is_usable(v: f32) -> bool {
    v.is_finite() && v >= 0.0
}

/// Sets values that are no radiance to zero. Returns the number of texels that had any.
fn blacken<const N: usize>(texels: &mut [[f32; N]]) -> usize {
    let broken = texels.iter_mut().filter(|t| !t.iter().all(|v| is_usable(*v)));
    broken.map(|texel| *texel = texel.map(|v| if is_usable(v) { v } else { 0.0 })).count()
}

pub(crate) fn mesh_place(index: usize, name: &str) -> String {
    if name.is_empty() { format!("mesh {index}") } else { format!("mesh \"{name}\"") }
}

/// Drops attributes whose length differs from that of the positions, because they would be read out of range. Drops
/// colours that are not finite, because they would make the surface invalid. Gives a note for each.
pub(crate) fn drop_unusable_attributes(mesh: &mut Arc<Mesh>) -> Vec<String> {
    let n = mesh.positions.len();
    let mut notes = Vec::new();
    let mut drop = |len: usize, name: &str| {
        let wrong = len != 0 && len != n;
        if wrong {
            notes.push(format!("has {len} {name} for {n} positions; they are ignored"));
        }
        wrong
    };
    if drop(mesh.normals.len(), "normals") {
        Arc::make_mut(mesh).normals.clear();
    }
    if drop(mesh.tangents.len(), "tangents") {
        Arc::make_mut(mesh).tangents.clear();
    }
    if drop(mesh.colors.len(), "vertex colours") {
        Arc::make_mut(mesh).colors.clear();
    }
    for set in 0..2 {
        if drop(mesh.uvs[set].len(), "texture coordinates") {
            Arc::make_mut(mesh).uvs[set].clear();
        }
    }
    // Values outside [0, 1] are clamped where they are used; a NaN would pass every clamp.
    if mesh.colors.iter().any(|c| !c.is_finite()) {
        notes.push("has vertex colours that are not finite; they are ignored".into());
        Arc::make_mut(mesh).colors.clear();
    }
    notes
}
