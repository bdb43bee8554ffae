//! The specular lobe of the principled surface: reflectance and colour of a facet, from plastic to metal.
//!
//! The shape of the lobe is that of [`crate::microfacet`].

use crate::fresnel::{normal_reflectance, schlick};
use dunkelfeld_radiometry::Rgb;

/// The colours of the specular reflection: exact Fresnel for the untinted dielectric, Schlick (1994) for metal and tint
/// (Burley 2012, 2015).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SpecularColor {
    /// Reflectance at normal incidence of the index alone.
    f0: f32,
    /// Factor on the exact Fresnel term, `(1 - metallic)(1 - spec_tint)`.
    exact: f32,
    /// Schlick's part, colour at normal incidence times weight: metal and tint together.
    schlick_f0: Rgb,
    /// Weight of Schlick's part.
    schlick: f32,
    /// Factors on the dielectric reflection at all angles and at normal incidence, unless both are neutral.
    scale: Option<(f32, Rgb)>,
    /// Upper bound of the dielectric reflection over the channels: the first, plus the second times the exact term.
    bound: [f32; 2],
}

impl SpecularColor {
    /// From the relative index `eta`, the base colour, its `hue`, and shares in `[0, 1]`; `scale` holds the factors on the
    /// dielectric reflection at all angles and at normal incidence (not negative).
    #[inline]
    pub fn new(eta: f32, base: Rgb, hue: Rgb, metallic: f32, spec_tint: f32, scale: (f32, Rgb)) -> Self {
        let f0 = normal_reflectance(eta);
        let tint = (1.0 - metallic) * spec_tint;
        let (factor, color) = scale;
        let brightest = (color.max_channel().max(1.0) * f0).min(1.0);
        Self {
            f0,
            exact: (1.0 - metallic) * (1.0 - spec_tint),
            schlick_f0: base * metallic + hue * (f0 * tint),
            schlick: metallic + tint,
            scale: (scale != (1.0, Rgb::WHITE)).then_some(scale),
            bound: [brightest - f0, 1.0 - brightest].map(|x| factor * x / (1.0 - f0)),
        }
    }

    /// Reflectance at normal incidence of the index alone.
    #[inline]
    pub fn dielectric_f0(&self) -> f32 {
        self.f0
    }

    /// Reflected share at a facet, given the exact dielectric term and [`crate::fresnel::schlick_weight`] there.
    #[inline]
    pub fn reflectance(&self, exact: f32, weight: f32) -> Rgb {
        self.compensated(exact, weight, 1.0, Rgb::WHITE)
    }

    /// [`Self::reflectance`] with factors on the dielectric and on the metal.
    #[inline]
    pub fn compensated(&self, exact: f32, weight: f32, dielectric: f32, metal: Rgb) -> Rgb {
        let mut value = Rgb::splat(exact);
        if let Some((factor, color)) = self.scale {
            // Exact Fresnel is treated as Schlick's blend between normal and grazing incidence, with scaled end points.
            let s = (exact - self.f0) / (1.0 - self.f0);
            let f0 = (color * self.f0).map(|c| c.min(1.0));
            value = schlick(f0, s).map(|c| c.max(0.0)) * factor;
        }
        value *= self.exact * dielectric;
        if self.schlick > 0.0 {
            value += metal * (self.schlick_f0 * (1.0 - weight) + Rgb::splat(self.schlick * weight));
        }
        value
    }

    /// Upper bound of the reflectance of the dielectric, for an exact term or for the mean of it over facets. Below, all
    /// channels receive the rest, so that a coloured reflection does not give it the opposite colour.
    #[inline]
    pub fn bound(&self, exact: f32) -> f32 {
        self.bound[0] + self.bound[1] * exact
    }

    /// True if some channel of the dielectric reflection is brighter than the exact term.
    #[inline]
    pub fn is_brighter(&self) -> bool {
        self.bound[0] > 0.0
    }

    /// The share of refracted light that is left where the reflection is brighter than the exact term.
    #[inline]
    pub fn refracted(&self, exact: f32) -> f32 {
        if self.is_brighter() && exact < 1.0 { ((1.0 - self.bound(exact)) / (1.0 - exact)).min(1.0) } else { 1.0 }
    }

    /// Colour of the metal at normal incidence.
    #[inline]
    pub fn metal(&self) -> Rgb {
        if self.schlick > 0.0 { self.schlick_f0 / self.schlick } else { Rgb::BLACK }
    }
}
