//! Rays of a wave, and their results.

use crate::observer::TraceConnection;
use dunkelfeld_bvh::{Hit, HitBatch, NO_HIT, RayBatch};
use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{HitLanes, Scene};

/// Rays, an array for each number.
#[derive(Debug, Default)]
pub(crate) struct Rays {
    origin: [Vec<f32>; 3],
    direction: [Vec<f32>; 3],
    t_max: Vec<f32>,
    /// Does the scene move? Else times are not stored.
    moves: bool,
    time: Vec<f32>,
    /// Number of the path of each ray.
    pub(crate) paths: Vec<u32>,
}

impl Rays {
    pub(crate) fn new(scene: &Scene) -> Self {
        Self { moves: scene.shutter().is_some(), ..Self::default() }
    }

    pub(crate) fn clear(&mut self) {
        let Self { origin, direction, t_max, time, paths, .. } = self;
        origin.iter_mut().chain(direction).chain([t_max, time]).for_each(Vec::clear);
        paths.clear();
    }

    #[inline]
    pub(crate) fn push(&mut self, ray: &Ray, path: u32) {
        for k in 0..3 {
            self.origin[k].push(ray.origin[k]);
            self.direction[k].push(ray.direction[k]);
        }
        self.t_max.push(ray.t_max);
        if self.moves {
            self.time.push(ray.time);
        }
        self.paths.push(path);
    }

    /// A ray by its number.
    #[inline]
    pub(crate) fn get(&self, ray: usize) -> Ray {
        let vector = |v: &[Vec<f32>; 3]| Vec3::new(v[0][ray], v[1][ray], v[2][ray]);
        let time = self.time.get(ray).copied().unwrap_or(0.0);
        Ray { origin: vector(&self.origin), direction: vector(&self.direction), t_max: self.t_max[ray], time }
    }

    /// The directions of some rays.
    #[inline(always)]
    pub(super) fn directions<F: Lanes>(&self, token: F::Token, rays: &[u32; MAX_WIDTH]) -> V3<F> {
        let [x, y, z] = &self.direction;
        V3::new(F::gather(token, x, rays), F::gather(token, y, rays), F::gather(token, z, rays))
    }

    /// The times of some rays \[s\].
    #[inline(always)]
    pub(super) fn times<F: Lanes>(&self, token: F::Token, rays: &[u32; MAX_WIDTH]) -> F {
        if self.time.is_empty() { F::splat(token, 0.0) } else { F::gather(token, &self.time, rays) }
    }

    /// Stores the rays of some lanes, with those of their paths.
    #[inline(always)]
    pub(crate) fn append<F: Lanes>(
        &mut self,
        (lanes, paths): (F::Mask, &[u32; MAX_WIDTH]),
        [origin, direction]: [V3<F>; 2],
        t_max: F,
        time: F,
    ) {
        let ([ox, oy, oz], [dx, dy, dz]) = (&mut self.origin, &mut self.direction);
        origin.x.append(lanes, ox);
        origin.y.append(lanes, oy);
        origin.z.append(lanes, oz);
        direction.x.append(lanes, dx);
        direction.y.append(lanes, dy);
        direction.z.append(lanes, dz);
        t_max.append(lanes, &mut self.t_max);
        if self.moves {
            time.append(lanes, &mut self.time);
        }
        for lane in lanes.lanes() {
            self.paths.push(paths[lane]);
        }
    }

    pub(crate) fn batch(&self) -> RayBatch<'_> {
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
pub(crate) struct Hits {
    /// Ray parameters and barycentric weights.
    numbers: [Vec<f32>; 3],
    /// Instances, parts, triangles.
    ids: [Vec<u32>; 3],
}

impl Hits {
    pub(crate) fn batch(&mut self, len: usize) -> HitBatch<'_> {
        self.numbers.iter_mut().for_each(|v| v.resize(len, 0.0));
        self.ids.iter_mut().for_each(|v| v.resize(len, 0));
        let ([t, b1, b2], [instance, part, triangle]) = (&mut self.numbers, &mut self.ids);
        HitBatch { t, b1, b2, instance, part, triangle }
    }

    /// Has a ray hit something?
    #[inline(always)]
    pub(crate) fn has(&self, ray: u32) -> bool {
        self.ids[0][ray as usize] != NO_HIT
    }

    /// The hits of some rays, which all have one.
    #[inline(always)]
    pub(crate) fn lanes<F: Lanes>(&self, token: F::Token, rays: &[u32; MAX_WIDTH]) -> HitLanes<F> {
        let ([t, b1, b2], mut ids) = (&self.numbers, [[0; MAX_WIDTH]; 3]);
        for lane in 0..F::WIDTH {
            let ray = rays[lane] as usize;
            [ids[0][lane], ids[1][lane], ids[2][lane]] = [self.ids[0][ray], self.ids[1][ray], self.ids[2][ray]];
        }
        HitLanes {
            t: F::gather(token, t, rays),
            b1: F::gather(token, b1, rays),
            b2: F::gather(token, b2, rays),
            instance: F::load_word(token, &ids[0]),
            part: F::load_word(token, &ids[1]),
            triangle: F::load_word(token, &ids[2]),
        }
    }

    #[inline]
    pub(crate) fn get(&self, i: usize) -> Option<Hit> {
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

/// Shadow rays of lanes.
pub(super) struct Queued<F: Lanes> {
    pub(super) lanes: F::Mask,
    pub(super) origin: V3<F>,
    pub(super) direction: V3<F>,
    pub(super) t_max: F,
    /// Radiance of the pixel if the ray is not occluded [W/(m^2 sr)].
    pub(super) light: Rgb<F>,
}

/// Shadow rays to one light, with the light that they carry.
#[derive(Debug, Default)]
pub(super) struct ShadowRays {
    pub(super) rays: Rays,
    /// Radiance of the pixel if the ray is not occluded [W/(m^2 sr)], by channel.
    pub(super) light: [Vec<f32>; 3],
    /// The groups of the lights, if the light of groups is found.
    pub(super) groups: Vec<u8>,
    /// The connections of rays behind covers, where they are observed.
    pub(super) connections: Vec<TraceConnection>,
}

impl ShadowRays {
    pub(super) fn clear(&mut self) {
        self.rays.clear();
        self.connections.clear();
        self.groups.clear();
        self.light.iter_mut().for_each(Vec::clear);
    }

    /// Stores the rays of lanes.
    #[inline(always)]
    pub(super) fn append<F: Lanes>(&mut self, q: &Queued<F>, time: F, paths: &[u32; MAX_WIDTH]) {
        self.rays.append((q.lanes, paths), [q.origin, q.direction], q.t_max, time);
        let [r, g, b] = &mut self.light;
        q.light.r.append(q.lanes, r);
        q.light.g.append(q.lanes, g);
        q.light.b.append(q.lanes, b);
    }

    /// Stores the groups of the lights of rays that were appended in some lanes.
    #[inline(always)]
    pub(super) fn append_groups<F: Lanes>(&mut self, lanes: F::Mask, of_lanes: &[u8; MAX_WIDTH]) {
        for lane in lanes.lanes() {
            self.groups.push(of_lanes[lane]);
        }
    }

    /// The light of a ray.
    #[inline]
    pub(super) fn light(&self, i: usize) -> Rgb {
        let [r, g, b] = &self.light;
        Rgb::new(r[i], g[i], b[i])
    }
}
