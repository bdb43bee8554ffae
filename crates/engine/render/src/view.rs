//! The camera of a render: its own view, or a camera of the scene.

use crate::error::Error;
use crate::settings::RenderSettings;
use dunkelfeld_film::MeanImage;
use dunkelfeld_scene::{Camera, RayGenerator, Scene};

/// Binds the camera of the settings to the film: their own view, or the camera that they name.
///
/// # Errors
/// A camera that the scene does not have, or one without rays for this film.
pub fn camera(scene: &Scene, settings: &RenderSettings) -> Result<RayGenerator, Error> {
    let mut camera = match &settings.run.view {
        Some(view) => view.clone(),
        None => find_camera(scene, settings)?,
    };
    let spread = || if settings.is_spread() { MeanImage::SPREAD } else { 0.0 };
    camera.lens.spread = settings.is_blurred().then(spread);
    Ok(scene.ray_generator(&camera, settings.width, settings.height)?)
}

/// The camera of the scene that the settings name.
pub fn find_camera(scene: &Scene, settings: &RenderSettings) -> Result<Camera, Error> {
    let aspect = settings.width as f32 / settings.height as f32;
    scene.camera(settings.camera.as_deref(), aspect).ok_or_else(|| {
        let names: Vec<&str> = scene.cameras().iter().map(|c| c.name.as_str()).collect();
        let known = if names.is_empty() { "the scene has none".into() } else { names.join(", ") };
        let name = settings.camera.clone().unwrap_or_default();
        Error::setting(
            "camera",
            format!("there is no camera \"{name}\""),
            if names.is_empty() {
                format!("cameras: {known}; leave it out for a view of the whole scene")
            } else {
                format!("write one of {known}, or leave it out")
            },
        )
    })
}
