//! The finished renders of a photon transfer study.

use super::runs::Unit;
use crate::series::Kept;
use dunkelfeld::Error;
use dunkelfeld::film::Plane;
use serde::{Deserialize, Serialize};

/// Version of the files in the folder.
pub(super) const VERSION: u32 = 6;
pub(super) const MANIFEST: &str = "ptc.json";
/// The layers of a stored render: expected signal, the same denoised, grey values of plain and of matched exposure, and
/// the variance of the render in matched exposure over the camera's, infinite where it is unknown.
pub(super) const SIGNAL: &str = "signal.Y";
pub(super) const DENOISED: &str = "denoised.Y";
pub(super) const PLAIN: &str = "plain.Y";
pub(super) const MATCHED: &str = "matched.Y";
pub(super) const RATIO: &str = "ratio.Y";

/// The small file of a finished render.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Record {
    pub(super) seed: u64,
    pub(super) frame: u32,
    pub(super) samples: u64,
    pub(super) invalid_samples: u64,
    /// Seconds of rendering and of denoising.
    pub(super) seconds: f64,
    pub(super) denoise_seconds: Option<f64>,
}

/// The finished renders.
pub(super) struct Renders {
    pub(super) store: Kept,
    pub(super) base: u64,
}

impl Renders {
    pub(super) fn record(&self, unit: &Unit) -> Result<Option<Record>, Error> {
        let record: Option<Record> = self.store.record(&unit.name())?;
        Ok(record.filter(|r| (r.seed, r.frame) == (unit.seed(self.base), unit.frame)))
    }

    /// The seed of a render, and of the sensor that exposes it.
    pub(super) fn seed(&self, unit: &Unit) -> u64 {
        unit.seed(self.base)
    }

    /// The expected signal, rendered or denoised.
    pub(super) fn signal(&self, unit: &Unit, denoised: bool) -> Result<Plane<f32>, Error> {
        self.plane(unit, if denoised { DENOISED } else { SIGNAL })
    }

    /// Grey values \[DN\] of plain or matched exposure.
    pub(super) fn values(&self, unit: &Unit, matched: bool) -> Result<Plane<u16>, Error> {
        Ok(self.plane(unit, if matched { MATCHED } else { PLAIN })?.map(|&v| v as u16))
    }

    /// Variance of the render over the camera's, infinite where it is unknown in matched exposure.
    pub(super) fn ratios(&self, unit: &Unit) -> Result<Plane<f32>, Error> {
        self.plane(unit, RATIO)
    }

    /// Mean radiance of the reference behind the lens.
    pub(super) fn radiance(&self, unit: &Unit) -> Result<Plane<[f32; 3]>, Error> {
        self.store.radiance(&unit.name())
    }

    fn plane(&self, unit: &Unit, layer: &str) -> Result<Plane<f32>, Error> {
        self.store.plane(&unit.name(), layer)
    }
}
