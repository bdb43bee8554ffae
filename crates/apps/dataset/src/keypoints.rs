//! Key points in an image: their places on the film, and whether they are visible through clear covers.

use crate::label_entry::KeyPoint;
use dunkelfeld_geometry::{DAffine3, DVec3};
use dunkelfeld_integrator::{Passage, crossings};
use dunkelfeld_scene::{RayGenerator, Scene};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// A point this far under the surface of its own object is visible, as a share of the diagonal of the object.
const OWN_DEPTH: f64 = 2e-3;
/// Bound on the rounding of points on surfaces, as a share of their coordinates.
const ROUNDING: f64 = 1e-5;
/// Steps toward the place of a point behind clear surfaces.
const STEPS: u32 = 20;
/// Distance \[pixels\] at which that place is found.
const FOUND: f64 = 0.01;
/// Share of the film beside its edges where a clear surface may bend a point into the film.
const MARGIN: f64 = 0.1;

/// The key points of an instance in an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct InstancePoints {
    /// Id of the instance.
    pub(crate) instance: u16,
    /// Name of the object.
    pub(crate) name: String,
    pub(crate) points: Vec<FilmPoint>,
}

impl InstancePoints {
    /// x, y and v of each point, as COCO has them.
    pub(crate) fn coco(&self) -> Vec<f64> {
        self.points.iter().flat_map(|point| [point.x, point.y, f64::from(point.v)]).collect()
    }

    /// Number of points in the film.
    pub(crate) fn in_film(&self) -> u32 {
        self.points.iter().map(|point| u32::from(point.v > 0)).sum()
    }
}

/// A key point in an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FilmPoint {
    pub(crate) name: String,
    /// Distance from the left edge of the image \[pixels\]; 0 outside of the film.
    pub(crate) x: f64,
    /// Distance from the upper edge \[pixels\]; 0 outside of the film.
    pub(crate) y: f64,
    /// 0 outside of the film, 1 hidden, 2 visible.
    pub(crate) v: u8,
}

/// An object with key points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PointObject {
    /// Index of the object in the scene.
    pub(crate) index: u32,
    /// From the frame of the key points to the world, in the middle of the exposure.
    pub(crate) to_world: DAffine3,
    /// Diagonal of the bounds of the object \[m\].
    pub(crate) diagonal: f64,
}

/// The key points of an object on a film of `size` pixels.
///
/// A point is where the camera images it, with the errors of the lens. Behind clear surfaces that is where the bent ray of
/// the camera meets it, as for the pixels of labels. A hidden point is where it would be without the surfaces that scatter.
pub(crate) fn film_points(
    scene: &Scene,
    rays: &RayGenerator,
    size: [u32; 2],
    object: &PointObject,
    points: &[KeyPoint],
) -> Vec<FilmPoint> {
    let film = Film { scene, rays, size, object: *object };
    let outside = |point: &KeyPoint| FilmPoint { name: point.name.clone(), x: 0.0, y: 0.0, v: 0 };
    let of_point = |point: &KeyPoint| {
        let ([x, y], is_visible) = film.point(point.position())?;
        let is_inside = (0.0..f64::from(size[0])).contains(&x) && (0.0..f64::from(size[1])).contains(&y);
        is_inside.then(|| FilmPoint { x, y, v: if is_visible { 2 } else { 1 }, ..outside(point) })
    };
    points.iter().map(|point| of_point(point).unwrap_or_else(|| outside(point))).collect()
}

/// The end of a ray near a point.
struct Sight {
    /// The place on the ray nearest to the point \[m\], render space; `None` if a mirror sends the ray elsewhere.
    nearest: Option<DVec3>,
    /// A surface that scatters, or a mirror, is in front of the point.
    is_hidden: bool,
    is_bent: bool,
}

struct Film<'a> {
    scene: &'a Scene,
    rays: &'a RayGenerator,
    size: [u32; 2],
    object: PointObject,
}

impl Film<'_> {
    /// The place of a point of the object, and whether it is visible. `None` if the camera does not image it.
    fn point(&self, local: DVec3) -> Option<([f64; 2], bool)> {
        let straight = self.place(local, DVec3::ZERO)?;
        let is_near = |at: [f64; 2]| {
            (at.iter().zip(self.size)).all(|(v, size)| (-MARGIN..=1.0 + MARGIN).contains(&(v / f64::from(size))))
        };
        if !is_near(straight) {
            return None;
        }
        let first = self.sight(straight, local);
        if !first.is_bent {
            return Some((straight, !first.is_hidden));
        }
        // The bent ray through the image of a virtual point shall meet the point. The virtual point is moved by the miss.
        let (mut offset, mut place, mut sight) = (DVec3::ZERO, straight, Sight { ..first });
        for _ in 0..STEPS {
            let Some(nearest) = sight.nearest else { break };
            let miss = self.at(local) - nearest;
            let seen = self.place(local, -miss)?;
            if (seen[0] - straight[0]).hypot(seen[1] - straight[1]) < FOUND {
                return Some((place, !sight.is_hidden));
            }
            offset += miss;
            match self.place(local, offset).filter(|place| is_near(*place)) {
                Some(next) => place = next,
                None => break,
            }
            sight = self.sight(place, local);
        }
        // No ray was found that meets the point, as behind a strong lens.
        Some((straight, false))
    }

    /// The place of a point, moved by an offset in the world, without clear surfaces.
    fn place(&self, local: DVec3, offset: DVec3) -> Option<[f64; 2]> {
        self.rays.project(self.scene.world_origin() + self.at(local) + offset)
    }

    /// A point of the object \[m\], render space.
    fn at(&self, local: DVec3) -> DVec3 {
        self.object.to_world.transform_point3(local) - self.scene.world_origin()
    }

    fn pixel(&self, place: [f64; 2]) -> [u32; 2] {
        [0, 1].map(|k| (place[k].max(0.0) as u32).min(self.size[k].saturating_sub(1)))
    }

    /// The ray of a place of the film, up to a point of the object.
    fn sight(&self, place: [f64; 2], local: DVec3) -> Sight {
        let pixel = self.pixel(place);
        let point = self.at(local);
        let Self { scene, rays, object, .. } = *self;
        let rounding = ROUNDING * point.abs().max_element().max(object.diagonal);
        let mut sight = Sight { nearest: None, is_hidden: false, is_bent: false };
        let (mut is_done, mut last) = (false, None);
        let within = [0, 1].map(|k| (place[k] - f64::from(pixel[k])) as f32);
        let _ = crossings(scene, rays, pixel, within, |crossing| {
            let (from, direction) = (crossing.point.as_dvec3(), crossing.direction.as_dvec3());
            let ahead = (point - from).dot(direction);
            let is_own = crossing.ids.object() == object.index;
            let depth = if is_own { OWN_DEPTH * object.diagonal } else { 0.0 };
            if ahead <= depth.max(rounding) {
                sight.nearest = Some(from + ahead * direction);
                is_done = true;
                return ControlFlow::Break(());
            }
            let onward = crossing.onward.as_dvec3();
            match crossing.passage {
                Passage::Open => {}
                Passage::Scattering => sight.is_hidden = true,
                Passage::Clear => {
                    let normal = crossing.normal.as_dvec3();
                    if (direction.dot(normal) > 0.0) != (onward.dot(normal) > 0.0) {
                        (sight.is_hidden, is_done) = (true, true);
                        return ControlFlow::Break(());
                    }
                    sight.is_bent = true;
                }
            }
            last = Some((from, onward));
            ControlFlow::Continue(())
        });
        if let (false, Some((from, direction))) = (is_done, last) {
            sight.nearest = Some(from + (point - from).dot(direction) * direction);
        }
        sight
    }
}

#[cfg(test)]
#[path = "keypoint_tests.rs"]
mod tests;
