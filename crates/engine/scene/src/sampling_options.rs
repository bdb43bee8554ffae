//! Sampling techniques that can be disabled. They change the noise, never the expected image.

/// The enabled sampling techniques, for scenes that need them.
///
/// Each is also an [`Effect`](crate::Effect), so that it is listed and left out by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Techniques {
    /// Surfaces take a sample of each light if there are few lights. If false, they take a sample of one light.
    pub every_light: bool,
    /// Next-event estimation through clear covers. If false, only scattering samples light behind covers.
    pub cover_connection: bool,
    /// Russian roulette by learned survival probabilities. If false, the throughput of a path decides.
    pub learned_roulette: bool,
}

impl Default for Techniques {
    /// All techniques enabled.
    fn default() -> Self {
        Self { every_light: true, cover_connection: true, learned_roulette: true }
    }
}
