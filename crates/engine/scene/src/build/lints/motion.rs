//! Hazards of motion, for the camera that sees it: motion beyond the film, several turns in an exposure, and a line scan
//! whose lines do not follow the object.

use super::places::{bounds, place};
use crate::build::report::BuildReport;
use crate::camera::RayGenerator;
use crate::camera::shutter::{LineScan, Shutter};
use crate::scene::{Part, Scene};
use dunkelfeld_geometry::{DVec3, RigidMotion};
use dunkelfeld_radiometry::Number;
use std::collections::BTreeSet;

/// Deviation of the image's motion from one row in a line period that is reported.
const MAX_MISMATCH: f64 = 0.02;
/// Below this number of rows in a line period the image does not move along the height of the film.
const SIDEWAYS: f64 = 1e-6;

impl Scene {
    /// Reports hazards of motion in the image of a camera on a film of `width` x `height` pixels.
    pub fn report_motion(&self, camera: &RayGenerator, [width, height]: [u32; 2], report: &mut BuildReport) {
        let Some(shutter) = self.shutter() else { return };
        let exposure = match shutter {
            Shutter::Frame { exposure } => *exposure,
            Shutter::Lines(lines) => lines.exposure,
        };
        let mut reported = BTreeSet::new();
        let moving = || self.parts.iter().filter_map(|part| Some((part, part.motion.as_deref()?)));
        for (part, motion) in moving() {
            let turns = motion.spin.map_or(0.0, |s| s.speed.abs() * exposure / std::f64::consts::TAU);
            let problem = if turns > 1.0 {
                Some(format!("turns {turns:.1} times during one exposure; check its speed and the exposure"))
            } else {
                let films = self.largest_step(camera, part, motion, exposure) / f64::from(height.max(width));
                (films > 1.0).then(|| {
                    format!(
                        "moves by {films:.1} times the film during one exposure; check its velocity and the exposure"
                    )
                })
            };
            if let Some(problem) = problem.filter(|_| reported.insert(part.object)) {
                report.hazard(place(self, part), problem);
            }
        }
        if let Shutter::Lines(lines) = shutter {
            if moving().next().is_none() {
                report.hazard(
                    "line scan",
                    "no object moves, so that all rows show the same line; give an object a velocity or a rotation",
                );
            }
            self.report_line_rate(camera, width, lines, report);
        }
    }

    /// The largest distance \[pixels\] in the image between the places of a corner at the start and at the end of an
    /// exposure. Corners that the camera does not see do not count.
    fn largest_step(&self, camera: &RayGenerator, part: &Part, motion: &RigidMotion, exposure: f64) -> f64 {
        let corners = bounds(self, part).corners().map(|c| c.as_dvec3());
        let steps = corners.iter().filter_map(|corner| {
            let at = |t: f64| camera.project(motion.at(t).transform_point3(*corner) + self.world_origin);
            let ([x0, y0], [x1, y1]) = (at(-0.5 * exposure)?, at(0.5 * exposure)?);
            Some((x1 - x0).hypot(y1 - y0))
        });
        steps.fold(0.0, f64::max)
    }

    /// Reports an image that does not move by one row toward the top from a line to the next in the same light. The surface is the one in the
    /// middle of the sensor line.
    fn report_line_rate(&self, camera: &RayGenerator, width: u32, lines: &LineScan, report: &mut BuildReport) {
        let y = (lines.line * f64::from(lines.rows)) as f32;
        let Some(hit) = self.intersect(&camera.ray(0.5 * width as f32, y)) else { return };
        let part = &self.parts[hit.part as usize];
        let Some(motion) = &part.motion else { return };
        let point = hit.point.as_dvec3();
        let step: DVec3 = motion.velocity_at(point) * (0.5 * lines.period * f64::from(lines.in_turn));
        let at = |p: DVec3| camera.project(p + self.world_origin);
        let (Some(before), Some(after)) = (at(point - step), at(point + step)) else { return };
        let (columns, rows) = (after[0] - before[0], before[1] - after[1]);
        let message = if columns.hypot(rows) < SIDEWAYS {
            "does not move in the middle of the sensor line, so that all rows show the same line; check its velocity, or the axis of its rotation".to_string()
        } else if rows.abs() < SIDEWAYS.max(SIDEWAYS * columns.abs()) {
            "the image moves across the rows; the velocity must be along the height of the image: turn the velocity or the camera by 90 degrees".to_string()
        } else if rows < 0.0 {
            format!(
                "its image moves down by {:.3} rows from line to line, so that the scan is upside down and stages do not follow it; turn the velocity or the camera around",
                -rows
            )
        } else if (rows - 1.0).abs() > MAX_MISMATCH {
            let rate = Number(five_digits(rows / lines.period));
            format!(
                "its image moves by {rows:.3} rows from line to line, so that the scan is stretched; `line_rate = \"{rate}Hz\"` gives square pixels"
            )
        } else {
            return;
        };
        report.hazard(place(self, part), message);
    }
}

fn five_digits(v: f64) -> f64 {
    format!("{v:.4e}").parse().unwrap_or(v)
}
