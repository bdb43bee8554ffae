//! New objects of a job: box, plane, cylinder and sphere, as stand-ins for parts, plates and belts.

use super::check;
use super::place::edges;
use crate::error::InputError;
use crate::toml_keys::{TableKeys, keys_of};
use dunkelfeld_geometry::{Mesh, Vec3};
use dunkelfeld_scene::shapes;
use serde::Deserialize;
use std::f64::consts::TAU;

/// Sides of the polygon of a cylinder. Its radius deviates from the circle by 0.0075 %.
const SIDES: u32 = 256;
/// Circles of latitude of a sphere.
const RINGS: u32 = 96;

/// Shape of a new object. It lies around the origin, its axis is y.
#[derive(Clone, Debug, PartialEq)]
pub enum Primitive {
    /// A closed box.
    Box(Cuboid),
    /// A rectangle without thickness. Its front is +y.
    Plane(Plane),
    /// A closed cylinder around the y axis.
    Cylinder(Cylinder),
    /// A closed sphere.
    Sphere(Sphere),
}

/// The names of the shapes.
const KINDS: &[&str] = &["box", "plane", "cylinder", "sphere"];

/// Keys of a box.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Cuboid {
    /// Edges \[m\] along x, y and z.
    #[serde(deserialize_with = "edges")]
    pub size: [f64; 3],
}

/// Keys of a plane.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Plane {
    /// Edges \[m\] along x and z.
    #[serde(deserialize_with = "edges")]
    pub size: [f64; 2],
}

/// Keys of a cylinder.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Cylinder {
    /// Diameter \[m\].
    #[serde(deserialize_with = "check::length")]
    pub diameter: f64,
    /// Height \[m\] along y.
    #[serde(deserialize_with = "check::length")]
    pub height: f64,
}

/// Keys of a sphere.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Sphere {
    /// Diameter \[m\].
    #[serde(deserialize_with = "check::length")]
    pub diameter: f64,
}

impl Primitive {
    /// The shape of an entry of `[[object]]`; `None` without a `kind`.
    pub(super) fn read(keys: &mut TableKeys<'_>) -> Result<Option<Self>, InputError> {
        let Some(kind) = keys.kind(KINDS)? else {
            keys.describe(" of an object without a `kind`");
            return Ok(None);
        };
        keys.describe(format!(" of an object of kind \"{kind}\""));
        Ok(Some(match kind {
            "box" => Self::Box(keys.take(&[])?),
            "plane" => Self::Plane(keys.take(&[])?),
            "cylinder" => Self::Cylinder(keys.take(&[])?),
            _ => Self::Sphere(keys.take(&[])?),
        }))
    }

    /// The keys of all shapes.
    pub(super) fn keys() -> [&'static [&'static str]; 3] {
        [&["kind"], keys_of::<Cuboid>(), keys_of::<Cylinder>()]
    }

    /// The mesh.
    pub(super) fn mesh(&self) -> Mesh {
        match self {
            Self::Box(Cuboid { size }) => {
                let half = 0.5 * Vec3::from_array(size.map(|v| v as f32));
                shapes::cuboid(-half, half)
            }
            Self::Plane(Plane { size }) => {
                let [x, z] = size.map(|v| v as f32);
                shapes::rectangle(Vec3::new(-0.5 * x, 0.0, 0.5 * z), Vec3::X * x, Vec3::NEG_Z * z)
            }
            Self::Cylinder(c) => cylinder(0.5 * c.diameter as f32, c.height as f32),
            Self::Sphere(s) => shapes::sphere(Vec3::ZERO, 0.5 * s.diameter as f32, RINGS, true),
        }
    }
}

/// A closed cylinder around the y axis with smooth sides and flat ends.
fn cylinder(radius: f32, height: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let around = |k: u32| {
        let (sin, cos) = (f64::from(k % SIDES) / f64::from(SIDES) * TAU).sin_cos();
        Vec3::new(sin as f32, 0.0, cos as f32)
    };
    let half = 0.5 * height;
    // Side: two rings with normals of their own.
    for y in [-half, half] {
        for k in 0..SIDES {
            mesh.positions.push(radius * around(k) + Vec3::Y * y);
            mesh.normals.push(around(k));
        }
    }
    for k in 0..SIDES {
        let next = (k + 1) % SIDES;
        mesh.triangles.extend([[k, next, SIDES + next], [k, SIDES + next, SIDES + k]]);
    }
    for (y, normal) in [(-half, Vec3::NEG_Y), (half, Vec3::Y)] {
        let middle = mesh.positions.len() as u32;
        mesh.positions.push(Vec3::Y * y);
        mesh.normals.push(normal);
        for k in 0..SIDES {
            mesh.positions.push(radius * around(k) + Vec3::Y * y);
            mesh.normals.push(normal);
            let (this, next) = (middle + 1 + k, middle + 1 + (k + 1) % SIDES);
            mesh.triangles.push(if y > 0.0 { [middle, this, next] } else { [middle, next, this] });
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_geometry::health::{MeshHealth, clean};
    use dunkelfeld_geometry::{Threads, geometric_normal};

    #[test]
    fn primitives_have_their_sizes_and_point_outward() {
        let pi = std::f64::consts::PI;
        for (shape, volume) in [
            (Primitive::Box(Cuboid { size: [1.0, 2.0, 3.0] }), 6.0),
            (Primitive::Cylinder(Cylinder { diameter: 2.0, height: 3.0 }), 3.0 * pi),
            (Primitive::Sphere(Sphere { diameter: 2.0 }), 4.0 / 3.0 * pi),
        ] {
            let mut mesh = shape.mesh();
            assert_eq!(clean(&mut mesh, Threads::ONE).total(), 0, "{shape:?}");
            let health = MeshHealth::from_mesh(&mesh);
            assert!(health.is_closed() && (health.signed_volume / volume - 1.0).abs() < 2e-3, "{shape:?} {health:?}");
            for (t, corners) in mesh.triangles.iter().enumerate().filter(|_| !mesh.normals.is_empty()) {
                let normal = geometric_normal(&mesh.corners(t));
                assert!(corners.iter().all(|i| mesh.normals[*i as usize].dot(normal) > 0.99), "{shape:?}");
            }
        }
        let plane = Primitive::Plane(Plane { size: [4.0, 6.0] }).mesh();
        assert_eq!(geometric_normal(&plane.corners(0)), Vec3::Y);
        assert_eq!(plane.positions.iter().copied().reduce(Vec3::max), Some(Vec3::new(2.0, 0.0, 3.0)));
    }
}
