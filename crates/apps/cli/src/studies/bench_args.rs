//! Flags of `bench`.

use crate::choices::denoisers;
use crate::run_args::ViewArgs;
use crate::values::{effect, within};
use clap::Args;
use dunkelfeld::DenoiseMethod;
use dunkelfeld::adaptive::Strategy;
use dunkelfeld::scene::Effect;
use std::path::PathBuf;

/// Flags of `bench`.
///
/// Renders the scene many times with different seeds and compares. The folder gets `report.html`, which needs no other file, its
/// numbers as CSV, its charts as SVG, and in `units/` every finished render. The same command continues a bench that was
/// interrupted.
#[derive(Debug, Args)]
pub(crate) struct BenchArgs {
    /// A scene (.gltf, .glb, .obj, .stl, .ply) or a job (.toml). Its budget and strategy are not used. Flags replace keys of the job.
    #[arg(value_name = "SCENE|JOB.toml")]
    pub(crate) input: PathBuf,

    /// The folder of the report [default: the input's name with -bench, in this folder].
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// Less than a minute in all: few samples per pixel, and, if no size is given, the largest film that this machine renders in that time.
    #[arg(long)]
    pub(crate) quick: bool,
    /// Discard the renders in the folder.
    #[arg(long)]
    pub(crate) restart: bool,

    /// Samples per pixel of the points, ascending [default: 4,8,16,32,64,128; with --quick 4,8,16,32].
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', value_parser = within(1..=u32::MAX))]
    pub(crate) spp: Vec<u32>,
    /// Independent renders of each point, an even number from 4 on [default: 8].
    #[arg(long, value_name = "N", value_parser = within(1..=u32::MAX))]
    pub(crate) seeds: Option<u32>,
    /// The strategies to compare [default: all].
    #[arg(long, value_name = "NAME,NAME,...", value_delimiter = ',', value_parser = strategy)]
    pub(crate) strategies: Vec<Strategy>,
    /// The levels k whose time is measured [default: 1,0.7,0.5,0.25].
    #[arg(long, value_name = "K,K,...", value_delimiter = ',')]
    pub(crate) noise: Vec<f64>,
    /// The effects to leave out, one at a time, or none [default: all that the scene needs].
    #[arg(long, value_name = "EFFECT,...|none", value_parser = effect_choice)]
    pub(crate) effects: Option<EffectChoice>,
    /// The denoisers to compare, or off [default: builtin, and oidn if this machine has it]. Images without a denoiser are
    /// always measured; all sections except that of the denoisers are about them.
    #[arg(long, value_name = "NAME,NAME|off", value_delimiter = ',', value_parser = denoisers())]
    pub(crate) denoise: Vec<DenoiseMethod>,
    /// Intel Open Image Denoise 1.4 or 2: the library or its folder [default: DUNKELFELD_OIDN, then the usual places of the system].
    #[arg(long, value_name = "PATH")]
    pub(crate) oidn: Option<PathBuf>,
    /// Samples per pixel of the renders with and without an effect [default: a quarter of the largest of --spp].
    #[arg(long, value_name = "N", value_parser = within(1..=u32::MAX))]
    pub(crate) effect_spp: Option<u32>,
    /// Samples per pixel of the reference [default: four times the largest of --spp].
    #[arg(long, value_name = "N", value_parser = within(1..=u32::MAX))]
    pub(crate) reference_spp: Option<u32>,

    #[command(flatten)]
    pub(crate) view: ViewArgs,
}

/// Effects on the command line: a list, or none at all.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct EffectChoice(pub(crate) Vec<Effect>);

fn effect_choice(text: &str) -> Result<EffectChoice, String> {
    let names = text.split(',').filter(|_| text != "none");
    names.map(effect).collect::<Result<_, _>>().map(EffectChoice)
}

fn strategy(name: &str) -> Result<Strategy, String> {
    name.parse().map_err(|e: dunkelfeld::adaptive::UnknownStrategy| e.to_string())
}
