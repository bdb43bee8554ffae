//! Labels of an image: the instance at each pixel, seen through clear covers, with coverage, depth and normals.

use crate::ids::ObjectLabel;
use crate::label_entry::LabelSight;
use crate::surface_path::SurfacePath;
use dunkelfeld_film::Plane;
use dunkelfeld_geometry::{DAffine3, DVec3, Vec3};
use dunkelfeld_integrator::{Crossing, Passage, PixelIds, crossings};
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
    /// The surfaces below the defects that change no object.
    pub(crate) surfaces: bool,
    /// The surfaces below the changed objects. Needs `surfaces`.
    pub(crate) below: bool,
}

/// The labels of an image.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LabelPlanes {
    /// Instance of each pixel, 0 for none: the one with the most samples of the pixel, and of equals the lowest. Defects come
    /// first.
    pub(crate) instances: Plane<u16>,
    /// Share of the samples of the pixel that belong to its instance, 65535 for all. `None` with one sample.
    pub(crate) coverage: Option<Plane<u16>>,
    /// Depth along the axis of the camera \[m\]; 0 where there is no surface.
    pub(crate) depth: Option<Plane<f32>>,
    /// Unit normal toward the camera in its frame: x right, y down, z forward; 0 where there is no surface.
    pub(crate) normals: Option<Plane<[f32; 3]>>,
    /// The surfaces that each pixel shows without the defects, but with the objects that a defect has changed.
    pub(crate) surfaces: Option<Plane<SurfacePath>>,
    /// Where the centre of a pixel shows a changed object: its instance, and the surfaces without it, but with all other
    /// changed objects. 0 elsewhere.
    pub(crate) below: Option<Plane<(u16, SurfacePath)>>,
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
    /// Is the visible instance a defect that hides what is behind it?
    is_defect: bool,
    /// The first clear object with a label.
    clear: u16,
    /// The first changed object that labels are seen through.
    changed: u16,
    /// All instances.
    all: Vec<u16>,
    /// The first surface that scatters, or else the first clear one.
    surface: Option<(Crossing, bool)>,
    /// The surfaces without those of defects that change no object.
    path: SurfacePath,
    /// The surfaces without those of all defects. Its end is not before that of the path below any changed object.
    lowest: SurfacePath,
    /// All surfaces up to the end of `lowest`, for the path below a changed object.
    crossings: Vec<(Crossing, Option<ObjectLabel>)>,
}

impl Met {
    fn begin(&mut self) {
        let (all, crossings) = (std::mem::take(&mut self.all), std::mem::take(&mut self.crossings));
        *self = Self { all, crossings, ..Self::default() };
        self.all.clear();
        self.crossings.clear();
    }

    /// Receives a surface for the paths and the areas.
    fn pass(&mut self, crossing: &Crossing, label: Option<ObjectLabel>) {
        let (is_defect, is_change) = label.map_or((false, false), |label| (label.is_defect, label.is_change));
        if !self.lowest.is_decided {
            self.crossings.push((*crossing, label));
        }
        self.lowest.visit(crossing, is_defect, LEAST_COVERAGE);
        self.path.visit(crossing, is_defect && !is_change, LEAST_COVERAGE);
        if let Some(label) = label
            && (label.sight != LabelSight::Surface || crossing.coverage >= LEAST_COVERAGE)
            && !self.all.contains(&label.instance)
        {
            self.all.push(label.instance);
        }
    }

    /// Receives a surface.
    fn visit(&mut self, crossing: &Crossing, labels: &[Option<ObjectLabel>]) {
        let label_of = |ids: PixelIds| labels.get(ids.object() as usize).copied().flatten();
        let label = label_of(crossing.ids);
        // Below a defect that fills a hole is the surface with the hole.
        let replaced = label.and_then(|label| label.replaces).map(|ids| Crossing { ids, ..*crossing });
        self.pass(crossing, label);
        if let Some(replaced) = replaced {
            self.pass(&replaced, label_of(replaced.ids));
        }
        let (is_defect, is_change) = label.map_or((false, false), |label| (label.is_defect, label.is_change));
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
        let Some(label) = label else {
            self.is_decided = scatters;
            return;
        };
        let (is_seen, is_passed) = match label.sight {
            LabelSight::Surface => (scatters || covers, crossing.passage == Passage::Clear),
            LabelSight::Everywhere => (true, false),
            LabelSight::Behind => (scatters, true),
        };
        if is_seen {
            (self.visible, self.is_decided, self.is_defect) = (label.instance, true, is_defect);
        } else if is_passed {
            let first = |id: &mut u16| *id = if *id == 0 { label.instance } else { *id };
            first(&mut self.clear);
            if is_change {
                first(&mut self.changed);
            }
        }
    }

    /// The visible instance, 0 for none.
    fn instance(&self) -> u16 {
        match (self.is_decided, self.visible) {
            (false, _) => self.clear,
            (true, 0) => self.changed,
            (true, visible) => visible,
        }
    }

    /// The visible instance and the surfaces without it, if it is a changed object.
    fn below(&self) -> (u16, SurfacePath) {
        let (instance, mut path) = (self.instance(), SurfacePath::default());
        let is_it = |label: &Option<ObjectLabel>| label.is_some_and(|l| l.is_change && l.instance == instance);
        if !self.crossings.iter().any(|(_, label)| is_it(label)) {
            return (0, path);
        }
        for (crossing, label) in &self.crossings {
            let is_added = label.is_some_and(|label| label.is_defect && !label.is_change);
            path.visit(crossing, is_added || is_it(label), LEAST_COVERAGE);
        }
        (instance, path)
    }
}

/// The objects of an image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LabelObjects<'a> {
    /// The label of each object, by its index in the scene.
    pub(crate) labels: &'a [Option<ObjectLabel>],
    /// The bounds of each labelled object \[m\], world space.
    pub(crate) bounds: &'a [[DVec3; 2]],
    /// Boxes of pixels that contain the defects.
    pub(crate) refined: &'a [PixelBox],
}

/// The camera of the labels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LabelCamera<'a> {
    pub(crate) rays: &'a RayGenerator,
    /// From the camera to the world.
    pub(crate) pose: DAffine3,
    /// Width and height of the film \[pixels\].
    pub(crate) size: [u32; 2],
}

/// A box of pixels: left, top, right and bottom, the last two exclusive.
pub(crate) type PixelBox = [u32; 4];

/// Traces the labels of an image, on the threads of the current pool.
///
/// With several samples, each pixel has a first one in its centre. The others are taken where the pixels around have
/// different instances, and in the boxes of the defects. In a pixel with a sample of a defect the
/// instance is that of the defect with the most samples, so that thin defects have no gaps.
pub(crate) fn trace_labels(
    scene: &Scene,
    camera: LabelCamera<'_>,
    LabelObjects { labels, bounds, refined }: LabelObjects<'_>,
    layers: LabelLayers,
) -> LabelPlanes {
    let [width, height] = camera.size;
    let side = layers.samples.max(1);
    // Rounding of f32 and of the transforms is far below this share of the coordinates.
    let grown = |[low, high]: [DVec3; 2]| {
        let (low, high) = (low - scene.world_origin(), high - scene.world_origin());
        let margin = 1e-5 * low.abs().max(high.abs()).max_element() + 1e-7;
        [(low - margin).as_vec3(), (high + margin).as_vec3()]
    };
    let objects = bounds.iter().copied().map(grown).collect();
    let tracer = Tracer { scene, camera, labels, layers, objects };
    let rows: Vec<CentreRow> = (0..height).into_par_iter().map(|y| tracer.centres(y)).collect();
    let centres = plane(width, height, rows.iter().flat_map(|row| row.instances.iter().copied()));
    let is_refined = if side > 1 { refined_pixels(&centres, refined) } else { Plane::new(width, height, false) };
    let fine: Vec<FineRow> = (0..height).into_par_iter().map(|y| tracer.refine(y, &centres, &is_refined)).collect();
    let mut areas: BTreeMap<u16, Area> = BTreeMap::new();
    for (id, area) in fine.iter().flat_map(|row| &row.areas) {
        let sum = areas.entry(*id).or_default();
        sum.visible += area.visible;
        sum.amodal += area.amodal;
    }
    for (row, y) in rows.iter().zip(0..) {
        let flags = row_of(&is_refined, y);
        for (id, _) in row.instances.iter().zip(flags).filter(|(id, refined)| **id != 0 && !**refined) {
            areas.entry(*id).or_default().visible += 1.0;
        }
        for (_, id) in row.met.iter().filter(|(x, _)| !flags[*x as usize]) {
            areas.entry(*id).or_default().amodal += 1.0;
        }
    }
    LabelPlanes {
        instances: plane(width, height, fine.iter().flat_map(|r| &r.instances).copied()),
        coverage: (side > 1).then(|| plane(width, height, fine.iter().flat_map(|r| &r.coverage).copied())),
        depth: layers.depth.then(|| plane(width, height, rows.iter().flat_map(|r| &r.depth).copied())),
        normals: layers.normals.then(|| plane(width, height, rows.iter().flat_map(|r| &r.normals).copied())),
        surfaces: layers.surfaces.then(|| plane(width, height, rows.iter().flat_map(|r| &r.surfaces).copied())),
        below: layers.below.then(|| plane(width, height, rows.iter().flat_map(|r| &r.below).copied())),
        areas,
    }
}

/// The pixels with samples beside their centre.
fn refined_pixels(centres: &Plane<u16>, boxes: &[PixelBox]) -> Plane<bool> {
    let (width, height) = (centres.width(), centres.height());
    let mut refined = Plane::from_fn(width, height, |x, y| {
        let at = |x: u32, y: u32| centres.data()[y as usize * width as usize + x as usize];
        let here = at(x, y);
        let near = |v: u32, end: u32| v.saturating_sub(1)..(v + 2).min(end);
        near(y, height).any(|ny| near(x, width).any(|nx| at(nx, ny) != here))
    });
    for &[left, top, right, bottom] in boxes {
        for y in top..bottom.min(height) {
            let start = y as usize * width as usize;
            let (from, to) = (left.min(width) as usize, right.min(width) as usize);
            if from < to {
                refined.data_mut()[start + from..start + to].fill(true);
            }
        }
    }
    refined
}

/// The row of a plane.
fn row_of<T>(plane: &Plane<T>, y: usize) -> &[T] {
    let width = plane.width() as usize;
    &plane.data()[y * width..(y + 1) * width]
}

struct Tracer<'a> {
    scene: &'a Scene,
    camera: LabelCamera<'a>,
    labels: &'a [Option<ObjectLabel>],
    layers: LabelLayers,
    /// Bounds of the labelled objects \[m\], render space.
    objects: Vec<[Vec3; 2]>,
}

/// Does the ray meet a box behind a crossing? The point of the crossing may lie on the box (Kay and Kajiya 1986).
fn meets([low, high]: &[Vec3; 2], crossing: &Crossing) -> bool {
    let inverse = crossing.direction.recip();
    let (a, b) = ((*low - crossing.point) * inverse, (*high - crossing.point) * inverse);
    // The margin of the box keeps the point off its planes, where a zero times an infinity would be no number.
    let near = a.min(b).max_element();
    let far = a.max(b).min_element();
    !(near > far || far < 0.0)
}

/// The centres of a row of pixels.
#[derive(Clone, Debug, Default)]
struct CentreRow {
    instances: Vec<u16>,
    /// Column and id of each instance that a ray meets.
    met: Vec<(u32, u16)>,
    depth: Vec<f32>,
    normals: Vec<[f32; 3]>,
    surfaces: Vec<SurfacePath>,
    below: Vec<(u16, SurfacePath)>,
}

/// The samples of a row of pixels.
#[derive(Clone, Debug, Default)]
struct FineRow {
    instances: Vec<u16>,
    coverage: Vec<u16>,
    /// Areas in the refined pixels.
    areas: BTreeMap<u16, Area>,
}

impl Tracer<'_> {
    fn ray(&self, met: &mut Met, pixel: [u32; 2], place: [f32; 2], has_paths: bool) {
        met.begin();
        // What nobody asks for is not followed.
        met.path.is_decided = !(has_paths && self.layers.surfaces);
        met.lowest.is_decided = !(has_paths && self.layers.below);
        let _ = crossings(self.scene, self.camera.rays, pixel, place, |crossing| {
            met.visit(crossing, self.labels);
            // Behind the first surface that scatters, only objects with a label matter.
            let is_behind = crossing.passage == Passage::Scattering;
            let is_known = met.path.is_decided && met.lowest.is_decided;
            if is_behind && is_known && !self.objects.iter().any(|bounds| meets(bounds, crossing)) {
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        });
    }

    fn centres(&self, y: u32) -> CentreRow {
        let pose = self.camera.pose;
        let forward = -pose.matrix3.z_axis.normalize_or_zero();
        let axes = [pose.matrix3.x_axis, -pose.matrix3.y_axis, forward].map(|axis| axis.normalize_or_zero().as_vec3());
        let (mut row, mut met) = (CentreRow::default(), Met::default());
        for x in 0..self.camera.size[0] {
            self.ray(&mut met, [x, y], [0.5; 2], true);
            row.instances.push(met.instance());
            row.met.extend(met.all.iter().map(|id| (x, *id)));
            if self.layers.surfaces {
                row.surfaces.push(met.path);
            }
            if self.layers.below {
                row.below.push(met.below());
            }
            if self.layers.depth || self.layers.normals {
                let found = met.surface.map(|(crossing, _)| {
                    let from_eye = self.scene.world_origin() + crossing.point.as_dvec3() - pose.translation;
                    let is_back = crossing.normal.as_dvec3().dot(from_eye) > 0.0;
                    let normal = if is_back { -crossing.normal } else { crossing.normal };
                    (from_eye.dot(forward) as f32, axes.map(|axis: Vec3| axis.dot(normal)))
                });
                let (depth, normal) = found.unwrap_or_default();
                row.depth.push(depth);
                row.normals.push(normal);
            }
        }
        row
    }

    fn refine(&self, y: u32, centres: &Plane<u16>, is_refined: &Plane<bool>) -> FineRow {
        let side = self.layers.samples.max(1);
        let share = 1.0 / f64::from(side * side);
        let (mut row, mut met) = (FineRow::default(), Met::default());
        let mut counts: Vec<(u16, u32, bool)> = Vec::new();
        for (x, (&centre, &refined)) in
            (0..).zip(row_of(centres, y as usize).iter().zip(row_of(is_refined, y as usize)))
        {
            if !refined {
                row.instances.push(centre);
                row.coverage.push(if centre == 0 { 0 } else { u16::MAX });
                continue;
            }
            counts.clear();
            for k in 0..side * side {
                let place = [k % side, k / side].map(|i| (i as f32 + 0.5) / side as f32);
                self.ray(&mut met, [x, y], place, false);
                let instance = met.instance();
                match counts.iter_mut().find(|(id, ..)| *id == instance) {
                    Some((_, count, is_defect)) => (*count, *is_defect) = (*count + 1, *is_defect || met.is_defect),
                    None => counts.push((instance, 1, met.is_defect)),
                }
                for &id in &met.all {
                    row.areas.entry(id).or_default().amodal += share;
                }
                if instance != 0 {
                    row.areas.entry(instance).or_default().visible += share;
                }
            }
            let most = |defects: bool| {
                let found = counts.iter().copied().filter(|(.., is_defect)| !defects || *is_defect);
                found.max_by_key(|&(id, count, _)| (count, u16::MAX - id))
            };
            let (instance, count, _) = most(true).or_else(|| most(false)).unwrap_or_default();
            let covered = if instance == 0 { 0.0 } else { f64::from(count) * share };
            row.instances.push(instance);
            row.coverage.push((covered * 65535.0).round() as u16);
        }
        row
    }
}

fn plane<T: Clone + Default>(width: u32, height: u32, values: impl Iterator<Item = T>) -> Plane<T> {
    Plane::from_vec(width, height, values.collect()).unwrap_or_else(|| Plane::new(width, height, T::default()))
}

#[cfg(test)]
#[path = "label_tests.rs"]
mod tests;
