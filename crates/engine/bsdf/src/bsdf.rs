//! The closed set of scattering models behind one interface.

use crate::bsdf_sample::{BsdfSample, View};
use crate::{Dielectric, HenyeyGreenstein, Principled, ThinSheet, Translucent};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;

/// The scattering function of one point of a surface or of a medium.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Bsdf {
    /// Plastic, metal, painted and coated surfaces, rough glass.
    Principled(Principled),
    /// The boundary of a clear solid, smooth or rough.
    Dielectric(Dielectric),
    /// A clear sheet too thin to displace a ray.
    ThinSheet(ThinSheet),
    /// Paper, leaves, milk glass: light is transmitted diffusely.
    Translucent(Translucent),
    /// A point in a medium. Its local frame is that of the world.
    Phase(HenyeyGreenstein),
    /// Absorbs all light.
    Absorber,
}

impl Bsdf {
    /// The BSDF times `|cos wi|` [1/sr]. Delta lobes are excluded.
    #[inline]
    pub fn eval(&self, wo: LocalDir, wi: LocalDir) -> Rgb {
        self.eval_pdf(wo, wi).0
    }

    /// The density of `wi` in [`Self::sample`] [1/sr]. Delta lobes are excluded.
    #[inline]
    pub fn pdf(&self, wo: LocalDir, wi: LocalDir) -> f32 {
        self.eval_pdf(wo, wi).1
    }

    /// [`Self::eval`] and [`Self::pdf`] together, at the cost of one.
    pub fn eval_pdf(&self, wo: LocalDir, wi: LocalDir) -> (Rgb, f32) {
        let (wo, wi) = (wo.0.into(), wi.0.into());
        match self {
            Self::Principled(b) if !b.is_rich() => b.view::<false>(wo).eval_pdf(wi),
            Self::Principled(b) => b.view::<true>(wo).eval_pdf(wi),
            Self::Dielectric(b) => b.view(wo).eval_pdf(wi),
            Self::ThinSheet(b) => b.view(wo).eval_pdf(wi),
            Self::Translucent(b) => b.view(wo).eval_pdf(wi),
            Self::Phase(p) => p.view(wo).eval_pdf(wi),
            Self::Absorber => (Rgb::BLACK, 0.0),
        }
    }

    /// Samples a direction; `u_lobe` chooses the lobe, `u` the direction in it, all in `[0, 1)`.
    ///
    /// `None` if the light is absorbed. Then the estimate of the scattered light is zero.
    pub fn sample(&self, wo: LocalDir, u_lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let wo = wo.0.into();
        match self {
            Self::Principled(b) if !b.is_rich() => b.view::<false>(wo).sample(u_lobe, u),
            Self::Principled(b) => b.view::<true>(wo).sample(u_lobe, u),
            Self::Dielectric(b) => b.view(wo).sample(u_lobe, u),
            Self::ThinSheet(b) => b.view(wo).sample(u_lobe, u),
            Self::Translucent(b) => b.view(wo).sample(u_lobe, u),
            Self::Phase(p) => p.view(wo).sample(u_lobe, u),
            Self::Absorber => return None,
        }
        .into()
    }

    /// The same surface with compensation of the energy that rough lobes lose between their facets; see
    /// [`crate::compensation`]. Diffuse, sheen and clear-coat lobes and smooth boundaries have no such loss and stay as
    /// they are.
    #[inline]
    pub fn with_energy_compensation(self) -> Self {
        match self {
            Self::Principled(b) => Self::Principled(b.with_energy_compensation()),
            Self::Dielectric(b) => Self::Dielectric(b.with_energy_compensation()),
            Self::ThinSheet(b) => Self::ThinSheet(b.with_energy_compensation()),
            Self::Translucent(b) => Self::Translucent(b.with_energy_compensation()),
            Self::Phase(_) | Self::Absorber => self,
        }
    }

    /// True if it scatters into delta lobes only (or not at all). Then next-event estimation cannot connect it to a
    /// light.
    #[inline]
    pub fn is_delta(&self) -> bool {
        match self {
            Self::Principled(_) => false,
            Self::Translucent(_) | Self::Phase(_) => false,
            Self::Dielectric(b) => b.is_delta(),
            Self::ThinSheet(b) => b.is_delta(),
            Self::Absorber => true,
        }
    }

    /// True if the auxiliary layers pass through it: it scatters into single directions only, or into a lobe as narrow
    /// as that of a polished metal. Used for layers, not for transport.
    #[inline]
    pub fn is_see_through(&self) -> bool {
        match self {
            Self::Principled(b) => b.is_polished(),
            _ => self.is_delta(),
        }
    }

    /// Approximate albedo, as a guide for denoisers. For a principled surface it is the base colour, which increases
    /// toward grazing angles by the reflection on top. For a clear surface it is reflection plus transmission. Within
    /// `[0, 1]`. Not energy-exact and not for transport.
    #[inline(always)]
    pub fn albedo(&self, wo: LocalDir) -> Rgb {
        let wo = wo.0.into();
        match self {
            Self::Principled(b) => b.albedo(wo),
            Self::Dielectric(b) => b.albedo(wo),
            Self::ThinSheet(b) => b.albedo(wo),
            Self::Translucent(b) => b.albedo(wo),
            Self::Phase(_) => Rgb::WHITE,
            Self::Absorber => Rgb::BLACK,
        }
    }
}
