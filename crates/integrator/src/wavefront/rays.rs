//! Rays of a wave, and their results.

use dunkelfeld_bvh::{Hit, HitBatch, NO_HIT, RayBatch};
use dunkelfeld_geometry::Ray;
use dunkelfeld_lanes::{Lanes, V3};
use dunkelfeld_radiometry::Rgb;

/// Rays, an array for each number.
#[derive(Debug, Default)]
pub(super) struct Rays {
    origin: [Vec<f32>; 3],
    direction: [Vec<f32>; 3],
    t_max: Vec<f32>,
    /// Empty for a scene at rest.
    time: Vec<f32>,
}

impl Rays {
    pub(super) fn clear(&mut self) {
        let Self { origin, direction, t_max, time } = self;
        origin.iter_mut().chain(direction).chain([t_max, time]).for_each(Vec::clear);
    }

    #[inline]
    pub(super) fn push(&mut self, ray: &Ray, moves: bool) {
        for k in 0..3 {
            self.origin[k].push(ray.origin[k]);
            self.direction[k].push(ray.direction[k]);
        }
        self.t_max.push(ray.t_max);
        if moves {
            self.time.push(ray.time);
        }
    }

    /// Stores the rays of some lanes.
    #[inline(always)]
    pub(super) fn append<F: Lanes>(&mut self, lanes: F::Mask, origin: V3<F>, direction: V3<F>, t_max: F) {
        let ([ox, oy, oz], [dx, dy, dz]) = (&mut self.origin, &mut self.direction);
        origin.x.append(lanes, ox);
        origin.y.append(lanes, oy);
        origin.z.append(lanes, oz);
        direction.x.append(lanes, dx);
        direction.y.append(lanes, dy);
        direction.z.append(lanes, dz);
        t_max.append(lanes, &mut self.t_max);
    }

    /// Stores the time of a ray in a scene that moves.
    #[inline]
    pub(super) fn push_time(&mut self, time: f32) {
        self.time.push(time);
    }

    pub(super) fn batch(&self) -> RayBatch<'_> {
        RayBatch {
            origin: self.origin.each_ref().map(Vec::as_slice),
            direction: self.direction.each_ref().map(Vec::as_slice),
            t_max: &self.t_max,
            time: &self.time,
        }
    }
}

/// The nearest hits of rays.
#[derive(Debug, Default)]
pub(super) struct Hits {
    /// Ray parameters and barycentric weights.
    numbers: [Vec<f32>; 3],
    /// Instances, parts, triangles.
    ids: [Vec<u32>; 3],
}

impl Hits {
    pub(super) fn batch(&mut self, len: usize) -> HitBatch<'_> {
        self.numbers.iter_mut().for_each(|v| v.resize(len, 0.0));
        self.ids.iter_mut().for_each(|v| v.resize(len, 0));
        let ([t, b1, b2], [instance, part, triangle]) = (&mut self.numbers, &mut self.ids);
        HitBatch { t, b1, b2, instance, part, triangle }
    }

    #[inline]
    pub(super) fn get(&self, i: usize) -> Option<Hit> {
        let ([t, b1, b2], [instance, part, triangle]) = (&self.numbers, &self.ids);
        (instance[i] != NO_HIT).then(|| Hit {
            t: t[i],
            b1: b1[i],
            b2: b2[i],
            instance: instance[i],
            part: part[i],
            triangle: triangle[i],
        })
    }
}

/// Shadow rays to one light, with the light that they carry.
#[derive(Debug, Default)]
pub(super) struct ShadowRays {
    pub(super) rays: Rays,
    pub(super) paths: Vec<u32>,
    /// Radiance of the pixel if the ray is not occluded [W/(m^2 sr)], by channel.
    pub(super) light: [Vec<f32>; 3],
    /// Paths with light of connections to the same light samples.
    pub(super) connected: Vec<(u32, Rgb)>,
}

impl ShadowRays {
    pub(super) fn clear(&mut self) {
        self.rays.clear();
        self.paths.clear();
        self.connected.clear();
        self.light.iter_mut().for_each(Vec::clear);
    }

    /// The light of a ray.
    #[inline]
    pub(super) fn light(&self, i: usize) -> Rgb {
        let [r, g, b] = &self.light;
        Rgb::new(r[i], g[i], b[i])
    }
}
