//! Ways of looking for light that a scene can be rendered without: they change the noise, never the expected image.

/// Which of the ways of looking for light are used, where the scene calls for them.
///
/// Each is an [`Effect`](crate::Effect) by name, so that it can be listed and left out as effects are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Techniques {
    /// All lights are asked at each surface of a path where they are few; without it one is chosen at each.
    pub every_light: bool,
    /// Light behind clear covers is connected to; without it paths find it by chance.
    pub cover_connection: bool,
}

impl Default for Techniques {
    /// All of them.
    fn default() -> Self {
        Self { every_light: true, cover_connection: true }
    }
}
