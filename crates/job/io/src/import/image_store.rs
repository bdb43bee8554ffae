//! The images of one scene during import, each content once, within the memory that is allowed.

use crate::error::InputError;
use crate::images::{ImageHeader, decode_image, image_header, repair_message};
use crate::import::texel_budget::TexelBudget;
use crate::import::warnings::Warnings;
use crate::loader::Limits;
use dunkelfeld_scene::{Image, ImageId};
use std::path::Path;
use twox_hash::XxHash3_128;

/// A hash of the content of an image file. Two files with the same hash are taken to be equal. A deliberate collision
/// only replaces an image in the scene of its author.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Content {
    hash: u128,
    length: usize,
    /// For TGA files the name selects the decoder.
    is_tga: bool,
}

impl Content {
    pub(crate) fn from_bytes(bytes: &[u8], file_name: &str) -> Self {
        let is_tga = Path::new(file_name).extension().is_some_and(|e| e.eq_ignore_ascii_case("tga"));
        Self { hash: XxHash3_128::oneshot(bytes), length: bytes.len(), is_tga }
    }
}

/// The fault of an image for which there is no memory left.
const BEYOND: &str = "the images together exceed the memory allowed";

/// Images in order of first use.
#[derive(Debug)]
pub(crate) struct ImageStore {
    limits: Limits,
    budget: TexelBudget,
    images: Vec<Image>,
}

impl ImageStore {
    /// An empty store.
    pub(crate) fn new(limits: &Limits) -> Self {
        Self { limits: *limits, budget: TexelBudget::new(limits, &[]), images: Vec::new() }
    }

    /// An image.
    pub(crate) fn image(&self, id: ImageId) -> Option<&Image> {
        self.images.get(id.0 as usize)
    }

    pub(crate) fn into_images(self) -> Vec<Image> {
        self.images
    }

    /// Checks whether all images fitted.
    ///
    /// # Errors
    /// See [`TexelBudget::check`].
    pub(crate) fn check(&self, file: &Path) -> Result<(), InputError> {
        self.budget.check(file)
    }

    /// Decodes an image.
    ///
    /// # Errors
    /// If the bytes are no image, or if it does not fit, which its header tells.
    pub(crate) fn decode(
        &mut self,
        bytes: &[u8],
        file_name: &str,
        place: &str,
        warnings: &mut Warnings,
    ) -> Result<Image, String> {
        let header = image_header(bytes, file_name, &self.limits.of_header()).map_err(|fault| fault.problem)?;
        if !self.budget.fits(place, &header) {
            return Err(BEYOND.into());
        }
        let decoded = decode_image(bytes, file_name, &self.limits).map_err(|fault| fault.problem)?;
        if decoded.repaired > 0 {
            warnings.push(place, repair_message(decoded.repaired));
        }
        Ok(decoded.image)
    }

    /// Adds an image.
    ///
    /// # Errors
    /// If it does not fit.
    pub(crate) fn add(&mut self, image: Image, place: &str) -> Result<ImageId, String> {
        if !self.budget.add(place, &header_of(&image)) {
            return Err(BEYOND.into());
        }
        let id = u32::try_from(self.images.len()).map_err(|_| "there are too many images")?;
        self.images.push(image);
        Ok(ImageId(id))
    }
}

fn header_of(image: &Image) -> ImageHeader {
    let (channels, value_bytes) = (image.texels.channels() as u8, image.texels.value_bytes() as u8);
    ImageHeader { width: image.width, height: image.height, channels, value_bytes }
}
