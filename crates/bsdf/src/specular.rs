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
}

impl SpecularColor {
    /// From the relative index `eta`, the base colour, its `hue`, and shares in `[0, 1]`; `scale` holds the factors on the
    /// dielectric reflection at all angles and at normal incidence (not negative).
    #[inline]
    pub fn new(eta: f32, base: Rgb, hue: Rgb, metallic: f32, spec_tint: f32, scale: (f32, Rgb)) -> Self {
        let f0 = normal_reflectance(eta);
        let tint = (1.0 - metallic) * spec_tint;
        Self {
            f0,
            exact: (1.0 - metallic) * (1.0 - spec_tint),
            schlick_f0: base * metallic + hue * (f0 * tint),
            schlick: metallic + tint,
            scale: (scale != (1.0, Rgb::WHITE)).then_some(scale),
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
        let mut value = Rgb::splat(exact);
        if let Some((factor, color)) = self.scale {
            // Exact Fresnel is treated as Schlick's blend between normal and grazing incidence, with scaled end points.
            let s = if self.f0 < 1.0 { ((exact - self.f0) / (1.0 - self.f0)).max(0.0) } else { 1.0 };
            let f0 = (color * self.f0).map(|c| c.min(1.0));
            value = schlick(f0, s) * factor;
        }
        value *= self.exact;
        if self.schlick > 0.0 {
            value += self.schlick_f0 * (1.0 - weight) + Rgb::splat(self.schlick * weight);
        }
        value
    }

    /// Reflectance at normal incidence.
    #[inline]
    pub fn normal_reflectance(&self) -> Rgb {
        self.reflectance(self.f0, 0.0)
    }
}
