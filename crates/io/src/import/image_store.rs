//! The images of one scene during import: measured from their headers first, then decoded, each content once.

use crate::error::InputError;
use crate::images::{ImageHeader, decode_image, image_header, repair_message};
use crate::import::texel_budget::TexelBudget;
use crate::import::warnings::Warnings;
use crate::loader::Limits;
use dunkelfeld_scene::{Image, ImageId, Texels};
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

/// Images in order of first use.
///
/// A scene is read twice. A measuring store reads headers only and returns images without texels. So the sum is known
/// (see [`ImageStore::check`]) before a decoding store allocates memory.
#[derive(Debug)]
pub(crate) struct ImageStore {
    limits: Limits,
    measures: bool,
    budget: TexelBudget,
    images: Vec<Image>,
}

impl ImageStore {
    /// A store that reads headers only.
    pub(crate) fn measuring(limits: &Limits) -> Self {
        Self { measures: true, ..Self::decoding(limits) }
    }

    /// A store that decodes.
    pub(crate) fn decoding(limits: &Limits) -> Self {
        Self { limits: *limits, measures: false, budget: TexelBudget::new(limits, &[]), images: Vec::new() }
    }

    /// Does it measure only, so that its images have no texels?
    pub(crate) fn measures(&self) -> bool {
        self.measures
    }

    /// An image; without texels in a measuring store.
    pub(crate) fn image(&self, id: ImageId) -> Option<&Image> {
        self.images.get(id.0 as usize)
    }

    pub(crate) fn into_images(self) -> Vec<Image> {
        self.images
    }

    /// Checks whether all measured images fit.
    ///
    /// # Errors
    /// See [`TexelBudget::check`].
    pub(crate) fn check(&self, file: &Path) -> Result<(), InputError> {
        self.budget.check(file)
    }

    /// The header of an encoded image. The texel budget checks its size in memory.
    ///
    /// # Errors
    /// The fault of the image.
    pub(crate) fn header(&self, bytes: &[u8], file_name: &str) -> Result<ImageHeader, String> {
        image_header(bytes, file_name, &self.limits.of_header()).map_err(|fault| fault.problem)
    }

    /// Decodes an image without storing it.
    ///
    /// # Errors
    /// The fault of the image.
    pub(crate) fn decode(
        &self,
        bytes: &[u8],
        file_name: &str,
        place: &str,
        warnings: &mut Warnings,
    ) -> Result<Image, String> {
        let decoded = decode_image(bytes, file_name, &self.limits).map_err(|fault| fault.problem)?;
        if decoded.repaired > 0 {
            warnings.push(place, repair_message(decoded.repaired));
        }
        Ok(decoded.image)
    }

    /// Adds the place of an image that is only measured.
    ///
    /// # Errors
    /// If the number of images is out of range.
    pub(crate) fn add_measured(&mut self, header: &ImageHeader, place: &str) -> Result<ImageId, String> {
        self.budget.add(place, header);
        let ImageHeader { width, height, .. } = *header;
        self.push(Image { name: String::new(), width, height, texels: Texels::Gray8(Vec::new()).into() })
    }

    /// Adds an image.
    ///
    /// # Errors
    /// If it does not fit, which the measurement should have detected.
    pub(crate) fn add(&mut self, image: Image, place: &str) -> Result<ImageId, String> {
        let header = header_of(&image);
        if !self.budget.add(place, &header) {
            return Err("the images together exceed the memory allowed".into());
        }
        self.push(image)
    }

    fn push(&mut self, image: Image) -> Result<ImageId, String> {
        let id = u32::try_from(self.images.len()).map_err(|_| "there are too many images")?;
        self.images.push(image);
        Ok(ImageId(id))
    }
}

fn header_of(image: &Image) -> ImageHeader {
    let (channels, value_bytes) = (image.texels.channels() as u8, image.texels.value_bytes() as u8);
    ImageHeader { width: image.width, height: image.height, channels, value_bytes }
}
