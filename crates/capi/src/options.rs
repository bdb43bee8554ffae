//! Options of renders and exposures as structures of C. Fields that are zero are those of the scene, or of the render.

use crate::cancel::Cancel;
use crate::pointers::{Text, Versioned};
use crate::status::{Failure, Status};
use dunkelfeld::radiometry::Seconds;
use dunkelfeld::sensor::{Exposure, ExposureNoise};
use dunkelfeld::{Error, ExposeOptions as Expose, ExposureOption, RenderOptions as Render, SensorOption};
use std::ffi::{c_char, c_int, c_void};

/// The progress of a render.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Number of bytes of the structure of the library.
    pub struct_size: usize,
    /// Name of the stage, such as "refine".
    pub stage: *const c_char,
    /// Share of the stage that is done, 0 to 1.
    pub fraction: f64,
    /// Seconds since the start.
    pub elapsed: f64,
    /// Seconds that remain; negative if unknown.
    pub remaining: f64,
    /// Samples until now.
    pub samples: u64,
}

/// A function that is called about ten times a second, by threads of the render, one call at a time. It may use films and other scenes. Any value but 0 cancels the render.
/// It must not throw an exception.
pub type ProgressFunction = Option<extern "C" fn(user: *mut c_void, progress: *const Progress) -> c_int>;

/// Options of one render. Fields that are zero or NULL are those of the scene. Initialise it by dunkelfeld_render_options().
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RenderOptions {
    /// sizeof(DunkelfeldRenderOptions).
    pub struct_size: usize,
    /// Width of the film [pixels].
    pub width: u32,
    /// Height of the film [pixels].
    pub height: u32,
    /// Name of the camera.
    pub camera: *const c_char,
    /// Limit of the wall-clock time [s]. A limit here replaces all limits of the scene.
    pub time: f64,
    /// Limit of the mean samples per pixel.
    pub spp: f64,
    /// The k of the certificate at which the render ends.
    pub noise: f64,
    /// Seed of samples, noise and device, if has_seed is not zero.
    pub seed: u64,
    /// Is the seed set?
    pub has_seed: i32,
    /// Is the frame set?
    pub has_frame: i32,
    /// Number of the frame, if has_frame is not zero.
    pub frame: u32,
    /// Number of threads, at most 1024; 0 stands for the number of the scene.
    pub threads: u32,
    /// First sample of a part of a render.
    pub samples_from: u32,
    /// End of the samples of a part, which dunkelfeld_merge() joins with others; 0 for a whole render.
    pub samples_to: u32,
    /// Allocation of the samples: "uniform", "sobel" or "sensor".
    pub strategy: *const c_char,
    /// Preset, sensor file, or "none".
    pub sensor: *const c_char,
    /// Exposure time [s]; negative for the automatic one.
    pub exposure: f64,
    /// Path of the checkpoint. If the file exists, the render continues from it.
    pub checkpoint: *const c_char,
    /// A function for the progress.
    pub progress: ProgressFunction,
    /// The first argument of that function.
    pub user: *mut c_void,
    /// A switch that cancels the render.
    pub cancel: *mut Cancel,
    /// The share of the pixels that must be hidden at the k of `noise`, in per cent.
    pub share: f64,
}

/// Options of an exposure. Fields that are zero or NULL are those of the render. Initialise it by dunkelfeld_expose_options().
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ExposeOptions {
    /// sizeof(DunkelfeldExposeOptions).
    pub struct_size: usize,
    /// Preset or sensor file, behind the lens of the render; "none" for a picture of the radiance.
    pub sensor: *const c_char,
    /// Exposure time [s]; negative for the automatic one.
    pub exposure: f64,
    /// Seed of noise and device, if has_seed is not zero.
    pub seed: u64,
    /// Is the seed set?
    pub has_seed: i32,
    /// Is the frame set?
    pub has_frame: i32,
    /// Number of the first frame, if has_frame is not zero.
    pub frame: u32,
    /// Noise of the sensor: "plain" or "matched".
    pub exposure_noise: *const c_char,
}

/// The certificate of a film. Initialise it by dunkelfeld_certificate().
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Certificate {
    /// sizeof(DunkelfeldCertificate).
    pub struct_size: usize,
    /// The level k.
    pub k: f64,
    /// Share of the counted pixels in which the standard deviation of the render is at most k times that of the sensor.
    pub hidden: f64,
    /// Mean ratio of the variances, render over sensor.
    pub mean: f64,
    /// Median ratio.
    pub median: f64,
    /// Ratio that 99 % of the pixels do not exceed.
    pub p99: f64,
    /// Largest ratio.
    pub max: f64,
    /// Counted pixels.
    pub pixels: u64,
    /// Pixels left out because they are saturated.
    pub saturated: u64,
    /// Pixels of unknown variance; they are counted, and not hidden.
    pub unknown: u64,
    /// 1 if the render is hidden at k: at least 99 % of the counted pixels are.
    pub is_hidden: i32,
    /// Always zero.
    pub reserved: i32,
}

// SAFETY: `repr(C)`, the size first; zeros are a valid value of numbers, pointers, and optional functions.
unsafe impl Versioned for RenderOptions {}
// SAFETY: as above.
unsafe impl Versioned for ExposeOptions {}
// SAFETY: as above.
unsafe impl Versioned for Certificate {}

/// Zero is no value.
fn set<T: PartialEq + Default>(value: T) -> Option<T> {
    (value != T::default()).then_some(value)
}

fn exposure(seconds: f64) -> Result<Option<ExposureOption>, Failure> {
    Ok(match set(seconds) {
        None => None,
        Some(automatic) if automatic < 0.0 => Some(ExposureOption::Auto),
        Some(time) => Some(ExposureOption::Time(Exposure::new(Seconds(time)).map_err(Error::from)?)),
    })
}

/// A text of a structure that [`In`](crate::pointers::In) has read.
fn text(pointer: *const c_char) -> Text {
    // SAFETY: whoever passes a structure promises of its texts what holds for the others.
    unsafe { Text::of(pointer) }
}

fn sensor(name: *const c_char) -> Result<Option<SensorOption>, Failure> {
    Ok(text(name).get("sensor")?.map(|name| match name {
        "none" => SensorOption::None,
        name => SensorOption::Named(name.into()),
    }))
}

impl RenderOptions {
    pub(crate) fn to_options(self) -> Result<Render, Failure> {
        let strategy = text(self.strategy).get("strategy")?.map(str::parse).transpose();
        let unknown = |e: dunkelfeld::adaptive::UnknownStrategy| {
            Failure::new(Status::Setting, "strategy", e.to_string(), "uniform, sobel, variance or sensor")
        };
        let mut options = Render::default();
        (options.width, options.height) = (set(self.width), set(self.height));
        options.camera = text(self.camera).get("camera")?.map(Into::into);
        (options.time, options.spp) = (set(self.time), set(self.spp));
        (options.noise, options.share) = (set(self.noise), set(self.share));
        options.seed = (self.has_seed != 0).then_some(self.seed);
        options.frame = (self.has_frame != 0).then_some(self.frame);
        options.threads = set(self.threads).map(|n| n as usize);
        options.strategy = strategy.map_err(unknown)?;
        if self.samples_from > 0 || self.samples_to > 0 {
            options.samples = Some(self.samples_from..self.samples_to);
        }
        options.sensor = sensor(self.sensor)?;
        options.exposure = exposure(self.exposure)?;
        options.checkpoint = text(self.checkpoint).get("checkpoint")?.map(Into::into);
        Ok(options)
    }
}

impl ExposeOptions {
    pub(crate) fn to_options(self) -> Result<Expose, Failure> {
        let noise = match text(self.exposure_noise).get("exposure_noise")? {
            None => None,
            Some("plain") => Some(ExposureNoise::Plain),
            Some("matched") => Some(ExposureNoise::Matched),
            Some(other) => {
                let problem = format!("unknown value \"{other}\"");
                return Err(Failure::new(Status::Setting, "exposure_noise", problem, "plain or matched"));
            }
        };
        let mut options = Expose::default();
        options.sensor = sensor(self.sensor)?;
        options.exposure = exposure(self.exposure)?;
        options.seed = (self.has_seed != 0).then_some(self.seed);
        options.frame = (self.has_frame != 0).then_some(self.frame);
        options.exposure_noise = noise;
        Ok(options)
    }
}
