//! Check of views that the body of a lamp blocks: from behind it is black, and the part is out of sight.

use super::places::push;
use crate::build::report::BuildReport;
use crate::camera::RayGenerator;
use crate::scene::Scene;
use std::collections::{BTreeMap, BTreeSet};

/// Rays along one side of the middle of the film.
const RAYS: u32 = 8;
/// Share of the width and height of the film that is its middle.
const MIDDLE: f32 = 0.5;
/// A lamp that covers a larger share of the middle, and hides an object, is reported.
const MAX_COVERED: f64 = 0.5;

impl Scene {
    /// Reports lamps whose back covers the middle of the image of a camera and hides objects, on a film of `width` x
    /// `height` pixels.
    pub fn report_blocked_view(&self, camera: &RayGenerator, [width, height]: [u32; 2], report: &mut BuildReport) {
        let lamps: BTreeSet<u32> =
            self.parts.iter().filter(|part| self.is_lamp(part)).map(|part| part.object).collect();
        if lamps.is_empty() {
            return;
        }
        // The rays that a lamp covers, and those of them with an object behind it.
        let mut covered: BTreeMap<u32, [u32; 2]> = BTreeMap::new();
        for (i, j) in (0..RAYS).flat_map(|i| (0..RAYS).map(move |j| (i, j))) {
            let at = |k: u32, n: u32| (0.5 + MIDDLE * ((k as f32 + 0.5) / RAYS as f32 - 0.5)) * n as f32;
            let ray = camera.ray(at(i, width), at(j, height));
            let (mut nearest, mut farthest_object): (Option<(f32, Option<u32>)>, f32) = (None, 0.0);
            self.bvh.each_hit(&ray, |hit| {
                let hit = self.surface_point(&hit, 0.0);
                let is_from_behind = ray.direction.dot(hit.normal) > 0.0;
                if is_from_behind && self.compiled[hit.material as usize].is_back_invisible {
                    return;
                }
                let object = self.parts[hit.part as usize].object;
                let is_lamp = lamps.contains(&object);
                if !is_lamp {
                    farthest_object = farthest_object.max(hit.distance);
                }
                if nearest.is_none_or(|(distance, _)| hit.distance < distance) {
                    nearest = Some((hit.distance, (is_lamp && is_from_behind).then_some(object)));
                }
            });
            if let Some((distance, Some(lamp))) = nearest {
                let [rays, hidden] = covered.entry(lamp).or_default();
                *rays += 1;
                *hidden += u32::from(farthest_object > distance);
            }
        }
        let all = f64::from(RAYS * RAYS);
        let shares = covered.into_iter().map(|(object, [rays, hidden])| (object, f64::from(rays) / all, hidden));
        let findings = shares.filter(|(_, share, hidden)| *share > MAX_COVERED && *hidden > 0).map(|(object, share, _)| {
            let name = self.object_names.get(object as usize).map_or("", String::as_str);
            (
                format!("object \"{name}\""),
                format!(
                    "stands between camera and part: the back of the lamp covers {:.0} % of the middle of the image, and hides objects; write `elevation` in [[light]] to place it beside the axis, or move it",
                    100.0 * share
                ),
            )
        });
        push(report, findings.collect());
    }
}
