//! A place on a surface, and a made defect that is put there.

use super::host::Anchor;
use super::material;
use super::pieces::Pieces;
use super::spec::Finish;
use super::surface::{LocalSurface, SurfaceHit};
use super::tree::distance_to_box;
use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, RigidMotion};
use dunkelfeld_scene::{Image, Instance, Material, MeshPart, SceneBuilder, Volume};
use std::cell::RefCell;
use std::collections::HashMap;

/// The triangles of parts in the world, by object and part: the search for a place keeps them.
pub(super) type Known = HashMap<(usize, usize), Pieces>;

/// A place for a defect.
pub(super) struct Site<'a> {
    /// The material of the defect.
    pub(super) finish: Finish<'a>,
    pub(super) scene: &'a SceneBuilder,
    /// The drawn point.
    pub(super) anchor: &'a Anchor,
    /// The surface around the place. Positions are relative to the drawn point.
    pub(super) surface: LocalSurface<'a>,
    /// The drawn point on the surface.
    pub(super) foot: SurfaceHit,
    /// Part below the drawn point: index and mesh.
    pub(super) below: (usize, &'a Mesh),
    /// Its material.
    pub(super) host: &'a Material,
    /// The volume below, if light can enter it.
    pub(super) volume: Option<Volume>,
    /// Height of a patch above the surface \[m\].
    pub(super) lift: f64,
    pub(super) known: &'a RefCell<Known>,
}

impl Site<'_> {
    /// The triangles of the part below, relative to the drawn point.
    pub(super) fn pieces(&self) -> Pieces {
        let key = (self.anchor.instance, self.below.0);
        let mut known = self.known.borrow_mut();
        let in_world = known.entry(key).or_insert_with(|| {
            let to_world = self.scene.instances.get(key.0).map_or(DAffine3::IDENTITY, |instance| instance.to_world);
            Pieces::new(self.below.1, &to_world)
        });
        in_world.around(self.anchor.point)
    }

    /// True if no other object has a surface near: on a way from one point to another, or between its start and the point at
    /// `above` \[m\] from there. Clear solids above do not count.
    pub(super) fn has_room(&self, ways: &[[DVec3; 2]], above: DVec3) -> bool {
        let (scene, at) = (self.scene, self.anchor.point);
        let reach = ways.iter().flatten().map(|p| p.length()).fold(0.0, f64::max) + above.length();
        let is_near = |i: &Instance| scene.bounds_of(i).is_some_and(|[a, b]| distance_to_box(at, a, b) <= reach);
        let blocks = |instance: &Instance, part: &usize| {
            let Some(material) = material::of(scene, *part).filter(|m| !material::is_absent(m)) else { return false };
            let above = if material::clear_volume(material).is_some() { DVec3::ZERO } else { above };
            let surface = LocalSurface::collect(scene, instance, &[*part], at, reach);
            ways.iter().any(|[from, to]| surface.is_met(*from + above, *to, |_| true))
        };
        let mut others =
            scene.instances.iter().enumerate().filter(|(i, other)| *i != self.anchor.instance && is_near(other));
        others.all(|(_, other)| !other.meshes.iter().any(|part| blocks(other, part)))
    }
}

/// A defect in coordinates relative to the drawn point, or in those of the mesh that it is cut into.
pub(super) struct Made {
    pub(super) mesh: Mesh,
    pub(super) material: Material,
    /// Direction in the tangent plane \[rad\], drawn or given. `None` if the kind has none.
    pub(super) angle: Option<f64>,
    /// The mesh of the part below without the pieces that are the defect.
    pub(super) hole: Option<Mesh>,
    /// Are the coordinates those of the mesh of the body?
    pub(super) is_in_body: bool,
    /// An image that the material refers to as the next one of the scene.
    pub(super) image: Option<Image>,
}

impl Made {
    /// A defect that leaves its body as it is.
    pub(super) fn new(mesh: Mesh, angle: Option<f64>, material: Material) -> Self {
        Self { mesh, material, angle, hole: None, is_in_body: false, image: None }
    }
}

/// The step of f32 at the radius of the scene \[m\].
pub(super) fn rounding(scene: &SceneBuilder) -> f64 {
    let bounds = scene.instances.iter().filter_map(|i| scene.bounds_of(i));
    let all = bounds.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
    all.map_or(0.0, |[low, high]| 0.5 * low.distance(high)) * f64::from(f32::EPSILON)
}

/// Adds a mesh in its place in the world as an object of its own.
pub(super) fn insert(scene: &mut SceneBuilder, name: &str, made: Made, to_world: DAffine3, motion: RigidMotion) {
    let material = scene.add_material(made.material);
    let meshes = vec![scene.meshes.len()];
    scene.meshes.push(MeshPart { name: name.into(), mesh: made.mesh.into(), material, ..MeshPart::default() });
    scene.instances.push(Instance { name: name.into(), meshes, to_world, motion });
}

/// The largest distance between two vertices of a placed mesh \[m\] ([`largest_distance`]).
pub(super) fn extent_of(mesh: &Mesh, to_world: &DAffine3) -> f64 {
    largest_distance(mesh.positions.iter().map(|p| to_world.transform_point3(p.as_dvec3())))
}

/// The largest distance between two points, to a few per cent: from the largest distance between the outermost points in 26
/// directions, to the farthest point of each point, until the distance grows no more. Exact for balls and boxes.
pub(super) fn largest_distance(points: impl Iterator<Item = DVec3> + Clone) -> f64 {
    let steps = || (-1..=1).map(f64::from);
    let directions = steps().flat_map(|x| steps().flat_map(move |y| steps().map(move |z| DVec3::new(x, y, z))));
    // Of two opposite directions one is enough.
    let mut outermost: Vec<(DVec3, [(f64, DVec3); 2])> =
        directions.skip(14).map(|d| (d, [(f64::INFINITY, DVec3::ZERO), (f64::NEG_INFINITY, DVec3::ZERO)])).collect();
    let mut is_empty = true;
    for p in points.clone() {
        is_empty = false;
        for (direction, [least, most]) in &mut outermost {
            let height = p.dot(*direction);
            if height < least.0 {
                *least = (height, p);
            }
            if height > most.0 {
                *most = (height, p);
            }
        }
    }
    if is_empty {
        return 0.0;
    }
    let ends = || outermost.iter().flat_map(|(_, ends)| ends.map(|(_, p)| p));
    let pairs = ends().flat_map(|a| ends().map(move |b| (a.distance(b), a)));
    let Some((mut distance, mut from)) = pairs.reduce(|a, b| if b.0 > a.0 { b } else { a }) else { return 0.0 };
    loop {
        let all = points.clone().map(|p| (p.distance(from), p));
        match all.reduce(|a, b| if b.0 > a.0 { b } else { a }) {
            Some((farther, p)) if farther > distance => (distance, from) = (farther, p),
            _ => return distance,
        }
    }
}
