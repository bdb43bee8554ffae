//! Applies the changes of a job to an imported scene: its environment, and by other modules objects, materials and lights.

use super::{EnvironmentSettings, Job, Light};
use crate::error::{ImportWarning, InputError};
use crate::images::load_image;
use crate::input::Role;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Environment, EnvironmentSource, ImageId, SceneBuilder};

impl Job {
    /// Changes the scene by `[environment]`, `[[object]]`, `[[material]]`, `[camera]` and `[[light]]`, in this order. New
    /// materials exist before the objects are changed.
    ///
    /// # Errors
    /// If a name matches nothing in the scene, a light's quantity does not fit its kind, or the environment's image
    /// cannot be read. The scene is then partly changed and should be dropped.
    pub fn apply_overrides(&self, scene: &mut SceneBuilder) -> Result<Vec<ImportWarning>, InputError> {
        let mut warnings: Vec<ImportWarning> = self.exposure_warning().into_iter().collect();
        scene.energy_compensation = self.render.energy_compensation;
        scene.principled = self.render.principled;
        if let Some(environment) = &self.environment {
            scene.environment = self.environment(environment, scene, &mut warnings)?;
        }
        let new = self.add_new_materials(scene)?;
        let moved = self.change_all_objects(scene)?.objects(scene);
        for (i, change) in self.materials.iter().enumerate() {
            self.change_materials(i, change, &new, scene)?;
        }
        // Lights may be placed on the axis of a camera.
        self.add_cameras(scene)?;
        let targets = self.camera_targets(scene);
        for (i, light) in self.lights.iter().enumerate() {
            match light {
                Light::Lamp(lamp) => self.add_lamp((i, lamp), &targets, scene, &mut warnings)?,
                Light::Change(change) => self.change_lights(i, change, scene, &mut warnings)?,
            }
        }
        self.rest_emitters(&moved, scene, &mut warnings)?;
        Ok(warnings)
    }

    fn environment(
        &self,
        settings: &EnvironmentSettings,
        scene: &mut SceneBuilder,
        warnings: &mut Vec<ImportWarning>,
    ) -> Result<Option<Environment>, InputError> {
        let source = match (&settings.radiance, &settings.image) {
            (Some(radiance), _) => EnvironmentSource::Constant(*radiance),
            (None, Some(path)) => {
                let limits = self.import_options().limits;
                let (image, repaired) = load_image(path, Role::Environment, &limits, &scene.images).map_err(|e| {
                    let problem = format!("{}: {}", path.display(), e.problem);
                    self.source.error_at_key(&["environment", "image"], problem, e.help)
                })?;
                warnings.extend(repaired);
                scene.images.push(image);
                let image = ImageId((scene.images.len() - 1) as u32);
                EnvironmentSource::Image { image, scale: settings.scale.unwrap_or(Rgb::WHITE) }
            }
            (None, None) => return Ok(None),
        };
        Ok(Some(Environment { source, rotation: settings.rotation.unwrap_or(0.0) }))
    }
}
