//! Flags of `ptc`.

use crate::choices::denoisers;
use crate::run_args::ViewArgs;
use crate::values::within;
use clap::Args;
use dunkelfeld::DenoiseMethod;
use std::path::PathBuf;

/// Flags of `ptc`.
#[derive(Debug, Args)]
pub(crate) struct PtcArgs {
    /// A scene (.gltf, .glb, .obj, .stl, .ply) or a job (.toml): its budget, strategy, denoiser and exposure noise are not used, and
    /// flags replace its keys. Or three frames and more (.png, .tif, .bmp) of one camera and one scene.
    #[arg(value_name = "SCENE|JOB.toml|FRAMES", required = true)]
    pub(crate) inputs: Vec<PathBuf>,

    /// The folder of the report [default: the (first) input's name with -ptc, in this folder].
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// Discard the renders in the folder.
    #[arg(long)]
    pub(crate) restart: bool,

    /// Frames of each series; more may be added later [default: 50].
    #[arg(long, value_name = "N", value_parser = within(1..=u32::MAX))]
    pub(crate) frames: Option<u32>,
    /// Samples per pixel of the series, ascending [default: 64,2500].
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', value_parser = within(1..=u32::MAX))]
    pub(crate) spp: Vec<u32>,
    /// Denoiser of the paper's pictures, in addition to those without denoising [default: auto].
    #[arg(long, value_parser = denoisers())]
    pub(crate) denoise: Option<DenoiseMethod>,
    /// Intel Open Image Denoise 1.4 or 2: the library or its folder [default: DUNKELFELD_OIDN, then the usual places of the system].
    /// Without --denoise it means --denoise oidn.
    #[arg(long, value_name = "PATH")]
    pub(crate) oidn: Option<PathBuf>,
    /// Share of the pixels, the steepest, that count as strong edges, as in 0.2 [default: 0.2].
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    pub(crate) edges: Option<f64>,
    /// Only the paper's pictures, no frames of the sensor.
    #[arg(long)]
    pub(crate) pictures_only: bool,
    /// For frames: the grey value without light [default: 0].
    #[arg(long, value_name = "DN", allow_negative_numbers = true)]
    pub(crate) dark: Option<f64>,
    /// For frames: the grey value of saturation [default: the largest of as many bits as the frames use].
    #[arg(long, value_name = "DN", allow_negative_numbers = true)]
    pub(crate) saturation: Option<f64>,

    #[command(flatten)]
    pub(crate) view: ViewArgs,
}
