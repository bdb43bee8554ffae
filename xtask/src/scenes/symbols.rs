//! The printed symbols: pictograms built from patches that meet without overlapping, draped over the film.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, PI, TAU};

use glam::DVec2;

/// Longest edge of a patch cell \[mm\]: fine enough to follow the film.
const CELL: f64 = 1.1;

/// A flat drawing in millimetres, triangulated.
#[derive(Default)]
pub(crate) struct Drawing {
    /// Points \[mm\], x to the right, y up.
    pub(crate) points: Vec<DVec2>,
    /// Counter-clockwise triangles.
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// A symbol: its name, its coverage by ink, the ink's colour, and its drawing.
pub(crate) struct Symbol {
    /// Name in the file, for node, mesh and material.
    pub(crate) name: &'static str,
    /// Share of light that meets ink, 0 to 1.
    pub(crate) coverage: f64,
    /// Linear base colour of the ink.
    pub(crate) colour: [f64; 3],
    /// The pictogram, within +-6 mm.
    pub(crate) drawing: Drawing,
}

/// The nine symbols, row by row from the upper left.
pub(crate) fn all() -> Vec<Symbol> {
    const WHITE: [f64; 3] = [0.82, 0.82, 0.8];
    const BLUE: [f64; 3] = [0.22, 0.45, 0.8];
    const RED: [f64; 3] = [0.8, 0.2, 0.1];
    let symbol = |name, coverage, colour, drawing| Symbol { name, coverage, colour, drawing };
    vec![
        symbol("power", 1.0, WHITE, power()),
        symbol("snowflake", 0.85, BLUE, snowflake()),
        symbol("fan", 0.6, WHITE, fan()),
        symbol("airflow", 0.4, WHITE, arrow()),
        symbol("digits", 0.75, WHITE, digits()),
        symbol("dial", 0.9, RED, dial()),
        symbol("defrost", 0.5, WHITE, defrost()),
        symbol("drop", 0.25, WHITE, drop_shape()),
        symbol("plus-minus", 0.33, WHITE, plus_minus()),
    ]
}

impl Drawing {
    /// Adds the image of the unit square under `map`, in `nu` by `nv` cells; cells may close to a point at an edge.
    fn patch(&mut self, nu: usize, nv: usize, map: impl Fn(f64, f64) -> DVec2) {
        let first = self.points.len() as u32;
        let (columns, rows) = (nu as u32, nv as u32);
        for j in 0..=nv {
            for i in 0..=nu {
                self.points.push(map(i as f64 / nu as f64, j as f64 / nv as f64));
            }
        }
        let index = |i: u32, j: u32| first + j * (columns + 1) + i;
        for j in 0..rows {
            for i in 0..columns {
                let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
                self.triangle(a, b, c);
                self.triangle(a, c, d);
            }
        }
    }

    /// Adds a triangle, turned to wind counter-clockwise; a collapsed one is left out.
    fn triangle(&mut self, a: u32, b: u32, c: u32) {
        let [p, q, r] = [a, b, c].map(|i| self.points[i as usize]);
        let doubled_area = (q - p).perp_dot(r - p);
        if doubled_area > 1e-6 {
            self.triangles.push([a, b, c]);
        } else if doubled_area < -1e-6 {
            self.triangles.push([a, c, b]);
        }
    }

    /// Adds the quadrilateral `a b c d`; `c == d` makes a triangle.
    fn quad(&mut self, corners: [(f64, f64); 4]) {
        let [a, b, c, d] = corners.map(|(x, y)| DVec2::new(x, y));
        let cells = |length: f64| (length / CELL).ceil().max(1.0) as usize;
        let nu = cells(a.distance(b).max(d.distance(c)));
        let nv = cells(b.distance(c).max(a.distance(d)));
        self.patch(nu, nv, |u, v| a.lerp(b, u).lerp(d.lerp(c, u), v));
    }

    /// Adds a straight stroke.
    fn bar(&mut self, from: (f64, f64), to: (f64, f64), width: f64) {
        let (p, q) = (DVec2::from(from), DVec2::from(to));
        let side = (q - p).normalize().perp() * (0.5 * width);
        self.quad([p - side, q - side, q + side, p + side].map(|c| (c.x, c.y)));
    }

    /// Adds a sector of a ring about `centre`, radii and angles \[rad\] from-to.
    fn arc(&mut self, centre: (f64, f64), radii: [f64; 2], angles: [f64; 2]) {
        let sweep = angles[1] - angles[0];
        let nu = ((sweep * radii[1] / CELL).ceil() as usize).max((sweep / 0.2).ceil() as usize);
        let nv = ((radii[1] - radii[0]) / CELL).ceil() as usize;
        self.patch(nu, nv, |u, v| {
            DVec2::from(centre) + DVec2::from_angle(angles[0] + sweep * u) * (radii[0] + (radii[1] - radii[0]) * v)
        });
    }

    /// Adds everything of `part`, turned by `angle` and moved.
    fn add(&mut self, part: &Self, angle: f64, offset: DVec2) {
        let first = self.points.len() as u32;
        let rotation = DVec2::from_angle(angle);
        self.points.extend(part.points.iter().map(|p| rotation.rotate(*p) + offset));
        self.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + first)));
    }
}

fn power() -> Drawing {
    let mut d = Drawing::default();
    let gap = 0.62;
    d.arc((0.0, 0.0), [4.1, 5.4], [FRAC_PI_2 + gap, FRAC_PI_2 + TAU - gap]);
    d.bar((0.0, 0.8), (0.0, 6.0), 1.4);
    d
}

fn snowflake() -> Drawing {
    let mut arm = Drawing::default();
    // A sixth of the hexagon in the middle, the arm on its edge, and two pairs of needles on the arm's flanks.
    let half_edge = 1.0 / 3.0_f64.sqrt();
    arm.quad([(0.0, 0.0), (1.0, -half_edge), (1.0, half_edge), (1.0, half_edge)]);
    arm.bar((1.0, 0.0), (5.9, 0.0), 0.9);
    for side in [-1.0, 1.0] {
        arm.quad([(2.9, side * 0.45), (3.9, side * 0.45), (5.2, side * 1.85), (4.2, side * 1.85)]);
    }
    let mut d = Drawing::default();
    for k in 0..6 {
        d.add(&arm, FRAC_PI_2 + FRAC_PI_3 * f64::from(k), DVec2::ZERO);
    }
    d
}

fn fan() -> Drawing {
    let mut d = Drawing::default();
    d.arc((0.0, 0.0), [0.0, 1.15], [0.0, TAU]);
    for k in 0..4 {
        let start = FRAC_PI_2 * f64::from(k);
        d.patch(6, 7, |u, v| {
            let radius = 1.6 + 4.1 * u;
            let width = 0.5 + 0.75 * (PI * (0.1 + 0.75 * u)).sin();
            DVec2::from_angle(start + 0.75 * u + width * v) * radius
        });
    }
    d
}

fn arrow() -> Drawing {
    let mut d = Drawing::default();
    d.quad([(-4.6, 0.6), (4.6, 0.6), (0.0, 5.8), (0.0, 5.8)]);
    d.bar((0.0, 0.6), (0.0, -1.6), 3.4);
    for k in 0..2 {
        let y = -2.6 - 1.7 * f64::from(k);
        d.bar((0.0, y), (0.0, y - 1.0), 3.4);
    }
    d
}

/// "24" in seven segments, with a degree ring.
fn digits() -> Drawing {
    let mut d = Drawing::default();
    let (two, four) = ([true, false, true, true, true, false, true], [false, true, true, true, false, true, false]);
    for (lit, x) in [(two, -3.8), (four, 1.7)] {
        let mut digit = Drawing::default();
        let (w, h) = (1.85, 3.6);
        // Top, upper left, upper right, middle, lower left, lower right, bottom.
        let segments = [
            ((-w, h), (w, h)),
            ((-w, 0.0), (-w, h)),
            ((w, 0.0), (w, h)),
            ((-w, 0.0), (w, 0.0)),
            ((-w, -h), (-w, 0.0)),
            ((w, -h), (w, 0.0)),
            ((-w, -h), (w, -h)),
        ];
        for ((from, to), on) in segments.into_iter().zip(lit) {
            if on {
                segment(&mut digit, from.into(), to.into());
            }
        }
        d.add(&digit, 0.0, DVec2::new(x, 0.0));
    }
    d.arc((5.5, 3.9), [0.45, 0.95], [0.0, TAU]);
    d
}

/// A display segment: a bar with pointed ends, a little short of both of its joints.
fn segment(d: &mut Drawing, from: DVec2, to: DVec2) {
    let along = (to - from).normalize();
    let (p, q) = (from + along * 0.18, to - along * 0.18);
    let half = 0.55;
    let side = along.perp() * half;
    let (a, b) = (p + along * half, q - along * half);
    let corner = |c: DVec2| (c.x, c.y);
    d.quad([a - side, b - side, b + side, a + side].map(corner));
    d.quad([a - side, a + side, p, p].map(corner));
    d.quad([b + side, b - side, q, q].map(corner));
}

fn dial() -> Drawing {
    let mut d = Drawing::default();
    let (first, last) = (FRAC_PI_2 + 2.4, FRAC_PI_2 - 2.4);
    for k in 0..11 {
        let t = f64::from(k) / 10.0;
        let middle = first + (last - first) * t;
        d.arc((0.0, 0.0), [4.4, 4.9 + t], [middle - 0.16, middle + 0.16]);
    }
    d.arc((0.0, 0.0), [2.3, 3.4], [0.0, TAU]);
    d
}

fn defrost() -> Drawing {
    let mut d = Drawing::default();
    let (outer, inner) = ([5.8, 4.0], [4.9, 3.1]);
    // Four mitred sides of a window, narrower at the top.
    let narrow = |y: f64| if y > 0.0 { 0.82 } else { 1.0 };
    let at = |size: [f64; 2], x: f64, y: f64| (x * size[0] * narrow(y), y * size[1]);
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    for i in 0..4 {
        let ((ax, ay), (bx, by)) = (corners[i], corners[(i + 1) % 4]);
        d.quad([at(outer, ax, ay), at(outer, bx, by), at(inner, bx, by), at(inner, ax, ay)]);
    }
    for k in -1..=1 {
        d.patch(1, 9, |u, v| {
            let y = -2.2 + 4.4 * v;
            DVec2::new(2.3 * f64::from(k) + 0.45 * (TAU * v).sin() + 0.9 * (u - 0.5), y)
        });
    }
    d
}

fn drop_shape() -> Drawing {
    let mut d = Drawing::default();
    d.patch(4, 36, |u, v| {
        // The teardrop curve, its tip up, shrunk toward a centre inside the belly.
        let t = TAU * v;
        let rim = DVec2::new(5.2 * t.sin() * (0.5 * t).sin().powf(1.5), 5.8 * t.cos());
        DVec2::new(0.0, -1.8).lerp(rim, u)
    });
    d
}

fn plus_minus() -> Drawing {
    let mut d = Drawing::default();
    d.bar((-5.9, 0.0), (-1.3, 0.0), 1.5);
    d.bar((1.3, 0.0), (5.9, 0.0), 1.5);
    d.bar((3.6, 0.75), (3.6, 2.3), 1.5);
    d.bar((3.6, -0.75), (3.6, -2.3), 1.5);
    d
}
