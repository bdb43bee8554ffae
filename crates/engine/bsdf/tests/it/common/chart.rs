//! Charts of directions: maps from the unit square that resolve lobes of any width, in f64.
//!
//! A chart of facets maps the slope of the half vector, in units of the roughness, to the square: azimuth, and `r^2 /
//! (1 + r^2)`, which is uniform for the visible facets at a normal view (Walter et al. 2007).

use dunkelfeld_bsdf::Bsdf;
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_testkit::integrate_square;
use std::f64::consts::{PI, TAU};

type V = [f64; 3];

/// Cosine below which a direction is near the horizon.
const LOW: f64 = 0.25;

/// Number of parts of a square's side that are integrated separately.
const CUTS: usize = 2;

/// Change of direction at a facet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Way {
    /// Mirrored.
    Reflect,
    /// Refracted; the index of refraction below the surface over the one above.
    Refract(f64),
    /// Mirrored, and then mirrored at the surface: transmission through a rough sheet.
    Pass,
    /// The facet's own normal is the direction, whatever `wo`.
    Normal,
}

/// A map from the unit square to directions, for one `wo`.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Chart {
    /// Uniform in the cosine of the upper hemisphere, or of the lower one.
    Cosine { above: bool },
    /// Dense along the surface in the forward direction, on its upper or its lower side: uniform in the cubic roots of
    /// the cosine and of the angle to the plane of `wo`. Only for a `wo` near the horizon.
    Horizon { above: bool },
    /// Facets of the given slopes along x and y.
    Facets { slopes: [f64; 2], way: Way },
}

impl Chart {
    pub(crate) fn reflect(slopes: [f64; 2]) -> Self {
        Self::Facets { slopes, way: Way::Reflect }
    }

    pub(crate) fn normals(slopes: [f64; 2]) -> Self {
        Self::Facets { slopes, way: Way::Normal }
    }

    /// The direction at a point of the square, with its density there [1/sr]; `None` where no direction is.
    pub(crate) fn at(&self, wo: V, [x, y]: [f64; 2]) -> Option<(V, f64)> {
        let (sin, cos) = (TAU * x).sin_cos();
        match *self {
            Self::Cosine { above } => {
                let r = y.sqrt();
                let z = (1.0 - y).sqrt() * if above { 1.0 } else { -1.0 };
                Some(([r * cos, r * sin, z], z.abs() / PI))
            }
            Self::Horizon { .. } if wo[2].abs() > LOW => None,
            Self::Horizon { above } => {
                let (s, t) = (2.0 * x - 1.0, y);
                let z = t.powi(3);
                let (r, phi) = ((1.0 - z * z).sqrt(), PI * s.powi(3) + (-wo[1]).atan2(-wo[0]));
                let wi = [r * phi.cos(), r * phi.sin(), if above { z } else { -z }];
                Some((wi, 1.0 / (18.0 * PI * (s * t).powi(2))))
            }
            Self::Facets { slopes: [ax, ay], way } => {
                let r = (y / (1.0 - y)).sqrt();
                let m = normalize([ax * r * cos, ay * r * sin, 1.0]);
                if way == Way::Normal {
                    return Some((m, self.density(wo, m)));
                }
                let (up, side) = upward(wo);
                let cos_o = dot(up, m);
                if cos_o <= 0.0 {
                    return None;
                }
                let mirrored = combine(2.0 * cos_o, m, -1.0, up);
                let wi = match way {
                    Way::Reflect | Way::Pass | Way::Normal => (mirrored[2] > 0.0).then_some(mirrored)?,
                    Way::Refract(eta) => {
                        let eta = if side > 0.0 { eta } else { 1.0 / eta };
                        let cos2 = 1.0 - (1.0 - cos_o * cos_o) / (eta * eta);
                        let wi = combine(cos_o / eta - cos2.max(0.0).sqrt(), m, -1.0 / eta, up);
                        (cos2 > 0.0 && wi[2] < 0.0).then_some(wi)?
                    }
                };
                let flip = side * if way == Way::Pass { -1.0 } else { 1.0 };
                let wi = [wi[0], wi[1], wi[2] * flip];
                let density = self.density(wo, wi);
                (density > 0.0).then_some((wi, density))
            }
        }
    }

    /// Area of the square per solid angle at a direction [1/sr]; zero outside the chart.
    pub(crate) fn density(&self, wo: V, wi: V) -> f64 {
        match *self {
            Self::Cosine { above } => {
                if (wi[2] > 0.0) == above {
                    wi[2].abs() / PI
                } else {
                    0.0
                }
            }
            Self::Horizon { above } => {
                if (wi[2] > 0.0) != above || wo[2].abs() > LOW {
                    return 0.0;
                }
                let turn = (wi[0] * wo[1] - wi[1] * wo[0]).atan2(-wi[0] * wo[0] - wi[1] * wo[1]).abs();
                1.0 / (18.0 * PI * (turn / PI * wi[2].abs()).powf(2.0 / 3.0))
            }
            Self::Facets { slopes, way } => self.facet(wo, wi).map_or(0.0, |m| {
                let (up, side) = upward(wo);
                let down = [wi[0], wi[1], wi[2] * side];
                let per_direction = match way {
                    Way::Normal => 1.0,
                    Way::Reflect | Way::Pass => 0.25 / dot(up, m),
                    Way::Refract(eta) => {
                        let eta = if side > 0.0 { eta } else { 1.0 / eta };
                        let (cos_o, cos_i) = (dot(up, m), dot(down, m));
                        eta * eta * cos_i.abs() / (cos_o + eta * cos_i).powi(2)
                    }
                };
                let r2 = (m[0] / (slopes[0] * m[2])).powi(2) + (m[1] / (slopes[1] * m[2])).powi(2);
                // Slopes cover cos^-3 of the solid angle of normals, and the square pi ax ay (1 + r^2)^2 of slopes.
                per_direction / (m[2].powi(3) * PI * slopes[0] * slopes[1] * (1.0 + r2).powi(2))
            }),
        }
    }

    /// The point of the square for a direction; `None` outside the chart.
    pub(crate) fn square(&self, wo: V, wi: V) -> Option<[f64; 2]> {
        let Self::Facets { slopes, .. } = *self else { return None };
        let m = self.facet(wo, wi)?;
        let (x, y) = (m[0] / (slopes[0] * m[2]), m[1] / (slopes[1] * m[2]));
        let turn = y.atan2(x) / TAU;
        let r2 = x * x + y * y;
        Some([turn - turn.floor(), r2 / (1.0 + r2)])
    }

    /// The facet between two directions, facing up.
    fn facet(&self, wo: V, wi: V) -> Option<V> {
        let Self::Facets { way, .. } = *self else { return None };
        if way == Way::Normal {
            return (wi[2] > 0.0).then_some(wi);
        }
        let (up, side) = upward(wo);
        let wi = [wi[0], wi[1], wi[2] * side];
        let m = match way {
            Way::Reflect if wi[2] > 0.0 => combine(1.0, up, 1.0, wi),
            Way::Pass if wi[2] < 0.0 => combine(1.0, up, 1.0, [wi[0], wi[1], -wi[2]]),
            Way::Refract(eta) if wi[2] < 0.0 => combine(1.0, up, if side > 0.0 { eta } else { 1.0 / eta }, wi),
            _ => return None,
        };
        let m = normalize(if m[2] < 0.0 { m.map(|c| -c) } else { m });
        let sees_both = match way {
            Way::Refract(_) => dot(up, m) > 0.0 && dot(wi, m) < 0.0,
            _ => dot(up, m) > 0.0,
        };
        (m[2] > 0.0 && sees_both).then_some(m)
    }
}

/// The integral of `value` over all directions that some chart covers, to about 1e-5. Each chart integrates its share
/// by the power heuristic (Veach 1997). The integrand is flat where a chart resolves a lobe, and almost zero where
/// another chart resolves it better. So no chart has to resolve lobes that are narrow for it.
pub(crate) fn integrate(charts: &[Chart], wo: LocalDir, value: impl Fn(LocalDir) -> f64) -> f64 {
    let wo = wide(wo);
    let part = |chart: &Chart| {
        let f = |p: [f64; 2]| match chart.at(wo, p) {
            Some((wi, density)) => {
                let sum: f64 = charts.iter().map(|c| c.density(wo, wi).powi(2)).sum();
                value(narrow(wi)) * density / sum
            }
            None => 0.0,
        };
        // Divided in advance, so that a narrow range of directions, such as those that leave a solid along its surface,
        // is not missed.
        let cut = |k: usize| k as f64 / CUTS as f64;
        let cells = (0..CUTS * CUTS).map(|k| (k % CUTS, k / CUTS));
        cells
            .map(|(i, j)| integrate_square(&f, [cut(i), cut(j)], [cut(i + 1), cut(j + 1)], 1e-5 / (CUTS * CUTS) as f64))
            .sum::<f64>()
    };
    charts.iter().map(part).sum()
}

/// Albedo of a surface in a white furnace for `wo`, delta lobes excluded: the integral of the BSDF over the directions
/// of `charts`, with the scaling of radiance by refraction divided out.
pub(crate) fn albedo(bsdf: &Bsdf, wo: LocalDir, eta: f32, charts: &[Chart]) -> f64 {
    let eta2 = f64::from(if wo.0.z > 0.0 { eta } else { 1.0 / eta }).powi(2);
    integrate(charts, wo, |wi| f64::from(bsdf.eval(wo, wi).r) * if wo.same_side(wi) { 1.0 } else { eta2 })
}

pub(crate) fn wide(w: LocalDir) -> V {
    w.0.as_dvec3().normalize().to_array()
}

pub(crate) fn narrow(w: V) -> LocalDir {
    LocalDir::new(w[0] as f32, w[1] as f32, w[2] as f32)
}

fn upward(w: V) -> (V, f64) {
    if w[2] < 0.0 { ([w[0], w[1], -w[2]], -1.0) } else { (w, 1.0) }
}

fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn combine(s: f64, a: V, t: f64, b: V) -> V {
    [s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]]
}

fn normalize(a: V) -> V {
    let length = dot(a, a).sqrt();
    a.map(|c| c / length)
}
