//! Rays per second on one thread: closest hit and any hit, coherent and diffuse, in rooms of 12, 60 k and 1 M triangles. The
//! time to build scenes of 1 M triangles on one thread and on two.
//!
//! `cargo bench -p dunkelfeld --bench rays`; the throughput that criterion prints is rays per second. `-- build` builds only,
//! and prints the least time of all builds, which take turns.

#![allow(clippy::print_stdout, reason = "a bench prints its results")]

use std::hint::black_box;
use std::time::Instant;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dunkelfeld_bvh::{Bvh, BvhInstance, Hit, MeshTriangles};
use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, Ray, Vec3, geometric_normal, hit_point, offset_ray_origin};
use dunkelfeld_scene::{BuildCache, Material, SceneBuilder};

/// Rays per measurement: enough that they and what they touch do not stay in the first-level cache.
const RAYS: usize = 1 << 15;
/// Number of builds on each number of threads.
const BUILDS: usize = 7;

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

/// A bumpy torus of `2 around * across` triangles.
fn torus(around: usize, across: usize) -> (Vec<Vec3>, Vec<[u32; 3]>) {
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
    (positions, triangles)
}

struct Room {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    bvh: Bvh,
}

impl Room {
    /// A closed room of 12 triangles around a bumpy torus of `2 around * across`.
    fn new(around: usize, across: usize) -> Self {
        let (mut positions, mut triangles) = torus(around, across);
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

/// A scene of tori, beside each other, each an object of `2 around * across` triangles.
fn tori(count: usize, around: usize, across: usize, threads: usize) -> SceneBuilder {
    let mut scene = SceneBuilder { threads, ..SceneBuilder::default() };
    let grey = scene.add_material(Material::default());
    let (positions, triangles) = torus(around, across);
    for number in 0..count {
        // Objects of a file have meshes of their own.
        let mesh = Mesh { positions: positions.clone(), triangles: triangles.clone(), ..Mesh::default() };
        let object = scene.add_object(&number.to_string(), mesh, grey);
        scene.instances[object].to_world = DAffine3::from_translation(DVec3::new(3.0 * number as f64, 0.0, 0.0));
    }
    scene
}

/// Prints the least time of several builds on one thread and on two, in turns, so that other work disturbs both.
fn builds(_: &mut Criterion) {
    let arguments: Vec<String> = std::env::args().collect();
    let is_wanted = |name: &str| arguments.iter().skip(1).all(|a| a.starts_with('-') || name.contains(a.as_str()));
    if !is_wanted("build") || !arguments.iter().any(|a| a == "--bench") {
        return;
    }
    println!("{:<28} {:>10} {:>10} {:>6}", "build of a scene [ms]", "1 thread", "2 threads", "ratio");
    for (name, count, around, across) in
        [("1 mesh of 1 M triangles", 1, 1000, 500), ("100 meshes of 10 k triangles", 100, 100, 50)]
    {
        let scenes = [1, 2].map(|threads| tori(count, around, across, threads));
        let mut least = [f64::INFINITY; 2];
        for _ in 0..BUILDS {
            for (scene, least) in scenes.iter().zip(&mut least) {
                let scene = scene.clone();
                let began = Instant::now();
                let built = scene.build_with(&mut BuildCache::default());
                *least = least.min(began.elapsed().as_secs_f64());
                drop(black_box(built));
            }
        }
        let [one, two] = least.map(|seconds| 1e3 * seconds);
        println!("{name:<28} {one:>10.0} {two:>10.0} {:>6.2}", one / two);
    }
}

criterion_group!(benches, builds, rays);
criterion_main!(benches);
