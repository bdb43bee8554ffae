//! Meshes for scenes that are made by code: rectangles, boxes, spheres, sheets, bodies of revolution.

use dunkelfeld_geometry::{DVec3, Mesh, Vec2, Vec3};

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

/// A closed sphere of `2 * rings * rings` quadrilaterals along circles of latitude (at least 3 rings), winding outward.
/// It has smooth normals if `smooth` is true.
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

/// A closed sheet over a rectangle around the z axis, between the heights `height(0, x, y)` and `height(1, x, y)`
/// \[m\]. Each face is a grid of `cells * cells`. The faces have the normals of these functions, by central
/// differences. The walls are flat.
pub fn sheet(half: Vec2, cells: u32, height: impl Fn(usize, f64, f64) -> f64) -> Mesh {
    let (cells, half) = (cells.max(1), half.as_dvec2());
    let corners = cells + 1;
    let at = |i: u32| 2.0 * f64::from(i) / f64::from(cells) - 1.0;
    let place = |i: u32, j: u32| (half.x * at(i), half.y * at(j));
    let position = |side: usize, (x, y): (f64, f64)| DVec3::new(x, y, height(side, x, y)).as_vec3();
    let mut mesh = Mesh::default();
    for side in 0..2 {
        let first = mesh.positions.len() as u32;
        for (i, j) in (0..corners * corners).map(|k| (k % corners, k / corners)) {
            let ((x, y), h) = (place(i, j), 1e-4 * half.min_element());
            let slope = |dx: f64, dy: f64| (height(side, x + dx, y + dy) - height(side, x - dx, y - dy)) / (2.0 * h);
            let up = DVec3::new(-slope(h, 0.0), -slope(0.0, h), 1.0).normalize().as_vec3();
            mesh.positions.push(position(side, (x, y)));
            mesh.normals.push(if side == 1 { up } else { -up });
        }
        for (i, j) in (0..cells * cells).map(|k| (k % cells, k / cells)) {
            let index = |i: u32, j: u32| first + j * corners + i;
            let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
            mesh.triangles.extend(if side == 1 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] });
        }
    }
    let rim = |k: u32| match (k / cells % 4, k % cells) {
        (0, i) => (i, 0),
        (1, j) => (cells, j),
        (2, i) => (cells - i, cells),
        (_, j) => (0, cells - j),
    };
    for k in 0..4 * cells {
        let [(i, j), (m, n)] = [rim(k), rim(k + 1)];
        let quad = [(0, i, j), (0, m, n), (1, m, n), (1, i, j)].map(|(side, i, j)| position(side, place(i, j)));
        let first = mesh.positions.len() as u32;
        let normal = (quad[1] - quad[0]).cross(quad[3] - quad[0]).normalize_or_zero();
        mesh.positions.extend(quad);
        mesh.normals.extend([normal; 4]);
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    mesh
}

/// A closed body around the z axis with a regular polygon of `corners` as its cross-section. The outline consists of
/// points of radius and height \[m\]. It is closed and runs counter-clockwise with the radius to the right. A point on
/// the axis makes a tip or the middle of an end; a ring has none.
pub fn turned(outline: &[Vec2], corners: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for p in outline {
        mesh.positions.extend((0..corners).map(|k| {
            let (sin, cos) = (f64::from(k) / f64::from(corners) * std::f64::consts::TAU).sin_cos();
            Vec3::new(p.x * cos as f32, p.x * sin as f32, p.y)
        }));
    }
    let index = |p: usize, k: u32| (p % outline.len()) as u32 * corners + k % corners;
    for (p, k) in (0..outline.len()).flat_map(|p| (0..corners).map(move |k| (p, k))) {
        let [a, b, c, d] = [index(p, k), index(p, k + 1), index(p + 1, k + 1), index(p + 1, k)];
        let radius = |p: usize| outline[p % outline.len()].x;
        if radius(p) > 0.0 {
            mesh.triangles.push([a, b, c]);
        }
        if radius(p + 1) > 0.0 {
            mesh.triangles.push([a, c, d]);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_geometry::Threads;
    use dunkelfeld_geometry::health::{MeshHealth, clean};

    #[test]
    fn shapes_are_closed_and_their_normals_point_outward() {
        let r = 0.5;
        let dome = |side: usize, x: f64, y: f64| 0.1 * side as f64 + 0.2 * (1.0 - x * x) * (1.0 - 4.0 * y * y);
        let disc = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.5), (0.0, 0.5)].map(Vec2::from);
        let ring = [(0.5, 0.0), (1.0, 0.0), (1.0, 0.5), (0.5, 0.5)].map(Vec2::from);
        // A regular polygon of 100 corners.
        let polygon = 50.0 * (std::f64::consts::TAU / 100.0).sin();
        for (name, mut mesh, volume) in [
            ("box", cuboid(Vec3::new(1.0, 2.0, 3.0), Vec3::new(2.0, 4.0, 6.0)), 6.0),
            ("sheet", sheet(Vec2::new(1.0, 0.5), 8, dome), 0.2),
            ("disc", turned(&disc, 100), 0.5 * polygon),
            ("ring", turned(&ring, 100), 0.375 * polygon),
            ("sphere", sphere(Vec3::X, r, 40, true), 4.0 / 3.0 * std::f64::consts::PI * f64::from(r * r * r)),
        ] {
            assert_eq!(clean(&mut mesh, Threads::ONE).total(), 0, "{name} has unusable triangles");
            let health = MeshHealth::from_mesh(&mesh);
            assert!(health.is_closed() && !health.is_inside_out(), "{name}: {health:?}");
            assert!((health.signed_volume / volume - 1.0).abs() < 0.01, "{name}: {}", health.signed_volume);
        }
        let q = rectangle(Vec3::ZERO, Vec3::X, Vec3::Y);
        assert_eq!(dunkelfeld_geometry::geometric_normal(&q.corners(0)), Vec3::Z);
    }
}
