//! The messages of the measurements: pixels, regions, lines, photon transfer.

use crate::protocol::Camera;
use dunkelfeld::sensor::FilterColor;
use serde::{Deserialize, Serialize};

/// A request about a pixel.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ProbeRequest {
    pub(crate) camera: Camera,
    pub(crate) frame: u32,
    pub(crate) x: u32,
    pub(crate) y: u32,
}

/// The colour of a pixel behind a filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Channel {
    Red,
    Green,
    Blue,
}

impl From<FilterColor> for Channel {
    fn from(color: FilterColor) -> Self {
        match color {
            FilterColor::Red => Self::Red,
            FilterColor::Green => Self::Green,
            FilterColor::Blue => Self::Blue,
        }
    }
}

/// A pixel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Probe {
    pub(crate) x: u32,
    pub(crate) y: u32,
    /// `None` without a colour filter.
    pub(crate) channel: Option<Channel>,
    pub(crate) value: Option<u16>,
    pub(crate) electrons: Option<f32>,
    pub(crate) radiance: [f32; 3],
    pub(crate) camera_sigma: Option<f64>,
    pub(crate) render_sigma: Option<f64>,
    pub(crate) ratio: Option<f64>,
    /// `None` for an EXR.
    pub(crate) samples: Option<u32>,
    pub(crate) object: Option<String>,
    pub(crate) material: Option<String>,
    pub(crate) depth: Option<f32>,
    pub(crate) heaviest: Option<HeavyProbe>,
}

/// The largest sample of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct HeavyProbe {
    pub(crate) index: u32,
    pub(crate) share: f64,
}

/// A request about regions.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RegionsRequest {
    pub(crate) camera: Camera,
    pub(crate) frame: u32,
    /// Left, top, right and bottom \[pixels\], the last two exclusive.
    pub(crate) regions: Vec<[u32; 4]>,
    /// The pixels behind a colour filter that count; `None`: all.
    pub(crate) channel: Option<Channel>,
}

/// Regions and their contrast.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Regions {
    pub(crate) regions: Vec<Region>,
    /// Mean of the first less that of the second \[DN\].
    pub(crate) contrast: Option<f64>,
    /// Contrast-to-noise ratio: the contrast over the temporal noise of one pixel of the camera.
    pub(crate) cnr: Option<f64>,
}

/// The grey values of a region.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Region {
    pub(crate) pixels: u64,
    pub(crate) mean: f64,
    pub(crate) variance: f64,
    pub(crate) min: u16,
    pub(crate) max: u16,
    /// Mean above the mean without light, which contains the dark signal, over the standard deviation (EMVA 1288).
    pub(crate) snr: Option<f64>,
    pub(crate) saturated: f64,
    pub(crate) histogram: Histogram,
}

/// Numbers of pixels by grey value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Histogram {
    /// The first grey value, and the number of grey values of a bin.
    pub(crate) low: u32,
    pub(crate) width: u32,
    pub(crate) counts: Vec<u64>,
}

/// A request of a line profile.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LineRequest {
    pub(crate) camera: Camera,
    pub(crate) frame: u32,
    pub(crate) from: [f64; 2],
    pub(crate) to: [f64; 2],
    /// The pixels behind a colour filter of which the nearest one to each point of the line counts; `None`: all.
    pub(crate) channel: Option<Channel>,
}

/// A line profile \[DN\].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Line {
    pub(crate) values: Vec<u16>,
    pub(crate) expected: Vec<f64>,
    pub(crate) sigma: Vec<f64>,
    /// \[pixels\]
    pub(crate) length: f64,
}

/// A request of a photon transfer.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PhotonTransferRequest {
    pub(crate) camera: Camera,
}

/// The photon transfer of two frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct PhotonTransfer {
    pub(crate) points: Vec<TransferPoint>,
    /// The system gain K of the model [DN/e].
    pub(crate) gain: f64,
    pub(crate) line: TransferLine,
    /// Mean grey value without light \[DN\], with the dark signal of the exposure.
    pub(crate) dark: f64,
}

/// Mean \[DN\] and temporal variance [DN²].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct TransferPoint {
    pub(crate) mean: f64,
    pub(crate) variance: f64,
}

/// A straight line through the points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct TransferLine {
    pub(crate) slope: f64,
    pub(crate) offset: f64,
}
