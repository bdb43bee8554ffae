//! The record of an image: everything that was drawn, what the image shows, and the hashes of its files.

use dunkelfeld::Frame;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use twox_hash::XxHash3_128;

/// Version of the format of a set.
pub(crate) const FORMAT: u32 = 5;

/// The record of an image. It is a function of the study and the index: it contains no times and names no machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Index of the image in the set.
    pub index: u64,
    /// Hash of the texts of the study, as in `set.json`.
    pub study: String,
    /// The name and the value of each draw, of each placement and of each defect.
    pub drawn: BTreeMap<String, serde_json::Value>,
    /// Seed of the render and of the device.
    pub seed: u64,
    /// Number of the frame.
    pub frame: u32,
    /// Width \[pixels\].
    pub width: u32,
    /// Height \[pixels\].
    pub height: u32,
    /// Exposure time \[s\]; `None` without a sensor.
    pub exposure: Option<f64>,
    /// Samples of all pixels together.
    pub samples: u64,
    /// The certificate; `None` without a sensor.
    pub certificate: Option<CertificateRecord>,
    /// Share of the pixels for which noise-matched exposure holds; `None` with plain noise.
    pub matched: Option<f64>,
    /// The captures by name; empty for one image. Exposure, certificate and labels above are those of the first.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub captures: BTreeMap<String, CaptureRecord>,
    /// The labelled instances with a part in the film, by id.
    pub instances: Vec<InstanceRecord>,
    /// The files of the image, relative to the folder of the set.
    pub files: BTreeMap<String, FileRecord>,
}

/// The certificate of an image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CertificateRecord {
    /// Level of the certificate.
    pub k: f64,
    /// Share of the unsaturated pixels that are hidden at the level.
    pub hidden: f64,
    /// Median of the variance of the render over that of the sensor; `None` if it is unknown.
    pub median: Option<f64>,
    /// 99 % quantile of that ratio.
    pub p99: Option<f64>,
    /// Share of the pixels that are saturated.
    pub saturated: f64,
}

/// A capture of an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaptureRecord {
    /// Exposure time \[s\]; `None` without a sensor.
    pub exposure: Option<f64>,
    /// The certificate; `None` without a sensor.
    pub certificate: Option<CertificateRecord>,
    /// Share of the pixels for which noise-matched exposure holds; `None` with plain noise.
    pub matched: Option<f64>,
}

impl CaptureRecord {
    pub(crate) fn new(frame: &Frame, pixels: f64) -> Self {
        let sensor = frame.sensor.as_ref();
        let certificate = sensor.and_then(|s| s.certified.as_ref()).map(|certified| {
            let c = &certified.certificate;
            let finite = |v: f64| v.is_finite().then_some(v);
            let saturated = c.saturated as f64 / pixels;
            CertificateRecord { k: c.k, hidden: c.hidden, median: finite(c.median), p99: finite(c.p99), saturated }
        });
        Self {
            exposure: sensor.map(|s| s.exposure.time().0),
            certificate,
            matched: sensor.and_then(|s| s.matched.as_ref()).map(|m| m.share),
        }
    }
}

/// A labelled instance in an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstanceRecord {
    /// Id of the instance in this image, which is that of its masks. 1 or more.
    pub id: u16,
    /// Name of the object.
    pub name: String,
    /// Id of the category.
    pub category: u16,
    /// Left, top, width and height of the visible part \[pixels\].
    pub bbox: [u32; 4],
    /// Number of pixels in the mask.
    pub area: u64,
    /// Visible area by all samples of the labels \[pixels\].
    pub visible: f64,
    /// Area in the film that the instance would have if nothing hid it \[pixels\].
    pub amodal: f64,
    /// Mean of the instance minus mean of its surroundings \[DN\]; `None` if one of them has no pixels, without a sensor, and
    /// if it is below three of its errors, which are above the noise of a pixel.
    pub contrast: Option<f64>,
    /// Standard error of the contrast by the noise of the render \[DN\].
    pub contrast_error: Option<f64>,
    /// Magnitude of the contrast, less the share of the error, over the temporal noise of a pixel. `None` where `contrast` is.
    pub cnr: Option<f64>,
    /// Standard error of `cnr` by the noise of the render.
    pub cnr_error: Option<f64>,
    /// Largest extent of a defect \[mm\].
    pub size_mm: Option<f64>,
    /// Kind of a defect.
    pub defect: Option<String>,
    /// Place of a defect.
    pub place: Option<PlaceRecord>,
    /// Only of an object without a pose, which is mirrored, sheared or flat: the first three rows of the matrix from the
    /// object \[m\] to the camera \[mm\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub matrix: Option<[f64; 12]>,
}

/// The place of a defect in the middle of the exposure (of a line scan: in that of the middle row).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaceRecord {
    /// Name of the object below, or around. For missing, faded and shifted the name of the object itself.
    pub on: String,
    /// Position in the world \[m\]: the drawn point of the surface or of the volume. For missing, faded and shifted the middle
    /// of the bounds of the object.
    pub world: [f64; 3],
    /// The same in the frame of the object, as that of its key points \[m\]; `None` if the object is flat in an axis.
    pub object: Option<[f64; 3]>,
    /// Unit normal of the surface, world axes. Inside of a solid +y.
    pub normal: [f64; 3],
    /// Direction in the plane of the surface, drawn or given \[deg\]; `None` if the kind has none.
    pub angle_deg: Option<f64>,
}

/// Size and hash of a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileRecord {
    /// Size \[bytes\].
    pub bytes: u64,
    /// XXH3 of its content, 128 bits as hexadecimal digits.
    pub hash: String,
}

impl FileRecord {
    pub(crate) fn of(content: &[u8]) -> Self {
        Self { bytes: content.len() as u64, hash: format!("{:032x}", XxHash3_128::oneshot(content)) }
    }
}

/// Seconds that the parts of an image took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Draws, and the parts of the scene that were built again.
    pub change: f64,
    /// Samples.
    pub render: f64,
    /// Plan of the samples.
    pub plan: f64,
    /// Exposure and certificate.
    pub expose: f64,
    /// Labels and the visibility of the instances.
    pub label: f64,
    /// Encoding of the files, and writing them.
    pub write: f64,
    /// All of it.
    pub total: f64,
}
