//! The flags. Doc comments are the help texts.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Renders what an industrial camera would see: a path tracer with a built-in EMVA 1288 sensor.
///
/// Exit codes: 0 done; 1 rendered, but the result is flagged (invalid samples, time budget missed); 2 bad input or usage;
/// 130 interrupted, the best image so far was written.
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
    /// List what a scene holds, and what in it may trouble a render.
    Inspect(InspectArgs),
    /// List the sensor presets, or print the data sheet of one.
    Sensors(SensorsArgs),
}

/// Flags of `render`.
#[derive(Debug, Args)]
pub(crate) struct RenderArgs {
    /// A scene (.gltf, .glb, .obj) or a job (.toml). Flags win over the job.
    #[arg(value_name = "SCENE|JOB.toml")]
    pub(crate) input: PathBuf,

    /// The picture: PNG, 8 bit, gamma 2.2, clipped at saturation [default: the input's name with .png, in this folder].
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    pub(crate) image: Option<PathBuf>,
    /// Linear grey values, 16 bit, .png or .tif (with a sensor).
    #[arg(long, value_name = "FILE")]
    pub(crate) linear: Option<PathBuf>,
    /// All layers: mean radiance, its variance, samples per pixel, albedo, normal, depth, ids, electrons.
    #[arg(long, value_name = "FILE")]
    pub(crate) exr: Option<PathBuf>,
    /// Statistics of the render as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) stats: Option<PathBuf>,
    /// The sample plan that was rendered, as an EXR for --replay.
    #[arg(long, value_name = "FILE")]
    pub(crate) plan: Option<PathBuf>,

    /// Width of the image [default: 512].
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=32768))]
    pub(crate) width: Option<u32>,
    /// Height of the image [default: 512].
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=32768))]
    pub(crate) height: Option<u32>,
    /// Camera by name [default: the first; a framing of the whole scene if there is none].
    #[arg(long, value_name = "NAME")]
    pub(crate) camera: Option<String>,

    /// Stop after this wall-clock time, start and writing included, as in 20s or 5min.
    #[arg(long, value_name = "TIME")]
    pub(crate) time: Option<String>,
    /// Stop after this many samples per pixel, on average [default: 64 if there is no other limit].
    #[arg(long, value_name = "N")]
    pub(crate) spp: Option<f64>,
    /// Where the samples go [default: sobel].
    #[arg(long, value_enum)]
    pub(crate) allocate: Option<Allocate>,
    /// Render exactly the samples of an earlier render: an EXR that --exr or --plan wrote.
    #[arg(long, value_name = "FILE.exr", conflicts_with_all = ["time", "spp", "allocate"])]
    pub(crate) replay: Option<PathBuf>,

    /// Sensor preset, a sensor file (.toml), or none for a plain image where radiance 1 is white [default: imx250].
    #[arg(long, value_name = "NAME|FILE|none")]
    pub(crate) sensor: Option<String>,
    /// Exposure time as in 5ms, or auto: the 99.5 % quantile comes to 90 % of saturation [default: auto].
    #[arg(long, value_name = "TIME|auto")]
    pub(crate) exposure: Option<String>,

    /// Seed of everything random.
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Frame number: frames of one seed are independent, and come from the same camera.
    #[arg(long, value_name = "N")]
    pub(crate) frame: Option<u32>,
    /// Threads [default: one per core].
    #[arg(long, value_name = "N")]
    pub(crate) threads: Option<usize>,
    /// How progress is shown on standard error.
    #[arg(long, value_enum, default_value_t = ProgressKind::Bar)]
    pub(crate) progress: ProgressKind,
    /// Trace one sample instead of rendering, and print its path vertex by vertex.
    #[arg(long, value_name = "X,Y,SAMPLE")]
    pub(crate) debug_sample: Option<String>,
}

/// Strategies on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Allocate {
    /// The same number everywhere.
    Uniform,
    /// In proportion to the Sobel magnitude of a pilot image (Kludt et al.).
    Sobel,
}

/// How progress is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressKind {
    /// A bar with the remaining time (only on a terminal).
    Bar,
    /// One JSON object a line, for machines.
    Json,
    /// Nothing.
    None,
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
    /// A preset or a sensor file (.toml); without it, all presets are listed.
    #[arg(value_name = "NAME|FILE")]
    pub(crate) sensor: Option<String>,
}
