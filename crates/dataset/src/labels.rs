//! Labels of an image: the instance at each pixel, seen through clear covers, with coverage, depth and normals.

use crate::ids::ObjectLabel;
use dunkelfeld_film::Plane;
use dunkelfeld_geometry::{DAffine3, DVec3, Vec3};
use dunkelfeld_integrator::{Crossing, Passage, crossings};
use dunkelfeld_scene::{RayGenerator, Scene};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::ControlFlow;

/// A labelled object is visible where it covers at least this share of the light.
const LEAST_COVERAGE: f32 = 0.02;

/// The layers that are computed besides the instances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LabelLayers {
    /// Samples on each side of a pixel, at least 1.
    pub(crate) samples: u32,
    pub(crate) depth: bool,
    pub(crate) normals: bool,
}

/// The labels of an image.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LabelPlanes {
    /// Instance of each pixel, 0 for none: the one with the most samples of the pixel, and of equals the lowest.
    pub(crate) instances: Plane<u16>,
    /// Share of the samples of the pixel that belong to its instance, 65535 for all. `None` with one sample.
    pub(crate) coverage: Option<Plane<u16>>,
    /// Depth along the axis of the camera \[m\]; 0 where there is no surface.
    pub(crate) depth: Option<Plane<f32>>,
    /// Unit normal toward the camera in its frame: x right, y down, z forward; 0 where there is no surface.
    pub(crate) normals: Option<Plane<[f32; 3]>>,
    /// Area of each instance that is in the film.
    pub(crate) areas: BTreeMap<u16, Area>,
}

/// The areas of an instance \[pixels\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Area {
    /// The visible part.
    pub(crate) visible: f64,
    /// The part that would be visible without the objects that hide it: all rays of the camera that meet the instance. A
    /// ray is bent by clear surfaces up to the first surface that scatters, and is straight behind it.
    pub(crate) amodal: f64,
}

/// What a ray meets.
#[derive(Clone, Debug, Default)]
struct Met {
    /// The instance that is visible, 0 for none.
    visible: u16,
    is_decided: bool,
    /// The first clear object with a label.
    clear: u16,
    /// All instances.
    all: Vec<u16>,
    /// The first surface that scatters, or else the first clear one.
    surface: Option<(Crossing, bool)>,
}

impl Met {
    fn begin(&mut self) {
        let all = std::mem::take(&mut self.all);
        *self = Self { all, ..Self::default() };
        self.all.clear();
    }

    fn visit(&mut self, crossing: &Crossing, labels: &[Option<ObjectLabel>]) {
        let label = labels.get(crossing.ids.object() as usize).copied().flatten();
        if let Some(label) = label
            && !self.all.contains(&label.instance)
        {
            self.all.push(label.instance);
        }
        let scatters = crossing.passage == Passage::Scattering;
        if !self.surface.is_some_and(|(_, is_final)| is_final)
            && (scatters || (self.surface.is_none() && crossing.passage == Passage::Clear))
        {
            self.surface = Some((*crossing, scatters));
        }
        if self.is_decided {
            return;
        }
        // A print that covers a little of the light is visible, and the hole of a mask is not.
        let covers = crossing.passage == Passage::Open && (LEAST_COVERAGE..0.5).contains(&crossing.coverage);
        match label {
            // A defect may be as clear as what contains it, such as a bubble, or be the lack of something.
            Some(label) if scatters || covers || label.is_defect => {
                (self.visible, self.is_decided) = (label.instance, true);
            }
            None if scatters => self.is_decided = true,
            Some(label) if self.clear == 0 && crossing.passage == Passage::Clear => self.clear = label.instance,
            _ => {}
        }
    }

    /// The visible instance, 0 for none.
    fn instance(&self) -> u16 {
        if self.is_decided { self.visible } else { self.clear }
    }
}

/// Traces the labels of an image, on the threads of the current pool. `labels` are those of the objects of the scene, by
/// index.
pub(crate) fn trace_labels(
    scene: &Scene,
    (camera, pose): (&RayGenerator, DAffine3),
    [width, height]: [u32; 2],
    labels: &[Option<ObjectLabel>],
    layers: LabelLayers,
) -> LabelPlanes {
    let side = layers.samples.max(1);
    let share = 1.0 / f64::from(side * side);
    let (eye, forward) = (pose.translation, -pose.matrix3.z_axis.normalize_or_zero());
    let axes = [pose.matrix3.x_axis, -pose.matrix3.y_axis, forward].map(|axis| axis.normalize_or_zero().as_vec3());
    let wants_surface = layers.depth || layers.normals;
    let row_of = |y: u32| {
        let mut row = Row::default();
        let mut met = Met::default();
        let mut counts: Vec<(u16, u32)> = Vec::new();
        for x in 0..width {
            counts.clear();
            let mut surface = None;
            let ray = |met: &mut Met, place: [f32; 2]| {
                met.begin();
                let _ = crossings(scene, camera, [x, y], place, |crossing| {
                    met.visit(crossing, labels);
                    ControlFlow::Continue(())
                });
            };
            for k in 0..side * side {
                let place = [k % side, k / side].map(|i| (i as f32 + 0.5) / side as f32);
                ray(&mut met, place);
                let instance = met.instance();
                match counts.iter_mut().find(|(id, _)| *id == instance) {
                    Some((_, count)) => *count += 1,
                    None => counts.push((instance, 1)),
                }
                for &id in &met.all {
                    row.areas.entry(id).or_default().amodal += share;
                }
                if instance != 0 {
                    row.areas.entry(instance).or_default().visible += share;
                }
                if place == [0.5; 2] {
                    surface = met.surface;
                }
            }
            if wants_surface && side % 2 == 0 {
                ray(&mut met, [0.5; 2]);
                surface = met.surface;
            }
            let (instance, count) =
                counts.iter().copied().max_by_key(|&(id, count)| (count, u16::MAX - id)).unwrap_or((0, 0));
            row.instances.push(instance);
            if side > 1 {
                let covered = if instance == 0 { 0.0 } else { f64::from(count) * share };
                row.coverage.push((covered * 65535.0).round() as u16);
            }
            if wants_surface {
                let found = surface.map(|(crossing, _)| {
                    let point = scene.world_origin() + crossing.point.as_dvec3();
                    let from_eye = point - eye;
                    let normal =
                        if crossing.normal.as_dvec3().dot(from_eye) > 0.0 { -crossing.normal } else { crossing.normal };
                    (depth_of(from_eye, forward), axes.map(|axis: Vec3| axis.dot(normal)))
                });
                let (depth, normal) = found.unwrap_or_default();
                row.depth.push(depth);
                row.normals.push(normal);
            }
        }
        row
    };
    let rows: Vec<Row> = (0..height).into_par_iter().map(row_of).collect();
    let mut areas: BTreeMap<u16, Area> = BTreeMap::new();
    for (id, area) in rows.iter().flat_map(|row| &row.areas) {
        let sum = areas.entry(*id).or_default();
        sum.visible += area.visible;
        sum.amodal += area.amodal;
    }
    LabelPlanes {
        instances: plane(width, height, rows.iter().flat_map(|r| &r.instances).copied()),
        coverage: (side > 1).then(|| plane(width, height, rows.iter().flat_map(|r| &r.coverage).copied())),
        depth: layers.depth.then(|| plane(width, height, rows.iter().flat_map(|r| &r.depth).copied())),
        normals: layers.normals.then(|| plane(width, height, rows.iter().flat_map(|r| &r.normals).copied())),
        areas,
    }
}

fn depth_of(from_eye: DVec3, forward: DVec3) -> f32 {
    from_eye.dot(forward) as f32
}

/// The labels of a row.
#[derive(Clone, Debug, Default)]
struct Row {
    instances: Vec<u16>,
    coverage: Vec<u16>,
    depth: Vec<f32>,
    normals: Vec<[f32; 3]>,
    areas: BTreeMap<u16, Area>,
}

fn plane<T: Clone + Default>(width: u32, height: u32, values: impl Iterator<Item = T>) -> Plane<T> {
    Plane::from_vec(width, height, values.collect()).unwrap_or_else(|| Plane::new(width, height, T::default()))
}
