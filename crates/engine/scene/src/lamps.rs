//! Lamps of machine vision as emitting meshes: rings, bars, panels, discs, domes, spheres.
//!
//! A lamp lies in its own frame: its centre is the origin, it shines along -z, its height points along +y. All lengths
//! are in metres. Every lamp is one light (see [`MeshPart::is_single_light`](crate::MeshPart)). Round outlines are
//! polygons with the area of the circle, so that power and radiance agree with those of the round lamp.

mod irradiance;

pub use irradiance::irradiance_on_axis;

use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, Vec3};
use std::f64::consts::{PI, TAU};

/// Segments of a full circle. The mean radius of such a polygon deviates from that of the circle by less than 2e-4 of
/// it.
const SEGMENTS: u32 = 96;

/// Segments of the outline of an LED.
const LED_SEGMENTS: u32 = 10;

/// Distance of LEDs from the plate that carries them, as a share of their diameter.
const LED_LIFT: f64 = 0.05;

/// Share of the space of an LED that its lens takes in one direction, if no diameter is given.
const LED_FILL: f64 = 0.6;

/// The emitting surface of a lamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LampShape {
    /// A band around the axis, between two diameters if it is flat. The normals are tilted from the axis toward it by
    /// `tilt` \[rad\]: 0 is flat, pi/2 is the inside of a cylinder. The band keeps its mean radius and its width.
    Ring {
        /// Outer diameter of the flat band \[m\].
        outer_diameter: f64,
        /// Inner diameter of the flat band \[m\], above 0 and below the outer one.
        inner_diameter: f64,
        /// Tilt \[rad\], in [0, pi/2].
        tilt: f64,
    },
    /// A rectangle.
    Rectangle {
        /// Extent along x \[m\].
        width: f64,
        /// Extent along y \[m\].
        height: f64,
    },
    /// An ellipse, or a disc.
    Ellipse {
        /// Extent along x \[m\].
        width: f64,
        /// Extent along y \[m\].
        height: f64,
    },
    /// The inside of a hemisphere with a round opening around its apex. The rim lies in the plane z = 0.
    Dome {
        /// Diameter of the rim \[m\].
        diameter: f64,
        /// Diameter of the opening \[m\], 0 for none, below that of the rim.
        opening: f64,
    },
    /// The outside of a sphere.
    Sphere {
        /// Diameter \[m\].
        diameter: f64,
    },
}

/// LEDs of a lamp without a diffuser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leds {
    /// Number along the band or the width, 1 or more.
    pub columns: u32,
    /// Number of rows across the band or along the height, 1 or more.
    pub rows: u32,
    /// Diameter of the emitting discs \[m\]; `None` for a share of their distance.
    pub diameter: Option<f64>,
}

/// The meshes of a lamp.
#[derive(Clone, Debug, Default)]
pub struct LampMeshes {
    /// The emitting triangles; they emit from their front only.
    pub emitter: Mesh,
    /// The plate behind LEDs; empty without LEDs.
    pub plate: Mesh,
}

/// A surface over the unit square: a point and the unit normal of the emitting side.
type Chart<'a> = &'a dyn Fn(f64, f64) -> (DVec3, DVec3);

impl LampShape {
    /// The meshes of the lamp; with `leds` only their discs emit. A dome and a sphere have no LEDs.
    pub fn meshes(&self, leds: Option<Leds>) -> LampMeshes {
        match leds.filter(|_| !matches!(self, Self::Dome { .. } | Self::Sphere { .. })) {
            None => LampMeshes { emitter: self.surface(), plate: Mesh::default() },
            Some(leds) => LampMeshes { emitter: self.discs(leds), plate: self.surface() },
        }
    }

    /// The whole surface.
    fn surface(&self) -> Mesh {
        match *self {
            Self::Ring { .. } => grid(SEGMENTS, 1, true, &|u, v| self.point(u, v)),
            Self::Rectangle { .. } => grid(1, 1, false, &|u, v| self.point(u, v)),
            Self::Ellipse { width, height } => {
                fan(DVec3::ZERO, 0.5 * width * DVec3::X, 0.5 * height * DVec3::Y, SEGMENTS)
            }
            Self::Dome { .. } => grid(SEGMENTS, SEGMENTS / 4, true, &|u, v| self.point(u, v)),
            Self::Sphere { diameter } => {
                let mut mesh = grid(SEGMENTS / 2, SEGMENTS / 4, true, &|u, v| self.point(u, v));
                // The facets get the area of the sphere.
                let scale = (PI * diameter * diameter / area(&mesh)).sqrt() as f32;
                mesh.positions.iter_mut().for_each(|p| *p *= scale);
                mesh
            }
        }
    }

    /// The point of the surface at (u, v) in the unit square, and its normal. `u` runs around the axis or along the
    /// width.
    fn point(&self, u: f64, v: f64) -> (DVec3, DVec3) {
        let around = |u: f64| {
            let (sin, cos) = (TAU * u).sin_cos();
            DVec3::new(cos, sin, 0.0)
        };
        match *self {
            Self::Ring { outer_diameter, inner_diameter, tilt } => {
                let (mean, width) = (0.25 * (outer_diameter + inner_diameter), 0.5 * (outer_diameter - inner_diameter));
                let (sin, cos) = tilt.sin_cos();
                let (radial, across) = (around(u), width * (v - 0.5));
                let point = radial * (mean + across * cos) * same_area(SEGMENTS) - DVec3::Z * (across * sin);
                (point, -radial * sin - DVec3::Z * cos)
            }
            Self::Rectangle { width, height } | Self::Ellipse { width, height } => {
                (DVec3::new((u - 0.5) * width, (v - 0.5) * height, 0.0), DVec3::NEG_Z)
            }
            Self::Dome { diameter, opening } => {
                // From the opening to the rim.
                let first = (opening / diameter).clamp(0.0, 1.0).asin();
                let out = polar(around(u), first + v * (0.5 * PI - first));
                (out * (0.5 * diameter), -out)
            }
            Self::Sphere { diameter } => {
                let out = polar(around(u), PI * v);
                (out * (0.5 * diameter), out)
            }
        }
    }

    /// The distance between the middles of neighbouring LEDs \[m\], at the mean radius of a ring. It is the largest
    /// diameter of discs that do not overlap.
    pub fn led_space(&self, columns: u32, rows: u32) -> f64 {
        let [along, across] = match *self {
            Self::Ring { outer_diameter, inner_diameter, .. } => {
                [0.5 * PI * (outer_diameter + inner_diameter), 0.5 * (outer_diameter - inner_diameter)]
            }
            Self::Rectangle { width, height } | Self::Ellipse { width, height } => [width, height],
            Self::Dome { diameter, .. } | Self::Sphere { diameter } => [PI * diameter, diameter],
        };
        (along / f64::from(columns.max(1))).min(across / f64::from(rows.max(1)))
    }

    /// The discs of LEDs.
    fn discs(&self, leds: Leds) -> Mesh {
        let (columns, rows) = (leds.columns.max(1), leds.rows.max(1));
        let diameter = leds.diameter.unwrap_or(LED_FILL * self.led_space(columns, rows));
        let mut mesh = Mesh::default();
        for (i, j) in (0..columns).flat_map(|i| (0..rows).map(move |j| (i, j))) {
            let at = |k: u32, n: u32| (f64::from(k) + 0.5) / f64::from(n);
            let (u, v) = (at(i, columns), at(j, rows));
            let is_inside = (2.0 * u - 1.0).hypot(2.0 * v - 1.0) <= 1.0;
            if matches!(self, Self::Ellipse { .. }) && !is_inside {
                continue;
            }
            let (point, normal) = self.point(u, v);
            let x = normal.any_orthonormal_vector();
            let radius = 0.5 * diameter;
            let disc = fan(point + normal * (LED_LIFT * diameter), radius * x, radius * x.cross(normal), LED_SEGMENTS);
            append(&mut mesh, &disc);
        }
        mesh
    }

    /// The size of the lamp that counts as its diameter \[m\].
    pub fn extent(&self) -> f64 {
        match *self {
            Self::Ring { outer_diameter, .. } => outer_diameter,
            Self::Rectangle { width, height } | Self::Ellipse { width, height } => width.max(height),
            Self::Dome { diameter, .. } | Self::Sphere { diameter } => diameter,
        }
    }
}

/// The direction at the angle `theta` from +z toward the unit vector `around`.
fn polar(around: DVec3, theta: f64) -> DVec3 {
    around * theta.sin() + DVec3::Z * theta.cos()
}

/// The factor on the radius of a regular polygon that gives it the area of the circle.
fn same_area(segments: u32) -> f64 {
    let step = TAU / f64::from(segments);
    (step / step.sin()).sqrt()
}

/// A fan of triangles over an ellipse with the half-axes `a` and `b`. Its front is on the side of `b x a`.
fn fan(center: DVec3, a: DVec3, b: DVec3, segments: u32) -> Mesh {
    let rim = (0..segments).map(|k| {
        let (sin, cos) = (TAU * f64::from(k) / f64::from(segments)).sin_cos();
        center + (a * cos + b * sin) * same_area(segments)
    });
    Mesh {
        positions: std::iter::once(center).chain(rim).map(|p| p.as_vec3()).collect(),
        triangles: (0..segments).map(|k| [0, 1 + (k + 1) % segments, 1 + k]).collect(),
        ..Mesh::default()
    }
}

/// A grid of quadrilaterals over a chart. Each winds so that its front is on the emitting side. `closed`: the last
/// column joins the first.
fn grid(columns: u32, rows: u32, closed: bool, chart: Chart<'_>) -> Mesh {
    let mut mesh = Mesh::default();
    let across = if closed { columns } else { columns + 1 };
    for (j, i) in (0..=rows).flat_map(|j| (0..across).map(move |i| (j, i))) {
        let (point, _) = chart(f64::from(i) / f64::from(columns), f64::from(j) / f64::from(rows));
        mesh.positions.push(point.as_vec3());
    }
    let index = |i: u32, j: u32| j * across + i % across;
    // Around the axis first, so that neighbouring random numbers select neighbouring triangles.
    for (i, j) in (0..columns).flat_map(|i| (0..rows).map(move |j| (i, j))) {
        let (_, normal) = chart((f64::from(i) + 0.5) / f64::from(columns), (f64::from(j) + 0.5) / f64::from(rows));
        let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
        for triangle in [[a, b, c], [a, c, d]] {
            let [p, q, r] = triangle.map(|k| mesh.positions[k as usize]);
            let face: Vec3 = (q - p).cross(r - p);
            // The quadrilaterals at a pole have one triangle only.
            if face.length_squared() > 0.0 {
                let [p, q, r] = triangle;
                let is_front = face.dot(normal.as_vec3()) > 0.0;
                mesh.triangles.push(if is_front { [p, q, r] } else { [p, r, q] });
            }
        }
    }
    mesh
}

fn append(mesh: &mut Mesh, other: &Mesh) {
    let base = mesh.positions.len() as u32;
    mesh.positions.extend_from_slice(&other.positions);
    mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|i| base + i)));
}

/// The area of a mesh \[m^2\].
pub fn area(mesh: &Mesh) -> f64 {
    placed_area(mesh, &DAffine3::IDENTITY)
}

/// The area of a placed mesh \[m^2\]. Triangles without finite corners do not count.
pub fn placed_area(mesh: &Mesh, to_world: &DAffine3) -> f64 {
    let at = |i: u32| mesh.positions.get(i as usize).map(|p| to_world.transform_point3(p.as_dvec3()));
    let triangle = |[a, b, c]: &[u32; 3]| {
        let (a, b, c) = (at(*a)?, at(*b)?, at(*c)?);
        Some(0.5 * (b - a).cross(c - a).length())
    };
    mesh.triangles.iter().filter_map(triangle).filter(|a| a.is_finite()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_geometry::geometric_normal;

    const RING: LampShape = LampShape::Ring { outer_diameter: 0.1, inner_diameter: 0.06, tilt: 0.0 };

    #[test]
    fn all_triangles_emit_toward_the_part() {
        let tilted = LampShape::Ring { outer_diameter: 0.1, inner_diameter: 0.06, tilt: 0.7 };
        let square = LampShape::Rectangle { width: 0.3, height: 0.2 };
        let leds = Some(Leds { columns: 12, rows: 2, diameter: None });
        for (shape, leds) in [(RING, None), (tilted, None), (tilted, leds), (square, None), (square, leds)] {
            let mesh = shape.meshes(leds).emitter;
            assert!(!mesh.triangles.is_empty());
            for t in 0..mesh.triangles.len() {
                let n = geometric_normal(&mesh.corners(t));
                assert!(n.z < -0.7, "{shape:?}: {n}");
                let radial = Vec3::new(mesh.corners(t)[0].x, mesh.corners(t)[0].y, 0.0).normalize_or_zero();
                let is_tilted = matches!(shape, LampShape::Ring { tilt, .. } if tilt > 0.0);
                assert!(!is_tilted || n.dot(radial) < -0.5, "{n} at {radial}");
            }
        }
        let dome = LampShape::Dome { diameter: 0.2, opening: 0.04 }.surface();
        for t in 0..dome.triangles.len() {
            let [a, ..] = dome.corners(t);
            assert!(geometric_normal(&dome.corners(t)).dot(a) < 0.0);
        }
        let sphere = LampShape::Sphere { diameter: 0.2 }.surface();
        assert!(
            (0..sphere.triangles.len()).all(|t| geometric_normal(&sphere.corners(t)).dot(sphere.corners(t)[0]) > 0.0)
        );
    }
}
