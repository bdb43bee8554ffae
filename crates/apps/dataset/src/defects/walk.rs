//! Steps along a surface, and curves that follow it.

use super::draw::Harmonics;
use super::surface::{LocalSurface, SurfaceHit};
use dunkelfeld_geometry::{DQuat, DVec3};

/// Smallest cosine between the normals at both ends of a step. A sharper edge ends the walk.
const LEAST_COSINE: f64 = 0.7;

/// A point of a curve on the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Footing {
    /// The point of the surface.
    pub(super) hit: SurfaceHit,
    /// Unit direction of the curve, at right angles to the normal.
    pub(super) along: DVec3,
}

impl Footing {
    /// The unit vector to the left of the curve, in the tangent plane.
    pub(super) fn left(&self) -> DVec3 {
        self.hit.normal.cross(self.along)
    }

    /// The point of the surface at the distance `offset` \[m\] to the left. `None` beyond the surface or an edge.
    pub(super) fn beside(&self, surface: &LocalSurface<'_>, offset: f64) -> Option<SurfaceHit> {
        let reach = offset.abs().max(f64::MIN_POSITIVE);
        let hit = surface.project(self.hit.point + self.left() * offset, self.hit.normal, reach)?;
        (hit.normal.dot(self.hit.normal) >= LEAST_COSINE).then_some(hit)
    }

    /// The curve after a turn by `turn` \[rad\], counter-clockwise from outside, and a step of `distance` \[m\].
    pub(super) fn step(&self, surface: &LocalSurface<'_>, distance: f64, turn: f64) -> Option<Self> {
        let along = DQuat::from_axis_angle(self.hit.normal, turn) * self.along;
        let hit = surface.project(self.hit.point + along * distance, self.hit.normal, distance)?;
        if hit.normal.dot(self.hit.normal) < LEAST_COSINE {
            return None;
        }
        let along = (along - hit.normal * along.dot(hit.normal)).try_normalize()?;
        Some(Self { hit, along })
    }
}

/// The reference direction of angles at a point with this normal: the world's +x projected on the tangent plane, or +z
/// if the normal is within 18 degrees of the x axis.
pub(super) fn reference(normal: DVec3) -> DVec3 {
    let axis = if normal.x.abs() > 0.95 { DVec3::Z } else { DVec3::X };
    (axis - normal * axis.dot(normal)).try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector())
}

/// The reference direction, turned by `angle` \[rad\] counter-clockwise from outside.
pub(super) fn tangent_at(normal: DVec3, angle: f64) -> DVec3 {
    let x = reference(normal);
    let (sin, cos) = angle.sin_cos();
    x * cos + normal.cross(x) * sin
}

/// A curve on the surface. Its middle is the given point.
pub(super) struct Course<'a> {
    /// Length \[m\].
    pub(super) length: f64,
    /// Number of steps of each half.
    pub(super) steps: usize,
    /// Angle of the direction in the middle \[rad\].
    pub(super) angle: f64,
    /// Total turn \[rad\].
    pub(super) curvature: f64,
    /// Further changes of the direction \[rad\], over the length.
    pub(super) wander: &'a Harmonics,
}

impl Course<'_> {
    /// The points of the curve from its start to its end. `None` if it leaves the surface or meets a sharp edge.
    pub(super) fn on(&self, surface: &LocalSurface<'_>, middle: SurfaceHit) -> Option<Vec<Footing>> {
        let step = self.length / (2 * self.steps) as f64;
        let heading = |k: i32| {
            let share = f64::from(k) * step / self.length;
            self.curvature * share + self.wander.at(0.5 + share) - self.wander.at(0.5)
        };
        let forward = tangent_at(middle.normal, self.angle);
        let half = |sign: i32| {
            let mut foot = Footing { hit: middle, along: forward * f64::from(sign) };
            let mut feet = Vec::with_capacity(self.steps);
            for k in 0..self.steps as i32 {
                foot = foot.step(surface, step, heading(sign * (k + 1)) - heading(sign * k))?;
                feet.push(foot);
            }
            Some(feet)
        };
        // The first half is walked backward from the middle.
        let back = half(-1)?.into_iter().rev().map(|f| Footing { along: -f.along, ..f });
        let middle = Footing { hit: middle, along: forward };
        Some(back.chain([middle]).chain(half(1)?).collect())
    }
}
