//! The irradiance that a lamp gives on its axis, by adaptive quadrature over its triangles.

use crate::light::emission_profile::EmissionProfile;
use dunkelfeld_geometry::{DVec3, Mesh};

/// Deviation between a triangle and its four parts that ends the subdivision, relative to the result.
const TOLERANCE: f64 = 1e-6;

/// Largest radius of a part before its error is estimated, in units of the length over which the integrand changes.
const FIRST_RADIUS: f64 = 0.4;

/// A part with a smaller radius in that unit is not divided further. It limits the work at the edge of a profile.
const LAST_RADIUS: f64 = 1.0 / 512.0;

/// Depth of the subdivision. It ends the subdivision of triangles that touch the receiver.
const MAX_DEPTH: u32 = 24;

/// Irradiance [W/m^2] per radiance [W/(m^2 sr)] along the normal of a lamp, at the point (0, 0, -distance) of its frame
/// on a surface that faces the lamp, without occlusion: the integral of `profile(mu) mu cos / d^2` over its surface. The
/// relative error is below 1e-4, also for profiles of a few degrees.
///
/// A triangle is divided until its parts are small against their distance and against the width of the profile, then
/// until a part and its own four parts agree.
pub fn irradiance_on_axis(emitter: &Mesh, profile: &EmissionProfile, distance: f64) -> f64 {
    let receiver = DVec3::new(0.0, 0.0, -distance);
    let faces = (0..emitter.triangles.len()).filter_map(|t| {
        let corners = emitter.corners(t).map(|p| p.as_dvec3());
        Some((Face::new(corners, profile, receiver)?, corners))
    });
    let mut parts = Vec::new();
    for (face, corners) in faces {
        face.divide(corners, 0, &mut parts);
    }
    let first: f64 = parts.iter().map(|part| part.value).sum();
    let allowed = TOLERANCE * first / parts.len().max(1) as f64;
    parts.iter().map(|part| part.face.refined(part.corners, part.value, allowed)).sum()
}

/// The plane of a triangle, with the integrand.
#[derive(Clone, Copy)]
struct Face<'a> {
    profile: &'a EmissionProfile,
    receiver: DVec3,
    /// Unit normal of the emitting side.
    normal: DVec3,
    /// The point of the plane that is nearest to the receiver.
    foot: DVec3,
    /// Distance of the receiver from the plane \[m\], above 0.
    height: f64,
}

/// A part of a triangle, and its value by the rule.
struct Part<'a> {
    face: Face<'a>,
    corners: [DVec3; 3],
    value: f64,
}

impl<'a> Face<'a> {
    /// `None` if the receiver is not in front of the triangle.
    fn new([a, b, c]: [DVec3; 3], profile: &'a EmissionProfile, receiver: DVec3) -> Option<Self> {
        let normal = (b - a).cross(c - a).try_normalize()?;
        let height = (receiver - a).dot(normal);
        (height > 0.0).then(|| Self { profile, receiver, normal, foot: receiver - height * normal, height })
    }

    /// Divides a triangle until its parts are small against the length over which the integrand changes. Parts that do
    /// not emit toward the receiver are left out.
    fn divide(self, corners: [DVec3; 3], depth: u32, parts: &mut Vec<Part<'a>>) {
        let (center, radius) = circle(corners);
        if (center.distance(self.foot) - radius) > self.height * self.profile.cutoff_tangent() {
            return;
        }
        if depth < MAX_DEPTH && radius > FIRST_RADIUS * self.scale(center, radius) {
            quarters(corners).into_iter().for_each(|quarter| self.divide(quarter, depth + 1, parts));
        } else {
            parts.push(Part { face: self, corners, value: self.rule(corners) });
        }
    }

    /// The integral over a part with the value `value` by the rule, with an error below the larger of `allowed` and
    /// [`TOLERANCE`] times itself.
    fn refined(self, corners: [DVec3; 3], value: f64, allowed: f64) -> f64 {
        let quarters = quarters(corners);
        let values = quarters.map(|quarter| self.rule(quarter));
        let sum: f64 = values.iter().sum();
        let (center, radius) = circle(corners);
        let agrees = (sum - value).abs() <= allowed.max(TOLERANCE * sum);
        if self.resolves_edges(center, radius) && (agrees || radius < LAST_RADIUS * self.scale(center, radius)) {
            return sum;
        }
        // At an edge of the profile two of four parts have an error.
        quarters.into_iter().zip(values).map(|(quarter, value)| self.refined(quarter, value, 0.5 * allowed)).sum()
    }

    /// Is a part small, or away from the edges of the profile? All points of the rule may lie on one side of an edge.
    fn resolves_edges(self, center: DVec3, radius: f64) -> bool {
        let distance = center.distance(self.foot);
        self.profile.edges().into_iter().all(|(tangent, share)| {
            let edge = self.height * tangent;
            edge <= 0.0 || (distance - edge).abs() > radius || radius < share * edge
        })
    }

    /// A length over which the integrand changes around a part \[m\]: the distance of the receiver, or the width of the
    /// profile on the plane.
    fn scale(self, center: DVec3, radius: f64) -> f64 {
        let nearest = (center.distance(self.receiver) - radius).max(self.height);
        nearest.min(self.height * self.profile.width_tangent())
    }

    /// The quadrature of degree 5 with seven points (Radon 1948).
    fn rule(self, corners: [DVec3; 3]) -> f64 {
        let [a, b, c] = corners;
        let root = 15f64.sqrt();
        let center = (a + b + c) / 3.0;
        // The points of an orbit lie between the centre and the corners, or beyond the centre.
        let orbit = |toward: f64| corners.map(|p| self.integrand(center + toward * (p - center))).iter().sum::<f64>();
        let mean = 0.225 * self.integrand(center)
            + (155.0 - root) / 1200.0 * orbit((1.0 + root) / 7.0)
            + (155.0 + root) / 1200.0 * orbit((1.0 - root) / 7.0);
        0.5 * (b - a).cross(c - a).length() * mean
    }

    fn integrand(self, point: DVec3) -> f64 {
        let to_receiver = self.receiver - point;
        let d2 = to_receiver.length_squared();
        let direction = to_receiver / d2.sqrt();
        let mu = direction.dot(self.normal);
        self.profile.eval_f64(mu) * mu.max(0.0) * (-direction.z).max(0.0) / d2
    }
}

/// The centre of a triangle, and the radius around it that contains the triangle.
fn circle(corners: [DVec3; 3]) -> (DVec3, f64) {
    let [a, b, c] = corners;
    let center = (a + b + c) / 3.0;
    (center, corners.iter().map(|p| p.distance(center)).fold(0.0, f64::max))
}

/// The four similar parts of a triangle.
fn quarters([a, b, c]: [DVec3; 3]) -> [[DVec3; 3]; 4] {
    let [ab, bc, ca] = [0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)];
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lamps::LampShape;
    use std::f64::consts::{PI, TAU};

    fn agree(name: &str, value: f64, expected: f64, tolerance: f64) {
        assert!((value / expected - 1.0).abs() < tolerance, "{name}: {value} instead of {expected}");
    }

    /// The irradiance of the sector of a disc up to the angle `theta` from the axis, per angle around it. It is the
    /// integral of `profile sin cos` over theta.
    fn sector(profile: &EmissionProfile, theta: f64) -> f64 {
        match *profile {
            EmissionProfile::Lambertian => 0.5 * theta.sin().powi(2),
            EmissionProfile::CosinePower { exponent } => {
                let n = f64::from(exponent) + 2.0;
                (1.0 - theta.cos().powf(n)) / n
            }
            EmissionProfile::Louver { half_angle } => {
                let a = f64::from(half_angle);
                let t = theta.min(a);
                0.5 * t.sin().powi(2) - 0.5 * (t - t.sin() * t.cos()) / a.tan()
            }
            // The square of the ramp over its width, and the full cone.
            EmissionProfile::Spot { cos_inner, cos_outer } => {
                let (inner, outer) = (f64::from(cos_inner), f64::from(cos_outer));
                let top = theta.cos().max(outer);
                let full = 1.0 - top.max(inner);
                let edge = |mu: f64| ((mu - outer) / (inner - outer)).clamp(0.0, 1.0).powi(3) * (inner - outer) / 3.0;
                full + if inner > outer { edge(inner) - edge(top) } else { 0.0 }
            }
        }
    }

    fn profiles() -> Vec<EmissionProfile> {
        let mut all = vec![EmissionProfile::Lambertian];
        for degrees in [60.0, 5.0, 2.0f64] {
            let half_angle = 0.5 * degrees.to_radians();
            all.push(EmissionProfile::from_half_intensity_angle(half_angle));
            all.push(EmissionProfile::Louver { half_angle: half_angle as f32 });
            let cos_outer = half_angle.cos() as f32;
            all.push(EmissionProfile::Spot { cos_inner: (0.7 * half_angle).cos() as f32, cos_outer });
        }
        let hard = 5f64.to_radians().cos() as f32;
        all.push(EmissionProfile::Spot { cos_inner: hard, cos_outer: hard });
        all
    }

    /// Rectangles of all profiles down to 2 degrees. In polar coordinates around the axis the radial integral has a closed
    /// form; the periodic one around the axis is a sum over angles, from each side of the rectangle by itself.
    #[test]
    fn rectangles_on_their_axis_by_sectors() {
        for (width, height, distance) in [(0.08, 0.08, 0.12), (0.1, 0.1, 0.2), (0.1, 0.01, 0.2), (0.3, 0.2, 0.02)] {
            let mesh = LampShape::Rectangle { width, height }.meshes(None).emitter;
            for profile in profiles() {
                let side = |half: f64, other: f64| {
                    let last = (other / half).atan();
                    let n = 4000;
                    let theta = |i: i32| (half / distance / (last * (f64::from(i) + 0.5) / f64::from(n)).cos()).atan();
                    last / f64::from(n) * (0..n).map(|i| sector(&profile, theta(i))).sum::<f64>()
                };
                let expected = 4.0 * (side(0.5 * width, 0.5 * height) + side(0.5 * height, 0.5 * width));
                let name = format!("{profile:?}, {width} x {height} at {distance}");
                agree(&name, irradiance_on_axis(&mesh, &profile, distance), expected, 5e-5);
            }
        }
    }

    /// Closed forms of round lamps: a disc and the difference of two. Their polygons have the area of the circle, which
    /// leaves a deviation of their own where the profile has no end before their outline.
    #[test]
    fn discs_and_rings_on_their_axis() {
        let ring = LampShape::Ring { outer_diameter: 0.1, inner_diameter: 0.06, tilt: 0.0 };
        for h in [0.05, 0.2, 1.0] {
            for profile in profiles() {
                let disc = |r: f64| TAU * sector(&profile, (r / h).atan());
                let mesh = LampShape::Ellipse { width: 0.1, height: 0.1 }.meshes(None).emitter;
                let name = format!("{profile:?} at {h}");
                let is_inside = profile.cutoff_tangent() * h < 0.0499;
                let tolerance = if is_inside { 5e-5 } else { 1e-3 };
                agree(&name, irradiance_on_axis(&mesh, &profile, h), disc(0.05), tolerance);
                let expected = disc(0.05) - disc(0.03);
                if expected > 0.1 * disc(0.05) {
                    let value = irradiance_on_axis(&ring.meshes(None).emitter, &profile, h);
                    agree(&format!("ring, {name}"), value, expected, 5e-3);
                } else if is_inside && profile.cutoff_tangent() * h < 0.0299 {
                    let value = irradiance_on_axis(&ring.meshes(None).emitter, &profile, h);
                    assert!(value < 1e-12, "{name}: {value}");
                }
            }
        }
    }

    /// A Lambertian polygon has a closed form (Lambert 1760): rings of any tilt by their facets.
    #[test]
    fn tilted_rings_and_domes_by_the_contours_of_their_facets() {
        let ring = |tilt| LampShape::Ring { outer_diameter: 0.1, inner_diameter: 0.06, tilt };
        let dome = LampShape::Dome { diameter: 0.2, opening: 0.05 };
        for (shape, h) in [(ring(0.7), 0.05), (ring(0.7), 0.3), (ring(0.5 * PI), 0.02), (dome, 1e-3), (dome, 0.1)] {
            let mesh = shape.meshes(None).emitter;
            let receiver = DVec3::new(0.0, 0.0, -h);
            let facet = |t: usize| {
                let corners = mesh.corners(t).map(|p| p.as_dvec3() - receiver);
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                if normal.dot(corners[0]) >= 0.0 {
                    return 0.0;
                }
                let edge = |(a, b): (DVec3, DVec3)| {
                    let across = a.cross(b);
                    across.length().atan2(a.dot(b)) * across.normalize_or_zero().z
                };
                let [a, b, c] = corners;
                0.5 * [(a, b), (b, c), (c, a)].map(edge).iter().sum::<f64>().abs()
            };
            let expected: f64 = (0..mesh.triangles.len()).map(facet).sum();
            let value = irradiance_on_axis(&mesh, &EmissionProfile::Lambertian, h);
            agree(&format!("{shape:?} at {h}"), value, expected, 1e-5);
        }
    }
}
