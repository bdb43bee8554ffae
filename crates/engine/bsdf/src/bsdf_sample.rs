//! A sampled direction and its lobe.

use dunkelfeld_geometry::LocalDir;
use dunkelfeld_lanes::{Lanes, V3};
use dunkelfeld_radiometry::Rgb;
use std::ops::BitOr;

/// A surface seen from `wo`. It contains what does not depend on the other direction.
pub trait View<F: Lanes> {
    /// The BSDF times `|cos wi|` [1/sr] and the density of `wi` in [`Self::sample`] [1/sr]. Delta lobes are excluded.
    fn eval_pdf(&self, wi: V3<F>) -> (Rgb<F>, F);
    /// Samples a direction; `u_lobe` chooses the lobe, `u` the direction in it, all in `[0, 1)`.
    fn sample(&self, u_lobe: F, u: [F; 2]) -> BsdfSamples<F>;
    /// The albedo for a direction, which need not be `wo`: see [`crate::Bsdf::albedo`].
    fn albedo(&self, wo: V3<F>) -> Rgb<F>;
}

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// The sampled direction, a unit vector away from the surface.
    pub wi: LocalDir,
    /// `eval / pdf`; for a delta lobe its coefficient over the probability of taking it. Never black.
    pub weight: Rgb,
    /// Density per unit solid angle [1/sr]; for a delta lobe the discrete probability of taking it.
    pub pdf: f32,
    /// The lobe from which the direction was drawn.
    pub lobe: Lobe,
    /// Index of refraction on the side of `wi` over that on the side of `wo`; 1 unless the light was refracted.
    ///
    /// The weight of a refraction contains the factor `1 / eta^2` by which radiance changes. Roulette should divide it
    /// out.
    pub eta: f32,
}

/// A [`BsdfSample`] per lane. Weight and density are zero where the light is absorbed.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSamples<F: Lanes> {
    /// The sampled directions.
    pub wi: V3<F>,
    /// `eval / pdf`.
    pub weight: Rgb<F>,
    /// Densities [1/sr], or probabilities of delta lobes.
    pub pdf: F,
    /// Bits of the [`Lobe`]s.
    pub lobe: F::Word,
    /// Relative indices of refraction.
    pub eta: F,
}

impl<F: Lanes> BsdfSamples<F> {
    /// No samples: their density is zero.
    #[inline(always)]
    pub fn none(zero: F) -> Self {
        Self::new(V3::new(zero, zero, zero), Rgb::splat(zero), zero, zero, zero)
    }

    /// Samples with the weight `weight`. Light is absorbed where the weight is zero or the density underflowed. `lobe` is
    /// that of [`Lobe::in_lanes`].
    #[inline(always)]
    pub(crate) fn new(wi: V3<F>, weight: Rgb<F>, pdf: F, lobe: F, eta: F) -> Self {
        // Channels are not negative. The sum is finite if all are.
        let sum = weight.r + weight.g + weight.b;
        let is_some = pdf.is_positive() & sum.is_positive() & sum.is_finite();
        let weight = Rgb::select(is_some, weight, Rgb::splat(pdf.constant(0.0)));
        Self { wi, weight, pdf: pdf.only(is_some), lobe: lobe.to_bits(), eta }
    }
}

impl From<BsdfSamples<f32>> for Option<BsdfSample> {
    #[inline(always)]
    fn from(s: BsdfSamples<f32>) -> Self {
        let BsdfSamples { wi, weight, pdf, lobe, eta } = s;
        (pdf > 0.0).then_some(BsdfSample { wi: LocalDir(wi.into()), weight, pdf, lobe: Lobe(lobe.0 as u8), eta })
    }
}

/// A set of properties of a scattering event.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lobe(u8);

impl Lobe {
    /// Diffuse or sheen reflection.
    pub const DIFFUSE: Self = Self(1);
    /// A rough specular lobe.
    pub const GLOSSY: Self = Self(2);
    /// A single direction: it has no density, and `eval` excludes it.
    pub const DELTA: Self = Self(4);
    /// `wi` and `wo` lie on the same side.
    pub const REFLECTION: Self = Self(8);
    /// `wi` and `wo` lie on different sides.
    pub const TRANSMISSION: Self = Self(16);
    /// The clear coat on top of the principled surface.
    pub const CLEARCOAT: Self = Self(32);

    /// True if all properties of `other` are present.
    #[inline]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The bits in [`BsdfSamples::lobe`].
    #[inline]
    pub const fn bits(self) -> u32 {
        self.0 as u32
    }

    /// The inverse of [`Self::bits`].
    #[inline]
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits as u8)
    }

    /// The bits in all lanes, as those of a number, for selections.
    #[inline(always)]
    pub(crate) fn in_lanes<F: Lanes>(self, token: F::Token) -> F {
        F::from_bits(F::splat_word(token, self.bits()))
    }
}

impl BitOr for Lobe {
    type Output = Self;
    #[inline]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}
