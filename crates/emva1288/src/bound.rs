//! Figures of which no more is known than on which side of a number they lie.

use serde::Serialize;

/// A bound.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bound {
    /// The figure.
    pub symbol: &'static str,
    /// What it does not go beyond, in the figure's unit: by the largest dark noise that rounding may hide, or three standard
    /// errors above a value that does not stand out from its error.
    pub limit: f64,
    /// Which way the figure does not go.
    pub side: Side,
}

/// Where a figure lies, seen from its bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// It is not larger.
    Below,
    /// It is not smaller.
    Above,
}
