//! Energy compensation: a factor that restores the energy that the microfacet model loses between facets (Turquin
//! 2019).
//!
//! In Smith's model light meets one facet. Light that a second facet would scatter is lost, up to two thirds of it for
//! rough metal. Turquin (2019) scales the lobe by the missing energy. A white, perfectly reflecting surface of
//! *directional albedo* `E(wo)` has the factor `1 / E(wo)`. A surface of reflectance `F0` at normal incidence has the
//! factor `1 + F0 (1 - E) / E`. A clear boundary, which absorbs nothing, has the inverse of the sum of its reflection
//! and its transmission.
//!
//! The factor depends on `wo` alone. So the density of the samples does not change, and a surface in a white furnace
//! scatters all of its light. The cost is reciprocity: `f(wo, wi) / factor(wo)` is reciprocal, f itself is not. An
//! estimator that traces light in one direction only, as this one does, stays consistent.
//!
//! Directional albedos come from tables, which are computed on first use by cubature of the same lobes. They are upper
//! bounds, so that a factor does not create light. For cosines of the view above 0.03 a factor is at most 0.3 % too
//! small for isotropic facets that reflect everything, and 2 % for anisotropic or clear ones (`tests/it/furnace.rs`
//! integrates the lobes independently). The mean is 0.03 % and 0.3 %. An anisotropic clear boundary is compensated in
//! part.

use crate::fresnel;
use crate::microfacet::{Ggx, reflect};
use crate::transmission::refract;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use std::array::from_fn;
use std::sync::LazyLock;

/// Directional albedo of a GGX surface whose facets reflect all light, in the lanes of a mask; 1 in the others.
#[inline(always)]
pub fn reflected_once<F: Lanes>(mask: F::Mask, ggx: &Ggx<F>, wo: V3<F>) -> F {
    lane_by_lane(mask, ggx, wo, wo.z, isotropic_or_not)
}

/// Reflection plus transmission of a clear GGX boundary in the lanes of a mask; 1 in the others. `eta` is the index behind
/// over the one in front.
///
/// Anisotropic boundaries are treated as isotropic ones of the smaller slope, which lose less.
#[inline(always)]
pub fn scattered_once<F: Lanes>(mask: F::Mask, ggx: &Ggx<F>, wo: V3<F>, eta: F) -> F {
    lane_by_lane(mask, ggx, wo, eta, clear)
}

/// The results of a function of slopes, `wo` and `eta`: few scenes need it.
#[inline(always)]
fn lane_by_lane<F: Lanes>(mask: F::Mask, ggx: &Ggx<F>, wo: V3<F>, eta: F, of: fn([f32; 2], V3<f32>, f32) -> f32) -> F {
    let (token, [ax, ay]) = (eta.token(), ggx.slopes());
    let (ax, ay, wo, eta) = (ax.to_array(), ay.to_array(), wo.to_lanes(), eta.to_array());
    let mut once = [1.0; MAX_WIDTH];
    mask.each(
        #[inline(always)]
        |lane| once[lane] = of([ax[lane], ay[lane]], wo[lane].into(), eta[lane]),
    );
    F::load(token, &once)
}

#[inline(never)]
fn isotropic_or_not([ax, ay]: [f32; 2], wo: V3<f32>, _: f32) -> f32 {
    let [t, s] = coordinates(wo.z, (ax * ay).sqrt());
    if ax == ay {
        return ISOTROPIC.at([t, s]);
    }
    let (short, long) = (ax.min(ay), ax.max(ay));
    let stretch = (1.0 - (short / long).sqrt()) / (1.0 - MIN_ASPECT);
    let (x, y, sin2) = (ax * wo.x, ay * wo.y, wo.x * wo.x + wo.y * wo.y);
    let toward = if sin2 > 0.0 { ((x * x + y * y) / sin2).sqrt() } else { long };
    ANISOTROPIC.at([t, s, stretch, (toward - short) / (long - short)])
}

#[inline(never)]
fn clear([ax, ay]: [f32; 2], wo: V3<f32>, eta: f32) -> f32 {
    let [t, s] = coordinates(wo.z, ax.min(ay));
    let r = (eta - 1.0) / (eta + 1.0);
    // The remainder of the error of the table.
    (CLEAR.at([t, s, 0.5 + 0.5 * r.abs().sqrt().copysign(r)]) + 2.5e-3).min(1.0)
}

/// Cosine and slope as coordinates in the unit square. For small slopes the albedo is a function of cosine over slope,
/// which the first coordinate resolves at any scale. The coordinates are roots, because users set the root of the
/// slope.
fn coordinates(cos: f32, alpha: f32) -> [f32; 2] {
    let (c, s) = (cos.sqrt(), alpha.min(1.0).sqrt());
    [c * (1.0 + s) / (c + s), s]
}

/// The inverse of [`coordinates`]: a direction in the plane y = 0, and the slope.
fn from_coordinates(t: f32, s: f32) -> (V3<f32>, f32) {
    // For a smooth surface every cosine has the same coordinate.
    let c = if s > 0.0 { (t * s / (1.0 + s - t)).clamp(1e-3, 1.0) } else { 1.0 };
    let cos = c * c;
    (V3::new(((1.0 - cos) * (1.0 + cos)).sqrt(), 0.0, cos), s * s)
}

/// Coordinates: cosine, slope.
static ISOTROPIC: LazyLock<Table<2>> = LazyLock::new(|| {
    Table::new([32, 32], |[t, s]| {
        let (wo, alpha) = from_coordinates(t, s);
        directional_albedo(&Ggx::new(alpha, alpha), wo, None)
    })
});

/// Coordinates: cosine, slope, anisotropy, and slope toward wo.
static ANISOTROPIC: LazyLock<Table<4>> = LazyLock::new(|| {
    Table::new([16, 16, 10, 6], |[t, s, stretch, toward]| {
        let (wo, alpha) = from_coordinates(t, s);
        let aspect = 1.0 - stretch * (1.0 - MIN_ASPECT);
        let (short, long) = (alpha * aspect, alpha / aspect);
        let slope = short + toward * (long - short);
        let cos2 = if long > short { (slope * slope - short * short) / (long * long - short * short) } else { 1.0 };
        let (cos, sin) = (cos2.clamp(0.0, 1.0).sqrt(), (1.0 - cos2).clamp(0.0, 1.0).sqrt());
        directional_albedo(&Ggx::new(long, short), V3::new(wo.x * cos, wo.x * sin, wo.z), None)
    })
});

/// Coordinates: cosine, slope, and the index of refraction by its reflectance at normal incidence.
static CLEAR: LazyLock<Table<3>> = LazyLock::new(|| {
    Table::new([20, 20, 41], |[t, s, r]| {
        let (wo, alpha) = from_coordinates(t, s);
        let r = (2.0 * r - 1.0) * (2.0 * r - 1.0).abs().min(0.999);
        directional_albedo(&Ggx::new(alpha, alpha), wo, Some((1.0 + r) / (1.0 - r)))
    })
});

/// Square root of the least ratio of slopes in the table of anisotropic surfaces (Burley 2012: `1 - 0.9`).
const MIN_ASPECT: f32 = 0.316_227_77;

/// The integral of a lobe without colour over all directions: reflection only, or both sides of a boundary.
fn directional_albedo(ggx: &Ggx, wo: V3<f32>, eta: Option<f32>) -> f32 {
    const OUTWARD: usize = 32;
    // An isotropic surface is symmetric about the plane of wo: half of the turn is enough.
    let [ax, ay] = ggx.slopes();
    let (around, turn) = if ax == ay { (OUTWARD / 2, 0.5) } else { (OUTWARD, 1.0) };
    let g1 = |w: V3<f32>| if w.z > 0.0 { f64::from(ggx.g1(w)) } else { 0.0 };
    // Bounded normals reflect with weight g1(wi) times this factor, because they exclude directions below the surface.
    let bound = f64::from(ggx.pdf_visible(wo, wo) / (4.0 * ggx.pdf_bounded_reflection(wo, wo)));
    let mut sum = 0.0;
    for i in 0..OUTWARD {
        // Dense at both ends, where the integrand bends: u = v^2 (3 - 2 v).
        let v = (i as f32 + 0.5) / OUTWARD as f32;
        let weight = f64::from(6.0 * v * (1.0 - v));
        for k in 0..around {
            let u = [turn * (k as f32 + 0.5) / around as f32, v * v * (3.0 - 2.0 * v)];
            let m = ggx.sample_bounded(wo, u);
            let reflected = bound * g1(reflect(wo, m));
            sum += weight
                * match eta {
                    None => reflected,
                    Some(eta) => {
                        let reflected = reflected * f64::from(fresnel::dielectric(wo.dot(m), eta).reflectance);
                        let m = ggx.sample_visible(wo, u);
                        let f = fresnel::dielectric(wo.dot(m), eta);
                        let share = f64::from(1.0 - f.reflectance);
                        reflected + if share > 0.0 { share * g1(-refract(wo, m, eta, f.cos_t)) } else { 0.0 }
                    }
                };
        }
    }
    (sum / (around * OUTWARD) as f64) as f32
}

/// Values on a grid over the unit cube, with linear interpolation.
struct Table<const N: usize> {
    sizes: [usize; N],
    values: Vec<f32>,
}

impl<const N: usize> Table<N> {
    /// An upper bound of a function: the nodes are raised until no cell is below it in its middle.
    fn new(sizes: [usize; N], f: impl Fn([f32; N]) -> f32) -> Self {
        let point = |sizes: [usize; N], mut index: usize| {
            sizes.map(|size| {
                let k = index % size;
                index /= size;
                k
            })
        };
        let place = |at: [usize; N], shift: f32| from_fn(|k| (at[k] as f32 + shift) / (sizes[k] - 1) as f32);
        let count = sizes.iter().product();
        let mut table = Self { sizes, values: (0..count).map(|index| f(place(point(sizes, index), 0.0))).collect() };
        let cells = sizes.map(|size| size - 1);
        for index in 0..cells.iter().product() {
            let cell = point(cells, index);
            let middle = place(cell, 0.5);
            let missing = f(middle) - table.at(middle);
            if missing > 0.0 {
                for corner in 0..1usize << N {
                    let (mut index, mut stride) = (0, 1);
                    for k in 0..N {
                        index += (cell[k] + (corner >> k & 1)) * stride;
                        stride *= sizes[k];
                    }
                    table.values[index] += missing;
                }
            }
        }
        table
    }

    fn at(&self, at: [f32; N]) -> f32 {
        let mut cell = [(0, 0.0, 0); N];
        let mut stride = 1;
        for ((cell, x), size) in cell.iter_mut().zip(at).zip(self.sizes) {
            let x = x.clamp(0.0, 1.0) * (size - 1) as f32;
            let low = (x as usize).min(size - 2);
            *cell = (low * stride, x - low as f32, stride);
            stride *= size;
        }
        let mut sum = 0.0;
        for corner in 0..1usize << N {
            let (mut index, mut weight) = (0, 1.0);
            for (k, (low, fraction, stride)) in cell.into_iter().enumerate() {
                let high = corner >> k & 1 == 1;
                index += low + if high { stride } else { 0 };
                weight *= if high { fraction } else { 1.0 - fraction };
            }
            sum += weight * self.values.get(index).copied().unwrap_or(1.0);
        }
        sum
    }
}
