//! `[[light]]` with a `kind`: new lamps, described as in a catalogue.

use super::light::{Lamp, LampKind, PanelSize, Pose, Spot, Sun};
use super::{CameraSettings, Job, LensSettings, Strength, Wavelength};
use crate::error::{ImportWarning, InputError};
use crate::names::suggestion;
use dunkelfeld_geometry::{DAffine3, DMat3, DQuat, DVec3, Mesh};
use dunkelfeld_radiometry::{Nanometres, Number, Rgb};
use dunkelfeld_scene::lamps::{LampMeshes, area, irradiance_on_axis};
use dunkelfeld_scene::{
    AlphaMode, Camera, EmissionProfile, Environment, EnvironmentSource, Instance, LampShape, Leds, Material, MeshPart,
    PunctualKind, PunctualLight, SceneBuilder, Specular,
};
use dunkelfeld_sensor::Bands;
use std::f64::consts::PI;

/// Power of a lamp without a given strength \[W\].
const DEFAULT_POWER: f64 = 1.0;
/// Inner over outer diameter of a ring, and opening over diameter of a dome, if they are not given.
const RING_HOLE: f64 = 0.6;
const DOME_HOLE: f64 = 0.25;
/// Height over width of a bar, if it is not given.
const BAR_HEIGHT: f64 = 0.1;
/// Share of the light that the beam splitter of a coaxial lamp reflects toward the part, if it is not given.
const SPLITTER: f64 = 0.5;
/// Angular diameter \[rad\] of a sun, if it is not given.
const SUN: f64 = 0.0093;
/// Full angle \[rad\] at half of the intensity of a Lambertian surface.
const LAMBERTIAN: f64 = 2.0 * PI / 3.0;
/// Sine of the angle between two directions below which they count as parallel.
const PARALLEL: f64 = 1e-6;
/// Reflectance of housings and plates.
const BLACK: f32 = 0.04;

/// An entry of `[[light]]` that is a new lamp: its position in the job, and its keys.
pub(super) type Entry<'a> = (usize, &'a Lamp);

/// The poses of the lamps of an entry.
struct Poses {
    /// Lamp to world: each lamp shines along its -z.
    to_world: Vec<DAffine3>,
    /// Distance \[m\] of the target.
    distance: f64,
}

impl Job {
    /// Adds the lamps of an entry to the scene. `targets` are those of [`Job::camera_targets`].
    pub(super) fn add_lamp(
        &self,
        entry: Entry<'_>,
        targets: &[(&str, DVec3)],
        scene: &mut SceneBuilder,
        warnings: &mut Vec<ImportWarning>,
    ) -> Result<(), InputError> {
        let (i, lamp) = entry;
        if !lamp.common.enabled {
            return Ok(());
        }
        let duty = self.duty(lamp);
        if let LampKind::Environment(_) = lamp.kind {
            let radiance = if let Some(Strength::Radiance(radiance)) = lamp.strength { radiance } else { Rgb::WHITE };
            let radiance = lamp.in_band(radiance * (duty as f32));
            scene.environment = Some(Environment { source: EnvironmentSource::Constant(radiance), rotation: 0.0 });
            return Ok(());
        }
        let Poses { to_world, distance } = self.poses(entry, targets, scene)?;
        let lamps = lamp.names().into_iter().zip(to_world);
        if let Some(shape) = lamp.surface() {
            let made = self.mesh_lamp(entry, shape, duty, distance)?;
            lamps.for_each(|(name, pose)| made.add(name, pose, scene));
        } else {
            let distance = lamp.working_distance.unwrap_or(distance);
            let is_lit = !matches!(lamp.kind, LampKind::Sun(_));
            if is_lit && matches!(lamp.strength, Some(Strength::Irradiance(_))) && distance <= 0.0 {
                return Err(self.no_irradiance(i, distance));
            }
            let kind = lamp.without_surface(duty, distance);
            scene.lights.extend(lamps.map(|(name, to_world)| PunctualLight { name, to_world, kind }));
        }
        if matches!(lamp.kind, LampKind::Coaxial(..)) && scene.cameras.is_empty() {
            warnings.push(ImportWarning {
                place: format!("[[light]] {}", i + 1),
                message:
                    "a coaxial lamp lies on the axis of a camera, and the scene has none; it lies above the target"
                        .into(),
            });
        }
        Ok(())
    }

    /// The camera to which a lamp belongs; `None` in a scene without cameras.
    fn lamp_camera<'a>(&self, (i, lamp): Entry<'_>, scene: &'a SceneBuilder) -> Result<Option<&'a Camera>, InputError> {
        let Some(name) = &lamp.common.camera else {
            return Ok(scene.cameras.get(self.camera_index(scene)?.unwrap_or(0)));
        };
        let found = scene.cameras.iter().find(|camera| camera.name == *name);
        found.map(Some).ok_or_else(|| {
            let known: Vec<&str> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
            let problem = format!("there is no camera named \"{name}\"");
            self.light_error(i, "camera", problem, suggestion(name, "cameras", &known))
        })
    }

    /// The points that the cameras of the job look at, by the names of the cameras.
    pub(super) fn camera_targets(&self, scene: &SceneBuilder) -> Vec<(&str, DVec3)> {
        let target = |camera: &'_ CameraSettings| camera.look_at.as_ref()?.resolve(scene).ok();
        let all = self.camera.defined.iter().filter_map(|camera| Some((camera.name.as_str(), target(camera)?)));
        all.collect()
    }

    fn poses(&self, entry: Entry<'_>, targets: &[(&str, DVec3)], scene: &SceneBuilder) -> Result<Poses, InputError> {
        let (i, lamp) = entry;
        let camera = self.lamp_camera(entry, scene)?;
        let center = scene_center(scene).unwrap_or(DVec3::ZERO);
        // The axis points from the target to the camera.
        let (axis, up, default_target) = match camera {
            Some(camera) => {
                let m = camera.to_world.matrix3;
                let axis = m.z_axis.try_normalize().unwrap_or(DVec3::Y);
                let eye = camera.to_world.translation;
                let depth = (eye - center).dot(axis).max(0.0);
                (axis, m.y_axis.try_normalize().unwrap_or(DVec3::NEG_Z), eye - depth * axis)
            }
            None => (DVec3::Y, DVec3::NEG_Z, center),
        };
        let Pose { position, aim, target, .. } = &lamp.pose;
        let target = match target {
            Some(place) => place.resolve(scene).map_err(|e| self.light_error(i, "target", e.problem, e.help))?,
            None => {
                let looked_at = targets.iter().find(|(name, _)| camera.is_some_and(|camera| camera.name == *name));
                looked_at.map_or(default_target, |(_, target)| *target)
            }
        };
        let right = up.cross(axis).try_normalize().unwrap_or(axis.any_orthonormal_vector());
        let up = axis.cross(right);
        let by_angles = lamp.pose.elevation.map(|elevation| {
            let azimuth = f64::from(lamp.pose.azimuth.unwrap_or(0.0));
            let flat = right * azimuth.cos() + up * azimuth.sin();
            flat * f64::from(elevation).cos() + axis * f64::from(elevation).sin()
        });
        let default_direction = if matches!(lamp.kind, LampKind::Back(_)) { -axis } else { axis };
        let direction = lamp.pose.direction.or(by_angles).unwrap_or(default_direction);
        // The lamp's +z points against the direction in which it shines.
        let back = match (aim, position) {
            (Some(aim), _) => -aim,
            (None, Some(position)) => (position - target).try_normalize().ok_or_else(|| {
                self.light_error(i, "position", "the lamp is at its target", "move it, or write `aim`")
            })?,
            (None, None) => direction,
        };
        let position = position.unwrap_or(target + direction * lamp.pose.distance.unwrap_or(0.0));
        let is_bar = matches!(lamp.kind, LampKind::Bar(_));
        let lamp_up = match &lamp.pose.up {
            Some(up) if up.cross(back).length() < PARALLEL => {
                let problem = "`up` is parallel to the direction in which the lamp shines";
                return Err(self.light_error(i, "up", problem, "write a direction across it"));
            }
            Some(up) => *up,
            // The long side of a bar is perpendicular to the axis.
            None if back.cross(axis).length() > PARALLEL && is_bar => axis,
            None => up,
        };
        let x = lamp_up.cross(back).try_normalize().unwrap_or(back.any_orthonormal_vector());
        let frame = DAffine3 { matrix3: DMat3::from_cols(x, back.cross(x), back), translation: position };
        let count = lamp.count();
        let around = |k: u32| {
            let turn = DQuat::from_axis_angle(axis, std::f64::consts::TAU * f64::from(k) / f64::from(count));
            DAffine3::from_translation(target) * DAffine3::from_quat(turn) * DAffine3::from_translation(-target)
        };
        let to_world = (0..count).map(|k| if k == 0 { frame } else { around(k) * frame }).collect();
        Ok(Poses { to_world, distance: position.distance(target) })
    }

    /// The lamp of an entry with a surface, in its own frame. `distance` \[m\] is that of its target.
    fn mesh_lamp(
        &self,
        (i, lamp): Entry<'_>,
        shape: LampShape,
        duty: f64,
        distance: f64,
    ) -> Result<MeshLamp, InputError> {
        let leds =
            lamp.leds().map(|leds| Leds { columns: leds.columns, rows: leds.rows, diameter: lamp.front.led_diameter });
        if let Some((leds, diameter)) = leds.and_then(|leds| Some((leds, leds.diameter?))) {
            let space = shape.led_space(leds.columns, leds.rows);
            if diameter > space * (1.0 + 1e-9) {
                let problem = format!("LEDs of {} m overlap: they are {} m apart", Number(diameter), Number(space));
                return Err(self.light_error(i, "led_diameter", problem, "write a smaller one, or fewer LEDs"));
            }
        }
        let profile = lamp.profile();
        let meshes = shape.meshes(leds);
        let distance = lamp.working_distance.unwrap_or(distance).max(1e-3 * extent(shape));
        let emission = lamp
            .surface_radiance(&meshes.emitter, &profile, distance)
            .ok_or_else(|| self.no_irradiance(i, distance))?;
        Ok(MeshLamp {
            meshes,
            emission: emission * (duty as f32),
            profile,
            has_body: !matches!(lamp.kind, LampKind::Coaxial(..)) && lamp.front.body != Some(false),
            // Two triangles of a rectangle are sampled by solid angle, which is better.
            is_single_light: leds.is_some() || !matches!(shape, LampShape::Rectangle { .. }),
        })
    }

    /// The error of an irradiance at a distance \[m\] where no light arrives.
    fn no_irradiance(&self, i: usize, distance: f64) -> InputError {
        let problem = format!("no light of the lamp arrives on its axis at {} m", Number(distance));
        let help = "give `power` or `radiance`, or write another `working_distance`";
        self.light_error(i, "irradiance", problem, help)
    }

    /// True if the job makes lamps with a place.
    pub fn has_lamps(&self) -> bool {
        self.lamps().any(|(_, lamp)| !matches!(lamp.kind, LampKind::Sun(_) | LampKind::Environment(_)))
    }

    /// The wavelengths of the channels of the render, from the lamps of the job, and the transmission of the lens at
    /// them.
    ///
    /// # Errors
    /// Two lamps whose different wavelengths need the same channel.
    pub fn bands(&self) -> Result<Bands, InputError> {
        self.bands_behind(&self.lens)
    }

    /// [`Job::bands`] behind the filter of another lens.
    ///
    /// # Errors
    /// As [`Job::bands`].
    pub fn bands_behind(&self, lens: &LensSettings) -> Result<Bands, InputError> {
        let lines = self.lines()?;
        let mut bands = Bands::default();
        for (wavelength, line) in bands.wavelengths.iter_mut().zip(lines) {
            *wavelength = line.unwrap_or(*wavelength);
        }
        if let Some(filter) = &lens.filter {
            bands = bands.through(filter.center, filter.width, filter.transmission, lines.map(|line| line.is_some()));
        }
        Ok(bands)
    }

    /// The wavelengths of the channels that carry light of one wavelength; `None` for the others.
    ///
    /// # Errors
    /// As [`Job::bands`].
    pub fn lines(&self) -> Result<[Option<Nanometres>; 3], InputError> {
        let mut users: [Option<(usize, Nanometres)>; 3] = [None; 3];
        for (i, light) in self.lights.iter().enumerate().filter(|(_, light)| light.is_enabled()) {
            let Some(wavelength) = light.wavelength() else { continue };
            let channel = wavelength.channel();
            match users[channel] {
                Some((other, nm)) if nm != wavelength.0 => {
                    let color = ["red", "green", "blue"][channel];
                    let problem = format!(
                        "{} nm needs the {color} channel of the render, which has {} nm for light {}",
                        Number(wavelength.0.0),
                        Number(nm.0),
                        other + 1
                    );
                    let help = "give both lights the same wavelength, or render them one after the other";
                    return Err(self.light_error(i, "wavelength", problem, help));
                }
                _ => users[channel] = Some((i, wavelength.0)),
            }
        }
        Ok(users.map(|user| user.map(|(_, wavelength)| wavelength)))
    }

    /// The share of the light that the beam splitters of coaxial lamps let pass to a camera. `first` is the name of the
    /// first camera of the scene, to which lamps belong by default; `None` in a scene without cameras.
    pub fn splitter_transmission(&self, camera: &str, first: Option<&str>) -> f64 {
        let default = self.camera.selected.as_deref().or(first);
        let share = |lamp: &Lamp| match lamp.kind {
            LampKind::Coaxial(..) if lamp.common.camera.as_deref().or(default).is_none_or(|name| name == camera) => {
                1.0 - lamp.splitter()
            }
            _ => 1.0,
        };
        self.lamps().map(|(_, lamp)| share(lamp)).product()
    }
}

impl Lamp {
    /// The emitting surface; `None` without extent.
    pub(super) fn surface(&self) -> Option<LampShape> {
        Some(match &self.kind {
            LampKind::Ring(ring) => LampShape::Ring {
                outer_diameter: ring.diameter,
                inner_diameter: ring.inner_diameter.unwrap_or(RING_HOLE * ring.diameter),
                tilt: ring.tilt.unwrap_or(0.0),
            },
            LampKind::Bar(bar) => {
                LampShape::Rectangle { width: bar.width, height: bar.height.unwrap_or(BAR_HEIGHT * bar.width) }
            }
            LampKind::Dome(dome) => {
                LampShape::Dome { diameter: dome.diameter, opening: dome.opening.unwrap_or(DOME_HOLE * dome.diameter) }
            }
            LampKind::Coaxial(size, _) | LampKind::Back(size) | LampKind::Panel(size) => panel(size),
            LampKind::Spot(spot) => LampShape::Ellipse { width: spot.diameter?, height: spot.diameter? },
            LampKind::Point(point) => LampShape::Sphere { diameter: point.diameter? },
            LampKind::Sun(_) | LampKind::Environment(_) => return None,
        })
    }

    /// A light without extent. `distance` \[m\] is that of its irradiance.
    fn without_surface(&self, duty: f64, distance: f64) -> PunctualKind {
        let cone = match &self.kind {
            LampKind::Sun(sun) => return self.sun(sun, duty),
            LampKind::Spot(spot) => Some(cone(spot).map(|angle| angle as f32)),
            _ => None,
        };
        let solid_angle = cone.map_or(4.0 * PI, |[inner, outer]| super::lights::spot_solid_angle(inner, outer));
        let intensity = match self.strength {
            Some(Strength::Intensity(intensity)) => self.in_band(intensity),
            // The inverse square of the distance, on the axis (Lambert 1760).
            Some(Strength::Irradiance(irradiance)) => self.in_band(irradiance) * ((distance * distance) as f32),
            _ => self.of_mean(self.power() / solid_angle),
        } * (duty as f32);
        match cone {
            Some([inner, outer]) => PunctualKind::Spot { intensity, inner, outer },
            None => PunctualKind::Point { intensity },
        }
    }

    fn sun(&self, sun: &Sun, duty: f64) -> PunctualKind {
        let irradiance =
            if let Some(Strength::Irradiance(irradiance)) = self.strength { irradiance } else { Rgb::WHITE };
        let irradiance = self.in_band(irradiance) * (duty as f32);
        let half_angle = (0.5 * sun.angle.unwrap_or(SUN)) as f32;
        if half_angle > 0.0 {
            PunctualKind::Sun { irradiance, half_angle }
        } else {
            PunctualKind::Directional { irradiance }
        }
    }

    fn profile(&self) -> EmissionProfile {
        match (&self.kind, self.front.lens_angle, self.front.spread) {
            (LampKind::Spot(spot), ..) => {
                let [inner, outer] = cone(spot).map(|angle| angle.cos() as f32);
                EmissionProfile::Spot { cos_inner: inner, cos_outer: outer.max(0.0) }
            }
            (_, Some(angle), _) if angle < 0.999 * LAMBERTIAN => {
                EmissionProfile::from_half_intensity_angle(0.5 * angle)
            }
            // A spread of 180 degrees restricts nothing.
            (_, None, Some(angle)) if angle < 0.999 * PI => {
                EmissionProfile::Louver { half_angle: (0.5 * angle) as f32 }
            }
            _ => EmissionProfile::Lambertian,
        }
    }

    /// Radiance along the normal [W/(m^2 sr)]. `distance` \[m\] is that of the irradiance. `None` if the lamp gives no
    /// irradiance there.
    fn surface_radiance(&self, emitter: &Mesh, profile: &EmissionProfile, distance: f64) -> Option<Rgb> {
        Some(match self.strength {
            Some(Strength::Radiance(radiance)) => self.in_band(radiance) * (self.splitter() as f32),
            Some(Strength::Irradiance(irradiance)) => {
                let per_radiance = irradiance_on_axis(emitter, profile, distance);
                return (per_radiance > 0.0).then(|| self.in_band(irradiance) * ((1.0 / per_radiance) as f32));
            }
            // A small disc of radius r with the profile of a spot has the intensity pi r^2 L on its axis.
            Some(Strength::Intensity(intensity)) => {
                let share = if matches!(self.kind, LampKind::Spot(_)) { 1.0 } else { 0.25 };
                self.in_band(intensity) * ((1.0 / (share * area(emitter))) as f32)
            }
            _ => self.of_mean(self.splitter() * self.power() / (PI * area(emitter) * profile.exitance())),
        })
    }

    fn power(&self) -> f64 {
        if let Some(Strength::Power(power)) = self.strength { power } else { DEFAULT_POWER }
    }

    /// Share of the light that goes toward the part.
    fn splitter(&self) -> f64 {
        if let LampKind::Coaxial(_, splitter) = &self.kind { splitter.splitter.unwrap_or(SPLITTER) } else { 1.0 }
    }

    /// A strength of equal channels in the band of the light.
    fn in_band(&self, strength: Rgb) -> Rgb {
        self.common.wavelength.map_or(strength, |wavelength: Wavelength| wavelength.triple(f64::from(strength.mean())))
    }

    /// A strength of a mean over the channels, white or in the band of the light.
    fn of_mean(&self, mean: f64) -> Rgb {
        self.in_band(Rgb::splat(mean as f32))
    }
}

fn panel(size: &PanelSize) -> LampShape {
    match (size.diameter, size.width.unwrap_or(0.0)) {
        (Some(diameter), _) => LampShape::Ellipse { width: diameter, height: size.height.unwrap_or(diameter) },
        (None, width) => LampShape::Rectangle { width, height: size.height.unwrap_or(width) },
    }
}

/// Half-angles of the full cone and of the edge of a spot \[rad\].
fn cone(spot: &Spot) -> [f64; 2] {
    let outer = 0.5 * spot.cone_angle.unwrap_or(PI / 4.0);
    // The share `blend` of the cone, counted in cosines, is the edge.
    let inner = 1.0 - (1.0 - outer.cos()) * (1.0 - f64::from(spot.blend.unwrap_or(0.15)));
    [inner.clamp(-1.0, 1.0).acos(), outer]
}

/// The largest extent of a lamp \[m\].
fn extent(shape: LampShape) -> f64 {
    match shape {
        LampShape::Rectangle { width, height } | LampShape::Ellipse { width, height } => width.max(height),
        LampShape::Ring { outer_diameter: diameter, .. }
        | LampShape::Dome { diameter, .. }
        | LampShape::Sphere { diameter } => diameter,
    }
}

/// A lamp with a surface, in its own frame.
struct MeshLamp {
    meshes: LampMeshes,
    /// Radiance along the normal [W/(m^2 sr)].
    emission: Rgb,
    profile: EmissionProfile,
    has_body: bool,
    is_single_light: bool,
}

impl MeshLamp {
    /// Adds the lamp at a pose to the scene.
    fn add(&self, name: String, to_world: DAffine3, scene: &mut SceneBuilder) {
        let material = scene.add_material(Material {
            name: name.clone(),
            base_color: Rgb::splat(if self.has_body { BLACK } else { 0.0 }).into(),
            specular: Specular::NONE,
            roughness: 1.0.into(),
            emission: self.emission.into(),
            emission_profile: self.profile,
            alpha_mode: if self.has_body { AlphaMode::Opaque } else { AlphaMode::FrontOnly },
            ..Material::default()
        });
        let mesh = self.meshes.emitter.clone().into();
        let mut parts = vec![MeshPart {
            name: name.clone(),
            mesh,
            material,
            is_single_light: self.is_single_light,
            ..MeshPart::default()
        }];
        if !self.meshes.plate.triangles.is_empty() && self.has_body {
            let name = format!("{name} plate");
            let material = scene.add_material(Material {
                name: name.clone(),
                base_color: Rgb::splat(BLACK).into(),
                roughness: 0.5.into(),
                ..Material::default()
            });
            parts.push(MeshPart { name, mesh: self.meshes.plate.clone().into(), material, ..MeshPart::default() });
        }
        let first = scene.meshes.len();
        let meshes = (first..first + parts.len()).collect();
        scene.meshes.extend(parts);
        scene.instances.push(Instance { name, meshes, to_world, motion: Default::default() });
    }
}

/// The middle of all objects, without lamps that were added before.
fn scene_center(scene: &SceneBuilder) -> Option<DVec3> {
    let emits = |mesh: &MeshPart| scene.materials.get(mesh.material).is_some_and(|m| !m.emission.factor.is_black());
    let is_lamp = |n: &&Instance| n.meshes.iter().filter_map(|m| scene.meshes.get(*m)).any(emits);
    let bounds = |n: &Instance| scene.bounds_of(n);
    let parts = scene.instances.iter().filter(|n| !is_lamp(n)).filter_map(bounds);
    let all = parts.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
    all.or_else(|| scene.instances.iter().filter_map(bounds).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]))
        .map(|[low, high]| 0.5 * (low + high))
}

#[cfg(test)]
#[path = "lamps_tests.rs"]
mod tests;
