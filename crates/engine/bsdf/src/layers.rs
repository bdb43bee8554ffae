//! Light that the layers of a principled surface leave to what lies below them.
//!
//! The specular lobe, the clear coat and the sheen reflect the share `E(mu)` of the light of a direction with cosine
//! `mu`: their *directional albedo*. The layers below receive at most `T = 1 - E`. Two factors conserve energy and are
//! reciprocal:
//! - a diffuse lobe of albedo `a` below is `a / pi T(wo) T(wi) / T_mean`, with the cosine-weighted mean of `T`. Its
//!   albedo is `a T(wo)` (Kelemen and Szirmay-Kalos 2001; Kulla and Conty 2017);
//! - any other lobe below is scaled by `min(T(wo), T(wi))`.
//!
//! `T` is linear between nodes ([`Curve`]). The nodes come from tables, which are computed on first use. The nodes of
//! a table are lowered until its interpolation is nowhere above the exact value at the nodes and midway between them.
//! So a table loses light (0.2 % in the mean) and does not create it.

use crate::fresnel::{self, normal_reflectance};
use crate::microfacet::{Ggx, reflect};
use crate::{InLanes, clearcoat, sheen};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, V3, ln};
use std::array::from_fn;
use std::f32::consts::PI;
use std::sync::LazyLock;

/// Number of nodes of a curve.
const NODES: usize = 16;
/// Number of nodes and midpoints.
const FINE: usize = 2 * NODES - 1;
/// Nodes are dense below this cosine.
const BEND: f32 = 0.35;

/// A function of the cosine of a direction: linear in `(1 + BEND) mu / (mu + BEND)` between equidistant nodes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Curve([f32; NODES]);

impl Curve {
    /// One for all directions.
    pub const ONE: Self = Self([1.0; NODES]);

    /// The mean over the hemisphere, weighted by the cosine.
    pub fn mean(&self) -> f32 {
        self.0.iter().zip(MEAN.iter()).map(|(value, weight)| value * weight).sum()
    }

    /// A function of the values of two curves at each node.
    #[inline]
    pub fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(from_fn(|k| f(self.0[k], other.0[k])))
    }
}

/// The curves of a principled surface in one lane: the shares of the light of a direction that reach the diffuse lobe, and
/// that pass coat and sheen.
pub type Shares = [Curve; 2];
/// Number of the curve of the diffuse lobe.
pub const DIFFUSE: usize = 0;
/// Number of the curve of the other lobes below coat and sheen.
pub const SPECULAR: usize = 1;

/// The curves of a surface, or references to those of the surface of each lane.
pub trait Curves {
    /// The curves in a lane.
    fn of(&self, lane: usize) -> &Shares;

    /// The values of a curve for cosines in `[0, 1]`.
    #[inline(always)]
    fn at<F: Lanes>(&self, curve: usize, cos: F) -> F {
        let x = cos * ((1.0 + BEND) * (NODES - 1) as f32) / (cos + BEND);
        let low = (x - 0.5).clamp(0.0, (NODES - 2) as f32).round();
        let node = F::word_to_array(low.round_to_word());
        let [mut a, mut b] = [[0.0; MAX_WIDTH]; 2];
        for lane in 0..F::WIDTH {
            let (nodes, node) = (&self.of(lane)[curve].0, node[lane] as usize);
            // The remainders are those numbers. With them no check of the range is necessary.
            [a[lane], b[lane]] = [nodes[node % NODES], nodes[(node + 1) % NODES]];
        }
        let (a, b) = (F::load(cos.token(), &a), F::load(cos.token(), &b));
        a + (b - a) * (x - low)
    }
}

impl Curves for Shares {
    #[inline(always)]
    fn of(&self, _: usize) -> &Shares {
        self
    }
}

impl Curves for [&Shares; MAX_WIDTH] {
    #[inline(always)]
    fn of(&self, lane: usize) -> &Shares {
        self[lane]
    }
}

impl<F: Lanes> InLanes<F> for Shares {
    type Lanes<'a> = [&'a Self; MAX_WIDTH];
    #[inline(always)]
    fn collect<'a>(_: F::Token, of: impl Fn(usize) -> &'a Self + Copy) -> Self::Lanes<'a> {
        let mut lanes = [of(0); MAX_WIDTH];
        for (lane, shares) in lanes.iter_mut().enumerate().take(F::WIDTH) {
            *shares = of(lane);
        }
        lanes
    }
}

/// The cosine of a node; `node` counts from 0 to `NODES - 1` and may lie between nodes.
fn node_cosine(node: f32) -> f32 {
    let t = node / (NODES - 1) as f32;
    (BEND * t / (1.0 + BEND - t)).clamp(1e-4, 1.0)
}

/// Weights of the nodes in [`Curve::mean`].
static MEAN: LazyLock<[f32; NODES]> = LazyLock::new(|| {
    const STEPS: usize = 5_000;
    let cosines = || (0..STEPS).map(|i| (i as f32 + 0.5) / STEPS as f32);
    let sum = |values: [f32; NODES]| cosines().map(|c| f64::from(c * [Curve(values); 2].at(DIFFUSE, c))).sum::<f64>();
    let total = sum([1.0; NODES]);
    from_fn(|k| (sum(from_fn(|j| f32::from(u8::from(j == k)))) / total) as f32)
});

/// `1 - E` of a dielectric specular lobe, for each direction; a lower bound.
///
/// For two different slopes it is the lower one of two isotropic surfaces.
pub fn below_specular(ggx: &Ggx, eta: f32) -> Curve {
    if eta == 1.0 {
        return Curve::ONE;
    }
    let x = root_reflectance(eta);
    // See `BELOW_SPECULAR`.
    let x = 0.5 + 0.5 * if x < 0.0 { x.min(-STEP) } else { x };
    let curve = |alpha: f32| BELOW_SPECULAR.at([x, 1.0 - ln(alpha) / ln(LEAST_SLOPE)]);
    let [x, y] = ggx.slopes();
    if x == y { curve(x) } else { curve(x).zip(curve(y), f32::min) }
}

/// `1 - E` of clear coat and sheen together, each with its strength; a lower bound.
pub fn below_coat_and_sheen(coat: f32, coat_alpha: f32, sheen: f32) -> Curve {
    let mut curve = Curve::ONE;
    if coat > 0.0 {
        let x = ln(coat_alpha / GLOSSIEST) / ln(SATIN / GLOSSIEST);
        curve = curve.zip(BELOW_COAT.at([0.0, x]), |sum, below| sum - coat * (1.0 - below));
    }
    if sheen > 0.0 {
        curve = curve.zip(BELOW_SHEEN.at([0.0; 2]), |sum, below| sum - sheen * (1.0 - below));
    }
    curve.zip(curve, |sum, _| sum.max(0.0))
}

/// The least slope of a principled surface.
pub const LEAST_SLOPE: f32 = 0.001;
/// Widths of the coat of gloss 0 and 1.
const SATIN: f32 = 0.1;
const GLOSSIEST: f32 = 0.001;
/// Distance of the nodes of [`BELOW_SPECULAR`] in [`root_reflectance`].
const STEP: f32 = 2.0 / 30.0;

/// Root of the amplitude at normal incidence, negative toward a thinner medium.
fn root_reflectance(eta: f32) -> f32 {
    normal_reflectance(eta).sqrt().sqrt().copysign(eta - 1.0)
}

/// Coordinates: index by [`root_reflectance`], logarithm of the slope.
///
/// Toward a thinner medium the curves have a step at the critical angle. `E` falls with the index there, so a node has
/// the value of the node below it, and the interpolation is a lower bound.
static BELOW_SPECULAR: LazyLock<Table> = LazyLock::new(|| {
    const COSINES: usize = 64;
    let fresnel = |index: f32| -> [f32; COSINES + 1] {
        let x = 2.0 * index - 1.0;
        let x = if x < -0.75 * STEP { x - STEP } else { x.max(0.0) };
        let r = (x * x.abs()).clamp(-0.999, 0.999);
        from_fn(|k| fresnel::dielectric(k as f32 / COSINES as f32, (1.0 + r) / (1.0 - r)).reflectance)
    };
    // The Fresnel term is linear between cosines: the distribution of the cosines is computed once for all indices.
    let cosines = |x: f32| -> [[f32; COSINES + 1]; FINE] {
        let alpha = LEAST_SLOPE.powf(1.0 - x);
        let ggx = Ggx::new(alpha, alpha);
        from_fn(|k| {
            let wo = toward(k);
            let bound = ggx.pdf_visible(wo, wo) / (4.0 * ggx.pdf_bounded_reflection(wo, wo));
            let mut shares = [0.0; COSINES + 1];
            cubature(|u, weight| {
                let m = ggx.sample_bounded(wo, u);
                let wi = reflect(wo, m);
                if wi.z > 0.0 {
                    let x = wo.dot(m).clamp(0.0, 1.0) * COSINES as f32;
                    let low = (x as usize).min(COSINES - 1);
                    let share = weight * bound * ggx.g1(wi);
                    shares[low] += share * (1.0 - x + low as f32);
                    shares[low + 1] += share * (x - low as f32);
                }
            });
            shares
        })
    };
    Table::new([31, 20], fresnel, cosines, |fresnel, cosines| {
        cosines.each_ref().map(|shares| 1.0 - shares.iter().zip(fresnel).map(|(s, f)| s * f).sum::<f32>())
    })
});

/// Coordinate: logarithm of the width.
static BELOW_COAT: LazyLock<Table> = LazyLock::new(|| {
    let below = |x: f32| -> [f32; FINE] {
        let coat = clearcoat::Coat::new(GLOSSIEST * (SATIN / GLOSSIEST).powf(x));
        from_fn(|k| {
            let (wo, mut sum) = (toward(k), 0.0);
            cubature(|[u0, u1], weight| {
                let m = coat.sample_half_vector([u1, u0]);
                let (wi, cos_d) = (reflect(wo, m), wo.dot(m));
                if cos_d > 0.0 && wi.z > 0.0 {
                    sum += weight * coat.eval(wo, wi, m) / coat.pdf_reflection(m, cos_d);
                }
            });
            1.0 - sum
        })
    };
    Table::new([1, 5], |_| (), below, |(), below| *below)
});

/// A single curve.
static BELOW_SHEEN: LazyLock<Table> = LazyLock::new(|| {
    let below = from_fn(|k| {
        let (wo, mut sum) = (toward(k), 0.0);
        cubature(|[u0, u1], weight| {
            let cos = 1.0 - u1;
            let sin = (1.0 - cos * cos).sqrt();
            let turn = 2.0 * PI * u0;
            let wi = V3::new(sin * turn.cos(), sin * turn.sin(), cos);
            let cos_d = (0.5 + 0.5 * wo.dot(wi)).max(0.0).sqrt();
            sum += weight * 2.0 * PI * sheen::eval_sheen(wi.z, cos_d);
        });
        1.0 - sum
    });
    Table::new([1, 1], |_| (), |_| (), |(), ()| below)
});

/// The direction of a node or midpoint of a curve.
fn toward(fine: usize) -> V3<f32> {
    let cos = node_cosine(0.5 * fine as f32);
    V3::new(((1.0 - cos) * (1.0 + cos)).sqrt(), 0.0, cos)
}

/// Points and weights over the unit square for lobes that are symmetric in the first coordinate: half of it is enough.
fn cubature(mut visit: impl FnMut([f32; 2], f32)) {
    const OUTWARD: usize = 32;
    const AROUND: usize = 16;
    for i in 0..OUTWARD {
        // Dense at both ends, where the integrands bend: u = v^2 (3 - 2 v).
        let v = (i as f32 + 0.5) / OUTWARD as f32;
        let weight = 6.0 * v * (1.0 - v) / (OUTWARD * AROUND) as f32;
        for k in 0..AROUND {
            visit([(k as f32 + 0.5) / (2 * AROUND) as f32, v * v * (3.0 - 2.0 * v)], weight);
        }
    }
}

/// Curves on a grid over the unit square, with linear interpolation.
struct Table(Vec<Vec<Curve>>);

impl Table {
    /// A lower bound of `of(f(x), g(y))`, which contains the values of nodes and midpoints.
    fn new<A, B>(
        sizes: [usize; 2],
        f: impl Fn(f32) -> A,
        g: impl Fn(f32) -> B,
        of: impl Fn(&A, &B) -> [f32; FINE],
    ) -> Self {
        let fine = |size: usize| (0..2 * size - 1).map(move |k| k as f32 / (2 * size - 2).max(1) as f32);
        let (a, b): (Vec<A>, Vec<B>) = (fine(sizes[0]).map(f).collect(), fine(sizes[1]).map(g).collect());
        let exact: Vec<Vec<[f32; FINE]>> = a.iter().map(|a| b.iter().map(|b| of(a, b)).collect()).collect();
        let at_nodes = |row: &Vec<[f32; FINE]>| -> Vec<Curve> {
            row.iter().step_by(2).map(|values| Curve(from_fn(|k| values[2 * k].max(0.0)))).collect()
        };
        let mut curves: Vec<Vec<Curve>> = exact.iter().step_by(2).map(at_nodes).collect();
        let span = |x: usize| x / 2..=x.div_ceil(2);
        for (i, row) in exact.iter().enumerate() {
            for (j, values) in row.iter().enumerate() {
                for (k, exact) in values.iter().enumerate() {
                    let nodes =
                        || span(i).flat_map(move |i| span(j).flat_map(move |j| span(k).map(move |k| (i, j, k))));
                    let sum: f32 = nodes().map(|(i, j, k)| curves[i][j].0[k]).sum();
                    let lower = exact.max(0.0) * nodes().count() as f32 / sum;
                    if lower < 1.0 {
                        nodes().for_each(|(i, j, k)| curves[i][j].0[k] *= lower);
                    }
                }
            }
        }
        Self(curves)
    }

    fn at(&self, at: [f32; 2]) -> Curve {
        let between = |size: usize, x: f32| {
            let x = x.clamp(0.0, 1.0) * (size - 1) as f32;
            let low = (x as usize).min(size.saturating_sub(2));
            (low, (low + 1).min(size - 1), x - low as f32)
        };
        let (low, high, f) = between(self.0.len(), at[0]);
        let (left, right, g) = between(self.0[low].len(), at[1]);
        let [a, b, c, d] = [(low, left), (low, right), (high, left), (high, right)].map(|(i, j)| &self.0[i][j].0);
        let [wa, wb, wc, wd] = [(1.0 - f) * (1.0 - g), (1.0 - f) * g, f * (1.0 - g), f * g];
        Curve(from_fn(|k| wa * a[k] + wb * b[k] + wc * c[k] + wd * d[k]))
    }
}
