//! The scenes of a render: with all lights, and with single ones.

use dunkelfeld::Project;

/// A light with the scene in which it alone emits.
pub(crate) struct LightScene {
    pub(crate) name: String,
    pub(crate) project: Project,
}

/// The scenes of a render.
#[derive(Clone, Copy)]
pub(crate) struct Scenes<'a> {
    /// With all lights.
    pub(crate) whole: &'a Project,
    /// With single lights, if each has a film.
    pub(crate) lights: &'a [LightScene],
}

impl<'a> Scenes<'a> {
    /// The scene of a film: that of a light, or of all. `None` if the light has no film any more.
    pub(crate) fn of_film(&self, light: Option<&str>) -> Option<&'a Project> {
        match light {
            None => Some(self.whole),
            Some(name) => self.lights.iter().find(|light| light.name == name).map(|light| &light.project),
        }
    }
}
