//! The specular lobe of the principled surface: reflectance and colour of a facet, from plastic to metal.
//!
//! The shape of the lobe is that of [`crate::microfacet`].

use crate::fresnel::normal_reflectance;
use crate::in_lanes::in_lanes;
use dunkelfeld_lanes::{Lanes, Mask};
use dunkelfeld_radiometry::Rgb;

/// The colours of the specular reflection: exact Fresnel for the untinted dielectric, Schlick (1994) for metal and tint
/// (Burley 2012, 2015).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SpecularColor<F = f32> {
    /// The dielectric reflection: the first colour, plus the second times the exact term.
    dielectric: Rgb<F>,
    exact: Rgb<F>,
    /// Schlick's part, colour at normal incidence times weight: metal and tint together.
    schlick_f0: Rgb<F>,
    /// Weight of Schlick's part.
    schlick: F,
    /// Upper bound of the dielectric reflection over the channels: the first, plus the second times the exact term.
    bound: F,
    bound_exact: F,
}

in_lanes!(SpecularColor => SpecularColor<F> { dielectric, exact, schlick_f0, schlick, bound, bound_exact });

impl SpecularColor {
    /// From the relative index `eta`, the base colour, its `hue`, and shares in `[0, 1]`; `scale` holds the factors on the
    /// dielectric reflection at all angles and at normal incidence (not negative).
    #[inline]
    pub fn new(eta: f32, base: Rgb, hue: Rgb, metallic: f32, spec_tint: f32, (factor, color): (f32, Rgb)) -> Self {
        let f0 = normal_reflectance(eta);
        let tint = (1.0 - metallic) * spec_tint;
        let share = factor * ((1.0 - metallic) * (1.0 - spec_tint));
        // Exact Fresnel is treated as Schlick's blend between normal and grazing incidence, with scaled end points.
        let scaled = (color * f0).map(|c| c.min(1.0));
        let brightest = scaled.max_channel().max(f0);
        Self {
            dielectric: scaled.map(|c| (c - f0) / (1.0 - f0) * share),
            exact: scaled.map(|c| (1.0 - c) / (1.0 - f0) * share),
            schlick_f0: base * metallic + if tint > 0.0 { hue * (f0 * tint) } else { Rgb::BLACK },
            schlick: metallic + tint,
            bound: factor * (brightest - f0) / (1.0 - f0),
            bound_exact: factor * (1.0 - brightest) / (1.0 - f0),
        }
    }
}

impl<F: Lanes> SpecularColor<F> {
    /// Reflected share at a facet, given the exact dielectric term and [`crate::fresnel::schlick_weight`] there.
    #[inline(always)]
    pub fn reflectance(&self, exact: F, weight: F) -> Rgb<F> {
        self.add_schlick(self.reflected(exact), weight, Rgb::splat(exact.constant(1.0)))
    }

    /// [`Self::reflectance`] with factors on the dielectric and on the metal.
    #[inline(always)]
    pub fn compensated(&self, exact: F, weight: F, dielectric: F, metal: Rgb<F>) -> Rgb<F> {
        self.add_schlick(self.reflected(exact) * dielectric, weight, metal)
    }

    /// Reflected share of the dielectric.
    #[inline(always)]
    fn reflected(&self, exact: F) -> Rgb<F> {
        let (c, zero) = (self.dielectric + self.exact * exact, exact.constant(0.0));
        Rgb::new(c.r.max(zero), c.g.max(zero), c.b.max(zero))
    }

    #[inline(always)]
    fn add_schlick(&self, mut value: Rgb<F>, weight: F, metal: Rgb<F>) -> Rgb<F> {
        if self.schlick.is_positive().any() {
            value += metal * (self.schlick_f0 * weight.one_minus() + Rgb::splat(self.schlick * weight));
        }
        value
    }

    /// Upper bound of the reflectance of the dielectric, for an exact term or for the mean of it over facets. Below, all
    /// channels receive the rest, so that a coloured reflection does not give it the opposite colour.
    #[inline(always)]
    pub fn bound(&self, exact: F) -> F {
        self.bound + self.bound_exact * exact
    }

    /// True if some channel of the dielectric reflection is brighter than the exact term.
    #[inline(always)]
    pub fn is_brighter(&self) -> F::Mask {
        self.bound.is_positive()
    }

    /// The share of refracted light that is left where the reflection is brighter than the exact term.
    #[inline(always)]
    pub fn refracted(&self, exact: F) -> F {
        let one = exact.constant(1.0);
        let is_less = self.is_brighter() & exact.lt(one);
        is_less.select((self.bound(exact).one_minus() / exact.one_minus()).min(one), one)
    }

    /// Colour of the metal at normal incidence.
    #[inline(always)]
    pub fn metal(&self) -> Rgb<F> {
        let black = Rgb::splat(self.schlick.constant(0.0));
        Rgb::select(self.schlick.is_positive(), self.schlick_f0 / self.schlick, black)
    }
}
