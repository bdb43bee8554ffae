//! Findings about the images of a project: those of its scene, and those that depend on cameras, lenses and films.

use super::Project;
use crate::sensor_hazards::sensor_hazards;
use crate::shutter::splitter_of;
use dunkelfeld_radiometry::Number;
use dunkelfeld_render::camera;
use dunkelfeld_scene::{BuildReport, Finding, RayGenerator, Severity};

impl Project {
    /// The findings of the scene builder, and hazards of the images with the present settings: lights that light no object
    /// and are in no image, bodies around the camera, motion and lamps in the image of each camera that
    /// would be rendered, a beam splitter without a lens, and wavelengths that the sensor does not know. Cameras with settings out of
    /// range are left out.
    pub fn findings(&self) -> BuildReport {
        let mut report = self.report.clone();
        if !self.has_all_findings {
            self.scene.report_hazards(&mut report);
        }
        let views = self.views();
        let is_one = views.len() == 1;
        let mut cameras: Vec<(RayGenerator, [u32; 2])> = Vec::new();
        let mut are_all_known = true;
        for view in views {
            let settings = self.fit_settings(self.settings.clone().with_camera(view.clone()));
            let bound = settings.and_then(|s| {
                let name = s.run.view.as_ref().map(|view| view.name.clone());
                Ok((camera(&self.scene, &s)?, [s.width, s.height], name.unwrap_or_default()))
            });
            let Ok((camera, film, name)) = bound else {
                are_all_known = false;
                continue;
            };
            let mut of_camera = BuildReport::default();
            of_camera.findings.extend(self.splitter_without_lens(&name));
            self.scene.report_motion(&camera, film, &mut of_camera);
            self.scene.report_enclosed_camera(&camera, &mut of_camera);
            self.scene.report_blocked_view(&camera, film, &mut of_camera);
            for mut finding in of_camera.findings {
                // The same in another image is reported once.
                if report.findings.contains(&finding) {
                    continue;
                }
                if let (false, Some(name)) = (is_one || cameras.is_empty(), &view) {
                    finding.place += &format!(", camera \"{name}\"");
                }
                report.findings.push(finding);
            }
            cameras.push((camera, film));
        }
        if are_all_known {
            self.scene.report_averted_lights(&cameras, &mut report);
        }
        if self.scene.cameras().is_empty() && self.job.has_lamps() {
            report.findings.push(Finding {
                severity: Severity::Hazard,
                place: "camera".into(),
                message:
                    "the job has lamps and no camera, so that the view of the whole scene contains the lamps; write \
                          camera = { look_at = \"part\", working_distance = \"300mm\" }"
                        .into(),
            });
        }
        report.findings.extend(sensor_hazards(&self.settings.sensor, &self.optics.bands()));
        report
    }

    /// The hazard of a beam splitter in front of a camera whose image has no sensor.
    fn splitter_without_lens(&self, camera: &str) -> Option<Finding> {
        let share = splitter_of(&self.job, &self.scene, camera);
        (share < 1.0 && !self.settings.has_sensor()).then(|| Finding {
            severity: Severity::Hazard,
            place: "beam splitter".into(),
            message: format!(
                "without a sensor the image is the radiance in front of lens and beam splitter, which passes {} of it; \
                 select a sensor for the image behind them",
                Number(share)
            ),
        })
    }

    /// The names of the cameras that would be rendered; `None` is the first camera.
    pub(super) fn views(&self) -> Vec<Option<String>> {
        let defined = self.defined_cameras();
        if defined.is_empty() {
            return vec![self.settings.camera.clone()];
        }
        defined.into_iter().map(Some).collect()
    }
}
