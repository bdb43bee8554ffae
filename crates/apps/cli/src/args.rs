//! The flags. Doc comments are the help texts; values are checked here, before any file is opened.

use crate::choices::denoisers;
#[cfg(feature = "view")]
use crate::key_flags::OfLens;
use crate::key_flags::{KeyFlags, OfExpose, OfMerge, OfRender};
use crate::run_args::{MemoryArgs, RunArgs};
#[cfg(feature = "studies")]
use crate::studies::{BenchArgs, DatasetArgs, EmvaArgs, MtfArgs, PtcArgs};
#[cfg(feature = "view")]
use crate::values::socket_address;
use crate::values::{effect, pause, pixel_sample, sample_range, within};
use clap::{ArgGroup, Args, Parser, Subcommand};
use dunkelfeld::DenoiseMethod;
use dunkelfeld::scene::Effect;
use dunkelfeld::trace::PixelSample;
use std::ops::Range;
use std::path::PathBuf;

/// Renders images of an industrial camera: a path tracer with a built-in EMVA 1288 sensor.
///
/// Exit codes: 0 done; 1 rendered, but the result is flagged (invalid samples, time budget too small for every pixel; with `render --strict`
/// also a time budget that was missed); 2 bad input or usage; 130 interrupted, the best image so far was written.
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
    /// Join parts of a render, which `render --samples A..B --checkpoint FILE` made, and write images and statistics of the
    /// whole: the same to the last bit as if one process had rendered all of it.
    Merge(MergeArgs),
    /// Measure the time that accuracy costs, and write a report: noise against time for each strategy, time to hidden,
    /// cost and influence of each effect of the scene.
    #[cfg(feature = "studies")]
    Bench(Box<BenchArgs>),
    /// Make a data set: many images of a station, each a little different, with exact labels and the noise of a camera.
    #[cfg(feature = "studies")]
    Dataset(Box<DatasetArgs>),
    /// Denoise an EXR of this or another renderer: a layer beside those of the file, or a picture. The result is for
    /// display, not for measurement.
    Denoise(DenoiseArgs),
    /// Expose an EXR of this or another renderer: write the frames of a camera.
    Expose(Box<ExposeArgs>),
    /// Write EMVA 1288 data sets of simulated cameras, and analyse those of any camera.
    #[cfg(feature = "studies")]
    Emva(Box<EmvaArgs>),
    /// Measure the MTF of a camera and of its lens from frames of a slanted edge (ISO 12233).
    #[cfg(feature = "studies")]
    Mtf(MtfArgs),
    /// Measure the photon transfer of a scene's frames: the experiments of Kludt et al., and the camera's own curve from
    /// noise-matched frames. Writes a report.
    #[cfg(feature = "studies")]
    Ptc(Box<PtcArgs>),
    /// Show a scene, a film or an EXR in the browser, behind a camera whose knobs can be turned while it renders.
    #[cfg(feature = "view")]
    View(ViewArgs),
    /// Write a first job: for a scene with all its names, or of a preset station.
    Init(InitArgs),
    /// List the contents of a scene, and the hazards for a render.
    Inspect(InspectArgs),
    /// List the sensor presets, or print the data sheet of one.
    Sensors(SensorsArgs),
}

/// Flags of `render`.
#[derive(Debug, Args)]
pub(crate) struct RenderArgs {
    /// A scene (.gltf, .glb, .obj, .stl, .ply) or a job (.toml). Flags replace keys of the job.
    #[arg(value_name = "SCENE|JOB.toml")]
    pub(crate) input: PathBuf,

    #[command(flatten)]
    pub(crate) keys: KeyFlags<OfRender>,
    /// Camera by name, of the job or of the scene [default: all that the job defines, each with its name in the files; otherwise
    /// the first of the scene, or a framing of the whole scene].
    #[arg(long, value_name = "NAME")]
    pub(crate) camera: Option<String>,

    /// Render exactly the samples of an earlier render: an EXR that --exr or --plan wrote. Size, seed and frame are those
    /// of the file, unless they are given.
    #[arg(long, value_name = "FILE.exr", conflicts_with_all = ["time", "spp", "noise", "share", "allocate"])]
    pub(crate) replay: Option<PathBuf>,

    /// Write the state of the render to this file, and continue from it if the file exists. The same command continues a
    /// render that was killed, and the result has the same bits as without the interruption. With --time, the seconds of
    /// all runs count together. Outputs, threads and progress may change; all other settings must be the same. The file
    /// stays when the render is complete.
    #[arg(long, value_name = "FILE", conflicts_with = "debug_sample")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Pause between two checkpoints; large ones are written more rarely, so that they take at most 2 % of one thread's
    /// time. 0s writes at every opportunity [default: 30s].
    #[arg(long, value_name = "TIME", value_parser = pause, requires = "checkpoint")]
    pub(crate) checkpoint_every: Option<f64>,
    /// Render only the samples A to B - 1 of every pixel: a part of a render, for `merge`. With --replay, those of the
    /// plan.
    #[arg(long, value_name = "A..B", value_parser = sample_range, requires = "checkpoint",
          conflicts_with_all = ["time", "spp", "noise", "share", "allocate", "plan"])]
    pub(crate) samples: Option<Range<u32>>,

    /// Number of frames of one device, each with samples and noise of its own, from --frame on. Of several frames each
    /// file gets its number, as in out-0007.png. An automatic exposure is that of the first frame [default: 1].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = within(1..=10_000u32),
          conflicts_with_all = ["checkpoint", "replay", "samples", "debug_sample"])]
    pub(crate) frames: Option<u32>,
    /// Leave out an effect that the scene needs, as in scattering or normal-maps, to measure its cost and its influence on
    /// the image. Techniques too: without every-light one light is sampled at a time, for the same image with other
    /// noise. May be repeated. `inspect` lists the effects. The outputs name the effects that were left out.
    #[arg(long, value_name = "EFFECT", value_delimiter = ',', value_parser = effect)]
    pub(crate) without: Vec<Effect>,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    /// End with exit code 1 if the command took longer than the time budget by more than 2 % and 0.2 s. Without the flag
    /// that is a warning, and the exit code is 0.
    #[arg(long)]
    pub(crate) strict: bool,
    /// Trace one sample instead of rendering, and print its path vertex by vertex. Nothing is written, so flags for outputs
    /// and budgets are refused.
    #[arg(long, value_name = "X,Y,SAMPLE", value_parser = pixel_sample,
          conflicts_with_all = ["output", "linear", "exr", "stats", "plan", "time", "spp", "allocate"])]
    pub(crate) debug_sample: Option<PixelSample>,
}

/// Flags of `merge`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("result").required(true).multiple(true).args(["output", "linear", "exr", "stats", "checkpoint"])))]
pub(crate) struct MergeArgs {
    /// The parts, in any order: they must be of one render and follow each other without overlaps and gaps. They contain
    /// all data, so neither scene nor job is needed.
    #[arg(value_name = "PART", required = true)]
    pub(crate) parts: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) files: KeyFlags<OfMerge>,
    /// The whole as a part again: for another merge, or for `render --samples A..B --checkpoint FILE` with other outputs.
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
/// Uses variance, albedo, normal and depth if the file has them; names are those of this program, of Blender's view layers
/// and of Mitsuba's AOVs.
#[derive(Debug, Args)]
pub(crate) struct DenoiseArgs {
    /// The image to denoise.
    #[arg(value_name = "IN.exr")]
    pub(crate) input: PathBuf,
    /// An EXR with all layers of the input and denoised.R/G/B; or a PNG, 8 bit, gamma 2.2, in which radiance 1 is white, or
    /// the bright parts of an image that was rendered for a sensor.
    #[arg(short = 'o', long = "output", value_name = "OUT.exr|png")]
    pub(crate) output: PathBuf,
    /// The denoiser [default: auto].
    #[arg(long, value_parser = denoisers())]
    pub(crate) denoise: Option<DenoiseMethod>,
    /// Intel Open Image Denoise 1.4 or 2: the library or its folder [default: DUNKELFELD_OIDN, then the usual places of the system].
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
/// The image contains mean radiance in W/(m^2 sr); the names of its channels may be those of this program, of Blender's view layers
/// or of Mitsuba. The noise of a frame is a function of seed and frame number, on any number of threads; all frames of a seed
/// come from one device.
#[derive(Debug, Args)]
pub(crate) struct ExposeArgs {
    /// The image to expose.
    #[arg(value_name = "IN.exr")]
    pub(crate) input: PathBuf,
    #[command(flatten)]
    pub(crate) keys: KeyFlags<OfExpose>,
    /// The layer that contains radiance, as in ViewLayer.Combined [default: the first with a standard name].
    #[arg(long, value_name = "NAME")]
    pub(crate) layer: Option<String>,
    /// Number of frames.
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = within(1..=u32::MAX))]
    pub(crate) frames: u32,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// Flags of `view`.
///
/// The program prints the address of the page, and opens it in the browser of the desktop. Files that the page saves go to the
/// output folder, jobs to the folder of the scene; no file is replaced.
#[cfg(feature = "view")]
#[derive(Debug, Args)]
pub(crate) struct ViewArgs {
    /// A scene (.gltf, .glb, .obj, .stl, .ply), a job (.toml), a saved film (.film) or an EXR of any renderer.
    #[arg(value_name = "SCENE|JOB.toml|FILM|IN.exr")]
    pub(crate) input: PathBuf,
    /// Print the address, and open no browser.
    #[arg(long)]
    pub(crate) no_open: bool,
    /// The port on 127.0.0.1 [default: a free one].
    #[arg(long, value_name = "PORT", allow_negative_numbers = true, value_parser = within(1..=u16::MAX))]
    pub(crate) port: Option<u16>,
    /// Listen on this address instead of 127.0.0.1, as in 0.0.0.0:8080. The address of the page then contains a random token:
    /// whoever has it can use the page.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "port", value_parser = socket_address)]
    pub(crate) listen: Option<std::net::SocketAddr>,
    /// The folder of saved pictures and films [default: this folder].
    #[arg(short = 'o', long = "output", value_name = "FOLDER")]
    pub(crate) output: Option<PathBuf>,
    /// Threads of the exposures and measurements beside the render [default: one per core].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = within(1..=1024u16))]
    pub(crate) threads: Option<u16>,
    /// Nice value of the threads of the render, 0 to 19: with a larger one, other programs get more time [default: 10].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = within(0..=dunkelfeld::limits::MAX_NICE))]
    pub(crate) nice: Option<u8>,
    #[command(flatten, next_help_heading = "Lens of an EXR")]
    pub(crate) lens: KeyFlags<OfLens>,
}

/// Flags of `init`.
#[derive(Debug, Args)]
pub(crate) struct InitArgs {
    /// A scene (.gltf, .glb, .obj, .stl, .ply). Without SCENE and NAME the preset stations are listed.
    #[arg(value_name = "SCENE")]
    pub(crate) input: Option<PathBuf>,
    /// Camera, lens and lights of a preset station, as dark-field-ring; without SCENE with a stand-in part.
    #[arg(long, value_name = "NAME")]
    pub(crate) station: Option<String>,
    /// The job; no file is replaced [default: the name of the scene or the station with .toml, in this folder].
    #[arg(short = 'o', long = "output", value_name = "JOB.toml")]
    pub(crate) output: Option<PathBuf>,
}

/// Flags of `inspect`.
#[derive(Debug, Args)]
pub(crate) struct InspectArgs {
    /// A scene (.gltf, .glb, .obj, .stl, .ply) or a job (.toml).
    #[arg(value_name = "SCENE|JOB.toml")]
    pub(crate) input: PathBuf,
    /// Print JSON instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Flags of `sensors`.
#[derive(Debug, Args)]
pub(crate) struct SensorsArgs {
    /// A preset or a sensor file (.toml); without it, all presets are listed.
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
