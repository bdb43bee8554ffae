//! Options of renders and exposures as structures of C. Fields that are zero are those of the scene, or of the render.

use crate::cancel::Cancel;
use crate::pointers::{Text, Versioned};
use crate::status::Failure;
use dunkelfeld::{ExposeOptions as Expose, RenderOptions as Render};
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
    /// Keys of a job that do not change the scene, as lines of TOML: "budget.spp = 64". They replace those of the scene for
    /// this render.
    pub keys: *const c_char,
    /// Name of the camera.
    pub camera: *const c_char,
    /// Path of the checkpoint. If the file exists, the render continues from it.
    pub checkpoint: *const c_char,
    /// A function for the progress.
    pub progress: ProgressFunction,
    /// The first argument of that function.
    pub user: *mut c_void,
    /// A switch that cancels the render.
    pub cancel: *mut Cancel,
    /// Number of threads, at most 1024; 0 stands for the number of the scene.
    pub threads: u32,
    /// First sample of a part of a render.
    pub samples_from: u32,
    /// End of the samples of a part, which dunkelfeld_merge() joins with others; 0 for a whole render.
    pub samples_to: u32,
    /// Always zero.
    pub reserved: u32,
}

/// Options of an exposure. Fields that are zero or NULL are those of the render. Initialise it by dunkelfeld_expose_options().
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct ExposeOptions {
    /// sizeof(DunkelfeldExposeOptions).
    pub struct_size: usize,
    /// Keys of a job as lines of TOML: "sensor.model", "sensor.exposure", "sensor.exposure_noise", "seed" and "frame" (the number
    /// of the first frame), such as "sensor.exposure = '2ms'".
    pub keys: *const c_char,
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

/// A text of a structure that [`In`](crate::pointers::In) has read.
fn text(pointer: *const c_char) -> Text {
    // SAFETY: whoever passes a structure promises of its texts what holds for the others.
    unsafe { Text::of(pointer) }
}

impl RenderOptions {
    pub(crate) fn to_options(self) -> Result<Render, Failure> {
        let mut options = Render::default().with_keys(text(self.keys).get("keys")?.unwrap_or_default());
        options.camera = text(self.camera).get("camera")?.map(Into::into);
        options.threads = set(self.threads).map(|n| n as usize);
        if self.samples_from > 0 || self.samples_to > 0 {
            options.samples = Some(self.samples_from..self.samples_to);
        }
        options.checkpoint = text(self.checkpoint).get("checkpoint")?.map(Into::into);
        Ok(options)
    }
}

impl ExposeOptions {
    pub(crate) fn to_options(self) -> Result<Expose, Failure> {
        Ok(Expose::default().with_keys(text(self.keys).get("keys")?.unwrap_or_default()))
    }
}
