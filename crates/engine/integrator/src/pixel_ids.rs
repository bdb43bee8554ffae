//! Ids of a pixel: object and material of the first surface behind the centre of the pixel that scatters light; and all
//! surfaces that the ray of a pixel meets.

use crate::ray_state::{RayState, SurfaceHit};
use crate::wavefront::rays::{Hits, Rays};
use dunkelfeld_geometry::{LocalDir, Ray, Vec3};
use dunkelfeld_lanes::InstructionSet;
use dunkelfeld_scene::{Moment, RayGenerator, Scene, SurfacePoint};
use std::num::NonZeroU32;
use std::ops::ControlFlow;

/// Object and material at the centre of a pixel. An `Option` of it takes 8 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelIds {
    /// Index of the object plus one.
    object: NonZeroU32,
    material: u32,
}

impl PixelIds {
    /// From indices counted from 0. The index of the object is below `u32::MAX`.
    pub fn new(object: u32, material: u32) -> Self {
        Self { object: NonZeroU32::MIN.saturating_add(object), material }
    }

    /// Index of the object in the scene, counted from 0.
    pub fn object(&self) -> u32 {
        self.object.get() - 1
    }

    /// Index of the material.
    pub fn material(&self) -> u32 {
        self.material
    }
}

/// The way of a ray behind a surface that it meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passage {
    /// The surface covers less than half there, or bends no light: the ray goes straight on.
    Open,
    /// The surface is smooth and clear: the ray goes on in the direction that carries more light.
    Clear,
    /// The surface scatters light. The ray goes straight on, as if all surfaces from here on were absent.
    Scattering,
}

/// A surface that the ray of a pixel meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Object and material of the surface.
    pub ids: PixelIds,
    /// The way of the ray behind it.
    pub passage: Passage,
    /// Share of the light that the surface covers there (alpha), in \[0, 1\].
    pub coverage: f32,
    /// The point on the surface \[m\], render space ([`Scene::world_origin`] is its origin in the world).
    pub point: Vec3,
    /// Unit geometric normal of the surface, world axes.
    pub normal: Vec3,
    /// Unit direction of the ray that meets it, world axes.
    pub direction: Vec3,
    /// Unit direction of the ray behind it, world axes. It differs from `direction` only for [`Passage::Clear`].
    pub onward: Vec3,
}

/// A surface of low coverage that a ray has passed.
struct Passed {
    /// The ray behind it.
    beyond: RayState,
    surface: SurfacePoint,
    /// The last of the surfaces in contact with it that was visited.
    last: Option<SurfacePoint>,
}

/// Upper bound on the cost of a hostile file. No real scene has so many sheets behind one another.
const MAX_CROSSINGS: u32 = 10_000;

/// The ids of pixel (x, y), or `None` if no surface lies behind its centre. The ray passes a surface whose coverage is
/// below one half. It also passes a smooth clear surface, in the direction that carries more light. The ids of the
/// first such clear surface are returned if no other surface lies behind it. Moving objects are at the middle of the
/// exposure.
pub fn pixel_ids(scene: &Scene, camera: &RayGenerator, x: u32, y: u32) -> Option<PixelIds> {
    let (mut first_clear, mut found) = (None, None);
    let _ = crossings(scene, camera, [x, y], [0.5; 2], |crossing| match crossing.passage {
        Passage::Open => ControlFlow::Continue(()),
        Passage::Clear => {
            first_clear = first_clear.or(Some(crossing.ids));
            ControlFlow::Continue(())
        }
        Passage::Scattering => {
            found = Some(crossing.ids);
            ControlFlow::Break(())
        }
    });
    found.or(first_clear)
}

/// [`pixel_ids`] of the pixels of a row, from its left end.
pub fn pixel_ids_of_row(scene: &Scene, camera: &RayGenerator, y: u32, row: &mut [Option<PixelIds>]) {
    let (mut rays, mut hits) = (Rays::new(scene), Hits::default());
    for x in 0..row.len() as u32 {
        rays.push(&pixel_ray(scene, camera, [x, y], [0.5; 2]), x);
    }
    scene.bvh().closest_hits(InstructionSet::best(), &rays.batch(), &mut hits.batch(row.len()));
    for (x, ids) in row.iter_mut().enumerate() {
        *ids = hits.get(x).and_then(|hit| {
            // Behind an opaque surface nothing is seen.
            let material = scene.material_of(hit.instance, hit.part, hit.triangle);
            if scene.has_media() || !scene.is_opaque(material) {
                return pixel_ids(scene, camera, x as u32, y);
            }
            let (object, material) = scene.ids(&scene.surface_point(&hit, rays.get(x).time));
            Some(PixelIds::new(object, material))
        });
    }
}

/// The ray through a place of a pixel, in the middle of the exposure.
fn pixel_ray(scene: &Scene, camera: &RayGenerator, [x, row]: [u32; 2], place: [f32; 2]) -> Ray {
    let middle = Moment { time: 0.0, y: row as f32 + 0.5 };
    let Moment { time, y } = scene.shutter().map_or(middle, |shutter| shutter.middle(row));
    camera.ray(x as f32 + place[0], y + (place[1] - 0.5)).at_time(time)
}

/// Calls `visit` for the surfaces that the ray through a place of a pixel meets, in order, until it breaks or no surface is
/// left. `place` is the place in the pixel, from its top left corner, in \[0, 1); (0.5, 0.5) is its centre. The ray passes
/// open and clear surfaces as in [`pixel_ids`]. Behind the first surface that scatters, it goes straight on through all
/// surfaces, which are then reported as [`Passage::Scattering`]. Moving objects are at the middle of the exposure.
pub fn crossings(
    scene: &Scene,
    camera: &RayGenerator,
    pixel: [u32; 2],
    place: [f32; 2],
    mut visit: impl FnMut(&Crossing) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let mut ray_state = RayState::from_camera(scene, pixel_ray(scene, camera, pixel, place));
    let mut is_behind = false;
    let mut passed: Option<Passed> = None;
    for _ in 0..MAX_CROSSINGS {
        let mut interface = None;
        // The surfaces in contact with one that was passed, then those behind it.
        let coincident = passed.as_ref().and_then(|p| scene.next_coincident(&ray_state.ray, p.surface, p.last));
        let hit = match (coincident, passed.take()) {
            (Some(point), Some(before)) => {
                passed = Some(Passed { last: Some(point), ..before });
                ray_state.hit_at(scene, point, &mut interface)
            }
            (_, before) => {
                ray_state = before.map_or(ray_state, |before| before.beyond);
                let Some(point) = scene.intersect(&ray_state.ray) else { break };
                ray_state.hit_at(scene, point, &mut interface)
            }
        };
        let (object, material) = scene.ids(&hit.surface);
        let ids = PixelIds::new(object, material);
        let coverage = scene.coverage(&hit.surface, ray_state.ray.direction);
        let SurfacePoint { point, normal, .. } = hit.surface;
        let direction = ray_state.ray.direction;
        let at = |passage| Crossing { ids, passage, coverage, point, normal, direction, onward: direction };
        let is_open = hit.open_tint().is_some() || coverage < 0.5;
        if is_behind || is_open {
            visit(&at(if is_behind { Passage::Scattering } else { Passage::Open }))?;
            let beyond = ray_state.pass_through(&hit);
            if is_behind || hit.open_tint().is_some() {
                (ray_state, passed) = (beyond, None);
            } else if passed.is_none() {
                passed = Some(Passed { beyond, surface: hit.surface, last: None });
            }
            continue;
        }
        passed = None;
        let straight = ray_state.pass_through(&hit);
        let (scattering, clear) = (at(Passage::Scattering), at(Passage::Clear));
        ray_state = match beyond_clear(scene, &ray_state, &hit) {
            Some(beyond) => {
                visit(&Crossing { onward: beyond.ray.direction, ..clear })?;
                beyond
            }
            None => {
                visit(&scattering)?;
                is_behind = true;
                straight
            }
        };
    }
    ControlFlow::Continue(())
}

/// The ray behind a smooth surface, in the direction that carries more light. `None` at other surfaces, and if light would
/// also be reflected by the opposite facet ([`ShadingFrames::image`](dunkelfeld_scene::ShadingFrames::image)).
fn beyond_clear(scene: &Scene, ray_state: &RayState, hit: &SurfaceHit<'_>) -> Option<RayState> {
    let (surface, wo, mut storage) = (&hit.surface, -ray_state.ray.direction, None);
    let eta = hit.interface.and_then(|interface| interface.relative_index());
    let bsdf = scene.bsdf(surface, 0.5, eta, &mut storage);
    if !bsdf.is_delta() {
        return None;
    }
    let frames = scene.shade_lanes::<f32>(surface.material(), &surface.into(), wo.into()).frames;
    let sample = bsdf.sample(LocalDir(frames.frame.to_local(wo.into()).into()), 0.5, [0.0; 2])?;
    let local = sample.wi.0.into();
    let wi = frames.frame.to_world(local);
    let is_possible = sample.pdf > 0.0 && frames.consistent(wi, local);
    is_possible.then(|| ray_state.spawn_ray(scene, hit, wi.into()))
}
