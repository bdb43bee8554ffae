//! How surfaces scatter light: the principled BSDF lobe by lobe, dielectric solids, thin sheets.
//!
//! Everything is a pure function of numbers. Directions are [`LocalDir`](dunkelfeld_geometry::LocalDir)s in a shading
//! frame whose normal is +z; `wo` points toward the camera, `wi` is the direction that is sampled, both point away from
//! the surface. `eval` includes the cosine of `wi` [1/sr]; densities are per unit solid angle of `wi` [1/sr]. A
//! direction may lie on either side of the surface; a direction that lies *in* it (z = 0) scatters nothing. Nothing
//! here returns NaN, an infinity or a negative value for unit directions, whatever the parameters.
//!
//! One file per lobe: [`diffuse`], [`sheen`], [`clearcoat`], [`specular`], [`transmission`], the last two on the facets of
//! [`microfacet`] with [`fresnel`]; [`principled`], [`dielectric`] and [`thin`] mix them. [`compensation`] gives rough
//! surfaces back, on demand, what they lose between facets.

#![forbid(unsafe_code)]

/// False in a build for measurements (feature `plain-only`), which knows opaque surfaces that are the same everywhere, and of
/// them the diffuse and the specular lobe: what lies behind this constant is not compiled into it.
pub const EFFECTS: bool = !cfg!(feature = "plain-only");

mod bsdf;
pub mod clearcoat;
pub mod compensation;
pub mod dielectric;
pub mod diffuse;
pub mod fresnel;
pub mod microfacet;
pub mod phase;
pub mod principled;
pub mod sheen;
pub mod specular;
pub mod thin;
pub mod translucent;
pub mod transmission;

pub use bsdf::{Bsdf, BsdfSample, Lobe};
pub use dielectric::Dielectric;
pub use phase::HenyeyGreenstein;
pub use principled::{Principled, PrincipledParams};
pub use thin::ThinSheet;
pub use translucent::Translucent;
