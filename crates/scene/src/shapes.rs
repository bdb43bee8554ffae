//! Meshes for scenes that are written by hand: rectangles, boxes, spheres.

use dunkelfeld_geometry::{Mesh, Vec2, Vec3};

/// A rectangle of two triangles with texture coordinates; its front is on the side of `edge_u x edge_v`.
pub fn rectangle(corner: Vec3, edge_u: Vec3, edge_v: Vec3) -> Mesh {
    Mesh {
        positions: vec![corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        uvs: [vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y], Vec::new()],
        ..Mesh::default()
    }
}

/// A closed box between two opposite corners, winding outward.
pub fn cuboid(low: Vec3, high: Vec3) -> Mesh {
    let at = |i: usize| Vec3::new([low.x, high.x][i & 1], [low.y, high.y][(i >> 1) & 1], [low.z, high.z][i >> 2]);
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    Mesh {
        positions: (0..8).map(at).collect(),
        triangles: quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        ..Mesh::default()
    }
}

/// A closed sphere of `2 * rings * rings` quadrilaterals along circles of latitude (at least 3 rings), winding outward;
/// with smooth normals if asked for.
pub fn sphere(center: Vec3, radius: f32, rings: u32, smooth: bool) -> Mesh {
    let rings = rings.max(3);
    let columns = 2 * rings;
    let mut directions = vec![Vec3::Y];
    for i in 1..rings {
        let (sin_theta, cos_theta) = (std::f32::consts::PI * i as f32 / rings as f32).sin_cos();
        for j in 0..columns {
            let (sin_phi, cos_phi) = (std::f32::consts::TAU * j as f32 / columns as f32).sin_cos();
            directions.push(Vec3::new(sin_theta * sin_phi, cos_theta, sin_theta * cos_phi));
        }
    }
    directions.push(Vec3::NEG_Y);
    let south = directions.len() as u32 - 1;
    let at = |i: u32, j: u32| match i {
        0 => 0,
        i if i == rings => south,
        i => 1 + (i - 1) * columns + j % columns,
    };
    let mut triangles = Vec::new();
    for i in 0..rings {
        for j in 0..columns {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if b != c {
                triangles.push([a, b, c]);
            }
            if a != d {
                triangles.push([a, c, d]);
            }
        }
    }
    Mesh {
        positions: directions.iter().map(|d| center + radius * *d).collect(),
        triangles,
        normals: if smooth { directions } else { Vec::new() },
        ..Mesh::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_geometry::health::{MeshHealth, clean};

    #[test]
    fn bodies_are_closed_and_wind_outward() {
        let r = 0.5;
        for (name, mut mesh, volume) in [
            ("box", cuboid(Vec3::new(1.0, 2.0, 3.0), Vec3::new(2.0, 4.0, 6.0)), 6.0),
            ("sphere", sphere(Vec3::X, r, 40, true), 4.0 / 3.0 * std::f64::consts::PI * f64::from(r * r * r)),
        ] {
            assert_eq!(clean(&mut mesh).total(), 0, "{name} has unusable triangles");
            let health = MeshHealth::of(&mesh);
            assert!(health.is_closed() && !health.is_inside_out(), "{name}: {health:?}");
            assert!((health.signed_volume / volume - 1.0).abs() < 0.01, "{name}: {}", health.signed_volume);
        }
        let q = rectangle(Vec3::ZERO, Vec3::X, Vec3::Y);
        assert_eq!(dunkelfeld_geometry::geometric_normal(&q.corners(0)), Vec3::Z);
    }
}
