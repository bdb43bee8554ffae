//! Scattering functions of surfaces: the principled BSDF lobe by lobe, dielectric solids, thin sheets.
//!
//! Everything is a pure function of numbers, generic over [`Lanes`](dunkelfeld_lanes::Lanes): `f32` is one lane. A surface
//! is compiled to numbers of one lane, loaded into lanes ([`InLanes`]), and seen from `wo` ([`View`]). [`Bsdf`] has the
//! same functions for one lane. Directions lie in a shading frame whose normal is +z. `wo` points toward the camera, `wi` is the sampled direction, and both point away from the
//! surface. `eval` includes the cosine of `wi` [1/sr]; densities are per unit solid angle of `wi` [1/sr]. A direction
//! may lie on either side of the surface. For a direction *in* the surface (z = 0) the BSDF is zero. No function
//! returns NaN, an infinity or a negative value for unit directions, for any parameters.
//!
//! One file per lobe: [`diffuse`], [`sheen`], [`clearcoat`], [`specular`], [`transmission`], the last two on the facets
//! of [`microfacet`] with [`fresnel`]. [`principled`], [`dielectric`] and [`thin`] mix them, [`layers`] keeps
//! the energy of the mix. [`compensation`] optionally restores the energy that rough surfaces lose between facets.

#![forbid(unsafe_code)]

mod bsdf;
mod bsdf_sample;
pub mod clearcoat;
pub mod compensation;
pub mod dielectric;
pub mod diffuse;
pub mod fresnel;
mod in_lanes;
pub mod layers;
pub mod microfacet;
pub mod phase;
pub mod principled;
pub mod sheen;
pub mod specular;
pub mod thin;
pub mod translucent;
pub mod transmission;

pub use bsdf::Bsdf;
pub use bsdf_sample::{BsdfSample, BsdfSamples, Lobe, View};
pub use dielectric::Dielectric;
pub use in_lanes::InLanes;
pub use phase::HenyeyGreenstein;
pub use principled::{Principled, PrincipledModel, PrincipledParams};
pub use thin::ThinSheet;
pub use translucent::Translucent;
