//! The renders of a bench, one by one: each a unit that is finished or not.

use super::settings::BenchSettings;
use crate::series::hash_text;
use dunkelfeld::adaptive::Strategy;
use dunkelfeld::scene::Effect;
use dunkelfeld_sampling::hash_u64;

/// The purpose of a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Many uniform samples. It determines exposure, sensor noise and saturation, and is the reference picture of
    /// comparisons.
    Reference,
    /// The pilot of a strategy.
    Pilot,
    /// One of the renders of a strategy and a sample count.
    Point(Strategy),
    /// One of the renders without an effect, or with all of them: same seed, same samples.
    Effects(Option<Effect>),
}

/// One render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unit {
    pub(super) purpose: Purpose,
    /// Mean samples per pixel.
    pub(super) spp: u32,
    /// Index among the renders that differ only in their seed.
    pub(super) index: u32,
}

impl Unit {
    /// The name of its files, without extension.
    pub(super) fn name(&self) -> String {
        let Self { spp, index, .. } = self;
        match self.purpose {
            Purpose::Reference => format!("reference-{spp}"),
            Purpose::Pilot => format!("pilot-{spp}"),
            Purpose::Point(strategy) => format!("{strategy}-{spp}-{index:02}"),
            Purpose::Effects(None) => format!("effects-all-{spp}-{index:02}"),
            Purpose::Effects(Some(effect)) => format!("effects-without-{}-{spp}-{index:02}", effect.name()),
        }
    }

    pub(super) fn strategy(&self) -> Strategy {
        match self.purpose {
            Purpose::Point(strategy) => strategy,
            _ => Strategy::Uniform,
        }
    }

    pub(super) fn without(&self) -> Option<Effect> {
        match self.purpose {
            Purpose::Effects(effect) => effect,
            _ => None,
        }
    }

    /// The seed of its render. Renders of one point, of different points and of different purposes are independent. The
    /// render with and the one without an effect have the same seed, so that their common noise cancels in the
    /// difference. The seed is below 2^53, so that every reader of JSON reads it exactly.
    pub(super) fn seed(&self, base: u64) -> u64 {
        let purpose = match self.purpose {
            Purpose::Reference => hash_text("reference"),
            Purpose::Pilot => hash_text("pilot"),
            Purpose::Point(strategy) => hash_text(strategy.name()),
            Purpose::Effects(_) => hash_text("effects"),
        };
        hash_u64([base, purpose, u64::from(self.spp), u64::from(self.index)]) >> 11
    }
}

/// All renders, in their order: all points with the first seed, then with the next one. So an interrupted bench has
/// some data of everything, and a decrease in machine speed affects all points alike.
pub(super) fn units(settings: &BenchSettings, effects: &[Effect], pilot_spp: u32) -> Vec<Unit> {
    let once = |purpose, spp| Unit { purpose, spp, index: 0 };
    let mut units = vec![once(Purpose::Reference, settings.reference_spp()), once(Purpose::Pilot, pilot_spp)];
    for index in 0..settings.seeds() {
        for &spp in settings.ladder() {
            units.extend(settings.strategies().iter().map(|&s| Unit { purpose: Purpose::Point(s), spp, index }));
        }
    }
    if !effects.is_empty() {
        let spp = settings.effect_spp();
        for purpose in [None].into_iter().chain(effects.iter().copied().map(Some)).map(Purpose::Effects) {
            units.extend((0..settings.seeds()).map(|index| Unit { purpose, spp, index }));
        }
    }
    units
}
