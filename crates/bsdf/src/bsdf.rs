//! The closed set of surface models behind one interface.

use crate::{Dielectric, EFFECTS, Principled, ThinSheet, Translucent};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;
use std::ops::BitOr;

/// How one point of a surface scatters light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bsdf {
    /// Plastic, metal, painted and coated surfaces, rough glass.
    Principled(Principled),
    /// The boundary of a clear solid, smooth or rough.
    Dielectric(Dielectric),
    /// A clear sheet too thin to displace a ray.
    ThinSheet(ThinSheet),
    /// Paper, leaves, milk glass: light passes diffusely.
    Translucent(Translucent),
    /// Takes all light in.
    Absorber,
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
    /// Which lobe gave the direction.
    pub lobe: Lobe,
    /// Index of refraction on the side of `wi` over that on the side of `wo`; 1 unless the light was refracted.
    ///
    /// The weight of a refraction holds the factor `1 / eta^2` by which radiance changes; roulette should undo it.
    pub eta: f32,
}

/// A set of properties of a scattering event.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lobe(u8);

impl Lobe {
    /// Diffuse or sheen reflection.
    pub const DIFFUSE: Self = Self(1);
    /// A rough specular lobe.
    pub const GLOSSY: Self = Self(2);
    /// A single direction: no density, `eval` does not see it.
    pub const DELTA: Self = Self(4);
    /// `wi` and `wo` lie on the same side.
    pub const REFLECTION: Self = Self(8);
    /// `wi` and `wo` lie on different sides.
    pub const TRANSMISSION: Self = Self(16);
    /// The clear coat on top of the principled surface.
    pub const CLEARCOAT: Self = Self(32);

    /// Are all properties of `other` present?
    #[inline]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl BitOr for Lobe {
    type Output = Self;
    #[inline]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Bsdf {
    /// The BSDF times `|cos wi|` [1/sr]. Delta lobes do not contribute.
    #[inline]
    pub fn eval(&self, wo: LocalDir, wi: LocalDir) -> Rgb {
        self.eval_pdf(wo, wi).0
    }

    /// The density with which [`Self::sample`] gives `wi` [1/sr]. Delta lobes do not contribute.
    #[inline]
    pub fn pdf(&self, wo: LocalDir, wi: LocalDir) -> f32 {
        self.eval_pdf(wo, wi).1
    }

    /// [`Self::eval`] and [`Self::pdf`] together, for the price of one.
    #[inline]
    pub fn eval_pdf(&self, wo: LocalDir, wi: LocalDir) -> (Rgb, f32) {
        match self {
            Self::Principled(b) => b.eval_pdf(wo, wi),
            _ if EFFECTS => self.eval_clear(wo, wi),
            _ => (Rgb::BLACK, 0.0),
        }
    }

    /// [`Self::eval_pdf`] of surfaces that let light through: apart, as most surfaces do not.
    #[inline(never)]
    fn eval_clear(&self, wo: LocalDir, wi: LocalDir) -> (Rgb, f32) {
        match self {
            Self::Dielectric(b) => b.eval_pdf(wo, wi),
            Self::ThinSheet(b) => b.eval_pdf(wo, wi),
            Self::Translucent(b) => b.eval_pdf(wo, wi),
            Self::Principled(_) | Self::Absorber => (Rgb::BLACK, 0.0),
        }
    }

    /// Samples a direction; `u_lobe` chooses the lobe, `u` the direction in it, all in `[0, 1)`.
    ///
    /// `None` if the light is absorbed: the estimate of the scattered light is zero then.
    #[inline(always)]
    pub fn sample(&self, wo: LocalDir, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        match self {
            Self::Principled(b) => b.sample(wo, u_lobe, u),
            _ if EFFECTS => {
                // Not handed on as it is: the sample above would then lie in memory as this one does.
                let sample = self.sample_clear(wo, u_lobe, u)?;
                Some(sample)
            }
            _ => None,
        }
    }

    /// [`Self::sample`] of surfaces that let light through.
    #[inline(never)]
    fn sample_clear(&self, wo: LocalDir, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        match self {
            Self::Dielectric(b) => b.sample(wo, u_lobe, u),
            Self::ThinSheet(b) => b.sample(wo, u_lobe, u),
            Self::Translucent(b) => b.sample(wo, u_lobe, u),
            Self::Principled(_) | Self::Absorber => None,
        }
    }

    /// The same surface with the energy given back that rough lobes lose between their facets; see
    /// [`crate::compensation`]. Diffuse, sheen and clear-coat lobes and smooth boundaries lose nothing there and stay as
    /// they are.
    #[inline]
    pub fn with_energy_compensation(self) -> Self {
        match self {
            Self::Principled(b) => Self::Principled(b.with_energy_compensation()),
            Self::Dielectric(b) => Self::Dielectric(b.with_energy_compensation()),
            Self::ThinSheet(b) => Self::ThinSheet(b.with_energy_compensation()),
            Self::Translucent(b) => Self::Translucent(b.with_energy_compensation()),
            Self::Absorber => Self::Absorber,
        }
    }

    /// Does it scatter into delta lobes only (or not at all)? Then connecting it to a light is pointless.
    #[inline]
    pub fn is_delta(&self) -> bool {
        match self {
            Self::Principled(_) => false,
            _ if !EFFECTS => true,
            Self::Translucent(_) => false,
            Self::Dielectric(b) => b.is_delta(),
            Self::ThinSheet(b) => b.is_delta(),
            Self::Absorber => true,
        }
    }

    /// Does it show what is around rather than itself: does it scatter into single directions only, or as good as that, as a
    /// polished metal does? For layers, not for transport.
    #[inline]
    pub fn is_see_through(&self) -> bool {
        match self {
            Self::Principled(b) => b.is_polished(),
            _ => self.is_delta(),
        }
    }

    /// Approximate share of light scattered, as a guide for denoisers: the base colour of a principled surface,
    /// brighter toward grazing angles by the reflection on top; reflection plus transmission of a clear one. Within
    /// `[0, 1]`. Not energy-exact and not for transport.
    #[inline(always)]
    pub fn albedo(&self, wo: LocalDir) -> Rgb {
        match self {
            Self::Principled(b) => b.albedo(wo),
            _ if !EFFECTS => Rgb::BLACK,
            Self::Dielectric(b) => b.albedo(wo),
            Self::ThinSheet(b) => b.albedo(wo),
            Self::Translucent(b) => b.albedo(wo),
            Self::Absorber => Rgb::BLACK,
        }
    }
}
