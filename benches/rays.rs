//! Rays per second on one thread: closest hit and any hit, coherent and diffuse, in rooms of 12, 60 k and 1 M triangles.
//!
//! `cargo bench -p dunkelfeld --bench rays`; the throughput that criterion prints is rays per second.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dunkelfeld_bvh::{Bvh, BvhInstance, Hit, MeshTriangles};
use dunkelfeld_geometry::{Ray, Vec3, geometric_normal, hit_point, offset_ray_origin};

/// Rays per measurement: enough that they and what they touch do not stay in the first-level cache.
const RAYS: usize = 1 << 15;

/// A linear congruential generator (Knuth's MMIX constants), so that a bench needs no dependency for its numbers.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / 16_777_216.0
    }

    fn direction(&mut self) -> Vec3 {
        let z = 2.0 * self.unit() - 1.0;
        let (sin, cos) = (std::f32::consts::TAU * self.unit()).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * cos, r * sin, z).normalize()
    }
}

struct Room {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    bvh: Bvh,
}

impl Room {
    /// A closed room of 12 triangles around a bumpy torus of `2 around * across`.
    fn new(around: usize, across: usize) -> Self {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for i in 0..around {
            for j in 0..across {
                let a = std::f32::consts::TAU * i as f32 / around as f32;
                let b = std::f32::consts::TAU * j as f32 / across as f32;
                let r = 0.35 + 0.05 * (7.0 * a).sin() * (5.0 * b).cos() + 0.004 * (91.0 * a + 31.0 * b).sin();
                let ring = 1.0 + r * b.cos();
                positions.push(Vec3::new(ring * a.cos(), ring * a.sin(), r * b.sin()));
                let at = |i: usize, j: usize| ((i % around) * across + j % across) as u32;
                triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        let base = positions.len() as u32;
        positions.extend((0..8).map(|i| {
            let side = |bit: u32| if i & bit == 0 { -2.0 } else { 2.0 };
            Vec3::new(side(1), side(2), side(4))
        }));
        for [a, b, c, d] in [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]] {
            triangles.extend([[a, b, c], [a, c, d]].map(|t| t.map(|i| base + i)));
        }
        let mesh = MeshTriangles { positions: &positions, triangles: &triangles };
        let bvh = Bvh::build(&[mesh], &[BvhInstance { mesh: 0, to_world: None, motion: None }])
            .expect("indices are in range");
        Self { positions, triangles, bvh }
    }

    /// Rays of a camera, pixel by pixel.
    fn coherent(&self) -> Vec<Ray> {
        let eye = Vec3::new(1.9, -1.9, 1.5);
        let forward = (-eye).normalize();
        let right = forward.cross(Vec3::Z).normalize();
        let up = right.cross(forward);
        let side = RAYS.isqrt();
        let at = |k: usize| 1.3 * ((k as f32 + 0.5) / side as f32 - 0.5);
        (0..side * side)
            .map(|i| Ray::new(eye, (forward + at(i % side) * right + at(i / side) * up).normalize()))
            .collect()
    }

    /// The ray that a diffuse surface sends on, or the one from it to `to`.
    fn bounce(&self, ray: &Ray, hit: &Hit, random: &mut Random, to: Option<Vec3>) -> Ray {
        let corners = self.triangles[hit.triangle as usize].map(|i| self.positions[i as usize]);
        let n = geometric_normal(&corners);
        let n = if n.dot(ray.direction) > 0.0 { -n } else { n };
        let (p, error) = hit_point(&corners, hit.b1, hit.b2);
        let (direction, t_max) = match to {
            None => ((n + 0.999 * random.direction()).normalize(), f32::INFINITY),
            Some(target) => ((target - p).normalize(), 0.999 * (target - p).length()),
        };
        Ray::with_end(offset_ray_origin(p, error, n, direction), direction, t_max)
    }

    /// After three diffuse bounces, in random order: no two neighbours have anything in common.
    fn diffuse(&self, random: &mut Random) -> Vec<Ray> {
        let mut rays = self.coherent();
        for _ in 0..3 {
            rays = rays.iter().filter_map(|r| Some(self.bounce(r, &self.bvh.closest_hit(r)?, random, None))).collect();
        }
        for i in (1..rays.len()).rev() {
            rays.swap(i, (random.unit() * (i + 1) as f32) as usize % (i + 1));
        }
        rays
    }

    /// From the visible points to points on a lamp under the ceiling.
    fn shadow(&self, random: &mut Random) -> Vec<Ray> {
        let rays = self.coherent();
        let lamp = |random: &mut Random| Vec3::new(random.unit() - 0.5, random.unit() - 0.5, 1.9);
        rays.iter()
            .filter_map(|r| {
                let target = lamp(random);
                Some(self.bounce(r, &self.bvh.closest_hit(r)?, random, Some(target)))
            })
            .collect()
    }
}

fn rays(criterion: &mut Criterion) {
    for (name, around, across) in [("12", 0, 0), ("60k", 300, 100), ("1M", 1000, 500)] {
        let room = Room::new(around, across);
        let mut random = Random(7);
        let (coherent, diffuse, shadow) = (room.coherent(), room.diffuse(&mut random), room.shadow(&mut random));
        let mut group = criterion.benchmark_group(format!("rays/{name}"));
        for (kind, rays) in [("coherent", &coherent), ("diffuse", &diffuse)] {
            group.throughput(Throughput::Elements(rays.len() as u64));
            group.bench_with_input(BenchmarkId::new("closest_hit", kind), rays, |bencher, rays| {
                bencher.iter(|| rays.iter().filter(|r| room.bvh.closest_hit(black_box(r)).is_some()).count());
            });
        }
        for (kind, rays) in [("shadow", &shadow), ("diffuse", &diffuse)] {
            group.throughput(Throughput::Elements(rays.len() as u64));
            group.bench_with_input(BenchmarkId::new("occluded", kind), rays, |bencher, rays| {
                bencher.iter(|| rays.iter().filter(|r| room.bvh.occluded(black_box(r))).count());
            });
        }
        group.finish();
    }
}

criterion_group!(benches, rays);
criterion_main!(benches);
