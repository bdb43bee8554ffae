//! Bounds of figures whose value is not known.

use serde::Serialize;

/// A bound.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bound {
    /// The symbol of the figure.
    pub symbol: &'static str,
    /// The bound, in the figure's unit. It follows from the largest dark noise that rounding may hide, or lies three
    /// standard errors above a value that is not significantly different from zero.
    pub limit: f64,
    /// The side of the bound on which the figure lies.
    pub side: Side,
}

/// The side of its bound on which a figure lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// The figure is not larger than the bound.
    Below,
    /// The figure is not smaller than the bound.
    Above,
}
