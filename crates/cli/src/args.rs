//! The flags. Doc comments are the help texts. Values are checked here, before any file is opened.

use crate::choices::{denoisers, exposure_noises, strategies, vignettings};
use crate::run_args::{MemoryArgs, RunArgs};
#[cfg(feature = "studies")]
use crate::studies::{BenchArgs, EmvaArgs, PtcArgs};
use crate::values::{
    ExposureChoice, effect, exposure, length, noise_level, pause, pixel_sample, sample_range, samples_per_pixel,
    time_limit, whole, within,
};
use clap::{ArgGroup, Args, Parser, Subcommand};
use dunkelfeld::DenoiseMethod;
use dunkelfeld::adaptive::Strategy;
use dunkelfeld::integrator::PixelSample;
use dunkelfeld::scene::{Effect, Vignetting};
use dunkelfeld::sensor::ExposureNoise;
use std::ops::Range;
use std::path::PathBuf;

/// Simulates the images of an industrial camera: a path tracer with a built-in EMVA 1288 sensor.
///
/// Exit codes: 0 done; 1 rendered, but the result has a fault (invalid samples, time budget missed or too small); 2
/// invalid input or usage; 130 interrupted, the best image so far was written.
#[derive(Debug, Parser)]
#[command(name = "dunkelfeld", version, about, long_about, propagate_version = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Render a scene, expose it through a sensor, write images and statistics.
    Render(Box<RenderArgs>),
    /// Join parts of a render, which `render --samples A..B --checkpoint FILE` made, and write images and statistics of
    /// the whole. They are the same to the last bit as if one process had rendered all of it.
    Merge(MergeArgs),
    /// Measure the cost of accuracy in time, and write a report: noise against time for each strategy, time until the
    /// noise is hidden beneath the sensor's, cost and influence of each effect of the scene.
    #[cfg(feature = "studies")]
    Bench(Box<BenchArgs>),
    /// Denoise an EXR of this or another renderer. The result is a layer beside those of the input, or a picture. It is
    /// for display, not for measurements.
    Denoise(DenoiseArgs),
    /// Expose an EXR of this or another renderer: write the frames that a camera would record of it.
    Expose(Box<ExposeArgs>),
    /// Write EMVA 1288 data sets of simulated cameras, and analyse data sets of any camera.
    #[cfg(feature = "studies")]
    Emva(Box<EmvaArgs>),
    /// Measure the photon transfer of the frames of a scene: the experiments of Kludt et al., and the photon transfer
    /// curve of the camera from noise-matched frames. Writes a report.
    #[cfg(feature = "studies")]
    Ptc(Box<PtcArgs>),
    /// List the content of a scene, and its hazards for a render.
    Inspect(InspectArgs),
    /// List the sensor presets, or print the data sheet of one.
    Sensors(SensorsArgs),
}

/// Flags of `render`.
#[derive(Debug, Args)]
pub(crate) struct RenderArgs {
    /// A scene (.gltf, .glb, .obj) or a job (.toml). Flags override the job.
    #[arg(value_name = "SCENE|JOB.toml")]
    pub(crate) input: PathBuf,

    /// The picture: PNG, 8 bit, gamma 2.2, clipped at saturation [default: the input's name with .png, in this folder,
    /// or with .render.png where that is an input].
    #[arg(short = 'o', long = "output", value_name = "FILE.png")]
    pub(crate) image: Option<PathBuf>,
    /// Linear grey values, 16 bit, .png or .tif (with a sensor).
    #[arg(long, value_name = "FILE")]
    pub(crate) linear: Option<PathBuf>,
    /// All layers: mean radiance, its variance, samples per pixel, albedo, normal, depth, ids, electrons, ratio of the
    /// render's noise to the sensor's, and the pixels where matched exposure holds.
    #[arg(long, value_name = "FILE.exr")]
    pub(crate) exr: Option<PathBuf>,
    /// Statistics of the render.
    #[arg(long, value_name = "FILE.json")]
    pub(crate) stats: Option<PathBuf>,
    /// The sample plan of the render, for --replay.
    #[arg(long, value_name = "FILE.exr")]
    pub(crate) plan: Option<PathBuf>,

    /// Width of the image [default: 512].
    #[arg(long, value_name = "PIXELS", allow_negative_numbers = true, value_parser = within(1..=dunkelfeld::MAX_SIDE))]
    pub(crate) width: Option<u32>,
    /// Height of the image [default: 512].
    #[arg(long, value_name = "PIXELS", allow_negative_numbers = true, value_parser = within(1..=dunkelfeld::MAX_SIDE))]
    pub(crate) height: Option<u32>,
    /// Camera by name [default: the first; if there is none, a view of the whole scene].
    #[arg(long, value_name = "NAME")]
    pub(crate) camera: Option<String>,

    /// Stop after this wall-clock time, as in 20s or 5min. It includes start and writing.
    #[arg(long, value_name = "TIME", value_parser = time_limit)]
    pub(crate) time: Option<f64>,
    /// Stop after this many samples per pixel, on average [default: 64 if there is no other limit].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = samples_per_pixel)]
    pub(crate) spp: Option<f64>,
    /// Stop when the render's noise is hidden beneath the sensor's: in 99 % of the unsaturated pixels its standard
    /// deviation is at most K times the sensor's, K from 0.001 to 1000. With 0.7 the noise of both is 22 % larger than
    /// the sensor's, with 0.5 12 %, with 0.25 3 %.
    #[arg(long, value_name = "K", allow_negative_numbers = true, value_parser = noise_level)]
    pub(crate) noise: Option<f64>,
    /// Strategy that distributes the samples over the pixels [default: sensor; sobel without a sensor].
    #[arg(long, value_parser = strategies())]
    pub(crate) allocate: Option<Strategy>,
    /// Render exactly the samples of an earlier render: an EXR that --exr or --plan wrote. Size, seed and frame are
    /// those of the file, unless flags set them.
    #[arg(long, value_name = "FILE.exr", conflicts_with_all = ["time", "spp", "noise", "allocate"])]
    pub(crate) replay: Option<PathBuf>,

    /// Store the state of the render in this file, and continue from it if the file exists. The same command continues
    /// a render that was killed, and its result is the same to the last bit as without the interruption. With --time,
    /// the seconds of all runs count together. Outputs, threads and progress may change; everything else must be as
    /// before. The file remains after the render.
    #[arg(long, value_name = "FILE", conflicts_with = "debug_sample")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Pause between two checkpoints. Large ones are written less often, so that they take at most 2 % of one thread's
    /// time. 0s writes at every opportunity [default: 30s].
    #[arg(long, value_name = "TIME", value_parser = pause, requires = "checkpoint")]
    pub(crate) checkpoint_every: Option<f64>,
    /// Render only the samples A to B - 1 of every pixel: a part of a render, for `merge`. With --replay, those of them
    /// that the plan contains.
    #[arg(long, value_name = "A..B", value_parser = sample_range, requires = "checkpoint",
          conflicts_with_all = ["time", "spp", "noise", "allocate", "plan"])]
    pub(crate) samples: Option<Range<u32>>,

    /// Sensor preset, a sensor file (.toml), or none for a plain image where radiance 1 is white [default: imx250].
    #[arg(long, value_name = "NAME|FILE|none")]
    pub(crate) sensor: Option<String>,
    /// Exposure time as in 5ms, or auto, which puts the 99.5 % quantile at 90 % of saturation [default: auto].
    #[arg(long, value_name = "TIME|auto", value_parser = exposure)]
    pub(crate) exposure: Option<ExposureChoice>,
    /// Noise that the exposure adds to the render's own [default: plain].
    #[arg(long, value_parser = exposure_noises())]
    pub(crate) exposure_noise: Option<ExposureNoise>,

    /// Vignetting: how the lens darkens the image toward its edge [default: the job's; none].
    #[arg(long, value_parser = vignettings())]
    pub(crate) vignetting: Option<Vignetting>,

    /// Denoiser of the picture [default: off]. No measurement uses the denoised image. The EXR contains it as layer
    /// denoised beside the unbiased mean, and the metadata of the picture name the denoiser.
    #[arg(long, value_parser = denoisers())]
    pub(crate) denoise: Option<DenoiseMethod>,
    /// Intel Open Image Denoise 1.4 or 2: the library or its folder [default: DUNKELFELD_OIDN, then where systems have it].
    /// Without --denoise it means --denoise oidn.
    #[arg(long, value_name = "PATH")]
    pub(crate) oidn: Option<PathBuf>,

    /// Seed of all random numbers [default: 0].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole::<u64>)]
    pub(crate) seed: Option<u64>,
    /// Frame number. Frames of one seed are independent, and come from the same device [default: 0].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole::<u32>)]
    pub(crate) frame: Option<u32>,
    /// Leave out an effect of the scene, as in scattering or normal-maps, to measure its cost and its influence on the
    /// frame. This includes techniques: without every-light, each vertex samples one light instead of all, for the same
    /// image with other noise. May be repeated. `inspect` lists the effects. The outputs list those that were left out.
    #[arg(long, value_name = "EFFECT", value_delimiter = ',', value_parser = effect)]
    pub(crate) without: Vec<Effect>,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// Trace one sample instead of rendering, and print its path vertex by vertex. No file is written, so flags for
    /// outputs and budgets are refused.
    #[arg(long, value_name = "X,Y,SAMPLE", value_parser = pixel_sample,
          conflicts_with_all = ["image", "linear", "exr", "stats", "plan", "time", "spp", "allocate"])]
    pub(crate) debug_sample: Option<PixelSample>,
}

/// Flags of `merge`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("result").required(true).multiple(true).args(["image", "linear", "exr", "stats", "checkpoint"])))]
pub(crate) struct MergeArgs {
    /// The parts, in any order. They must be of one render, without overlaps and gaps. Their files contain all data
    /// that a merge needs. It needs neither scene nor job.
    #[arg(value_name = "PART", required = true)]
    pub(crate) parts: Vec<PathBuf>,
    /// The picture: PNG, 8 bit, gamma 2.2, clipped at saturation.
    #[arg(short = 'o', long = "output", value_name = "FILE.png")]
    pub(crate) image: Option<PathBuf>,
    /// Linear grey values, 16 bit, .png or .tif (with a sensor).
    #[arg(long, value_name = "FILE")]
    pub(crate) linear: Option<PathBuf>,
    /// All layers, as in `render`.
    #[arg(long, value_name = "FILE.exr")]
    pub(crate) exr: Option<PathBuf>,
    /// Statistics of the whole, and of its parts.
    #[arg(long, value_name = "FILE.json")]
    pub(crate) stats: Option<PathBuf>,
    /// The whole as one part, for another merge, or for `render --samples A..B --checkpoint FILE` with other outputs.
    #[arg(long, value_name = "FILE")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Threads [default: one per core].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = within(1..=1024u16))]
    pub(crate) threads: Option<u16>,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
}

/// Flags of `denoise`.
///
/// Uses the layers of variance, albedo, normal and depth that the file has. Names may be those of this program, of
/// Blender's view layers and of Mitsuba's AOVs.
#[derive(Debug, Args)]
pub(crate) struct DenoiseArgs {
    /// The image to denoise.
    #[arg(value_name = "IN.exr")]
    pub(crate) input: PathBuf,
    /// An EXR with all layers of the input and denoised.R/G/B, or a PNG, 8 bit, gamma 2.2. White in the PNG is radiance
    /// 1, or the bright parts of an image that was rendered for a sensor.
    #[arg(short = 'o', long = "output", value_name = "OUT.exr|png")]
    pub(crate) output: PathBuf,
    /// The denoiser [default: auto].
    #[arg(long, value_parser = denoisers())]
    pub(crate) denoise: Option<DenoiseMethod>,
    /// Intel Open Image Denoise 1.4 or 2: the library or its folder [default: DUNKELFELD_OIDN, then where systems have it].
    /// Without --denoise it means --denoise oidn.
    #[arg(long, value_name = "PATH")]
    pub(crate) oidn: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// Flags of `expose`.
///
/// The image contains mean radiance in W/(m^2 sr). The names of its channels may be those of this program, of Blender's
/// view layers or of Mitsuba. The noise of a frame is a function of seed and frame number, for any number of threads.
/// All frames of a seed come from one device.
#[derive(Debug, Args)]
pub(crate) struct ExposeArgs {
    /// The image to expose.
    #[arg(value_name = "IN.exr")]
    pub(crate) input: PathBuf,
    /// The picture: PNG, 8 bit, gamma 2.2, clipped at saturation, in colours behind a colour filter. With several
    /// frames, each name contains the frame number, as in out-0007.png [default: the input's name with .png, in this
    /// folder, unless --linear is given].
    #[arg(short = 'o', long = "output", value_name = "FILE.png")]
    pub(crate) image: Option<PathBuf>,
    /// Linear grey values, 16 bit, .png or .tif; behind a colour filter the raw mosaic. Numbered like the picture.
    #[arg(long, value_name = "FILE")]
    pub(crate) linear: Option<PathBuf>,
    /// Sensor preset, or a sensor file (.toml) [default: imx250].
    #[arg(long, value_name = "NAME|FILE")]
    pub(crate) sensor: Option<String>,
    /// Exposure time as in 5ms, or auto, which puts the 99.5 % quantile at 90 % of saturation [default: auto].
    #[arg(long, value_name = "TIME|auto", value_parser = exposure)]
    pub(crate) exposure: Option<ExposureChoice>,
    /// Noise that the exposure adds to the image's own [default: plain]. Matched needs a layer `variance`, and is for
    /// one frame.
    #[arg(long, value_parser = exposure_noises())]
    pub(crate) exposure_noise: Option<ExposureNoise>,
    /// f-number of the lens, 0.5 to 1000 [default: 4].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub(crate) f_number: Option<f64>,
    /// Share of the light that passes the lens, above 0 and at most 1 [default: 0.9].
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    pub(crate) transmission: Option<f64>,
    /// Magnification: image size over object size, 0 (far away) to 100 [default: 0].
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub(crate) magnification: Option<f64>,
    /// Vignetting: how the lens darkens the image toward its edge [default: none]. cos4 needs --focal-length, and is
    /// not for images that were rendered with it.
    #[arg(long, value_parser = vignettings())]
    pub(crate) vignetting: Option<Vignetting>,
    /// Focal length of the lens, as in 12mm. With the sensor's pixel pitch it determines the field angle of each pixel.
    #[arg(long, value_name = "LENGTH", value_parser = length, requires = "vignetting")]
    pub(crate) focal_length: Option<f64>,
    /// The layer with radiance, as in ViewLayer.Combined [default: the first with a supported name].
    #[arg(long, value_name = "NAME")]
    pub(crate) layer: Option<String>,
    /// Number of frames.
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = within(1..=u32::MAX))]
    pub(crate) frames: u32,
    /// Seed of noise and device.
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true, value_parser = whole::<u64>)]
    pub(crate) seed: u64,
    /// Number of the first frame.
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true, value_parser = whole::<u32>)]
    pub(crate) frame: u32,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// Flags of `inspect`.
#[derive(Debug, Args)]
pub(crate) struct InspectArgs {
    /// A scene (.gltf, .glb, .obj) or a job (.toml).
    #[arg(value_name = "SCENE|JOB.toml")]
    pub(crate) input: PathBuf,
    /// Print JSON instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Flags of `sensors`.
#[derive(Debug, Args)]
pub(crate) struct SensorsArgs {
    /// A preset or a sensor file (.toml). Without it, all presets are listed.
    #[arg(value_name = "NAME|FILE")]
    pub(crate) sensor: Option<String>,
    /// Print JSON instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_flags_do_not_contradict_each_other() {
        Cli::command().debug_assert();
    }
}
