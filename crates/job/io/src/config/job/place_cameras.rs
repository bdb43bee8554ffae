//! Adds the cameras of a job to an imported scene, and selects one.

use super::{CameraSettings, Job};
use crate::error::InputError;
use crate::names::suggestion;
use dunkelfeld_scene::{Camera, SceneBuilder};

impl Job {
    /// Adds the cameras of `[camera]` to the scene, in front of its own. One with the name of a camera of the scene
    /// replaces it.
    ///
    /// # Errors
    /// A camera without a pose that is not in the scene, a `look_at` that matches no object or lies at the position.
    pub(super) fn add_cameras(&self, scene: &mut SceneBuilder) -> Result<(), InputError> {
        let cameras: Vec<Camera> = (self.camera.defined.iter().enumerate())
            .map(|(i, settings)| {
                settings.camera(scene).map_err(|e| self.camera.error(&self.source, i, &[&e.place], e.problem, e.help))
            })
            .collect::<Result<_, _>>()?;
        scene.cameras.retain(|camera| cameras.iter().all(|defined| defined.name != camera.name));
        scene.cameras.splice(0..0, cameras);
        Ok(())
    }

    /// Sets the projection of the cameras with `K`, after [`Job::apply_overrides`]. `film` is the size of the whole film
    /// \[pixels\], to which `K` refers.
    pub fn apply_intrinsics(&self, scene: &mut SceneBuilder, film: [u32; 2]) {
        for camera in &mut scene.cameras {
            if let Some(settings) = self.camera_settings(&camera.name) {
                settings.set_intrinsics(camera, film);
            }
        }
    }

    /// The camera that is rendered if none is chosen, where this is not the first one of the scene.
    pub fn first_enabled(&self) -> Option<&str> {
        let defined = &self.camera.defined;
        let enabled = defined.iter().position(CameraSettings::is_enabled).filter(|index| *index > 0)?;
        Some(&defined[enabled].name)
    }

    /// The definition of a camera by its name.
    pub fn camera_settings(&self, name: &str) -> Option<&CameraSettings> {
        self.camera.defined.iter().find(|camera| camera.name == name)
    }

    /// An error about a key of the lens of a camera that depends on lens, film and scene together.
    pub fn lens_error(&self, camera: &str, error: InputError) -> InputError {
        let InputError { place: key, problem, help, .. } = error;
        let own = self.camera.defined.iter().position(|c| c.name == camera && c.lens.is_some());
        match own {
            Some(i) => self.camera.error(&self.source, i, &["lens", &key], problem, help),
            None => self.source.error_at_key(&["lens", &key], problem, help),
        }
    }

    /// An error about a key of `[film]` that depends on film and sensor together.
    pub fn film_error(&self, error: InputError) -> InputError {
        self.source.error_at_key(&["film", &error.place], error.problem, error.help)
    }

    /// Index of the job's camera; `None` if the job selects none.
    ///
    /// # Errors
    /// If the scene has no camera of that name.
    pub fn camera_index(&self, scene: &SceneBuilder) -> Result<Option<usize>, InputError> {
        let Some(name) = &self.camera.selected else { return Ok(None) };
        let found = scene.cameras.iter().position(|c| c.name == *name);
        found.map(Some).ok_or_else(|| {
            let known: Vec<&str> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
            let problem = format!("the scene has no camera named \"{name}\"");
            self.source.error_at_key(&["camera"], problem, suggestion(name, "cameras", &known))
        })
    }
}
