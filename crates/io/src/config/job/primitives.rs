//! New objects of a job: box, plane, cylinder and sphere, as stand-ins for parts, plates and belts.

use super::objects::ObjectOverride;
use dunkelfeld_geometry::{Mesh, Vec3};
use dunkelfeld_scene::shapes;
use serde::Deserialize;
use std::f64::consts::TAU;

/// Sides of the polygon of a cylinder. Its radius deviates from the circle by 0.0075 %.
const SIDES: u32 = 256;
/// Circles of latitude of a sphere.
const RINGS: u32 = 96;

/// Shape of a new object. It lies around the origin, its axis is y.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PrimitiveKind {
    /// A closed box with the edges `size = [x, y, z]`.
    Box,
    /// A rectangle without thickness with the edges `size = [x, z]`. Its front is +y.
    Plane,
    /// A closed cylinder around the y axis with `diameter` and `height`.
    Cylinder,
    /// A closed sphere with `diameter`.
    Sphere,
}

impl PrimitiveKind {
    /// Are the sizes of the kind given, and no others?
    ///
    /// # Errors
    /// Key, problem and help.
    pub(super) fn check(self, o: &ObjectOverride) -> Result<(), (&'static str, String, &'static str)> {
        let (name, keys, help): (_, &[&str], _) = match self {
            Self::Box => ("a box", &["size"], "give `size = [x, y, z]`"),
            Self::Plane => ("a plane", &["size"], "give `size = [x, z]`"),
            Self::Cylinder => ("a cylinder", &["diameter", "height"], "give `diameter` and `height`"),
            Self::Sphere => ("a sphere", &["diameter"], "give `diameter`"),
        };
        let given = [("size", o.size.is_some()), ("diameter", o.diameter.is_some()), ("height", o.height.is_some())];
        for (key, given) in given {
            match (keys.contains(&key), given) {
                (true, false) => return Err(("kind", format!("{name} needs `{key}`"), help)),
                (false, true) => return Err((key, format!("{name} has no `{key}`"), help)),
                _ => {}
            }
        }
        let edges = if self == Self::Box { 3 } else { 2 };
        match &o.size {
            Some(size) if size.len() != edges => {
                Err(("size", format!("{name} has {edges} edges, and this has {}", size.len()), help))
            }
            _ if o.name.contains(['*', '?']) => {
                let problem = "a new object cannot have a pattern as its name".into();
                Err(("name", problem, "write a name without `*` and `?`"))
            }
            _ => Ok(()),
        }
    }
}

/// The mesh of a new object whose keys were checked.
pub(super) fn primitive(kind: PrimitiveKind, o: &ObjectOverride) -> Mesh {
    let edge = |k: usize| o.size.as_ref().and_then(|size| size.get(k)).map_or(1.0, |v| *v as f32);
    let radius = 0.5 * o.diameter.unwrap_or(1.0) as f32;
    match kind {
        PrimitiveKind::Box => {
            let half = 0.5 * Vec3::new(edge(0), edge(1), edge(2));
            shapes::cuboid(-half, half)
        }
        PrimitiveKind::Plane => {
            let (x, z) = (edge(0), edge(1));
            shapes::rectangle(Vec3::new(-0.5 * x, 0.0, 0.5 * z), Vec3::X * x, Vec3::NEG_Z * z)
        }
        PrimitiveKind::Cylinder => cylinder(radius, o.height.unwrap_or(1.0) as f32),
        PrimitiveKind::Sphere => shapes::sphere(Vec3::ZERO, radius, RINGS, true),
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
        let of = |kind, size: &[f64]| {
            let o = ObjectOverride {
                size: Some(size.to_vec()),
                diameter: Some(2.0),
                height: Some(3.0),
                ..ObjectOverride::default()
            };
            primitive(kind, &o)
        };
        let pi = std::f64::consts::PI;
        for (kind, volume) in
            [(PrimitiveKind::Box, 6.0), (PrimitiveKind::Cylinder, 3.0 * pi), (PrimitiveKind::Sphere, 4.0 / 3.0 * pi)]
        {
            let mut mesh = of(kind, &[1.0, 2.0, 3.0]);
            assert_eq!(clean(&mut mesh, Threads::ONE).total(), 0, "{kind:?}");
            let health = MeshHealth::from_mesh(&mesh);
            assert!(health.is_closed() && (health.signed_volume / volume - 1.0).abs() < 2e-3, "{kind:?} {health:?}");
            for (t, corners) in mesh.triangles.iter().enumerate().filter(|_| !mesh.normals.is_empty()) {
                let normal = geometric_normal(&mesh.corners(t));
                assert!(corners.iter().all(|i| mesh.normals[*i as usize].dot(normal) > 0.99), "{kind:?}");
            }
        }
        let plane = of(PrimitiveKind::Plane, &[4.0, 6.0]);
        assert_eq!(geometric_normal(&plane.corners(0)), Vec3::Y);
        assert_eq!(plane.positions.iter().copied().reduce(Vec3::max), Some(Vec3::new(2.0, 0.0, 3.0)));
    }
}
