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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::denoiser::Serial;
    use dunkelfeld_film::Plane;

    #[test]
    fn the_mean_is_returned_unchanged() {
        let mean = Plane::from_fn(3, 2, |x, y| [x as f32, y as f32, f32::INFINITY]);
        let denoiser: Box<dyn Denoiser> = Box::new(Off);
        assert_eq!(denoiser.denoise(&DenoiseInput::new(&mean), &Control::SILENT), Ok(mean));
    }

    #[test]
    fn the_caller_can_cancel() {
        let mean = Plane::new(1, 1, [0.0; 3]);
        let control = Control { executor: &Serial, progress: &|_| false };
        assert_eq!(Off.denoise(&DenoiseInput::new(&mean), &control), Err(DenoiseError::Cancelled));
    }
}
