//! Common code of the tests: random numbers, meshes, and intersection by brute force.
#![allow(unreachable_pub, clippy::unwrap_used)]

use dunkelfeld_bvh::{Bvh, BvhInstance, Hit, MeshTriangles};
use dunkelfeld_geometry::triangle::{RayShear, TriangleHit, intersect_triangle};
use dunkelfeld_geometry::{Ray, Transform, Vec3};
use rand_core::Rng as _;

/// Random numbers with a fixed seed.
pub struct Random(rand_pcg::Pcg32);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(rand_pcg::Pcg32::new(seed, 0x5eed))
    }

    pub fn int(&mut self, below: usize) -> usize {
        ((u64::from(self.0.next_u32()) * below as u64) >> 32) as usize
    }

    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.0.next_u32() >> 8) as f32 / 16_777_216.0
    }

    /// In [-1, 1).
    pub fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    pub fn in_cube(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    pub fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.in_cube();
            let l2 = v.length_squared();
            if (1e-4..1.0).contains(&l2) {
                return v / l2.sqrt();
            }
        }
    }
}

/// Positions and triangles.
#[derive(Clone, Debug, Default)]
pub struct Shape {
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    pub fn soup(corners: impl IntoIterator<Item = [Vec3; 3]>) -> Self {
        let positions: Vec<Vec3> = corners.into_iter().flatten().collect();
        let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        Self { positions, triangles }
    }

    pub fn view(&self) -> MeshTriangles<'_> {
        MeshTriangles { positions: &self.positions, triangles: &self.triangles }
    }

    pub fn bvh(&self) -> Bvh {
        Bvh::build(&[self.view()], &[BvhInstance { mesh: 0, to_world: None, motion: None }]).unwrap()
    }

    pub fn instanced(&self, to_world: Transform) -> Bvh {
        Bvh::build(&[self.view()], &[BvhInstance { mesh: 0, to_world: Some(to_world), motion: None }]).unwrap()
    }

    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|i| self.positions[i as usize])
    }

    pub fn map(&self, f: impl Fn(Vec3) -> Vec3) -> Self {
        Self { positions: self.positions.iter().map(|&p| f(p)).collect(), triangles: self.triangles.clone() }
    }

    /// The nearest hit by a test of every triangle; the first of equally near ones.
    pub fn brute_force(&self, ray: &Ray) -> Option<(u32, TriangleHit)> {
        let shear = RayShear::new(ray);
        let mut best: Option<(u32, TriangleHit)> = None;
        for i in 0..self.triangles.len() as u32 {
            // With the ray's own end. A hit near that end is decided more precisely than a hit near another one.
            if let Some(hit) = intersect_triangle(&shear, ray, &self.corners(i))
                && best.is_none_or(|(_, nearest)| hit.t < nearest.t)
            {
                best = Some((i, hit));
            }
        }
        best
    }

    /// Panics unless the structure and brute force have the same hit, to the bit (except a choice between equal `t`).
    pub fn assert_agrees(&self, bvh: &Bvh, ray: &Ray) -> Option<Hit> {
        let want = self.brute_force(ray);
        let got = bvh.closest_hit(ray);
        assert_eq!(got.is_some(), bvh.occluded(ray), "closest_hit and occluded disagree on {ray:?}");
        match (want, got) {
            (None, None) => {}
            (Some((_, want)), Some(got)) => {
                assert_eq!(want.t.to_bits(), got.t.to_bits(), "{want:?} against {got:?} for {ray:?}");
                let own = intersect_triangle(&RayShear::new(ray), ray, &self.corners(got.triangle));
                assert_eq!(own, Some(TriangleHit { t: got.t, b1: got.b1, b2: got.b2 }), "for {ray:?}");
            }
            _ => panic!("brute force says {want:?}, the tree {got:?} for {ray:?}"),
        }
        got
    }
}

/// A sphere of radius one: an icosahedron whose faces are divided `levels` times. 20 * 4^levels triangles.
pub fn icosphere(levels: u32) -> Shape {
    let phi = 0.5 * (1.0 + 5f32.sqrt());
    let mut shape = Shape::default();
    for [a, b] in [[-1.0, phi], [1.0, phi], [-1.0, -phi], [1.0, -phi]] {
        shape.positions.extend([Vec3::new(a, b, 0.0), Vec3::new(0.0, a, b), Vec3::new(b, 0.0, a)]);
    }
    // Three mutual neighbours make a face: on this scale neighbours are two apart, all others farther.
    let near = |a: Vec3, b: Vec3| (a - b).length() < 2.1;
    let p = shape.positions.clone();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if near(p[i], p[j]) && near(p[j], p[k]) && near(p[k], p[i]) {
                    let outward = (p[j] - p[i]).cross(p[k] - p[i]).dot(p[i]) > 0.0;
                    let (i, j, k) = (i as u32, j as u32, k as u32);
                    shape.triangles.push(if outward { [i, j, k] } else { [i, k, j] });
                }
            }
        }
    }
    shape.positions.iter_mut().for_each(|p| *p = p.normalize());
    for _ in 0..levels {
        let mut middles = std::collections::HashMap::new();
        let mut finer = Vec::with_capacity(4 * shape.triangles.len());
        for &[a, b, c] in &shape.triangles.clone() {
            let mut middle = |i: u32, j: u32| {
                *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    let p = (shape.positions[i as usize] + shape.positions[j as usize]).normalize();
                    shape.positions.push(p);
                    shape.positions.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        shape.triangles = finer;
    }
    shape
}

/// A torus with bumps around the circle of radius one in the xy plane; its tube is at least 0.25 thick everywhere.
pub fn bumpy_torus(around: usize, across: usize) -> Shape {
    let mut shape = Shape::default();
    for i in 0..around {
        for j in 0..across {
            let a = std::f32::consts::TAU * i as f32 / around as f32;
            let b = std::f32::consts::TAU * j as f32 / across as f32;
            let r = 0.35 + 0.05 * (7.0 * a).sin() * (5.0 * b).cos() + 0.02 * (31.0 * a + 11.0 * b).sin();
            shape.positions.push(Vec3::new((1.0 + r * b.cos()) * a.cos(), (1.0 + r * b.cos()) * a.sin(), r * b.sin()));
            let at = |i: usize, j: usize| ((i % around) * across + j % across) as u32;
            shape.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            shape.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    shape
}

/// Triangles of many sizes at many places in a cube, needles included.
pub fn random_soup(count: usize, seed: u64) -> Shape {
    let mut random = Random::new(seed);
    Shape::soup((0..count).map(|i| {
        let a = 2.0 * random.in_cube();
        let size = 10f32.powf(-2.5 * random.unit());
        let b = a + size * random.in_cube();
        // Every third is a needle, up to a million times as long as it is thick.
        let c = if i % 3 == 0 {
            a + 0.4 * (b - a) + 10f32.powf(-6.0 * random.unit()) * size * random.in_cube()
        } else {
            a + size * random.in_cube()
        };
        [a, b, c]
    }))
}
