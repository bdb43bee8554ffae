//! Rough clear boundaries in f64, from the published formulas and nothing of ours: GGX facets with Smith's separable masking
//! (Walter, Marschner, Li and Torrance 2007), exact Fresnel, one bounce per facet.

use super::support::fresnel;
use std::f64::consts::PI;

/// Share of the facets that face a direction of this cosine and are not hidden (Walter et al. 2007, equation 34).
pub(crate) fn visible(cos: f64, alpha: f64) -> f64 {
    2.0 * cos / (cos + (alpha * alpha * (1.0 - cos * cos) + cos * cos).sqrt())
}

/// Reflection of a rough boundary for parallel light of irradiance 1 on a plane that faces it: `F D G / (4 cos_o)`. Cosines of
/// `wo`, of `wi`, and azimuth between them.
pub(crate) fn reflected(cos_o: f64, cos_i: f64, azimuth: f64, alpha: f64, ior: f64) -> f64 {
    let (sin_o, sin_i) = ((1.0 - cos_o * cos_o).sqrt(), (1.0 - cos_i * cos_i).sqrt());
    let h = [sin_o + sin_i * azimuth.cos(), sin_i * azimuth.sin(), cos_o + cos_i];
    let length = h.iter().map(|x| x * x).sum::<f64>().sqrt();
    let m = h.map(|x| x / length);
    let e = (m[0] * m[0] + m[1] * m[1]) / (alpha * alpha) + m[2] * m[2];
    let d = 1.0 / (PI * alpha * alpha * e * e);
    let facing = (sin_o * m[0] + cos_o * m[2]).clamp(0.0, 1.0);
    fresnel(facing.acos(), ior) * d * visible(cos_o, alpha) * visible(cos_i, alpha) / (4.0 * cos_o)
}

/// An endless plate with two rough faces.
pub(crate) struct Plate {
    pub(crate) alpha: f64,
    pub(crate) ior: f64,
    /// Points along each axis of the integrals, in units of 32 cosines.
    pub(crate) fineness: usize,
}

/// Direction of the light at a face: on the side of the query, or on the other one, at this cosine.
enum Way {
    Back(f64),
    Through(f64),
}

impl Plate {
    /// Radiance that the plate shows at this cosine under a white sky on the viewer's side, and on the other one.
    ///
    /// Let `u` be what comes from one face into the plate, a function of the cosine, divided by the square of the index so
    /// that white is one inside as well: `u = R u + T s` under a sky s, where R and T are integrals over the facets of a face
    /// seen from inside. Skies of 1 on both sides give u from both faces alike; skies of 1 and -1 give u and -u. The half of
    /// sum and difference is each sky alone.
    pub(crate) fn seen_at(&self, cos: f64) -> [f64; 2] {
        let n = 32 * self.fineness;
        let faces: Vec<(Vec<f64>, f64)> = (0..n)
            .map(|k| {
                let (mut row, mut out) = (vec![0.0; n], 0.0);
                self.facets(at(k, n), 1.0 / self.ior, |share, way| match way {
                    Way::Back(cos) => between(cos, n).into_iter().for_each(|(k, w)| row[k] += w * share),
                    Way::Through(_) => out += share,
                });
                (row, out)
            })
            .collect();
        let inside = |sign: f64| {
            let mut u = vec![1.0; n];
            for _ in 0..2000 {
                let next =
                    |(row, out): &(Vec<f64>, f64)| out + sign * row.iter().zip(&u).map(|(r, u)| r * u).sum::<f64>();
                let new: Vec<f64> = faces.iter().map(next).collect();
                let step = new.iter().zip(&u).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                u = new;
                if step < 1e-9 {
                    break;
                }
            }
            u
        };
        let [even, odd] = [inside(1.0), inside(-1.0)];
        let [mut sum, mut difference] = [0.0; 2];
        self.facets(cos, self.ior, |share, way| match way {
            Way::Back(_) => {
                sum += share;
                difference += share;
            }
            Way::Through(cos) => {
                let of = |u: &[f64]| between(cos, n).into_iter().map(|(k, w)| w * u[k]).sum::<f64>();
                sum += share * of(&even);
                difference -= share * of(&odd);
            }
        });
        [0.5 * (sum + difference), 0.5 * (sum - difference)]
    }

    /// All facets that are seen from a direction of this cosine, each with where it sends light and how much of it arrives;
    /// `eta` is the index on the other side over the one on this side.
    ///
    /// Slopes r alpha have the density `r dr dphi / (pi (1 + r^2)^2)`, even in `q^2 = 1 / (1 + r^2)`; a facet is seen with its
    /// projection over the cosine. In q the product has no pole.
    fn facets(&self, cos: f64, eta: f64, mut visit: impl FnMut(f64, Way)) {
        let (turns, radii) = (48 * self.fineness, 128 * self.fineness);
        let sin = (1.0 - cos * cos).sqrt();
        let seen = visible(cos, self.alpha) / cos;
        for i in 0..radii {
            let q = (i as f64 + 0.5) / radii as f64;
            let slope = self.alpha * (1.0 - q * q).sqrt() / q;
            let upright = 1.0 / (1.0 + slope * slope).sqrt();
            for k in 0..turns {
                let phi = PI * (k as f64 + 0.5) / turns as f64;
                let facing = cos + sin * slope * phi.cos();
                if facing <= 0.0 {
                    continue;
                }
                let share = seen * facing * 2.0 * q / (turns * radii) as f64;
                let c = (facing * upright).min(1.0);
                let f = fresnel(c.acos(), eta);
                let up = 2.0 * c * upright - cos;
                if up > 0.0 {
                    visit(share * f * visible(up, self.alpha), Way::Back(up));
                }
                if f < 1.0 {
                    let bent = (1.0 - (1.0 - c * c) / (eta * eta)).sqrt();
                    // The refracted direction is (c / eta - bent) m - w / eta.
                    let down = cos / eta - (c / eta - bent) * upright;
                    if down > 0.0 {
                        visit(share * (1.0 - f) * visible(down.min(1.0), self.alpha), Way::Through(down.min(1.0)));
                    }
                }
            }
        }
    }
}

/// Node k of n: dense toward the horizon.
fn at(k: usize, n: usize) -> f64 {
    ((k as f64 + 0.5) / n as f64).powi(2)
}

/// The two nodes about a cosine, with the weights of linear interpolation.
fn between(cos: f64, n: usize) -> [(usize, f64); 2] {
    let x = (cos.sqrt() * n as f64 - 0.5).clamp(0.0, n as f64 - 1.0);
    let low = (x as usize).min(n - 2);
    [(low, 1.0 - (x - low as f64)), (low + 1, x - low as f64)]
}

#[test]
fn facets_of_no_slope_are_the_fresnel_formula_and_those_of_slope_one_have_their_closed_form() {
    let angle = 0.6f64;
    let smooth = Plate { alpha: 1e-3, ior: 1.5, fineness: 1 }.seen_at(angle.cos());
    let through = super::support::through_faces(2.0, fresnel(angle, 1.5));
    // R bends by 1e-6 over such slopes; between nodes 1/32 apart in the root of the cosine by 1e-3 of itself.
    assert!((smooth[0] - (1.0 - through)).abs() < 1e-3 && (smooth[1] - through).abs() < 1e-3, "{smooth:?}, {through}");
    // Slope one, seen from above, mirrors of everything: 1 - ln 2 (derived in crates/engine/bsdf/tests/it/furnace.rs).
    let mut all = 0.0;
    Plate { alpha: 1.0, ior: 1e9, fineness: 1 }.facets(1.0, 1e9, |share, way| match way {
        Way::Back(_) => all += share,
        Way::Through(_) => {}
    });
    assert!((all - (1.0 - std::f64::consts::LN_2)).abs() < 1e-3, "{all}");
}
