//! Nanoseconds per ray of one thread: primary rays, first shadow rays and diffuse second rays, in the waves of the
//! integrator, on a preset station and on a mesh of 1 M triangles; single rays, and batches of each instruction set. The time
//! to build scenes of 1 M triangles on one thread and on two.
//!
//! `cargo bench -p dunkelfeld --bench rays`; `-- rays` or `-- build` measures one of both. The times are sums of the least
//! times of all waves. All methods take turns, so that other work disturbs them alike.

#![allow(clippy::print_stdout, reason = "a bench prints its results")]

use std::hint::black_box;
use std::time::Instant;

use dunkelfeld::Project;
use dunkelfeld::commands::Station;
use dunkelfeld_bvh::{HitBatch, NO_HIT, RayBatch};
use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, Ray, Vec3};
use dunkelfeld_integrator::Wavefront;
use dunkelfeld_lanes::InstructionSet;
use dunkelfeld_scene::{BuildCache, Material, Scene, SceneBuilder};

/// Number of waves, and of samples of a pixel.
const WAVES: usize = 128;
const SAMPLES: usize = 16;
/// Side of a tile, and of the film \[pixels\].
const TILE: usize = 16;
const FILM: usize = 512;
/// Number of measurements of each wave.
const ROUNDS: usize = 20;
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

/// A scene with a camera and a square lamp.
struct World {
    name: &'static str,
    scene: Scene,
    /// The ray through a point of the film, from 0 to 1 in each coordinate.
    camera: Box<dyn Fn(f32, f32) -> Ray>,
    /// A corner of the lamp and its edges.
    lamp: [Vec3; 3],
}

impl World {
    /// A preset station with its stand-in part. The lamp is a square around the camera.
    fn station(name: &'static str) -> Option<Self> {
        let scene = Project::from_text("station.toml", &Station::find(name)?.job()).ok()?.scene;
        let camera = scene.ray_generator(scene.cameras().first()?, FILM as u32, FILM as u32).ok()?;
        let middle = camera.ray(0.5 * FILM as f32, 0.5 * FILM as f32);
        let side = middle.direction.any_orthonormal_vector();
        let (u, v) = (0.1 * side, 0.1 * side.cross(middle.direction));
        let camera = Box::new(move |x, y| camera.ray(FILM as f32 * x, FILM as f32 * y));
        Some(Self { name, scene, camera, lamp: [middle.origin - 0.5 * (u + v), u, v] })
    }

    /// A torus of 1 M triangles in a closed room of 12, with a lamp under the ceiling.
    fn dense() -> Option<Self> {
        let mut builder = tori(1, 1000, 500, 1);
        let grey = builder.add_material(Material::default());
        let positions = (0..8).map(|i| {
            let side = |bit: u32| if i & bit == 0 { -2.0 } else { 2.0 };
            Vec3::new(side(1), side(2), side(4))
        });
        let sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
        let triangles = sides.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        builder.add_object("room", Mesh { positions: positions.collect(), triangles, ..Mesh::default() }, grey);
        let scene = builder.build().ok()?.0;
        let origin = scene.world_origin().as_vec3();
        let eye = Vec3::new(1.9, -1.9, 1.5);
        let right = eye.cross(Vec3::NEG_Z).normalize();
        let up = right.cross(-eye).normalize();
        let camera = Box::new(move |x: f32, y: f32| {
            let direction = -eye.normalize() + 0.9 * (x - 0.5) * right + 0.9 * (0.5 - y) * up;
            Ray::new(eye - origin, direction.normalize())
        });
        Some(Self {
            name: "1 M triangles",
            scene,
            camera,
            lamp: [Vec3::new(-0.5, -0.5, 1.9) - origin, Vec3::X, Vec3::Y],
        })
    }

    /// Waves of primary rays, of first shadow rays and of diffuse second rays, in the order in which the integrator makes
    /// them: samples of a pixel side by side, pixels by tiles, points on surfaces by materials.
    fn waves(&self) -> [Vec<Rays>; 3] {
        let (mut waves, mut random) = ([const { Vec::new() }; 3], Random(7));
        let across = FILM / TILE;
        let samples = (0..across * across).flat_map(|tile| {
            // Tiles that are far from each other. The step is odd.
            let tile = tile * 389 % (across * across);
            (0..TILE * TILE * SAMPLES).map(move |sample| {
                let pixel = sample / SAMPLES;
                (tile % across * TILE + pixel % TILE, tile / across * TILE + pixel / TILE)
            })
        });
        let mut primary = Vec::new();
        for (x, y) in samples.take(WAVES * Wavefront::BATCH) {
            let at = |pixel: usize, random: &mut Random| (pixel as f32 + random.unit()) / FILM as f32;
            primary.push((self.camera)(at(x, &mut random), at(y, &mut random)));
            if primary.len() == Wavefront::BATCH {
                let [shadow, second] = self.bounce(&primary, &mut random);
                for (waves, rays) in waves.iter_mut().zip([&primary, &shadow, &second]) {
                    waves.push(Rays::new(rays));
                }
                primary.clear();
            }
        }
        waves
    }

    /// The rays from the first hits to the lamp, and those that diffuse surfaces send on.
    fn bounce(&self, rays: &[Ray], random: &mut Random) -> [Vec<Ray>; 2] {
        let (mut shadow, mut second) = (Vec::new(), Vec::new());
        let mut points: Vec<_> =
            rays.iter().filter_map(|ray| Some((ray.direction, self.scene.intersect(ray)?))).collect();
        points.sort_by_key(|(_, point)| point.material());
        for (direction, point) in points {
            let n = if point.normal.dot(direction) > 0.0 { -point.normal } else { point.normal };
            let [corner, u, v] = self.lamp;
            let to_lamp = corner + random.unit() * u + random.unit() * v - point.point;
            if to_lamp.dot(n) > 0.0 {
                let direction = to_lamp.normalize();
                shadow.push(Ray::with_end(point.ray_origin(direction), direction, 0.999 * to_lamp.length()));
            }
            let direction = (n + 0.999 * random.direction()).normalize();
            second.push(Ray::new(point.ray_origin(direction), direction));
        }
        [shadow, second]
    }
}

/// The rays of a wave, one by one and by coordinates.
struct Rays {
    single: Vec<Ray>,
    origin: [Vec<f32>; 3],
    direction: [Vec<f32>; 3],
    t_max: Vec<f32>,
}

impl Rays {
    fn new(rays: &[Ray]) -> Self {
        let of = |number: &dyn Fn(&Ray) -> f32| rays.iter().map(number).collect::<Vec<_>>();
        let axes = [0, 1, 2];
        Self {
            single: rays.to_vec(),
            origin: axes.map(|k| of(&|r| r.origin[k])),
            direction: axes.map(|k| of(&|r| r.direction[k])),
            t_max: of(&|r| r.t_max),
        }
    }

    fn batch(&self) -> RayBatch<'_> {
        let [origin, direction] = [&self.origin, &self.direction].map(|v| v.each_ref().map(Vec::as_slice));
        RayBatch { origin, direction, t_max: &self.t_max, time: &[] }
    }
}

/// Traces a wave with a method: single rays without an instruction set. Returns the number of rays that hit a surface.
fn trace(scene: &Scene, wave: &Rays, set: Option<InstructionSet>, any: bool) -> usize {
    let (bvh, count) = (scene.bvh(), wave.single.len());
    let Some(set) = set else {
        let hits = |ray: &&Ray| if any { bvh.occluded(ray) } else { bvh.closest_hit(black_box(ray)).is_some() };
        return wave.single.iter().filter(hits).count();
    };
    if any {
        let mut occluded = [false; Wavefront::BATCH];
        bvh.occluded_batch(set, &wave.batch(), &mut occluded[..count]);
        return occluded[..count].iter().filter(|o| **o).count();
    }
    let [mut t, mut b1, mut b2] = [[0.0; Wavefront::BATCH]; 3];
    let [mut instance, mut part, mut triangle] = [[0; Wavefront::BATCH]; 3];
    let (t, b1, b2) = (&mut t[..count], &mut b1[..count], &mut b2[..count]);
    let (part, triangle) = (&mut part[..count], &mut triangle[..count]);
    let mut hits = HitBatch { t, b1, b2, instance: &mut instance[..count], part, triangle };
    bvh.closest_hits(set, &wave.batch(), &mut hits);
    hits.instance.iter().filter(|i| **i != NO_HIT).count()
}

/// Prints the time per ray of all kinds and methods.
fn rays(rounds: usize) {
    let sets = InstructionSet::all().into_iter().filter(|set| set.lanes() > 1);
    let methods: Vec<_> = std::iter::once(None).chain(sets.map(Some)).collect();
    print!("{:<38} {:>8}", "ns per ray", "single");
    methods.iter().flatten().for_each(|set| print!(" {:>8}", format!("{} lanes", set.lanes())));
    println!();
    for world in [World::station("bright-field-ring"), World::dense()].into_iter().flatten() {
        for (kind, waves) in ["primary", "first shadow", "second"].into_iter().zip(world.waves()) {
            let mut least = vec![vec![f64::INFINITY; waves.len()]; methods.len()];
            for _ in 0..rounds {
                for (least, set) in least.iter_mut().zip(&methods) {
                    for (wave, least) in waves.iter().zip(least) {
                        let began = Instant::now();
                        black_box(trace(&world.scene, wave, *set, kind == "first shadow"));
                        *least = least.min(began.elapsed().as_secs_f64());
                    }
                }
            }
            let count: usize = waves.iter().map(|wave| wave.single.len()).sum();
            print!("{:<38}", format!("{}, {kind}", world.name));
            least.iter().for_each(|l| print!(" {:>8.1}", 1e9 * l.iter().sum::<f64>() / count.max(1) as f64));
            println!();
        }
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
fn builds() {
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

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let is_wanted = |name: &str| arguments.iter().all(|a| a.starts_with('-') || name.contains(a.as_str()));
    // Without `--bench` (`cargo test --bench rays`) each wave is traced once.
    let is_bench = arguments.iter().any(|a| a == "--bench");
    if is_wanted("build") && is_bench {
        builds();
    }
    if is_wanted("rays") {
        rays(if is_bench { ROUNDS } else { 1 });
    }
}
