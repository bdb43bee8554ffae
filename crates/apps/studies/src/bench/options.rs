//! Options of a bench, as the command line and Python name them.

use super::settings::BenchSettings;
use derive_setters::Setters;
use dunkelfeld::DenoiseMethod;
use dunkelfeld::adaptive::Strategy;
use dunkelfeld::scene::Effect;
use std::path::PathBuf;

/// Options of a bench. An empty list and `None` mean the default of [`BenchSettings`].
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct BenchOptions {
    /// Less than a minute in all: defaults are those of [`BenchSettings::quick`].
    pub quick: bool,
    /// Mean samples per pixel of the points, ascending. Those of the reference and of the effects follow from them.
    pub spp: Vec<u32>,
    /// Independent renders of each point.
    pub seeds: Option<u32>,
    /// The strategies to compare.
    pub strategies: Vec<Strategy>,
    /// The levels k whose time is measured.
    pub noise: Vec<f64>,
    /// The effects to leave out, one at a time; `None` means all that the scene needs.
    pub effects: Option<Vec<Effect>>,
    /// The denoisers to compare; `[Auto]` is the default, `[Off]` means none.
    pub denoise: Vec<DenoiseMethod>,
    /// Intel Open Image Denoise: the library or its folder.
    pub oidn: Option<PathBuf>,
    /// Samples per pixel of the renders with and without an effect.
    pub effect_spp: Option<u32>,
    /// Samples per pixel of the reference.
    pub reference_spp: Option<u32>,
}

impl From<BenchOptions> for BenchSettings {
    fn from(options: BenchOptions) -> Self {
        let mut settings = if options.quick { Self::quick() } else { Self::default() };
        if !options.spp.is_empty() {
            settings = settings.with_ladder(options.spp);
        }
        if !options.strategies.is_empty() {
            settings.strategies = options.strategies;
        }
        if !options.noise.is_empty() {
            settings.levels = options.noise;
        }
        settings.denoisers = match options.denoise.as_slice() {
            [] | [DenoiseMethod::Auto] => None,
            [DenoiseMethod::Off] => Some(Vec::new()),
            _ => Some(options.denoise),
        };
        settings.oidn = options.oidn;
        settings.seeds = options.seeds.unwrap_or(settings.seeds);
        settings.effect_spp = options.effect_spp.unwrap_or(settings.effect_spp);
        settings.reference_spp = options.reference_spp.unwrap_or(settings.reference_spp);
        settings.effects = options.effects;
        settings
    }
}
