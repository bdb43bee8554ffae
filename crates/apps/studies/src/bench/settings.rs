//! Settings of a bench.

use derive_setters::Setters;
use dunkelfeld::adaptive::{MAX_SPP, Strategy};
use dunkelfeld::scene::{Effect, SceneBuilder};
use dunkelfeld::{DenoiseMethod, Error};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Fewest renders for a variance with its standard error.
const MIN_SEEDS: u32 = 4;
/// Most renders of one point.
const MAX_SEEDS: u32 = 1024;
/// Largest length of the list of sample counts.
const MAX_RUNGS: usize = 24;
/// The usual numbers of samples per pixel, of which a quick bench has the first four.
const LADDER: [u32; 6] = [4, 8, 16, 32, 64, 128];
/// The usual levels k.
const LEVELS: [f64; 4] = [1.0, 0.7, 0.5, 0.25];

/// Settings of a bench, as the command line and Python name them. An empty list and `None` mean the default.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_", into)]
#[non_exhaustive]
pub struct BenchSettings {
    /// Less than a minute in all: few samples per pixel, on the largest film that this machine can render in that time.
    pub quick: bool,
    /// Mean samples per pixel of the points, ascending: by default 4 to 128, quick 4 to 32, as powers of two. They need not
    /// be such.
    pub spp: Vec<u32>,
    /// Independent renders of each point: even, 4 to 1024, by default 8. The time until the noise is hidden needs at least 8.
    pub seeds: Option<u32>,
    /// The strategies to compare, by default all.
    pub strategies: Vec<Strategy>,
    /// The levels k whose cost is measured: the render's noise is k times the sensor's.
    pub noise: Vec<f64>,
    /// The effects to leave out, one at a time; `None` means all effects of the scene.
    pub effects: Option<Vec<Effect>>,
    /// Denoisers of the renders of the points, which are also evaluated without denoising: each of `builtin` and `oidn`
    /// at most once, or `off` alone for none. The default, `auto`, is the built-in filter, and Intel Open Image Denoise if
    /// this machine has it.
    pub denoise: Vec<DenoiseMethod>,
    /// Intel Open Image Denoise: the library or its folder.
    pub oidn: Option<PathBuf>,
    /// Samples per pixel of the renders with and without an effect, by default a quarter of the largest of `spp`.
    pub effect_spp: Option<u32>,
    /// Samples per pixel of the reference, which determines the exposure, the sensor's noise and the saturated pixels: by
    /// default four times the largest of `spp`.
    pub reference_spp: Option<u32>,
}

impl BenchSettings {
    pub(super) fn ladder(&self) -> &[u32] {
        let rungs = if self.quick { &LADDER[..4] } else { &LADDER };
        if self.spp.is_empty() { rungs } else { &self.spp }
    }

    pub(super) fn top(&self) -> u32 {
        self.ladder().iter().copied().max().unwrap_or(1)
    }

    pub(super) fn seeds(&self) -> u32 {
        self.seeds.unwrap_or(8)
    }

    pub(super) fn strategies(&self) -> &[Strategy] {
        if self.strategies.is_empty() { &Strategy::ALL } else { &self.strategies }
    }

    pub(super) fn levels(&self) -> &[f64] {
        if self.noise.is_empty() { &LEVELS } else { &self.noise }
    }

    /// The denoisers to compare; `None` for those of this machine.
    pub(super) fn denoisers(&self) -> Option<&[DenoiseMethod]> {
        match self.denoise.as_slice() {
            [] | [DenoiseMethod::Auto] => None,
            [DenoiseMethod::Off] => Some(&[]),
            methods => Some(methods),
        }
    }

    pub(super) fn effect_spp(&self) -> u32 {
        self.effect_spp.unwrap_or(self.top().div_ceil(4))
    }

    pub(super) fn reference_spp(&self) -> u32 {
        self.reference_spp.unwrap_or(self.top().saturating_mul(4))
    }

    /// Checks that the settings can be measured.
    ///
    /// # Errors
    /// A setting outside its range, with help.
    pub fn check(&self) -> Result<(), Error> {
        let rungs = self.ladder();
        if rungs.len() > MAX_RUNGS || rungs[0] == 0 || rungs.windows(2).any(|w| w[0] >= w[1]) {
            let problem = format!("{rungs:?} is not an ascending list of numbers of samples per pixel");
            return Err(Error::setting(
                "spp",
                problem,
                format!("give 1 to {MAX_RUNGS} ascending numbers, as in 4,8,16"),
            ));
        }
        let top = self.top().max(self.effect_spp()).max(self.reference_spp());
        if top > MAX_SPP {
            let problem = format!("{top} samples per pixel are more than can be counted");
            return Err(Error::setting(
                "spp",
                problem,
                "use less than 1e9 for the reference, and a quarter of that for the other renders",
            ));
        }
        if !(MIN_SEEDS..=MAX_SEEDS).contains(&self.seeds()) || self.seeds() % 2 == 1 {
            let help =
                format!("use an even number from {MIN_SEEDS} to {MAX_SEEDS}: two halves give the noise of a bias");
            return Err(Error::setting(
                "seeds",
                format!("{} renders per point cannot be compared", self.seeds()),
                help,
            ));
        }
        let strategies = self.strategies();
        let repeated = strategies.iter().enumerate().any(|(i, s)| strategies[..i].contains(s));
        if repeated {
            return Err(Error::setting("strategies", "the list contains a strategy twice", "name each strategy once"));
        }
        if self.noise.iter().any(|k| !(*k > 0.0 && *k <= 10.0)) {
            return Err(Error::setting("k", "a level k is out of range", "use numbers above 0 and up to 10"));
        }
        let denoisers = self.denoisers().unwrap_or(&[]);
        let unfit = |m: &DenoiseMethod| matches!(m, DenoiseMethod::Off | DenoiseMethod::Auto);
        if denoisers.iter().any(unfit) || denoisers.iter().enumerate().any(|(i, m)| denoisers[..i].contains(m)) {
            let help = "name builtin, oidn or both, or off alone; renders without denoiser are always measured";
            return Err(Error::setting(
                "denoise",
                "the list contains a denoiser twice, or a name that is not a denoiser",
                help,
            ));
        }
        if self.oidn.is_some() && self.denoisers().is_some_and(|d| !d.contains(&DenoiseMethod::Oidn)) {
            let help = "add oidn to the denoisers, or do not name the library";
            return Err(Error::setting("oidn", "the library is named and not used", help));
        }
        let technique = self.effects.iter().flatten().find(|e| e.is_technique());
        if let Some(technique) = technique {
            let problem =
                format!("{} is a sampling technique: without it the noise differs, not the image", technique.name());
            let help = "leave out an effect of the scene; `dunkelfeld render --without` takes techniques too";
            return Err(Error::setting("effects", problem, help));
        }
        let fixed = self.effects.iter().flatten().find(|e| !can_be_left_out(**e));
        if let Some(effect) = fixed {
            let problem = format!("{} cannot be left out", effect.name());
            return Err(Error::setting(
                "effects",
                problem,
                "leave out another effect; `dunkelfeld inspect` lists them",
            ));
        }
        Ok(())
    }

    /// The inputs of the folder's fingerprint: equal values make the results of two benches comparable.
    pub(super) fn summary(&self) -> SettingsSummary {
        SettingsSummary {
            ladder: self.ladder().to_vec(),
            seeds: self.seeds(),
            effect_spp: self.effect_spp(),
            reference_spp: self.reference_spp(),
            quick: self.quick,
        }
    }
}

/// The settings that determine a results folder. Strategies, effects and levels may change, because they only select
/// units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct SettingsSummary {
    pub(super) ladder: Vec<u32>,
    pub(super) seeds: u32,
    pub(super) effect_spp: u32,
    pub(super) reference_spp: u32,
    pub(super) quick: bool,
}

/// Can the effect be left out with a bias? A technique has none.
pub(super) fn can_be_left_out(effect: Effect) -> bool {
    !effect.is_technique() && SceneBuilder::default().leave_out(effect)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_cannot_be_measured_are_errors() {
        type Change = fn(&mut BenchSettings);
        let cases: [(&str, Change); 14] = [
            ("spp", |s| s.spp = vec![0, 4]),
            ("spp", |s| s.spp = vec![8, 4]),
            ("spp", |s| s.spp = vec![4, 4]),
            ("spp", |s| s.spp = vec![4, u32::MAX]),
            ("seeds", |s| s.seeds = Some(2)),
            ("seeds", |s| s.seeds = Some(7)),
            ("strategies", |s| s.strategies = vec![Strategy::Uniform; 2]),
            ("strategies", |s| s.strategies = vec![Strategy::Uniform, Strategy::Sobel, Strategy::Uniform]),
            ("k", |s| s.noise = vec![f64::NAN]),
            ("denoise", |s| s.denoise = vec![DenoiseMethod::Auto, DenoiseMethod::Oidn]),
            ("denoise", |s| s.denoise = vec![DenoiseMethod::Builtin; 2]),
            ("oidn", |s| (s.oidn, s.denoise) = (Some("lib".into()), vec![DenoiseMethod::Off])),
            ("effects", |s| s.effects = Some(vec![Effect::Color])),
            ("effects", |s| s.effects = Some(vec![Effect::EveryLight])),
        ];
        for (name, change) in cases {
            let mut settings = BenchSettings::default();
            change(&mut settings);
            match settings.check() {
                Err(Error::Setting { what, .. }) => assert_eq!(what, name),
                other => panic!("{name}: {other:?}"),
            }
        }
    }
}
