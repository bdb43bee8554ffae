//! The clear PMMA cover: moulded (bulged faces, rounded rim) or plane-parallel (chamfered rim).

use glam::{DVec2, DVec3};

use super::mesh::{Mesh, Shell};
use super::outline::rounded_rectangle;
use super::solids::{Ends, MM, at_height, loft};

/// Half size in plan \[m\].
const HALF: DVec2 = DVec2::new(38.0 * MM, 28.0 * MM);
/// Corner radius in plan \[m\].
const CORNER: f64 = 5.0 * MM;
/// Height of the lower face at the rim above the symbols: the air gap \[m\].
pub(crate) const GAP: f64 = 1.0 * MM;
/// Thickness at the rim \[m\].
const THICKNESS: f64 = 4.0 * MM;
/// Radius of the moulded rim \[m\].
const RIM: f64 = 1.0 * MM;
/// Sagitta of the lower and the upper moulded face \[m\].
const SAGITTA: [f64; 2] = [0.6 * MM, 0.9 * MM];
/// Cells of a moulded face along x and z; 1 mm each.
const CELLS: [usize; 2] = [76, 56];
/// Chords of each quarter round of the moulded rim.
const RIM_STEPS: usize = 5;

/// The plane-parallel cover: exact planes, vertical walls, 0.3 mm chamfers.
pub(crate) fn flat() -> Mesh {
    let chamfer = 0.3 * MM;
    let profile = [(chamfer, GAP), (0.0, GAP + chamfer), (0.0, GAP + THICKNESS - chamfer), (chamfer, GAP + THICKNESS)]
        .map(|(inset, y)| DVec2::new(inset, y));
    // The crease limit lies between the corner's 9 degree chords and the 45 degree chamfer: round corners shade
    // smoothly, faces and chamfers stay planes.
    let outline = |inset: f64| rounded_rectangle(HALF - inset, CORNER - inset, 10);
    loft(&profile, Ends::Capped, outline).smooth(20.0)
}

/// The moulded cover: both faces bulge upwards, the rim is round, every normal is the surface's own.
pub(crate) fn moulded() -> Mesh {
    let mut mesh = Mesh::default();
    let mut shell = Shell::default();
    let lower = face(&mut mesh, &mut shell, 0);
    let upper = face(&mut mesh, &mut shell, 1);

    // Rings of the rim from the lower face's edge outward, up the wall and inward to the upper face's edge.
    let quarter = |step: usize| step as f64 / RIM_STEPS as f64 * std::f64::consts::FRAC_PI_2;
    let mut rings = vec![lower.clone()];
    for step in 1..=RIM_STEPS {
        rings.push(rim_ring(&mut mesh, &lower, quarter(step)));
    }
    for step in (1..=RIM_STEPS).rev() {
        rings.push(rim_ring(&mut mesh, &upper, quarter(step)));
    }
    rings.push(upper);
    for pair in rings.windows(2) {
        let n = pair[0].len();
        for i in 0..n {
            let j = (i + 1) % n;
            shell.quad(pair[0][i], pair[0][j], pair[1][j], pair[1][i]);
        }
    }
    mesh.triangles = shell.triangles;
    mesh
}

/// Height and upward normal of a moulded face (0 lower, 1 upper) over a plan point.
fn surface(side: usize, p: DVec2) -> (f64, DVec3) {
    let u = p / HALF;
    let (fall, sagitta) = (DVec2::ONE - u * u, SAGITTA[side]);
    let height = GAP + THICKNESS * side as f64 + sagitta * fall.x * fall.y;
    let slope = -2.0 * sagitta * u / HALF * DVec2::new(fall.y, fall.x);
    (height, at_height(-slope, 1.0).normalize())
}

/// Meshes one face inside the rim and returns its edge, counter-clockwise seen from above.
fn face(mesh: &mut Mesh, shell: &mut Shell, side: usize) -> Vec<u32> {
    let [nx, ny] = CELLS;
    let first = mesh.positions.len();
    let index = |i: usize, j: usize| (first + j * (nx + 1) + i) as u32;
    for j in 0..=ny {
        for i in 0..=nx {
            let p = in_rounded_rectangle(grid(i, nx), grid(j, ny));
            let (height, normal) = surface(side, p);
            mesh.positions.push(at_height(p, height));
            mesh.normals.push(if side == 1 { normal } else { -normal });
        }
    }
    for j in 0..ny {
        for i in 0..nx {
            let quad = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
            // The diagonal runs toward the corner of its quadrant, so that no triangle has all three corners on the rim.
            let turn = usize::from((2 * i < nx) != (2 * j < ny));
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| quad[(k + turn) % 4]);
            if side == 1 {
                shell.quad(a, b, c, d);
            } else {
                shell.quad(a, d, c, b);
            }
        }
    }
    let bottom = (0..nx).map(|i| index(i, 0));
    let right = (0..ny).map(|j| index(nx, j));
    let top = (0..nx).map(|i| index(nx - i, ny));
    let left = (0..ny).map(|j| index(0, ny - j));
    bottom.chain(right).chain(top).chain(left).collect()
}

/// One ring of the rim: from the edge vertices, turned outward by `angle` about the centre of the round.
fn rim_ring(mesh: &mut Mesh, edge: &[u32], angle: f64) -> Vec<u32> {
    let n = edge.len();
    let outward: Vec<DVec3> = (0..n)
        .map(|i| {
            let [back, ahead] = [edge[(i + n - 1) % n], edge[(i + 1) % n]].map(|k| mesh.positions[k as usize]);
            let normal = mesh.normals[edge[i] as usize];
            let along = ahead - back;
            let out = DVec3::new(-along.z, 0.0, along.x);
            (out - normal * out.dot(normal)).normalize()
        })
        .collect();
    let first = mesh.positions.len() as u32;
    for (i, out) in outward.into_iter().enumerate() {
        let (position, normal) = (mesh.positions[edge[i] as usize], mesh.normals[edge[i] as usize]);
        let turned = normal * angle.cos() + out * angle.sin();
        mesh.positions.push(position + RIM * (turned - normal));
        mesh.normals.push(turned);
    }
    (first..first + n as u32).collect()
}

fn grid(i: usize, cells: usize) -> f64 {
    2.0 * i as f64 / cells as f64 - 1.0
}

/// Maps the square \[-1, 1\]^2 onto the face inside the rim: a plain grid inside that bends to the round corners.
fn in_rounded_rectangle(u: f64, v: f64) -> DVec2 {
    let half = HALF - RIM;
    let radius = CORNER - RIM;
    let plain = half * DVec2::new(u, v);
    let m = u.abs().max(v.abs());
    if m == 0.0 {
        return plain;
    }
    let blend = m.powi(8);
    plain * (1.0 - blend) + m * blend * on_rounded_rectangle(u / m, v / m, half, radius)
}

/// Maps the square's edge to the rounded rectangle: each side's last `radius` becomes half of a corner's arc.
fn on_rounded_rectangle(u: f64, v: f64, half: DVec2, radius: f64) -> DVec2 {
    if v.abs() > u.abs() {
        let p = on_rounded_rectangle(v, u, DVec2::new(half.y, half.x), radius);
        return DVec2::new(p.y, p.x);
    }
    let along = half.y * v.abs();
    let straight = half.y - radius;
    if along <= straight {
        return DVec2::new(half.x * u, half.y * v);
    }
    let angle = (along - straight) / radius * std::f64::consts::FRAC_PI_4;
    let arc = DVec2::new(half.x - radius, straight) + radius * DVec2::from_angle(angle);
    DVec2::new(arc.x * u.signum(), arc.y * v.signum())
}
