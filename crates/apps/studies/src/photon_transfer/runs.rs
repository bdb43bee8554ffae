//! The renders of a photon transfer study, one by one.

use super::settings::PtcSettings;
use crate::series::hash_text;
use dunkelfeld::adaptive::Strategy;
use dunkelfeld_sampling::hash_u64;

/// The series of a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Series {
    /// The series of the paper: the same samples in each pixel, as pictures without the sensor's noise.
    Paper,
    /// The series of the camera: samples allocated by the sensor noise, exposed.
    Camera,
}

/// One render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unit {
    pub(super) series: Series,
    /// Mean samples per pixel.
    pub(super) spp: u32,
    pub(super) frame: u32,
}

impl Unit {
    /// The name of its files, without extension.
    pub(super) fn name(&self) -> String {
        let series = match self.series {
            Series::Paper => "paper",
            Series::Camera => "camera",
        };
        format!("{series}-{}-{:04}", self.spp, self.frame)
    }

    pub(super) fn strategy(&self) -> Strategy {
        match self.series {
            Series::Paper => Strategy::Uniform,
            Series::Camera => Strategy::Sensor,
        }
    }

    /// The seed of its render. The frames of a series differ by their number, so that all come from one device. The
    /// seed is below 2^53, so that every reader of JSON reads it exactly.
    pub(super) fn seed(&self, base: u64) -> u64 {
        let series = match self.series {
            Series::Paper => hash_text("paper"),
            Series::Camera => hash_text("camera"),
        };
        hash_u64([base, series, u64::from(self.spp)]) >> 11
    }
}

/// The render whose exposure all others use: the first one with the most samples.
pub(super) fn reference(settings: &PtcSettings) -> Unit {
    Unit { series: Series::Paper, spp: settings.spp().last().copied().unwrap_or(1), frame: 0 }
}

/// All renders, in their order: the reference, then frame by frame through all series. So an interrupted measurement
/// has some data of each.
pub(super) fn units(settings: &PtcSettings, with_camera: bool) -> Vec<Unit> {
    let first = reference(settings);
    let mut units = vec![first];
    for frame in 0..settings.frames() {
        for &spp in settings.spp() {
            units.push(Unit { series: Series::Paper, spp, frame });
            if with_camera {
                units.push(Unit { series: Series::Camera, spp, frame });
            }
        }
    }
    let mut is_first = true;
    units.retain(|u| *u != first || std::mem::replace(&mut is_first, false));
    units
}
