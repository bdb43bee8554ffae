//! Intel Open Image Denoise, loaded at run time: a filter with trained weights, if the machine has the library.
//!
//! The program does not link or ship the library. It supports versions 1.4 and 2. It always uses the CPU, with the
//! number of threads of the caller.

mod library;
mod prepare;
mod session;

pub use library::{Candidate, standard_names, standard_places};

use crate::denoiser::{Control, DenoiseError, DenoiseInput, Denoiser, Triples};
use dunkelfeld_film::Plane;
use library::Functions;
use session::Device;
use std::ffi::CStr;

/// Intel Open Image Denoise.
#[derive(Clone, Debug)]
pub struct Oidn {
    functions: Functions,
    version: String,
}

impl Oidn {
    /// Loads the first candidate that can be loaded. A library stays loaded until the program ends.
    ///
    /// # Errors
    /// [`DenoiseError::Unavailable`] with all candidates and the reasons of their failures. [`DenoiseError::Library`]
    /// if the library reports that it cannot work on this machine.
    pub fn load(candidates: &[Candidate]) -> Result<Self, DenoiseError> {
        let functions = Functions::load(candidates)?;
        let version = Device::new(&functions, 1)?.version()?;
        Ok(Self { functions, version })
    }

    /// The library's version, as in `2.3.3`.
    pub fn version(&self) -> &str {
        &self.version
    }
}

/// Progress at the limits of the steps: the features in the order of their preparation, then the image.
const STEPS: [f64; 4] = [0.0, 0.3, 0.6, 1.0];

impl Denoiser for Oidn {
    fn name(&self) -> String {
        format!("Intel Open Image Denoise {}", self.version)
    }

    /// Albedo and normal are denoised first, so that the filter can treat them as noise-free. A normal without an
    /// albedo is not used, since the library has no weights for that. First light and its rest are filtered one after the
    /// other, so that the noise of the rest does not blur the edges of the first light. Pixels that are not finite are
    /// replaced by the mean of their neighbours before the library gets them.
    fn denoise(&self, input: &DenoiseInput<'_>, control: &Control<'_>) -> Result<Triples, DenoiseError> {
        input.check()?;
        let (width, height) = (input.mean.width(), input.mean.height());
        if !(control.progress)(0.0) {
            return Err(DenoiseError::Cancelled);
        }
        if width == 0 || height == 0 {
            return Ok(input.mean.clone());
        }
        let device = Device::new(&self.functions, control.executor.threads().max(1))?;
        let albedo = input.albedo.map(|plane| prepare::feature(plane, 0.0));
        let normal = input.normal.filter(|_| albedo.is_some()).map(|plane| prepare::feature(plane, -1.0));
        let mut done = 0;
        let mut ready = |name: &CStr, plane: Option<Triples>| {
            let step = done;
            done += 1;
            plane.map(|plane| prefiltered(&device, name, &plane, step, control)).transpose()
        };
        let albedo = ready(c"albedo", albedo)?;
        let normal = ready(c"normal", normal)?;

        let from = if albedo.is_some() { STEPS[2] } else { 0.0 };
        let filtered = |light: &Triples, [begin, end]: [f64; 2]| -> Result<Triples, DenoiseError> {
            let (mean, scale) = prepare::radiance(light);
            let mut output = Plane::new(width, height, [0.0; 3]);
            let mut filter = device.filter()?;
            filter.input(c"color", &mean);
            for (name, plane) in [(c"albedo", &albedo), (c"normal", &normal)] {
                if let Some(plane) = plane {
                    filter.input(name, plane);
                }
            }
            filter.output(&mut output);
            filter.set_bool(c"hdr", true);
            filter.set_bool(c"cleanAux", albedo.is_some());
            filter.set_float(c"inputScale", scale);
            filter.run(&|fraction| (control.progress)(within(begin, end, fraction)))?;
            // The library may return values that are not finite. The result is finite.
            let bound = |v: f32| if v.is_nan() { 0.0 } else { v.clamp(0.0, f32::MAX) };
            output.data_mut().as_flattened_mut().iter_mut().for_each(|v| *v = bound(*v));
            Ok(output)
        };
        let Some(first_light) = input.first_light else { return filtered(input.mean, [from, 1.0]) };
        let middle = 0.5 * (from + 1.0);
        let combined = |a: &Triples, b: &Triples, f: fn(f32, f32) -> f32| {
            let mut out = a.clone();
            let pairs = out.data_mut().as_flattened_mut().iter_mut().zip(b.data().as_flattened());
            pairs.for_each(|(a, b)| *a = f(*a, *b));
            out
        };
        // Both parts are the image, whatever is given as first light.
        let rest = combined(input.mean, first_light, |all, first| all - first.min(all).max(0.0));
        let first = combined(input.mean, &rest, |all, rest| all - rest);
        let [rest, first] = [filtered(&rest, [from, middle])?, filtered(&first, [middle, 1.0])?];
        Ok(combined(&rest, &first, |rest, first| (rest + first).min(f32::MAX)))
    }
}

/// A feature after denoising.
fn prefiltered(
    device: &Device<'_>,
    name: &CStr,
    plane: &Triples,
    step: usize,
    control: &Control<'_>,
) -> Result<Triples, DenoiseError> {
    let mut output = Plane::new(plane.width(), plane.height(), [0.0; 3]);
    let mut filter = device.filter()?;
    filter.input(name, plane);
    filter.output(&mut output);
    filter.run(&|fraction| (control.progress)(within(STEPS[step], STEPS[step + 1], fraction)))?;
    Ok(output)
}

fn within(from: f64, to: f64, fraction: f64) -> f64 {
    from + (to - from) * fraction.clamp(0.0, 1.0)
}
