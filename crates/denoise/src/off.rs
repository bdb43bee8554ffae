//! No denoising: the image as it is.

use crate::denoiser::{Control, DenoiseError, DenoiseInput, Denoiser, Triples};

/// Returns the mean.
#[derive(Clone, Copy, Debug, Default)]
pub struct Off;

impl Denoiser for Off {
    fn name(&self) -> String {
        "off".into()
    }

    fn denoise(&self, input: &DenoiseInput<'_>, control: &Control<'_>) -> Result<Triples, DenoiseError> {
        input.check()?;
        if !(control.progress)(1.0) {
            return Err(DenoiseError::Cancelled);
        }
        Ok(input.mean.clone())
    }
}
