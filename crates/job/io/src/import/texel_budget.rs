//! The memory of the texels of all images of a scene: computed from headers, before any decoding.

use crate::error::InputError;
use crate::images::ImageHeader;
use crate::loader::Limits;
use dunkelfeld_scene::Image;
use std::path::Path;

/// The account of the texels of one scene.
#[derive(Debug)]
pub(crate) struct TexelBudget {
    most: u64,
    bytes: u64,
    images: usize,
    /// The first image that did not fit: place and description.
    beyond: Option<(String, String)>,
}

impl TexelBudget {
    /// An account that begins with the images in `beside`.
    pub(crate) fn new(limits: &Limits, beside: &[Image]) -> Self {
        let bytes = beside.iter().map(|i| i.texels.bytes() as u64).sum();
        Self { most: limits.total_image_bytes, bytes, images: beside.len(), beyond: None }
    }

    /// Adds an image; `false` if it does not fit.
    pub(crate) fn add(&mut self, place: &str, header: &ImageHeader) -> bool {
        let fits = self.fits(place, header);
        if fits {
            self.images += 1;
            self.bytes = self.bytes.saturating_add(header.bytes());
        }
        fits
    }

    /// Is there room for an image, and was there for all before?
    pub(crate) fn fits(&mut self, place: &str, header: &ImageHeader) -> bool {
        if self.beyond.is_none() && self.bytes.saturating_add(header.bytes()) > self.most {
            self.images += 1;
            self.bytes = self.bytes.saturating_add(header.bytes());
            self.beyond = Some((place.to_owned(), format!("{header}, {}", bytes_in_words(header.bytes()))));
        }
        self.beyond.is_none()
    }

    /// Checks whether all images fit.
    ///
    /// # Errors
    /// The message contains the sum of all images, the first one that did not fit, and help.
    pub(crate) fn check(&self, file: &Path) -> Result<(), InputError> {
        let Some((place, image)) = &self.beyond else { return Ok(()) };
        let (sum, most) = (bytes_in_words(self.bytes), bytes_in_words(self.most));
        let problem = match self.images {
            1 => {
                format!("the image ({image}) needs {sum} of memory when decoded, but {most} are allowed for all images")
            }
            n => format!(
                "{n} images of the scene need {sum} of memory when decoded, but {most} are allowed; this one \
                 ({image}) is the first that does not fit"
            ),
        };
        let gib = self.bytes.saturating_mul(2).div_ceil(1 << 30);
        let help = format!(
            "make the images smaller, or allow more in a job, such as `texture_memory = \"{gib}GiB\"` in [import]"
        );
        Err(InputError::new(file, place, problem, help))
    }
}

/// Bytes in a suitable unit.
pub(crate) fn bytes_in_words(bytes: u64) -> String {
    match bytes as f64 {
        b if b < 1024.0 => format!("{bytes} B"),
        b if b < 1024.0 * 1024.0 => format!("{:.1} KiB", b / 1024.0),
        b if b < 1024.0 * 1024.0 * 1024.0 => format!("{:.1} MiB", b / (1u64 << 20) as f64),
        b => format!("{:.2} GiB", b / (1u64 << 30) as f64),
    }
}
