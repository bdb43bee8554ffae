//! The geometry of a scene in its places: meshes in render space, instances, and the hierarchy over them.

use crate::build::bake::{PlacedObject, bake};
use crate::build::builder::{Instance, MeshPart};
use crate::build::cache::{Builds, PlacedMesh, tree_of};
use crate::build::error::BuildError;
use crate::build::validate::mesh_place;
use crate::geometry::rounded_edges::RoundedEdges;
use crate::geometry::triangle_data::Facets;
use crate::material::{Material, Surface};
use crate::media::medium::Medium;
use crate::media::nested_dielectrics::{NO_SOLID, SolidPart, Solids, rank_solids};
use crate::media::solid::Solid;
use crate::query::surface::CompiledMaterial;
use crate::scene::{Part, Placement};
use dunkelfeld_bvh::{Bvh, BvhInstance, InstanceMotion, MeshTree};
use dunkelfeld_geometry::{Aabb, DAffine3, DMat3, DVec3, Mesh, Threads, Transform, Vec3};
use std::collections::HashMap;
use std::sync::Arc;

/// Meshes used more than once are also moved to render space if their copies have at most this many triangles together.
/// The memory for this many triangles is small.
const MAX_BAKED_COPIES: usize = 16_384;

/// The meshes in render space share one tree if they have at most this many triangles together; rays are fastest in one
/// tree. Otherwise each has its own, so that a change of one object does not build the trees of the others again.
const MAX_SHARED_TREE: usize = 262_144;

/// Decides whether the parts of a mesh need the frame of their object.
pub(crate) type HasFrame<'a> = dyn Fn(&MeshPart) -> bool + 'a;

/// Geometry in its places: meshes in render space, and instanced meshes.
#[derive(Default)]
pub(crate) struct PlacedScene {
    pub(crate) meshes: Vec<Arc<Mesh>>,
    pub(crate) parts: Vec<Part>,
    pub(crate) placements: Vec<Placement>,
    /// See [`Scene::facets`](crate::scene::Scene::facets).
    pub(crate) facets: Facets,
    /// Transform of each placement but the shared one.
    transforms: Vec<Transform>,
    /// For each part the tree of its mesh; `None` in the shared tree.
    trees: Vec<Option<Arc<MeshTree>>>,
    /// The joined trees of the first parts.
    joined: Option<Arc<MeshTree>>,
    /// For each part of the shared tree its mesh in the description and its place in render space.
    shared: Vec<(Arc<Mesh>, DAffine3)>,
    /// For each part the index of its mesh in the builder.
    sources: Vec<usize>,
    /// For each part whether its emitting triangles are one light.
    pub(crate) single_lights: Vec<bool>,
    /// First and last time of a sample \[s\]; `None` if everything is at rest.
    times: Option<[f64; 2]>,
}

/// The meshes of a scene that are moved to render space, and whether they share a tree.
pub(crate) struct Baking {
    /// For each mesh of the builder: is it moved, where it is at rest?
    is_baked: Vec<bool>,
    is_shared: bool,
    has_times: bool,
}

impl Baking {
    /// Decides by the number of copies and triangles. `has_times` if objects can move.
    pub(crate) fn new(placed: &[PlacedObject], meshes: &[MeshPart], has_times: bool) -> Self {
        let mut uses = vec![0usize; meshes.len()];
        let rest = placed.iter().filter(|(_, i, _)| !has_times || i.motion.is_static());
        for &m in rest.flat_map(|(_, i, _)| &i.meshes) {
            uses[m] += 1;
        }
        let triangles = |m: usize| uses[m] * meshes[m].mesh.triangles.len();
        let is_baked: Vec<bool> = (0..meshes.len()).map(|m| uses[m] == 1 || triangles(m) <= MAX_BAKED_COPIES).collect();
        let all: usize = (0..meshes.len()).filter(|m| is_baked[*m]).map(triangles).sum();
        Self { is_baked, is_shared: all <= MAX_SHARED_TREE, has_times }
    }

    /// Does each mesh have a tree of its own?
    pub(crate) fn has_own_trees(&self) -> bool {
        !self.is_shared
    }

    fn moves(&self, instance: &Instance) -> bool {
        self.has_times && !instance.motion.is_static()
    }

    /// A moving part keeps a transform of its own.
    fn bakes(&self, instance: &Instance, mesh: usize) -> bool {
        self.is_baked[mesh] && !self.moves(instance)
    }
}

impl PlacedScene {
    /// Places all parts in render space, whose origin is `world_origin`. `times` are the first and last time of a
    /// sample \[s\].
    pub(crate) fn new(
        placed: &[PlacedObject],
        meshes: &[MeshPart],
        (baking, times, has_frame): (&Baking, Option<[f64; 2]>, &HasFrame<'_>),
        world_origin: DVec3,
        builds: &mut Builds<'_>,
    ) -> Result<Self, BuildError> {
        let mut scene = Self { times, ..Self::default() };
        let to_render = DAffine3::from_translation(-world_origin);
        let all = || placed.iter().flat_map(|(object, i, t)| i.meshes.iter().map(move |&m| (*object, i, m, t)));
        let in_render = |t: &Transform| to_render * *t.to_world();
        let mut edges = Edges::default();
        let mut part = |mesh: u32, (object, m, t): (u32, usize, &Transform)| -> Result<Part, BuildError> {
            let frame = has_frame(&meshes[m]).then(|| in_metres(in_render(t))).flatten();
            Ok(Part { mesh, object, frame, edges: edges.of((m, &meshes[m]), t)?, ..Part::of(&meshes[m]) })
        };
        // Parts of the shared tree come first, so that their triangles are numbered without gaps.
        let threads = builds.threads();
        let shared: Vec<_> = all().filter(|(_, i, m, _)| baking.is_shared && baking.bakes(i, *m)).collect();
        let triangles = |(_, _, m, _): &(u32, &Instance, usize, &Transform)| meshes[*m].mesh.triangles.len();
        let baked = threads
            .map_sized(shared.clone(), triangles, |(_, _, m, t), _| Arc::new(bake(&meshes[m].mesh, &in_render(t))));
        for ((object, _, m, t), mesh) in shared.into_iter().zip(baked) {
            let to_render = in_render(t);
            let (number, first_facet) = (scene.parts.len() as u32, scene.facets.len() as u32);
            scene.facets.extend(&mesh, number, meshes[m].material as u32);
            scene.shared.push((meshes[m].mesh.clone(), to_render));
            scene.meshes.push(mesh);
            let part = Part { first_facet, ..part(number, (object, m, t))? };
            scene.push(part, (m, &meshes[m]), None);
        }
        if !scene.facets.is_empty() {
            scene.placements.push(Placement::Shared);
            scene.transforms.push(Transform::IDENTITY);
        }
        let own_trees: Vec<_> = all().filter(|(_, i, m, _)| baking.has_own_trees() && baking.bakes(i, *m)).collect();
        let keys: Vec<_> = own_trees.iter().map(|(_, _, m, t)| (&meshes[*m].mesh, in_render(t))).collect();
        for ((object, _, m, t), PlacedMesh { mesh, own }) in own_trees.into_iter().zip(builds.placed(&keys)?) {
            scene.meshes.push(mesh);
            let part = part(scene.meshes.len() as u32 - 1, (object, m, t))?;
            let part = Part { facets: Some(own.facets), ..part };
            scene.push(part, (m, &meshes[m]), Some(own.tree));
        }
        scene.join();
        // Invertible in world space and moved: still invertible.
        let moved = |t: &Transform| Transform::new(in_render(t)).ok();
        let instanced: Vec<_> = all()
            .filter(|(_, i, m, _)| !baking.bakes(i, *m))
            .filter_map(|(object, instance, m, t)| Some((object, instance, m, moved(t)?, t)))
            .collect();
        let mut numbers: Vec<Option<usize>> = vec![None; meshes.len()];
        let mut stored: Vec<&Arc<Mesh>> = Vec::new();
        for (_, _, m, ..) in &instanced {
            numbers[*m].get_or_insert_with(|| {
                stored.push(&meshes[*m].mesh);
                stored.len() - 1
            });
        }
        let (trees, first) = (builds.instanced(&stored)?, scene.meshes.len());
        scene.meshes.extend(stored.into_iter().cloned());
        for (object, instance, m, transform, t) in instanced {
            let Some((number, own)) = numbers[m].and_then(|i| Some((i, trees.get(i)?.clone()))) else { continue };
            scene.placements.push(Placement::Part(scene.parts.len() as u32));
            scene.transforms.push(transform);
            let motion = baking.moves(instance).then(|| Box::new(instance.motion.seen_from(world_origin)));
            let transform = Some(Box::new(transform));
            let part = part((first + number) as u32, (object, m, t))?;
            let part = Part { transform, motion, facets: Some(own.facets), ..part };
            scene.push(part, (m, &meshes[m]), Some(own.tree));
        }
        Ok(scene)
    }

    /// Joins the trees of the parts so far, or gives each part an instance of its own if they cannot be joined.
    fn join(&mut self) {
        let trees: Vec<Arc<MeshTree>> = self.trees.iter().flatten().cloned().collect();
        if trees.is_empty() {
            return;
        }
        let parts = trees.len() as u32;
        match MeshTree::join(trees) {
            Some(joined) => {
                self.joined = Some(Arc::new(joined));
                self.placements.push(Placement::Joined);
            }
            None => self.placements.extend((0..parts).map(Placement::Part)),
        }
        self.transforms.resize(self.placements.len(), Transform::IDENTITY);
    }

    /// Adds a part of a mesh of the builder.
    fn push(&mut self, part: Part, (index, mesh): (usize, &MeshPart), tree: Option<Arc<MeshTree>>) {
        self.parts.push(part);
        self.trees.push(tree);
        self.sources.push(index);
        self.single_lights.push(mesh.is_single_light);
    }

    /// Finds and ranks the solids. Marks the parts that bound them. `closed` contains for each mesh of the builder whether
    /// it encloses a volume.
    pub(crate) fn solids(&mut self, materials: &[Material], compiled: &[CompiledMaterial], closed: &[bool]) -> Solids {
        let bounds = |part: &Part| {
            let mesh = &self.meshes[part.mesh as usize];
            let to_render = |p: Vec3| part.transform.as_ref().map_or(p, |t| t.point(p));
            let used = mesh.triangles.iter().flatten().map(|&i| to_render(mesh.positions[i as usize]));
            let [lo, hi] = used.map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])?;
            let (Some(motion), Some([from, to])) = (&part.motion, self.times) else { return Some([lo, hi]) };
            let swept = motion.swept(&Aabb { min: lo, max: hi }, from, to);
            Some([swept.min, swept.max])
        };
        let mut found = Vec::new();
        for (index, part) in self.parts.iter().enumerate() {
            let material = &materials[part.material as usize];
            let Surface::Solid(volume) = &material.surface else { continue };
            let Some(bounds) = bounds(part).filter(|_| compiled[part.material as usize].is_solid) else { continue };
            let solid = Solid { material: part.material, ior: material.ior, medium: Medium::new(volume) };
            let is_closed = closed[self.sources[index]];
            found.push(SolidPart { part: index, bounds, is_closed, priority: volume.priority, solid });
        }
        rank_solids(found, &mut self.parts)
    }

    /// Refuses media in which a path is scattered too often. `closed` as in [`Self::solids`].
    ///
    /// The mean chord of a body under uniform light is 4 V / S, also if it scatters (Blanco and Fournier 2003). So a path
    /// is scattered sigma_s 4 V / S times on average.
    ///
    /// # Errors
    /// The part whose body is too dense, and the problem.
    pub(crate) fn check_density(&self, solids: &[Solid], closed: &[bool]) -> Result<(), (&Part, String)> {
        for (index, part) in self.parts.iter().enumerate() {
            let Some(medium) = solids.get(part.solid as usize).map(|s| s.medium).filter(Medium::scatters) else {
                continue;
            };
            let mesh = &self.meshes[part.mesh as usize];
            let to_render = |p: Vec3| part.transform.as_ref().map_or(p, |t| t.point(p)).as_dvec3();
            let corners = || (0..mesh.triangles.len()).map(|t| mesh.corners(t).map(to_render));
            let bounds = corners().flatten().map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
            let Some([low, high]) = bounds else { continue };
            let (mut area, mut volume) = (0.0, 0.0);
            for [a, b, c] in corners().map(|c| c.map(|p| p - low)) {
                area += 0.5 * (b - a).cross(c - a).length();
                volume += a.dot(b.cross(c)) / 6.0;
            }
            // An open mesh has no volume: that of its box is an upper bound.
            let volume = if closed[self.sources[index]] { volume.abs() } else { (high - low).element_product() };
            let Some((scatterings, most)) = medium.excess(4.0 * volume / area) else { continue };
            return Err((
                part,
                format!(
                    "its medium scatters light {scatterings:.1e} times on average (scattering coefficient x 4 V / S), and at most {most} are possible"
                ),
            ));
        }
        Ok(())
    }

    /// Builds the hierarchy over all geometry. Parts that cover partly are marked, so that rays evaluate their
    /// coverage.
    pub(crate) fn hierarchy(
        &self,
        covers_partly: &dyn Fn(&Part) -> bool,
        builds: &mut Builds<'_>,
    ) -> Result<Bvh, BuildError> {
        let threads = builds.threads();
        let mut trees: Vec<Arc<MeshTree>> = Vec::new();
        let mut tree_of_mesh = vec![u32::MAX; self.meshes.len()];
        let mut instances = Vec::with_capacity(self.placements.len());
        for (placement, transform) in self.placements.iter().zip(&self.transforms) {
            match placement {
                Placement::Shared => {
                    instances.push(BvhInstance { mesh: trees.len() as u32, to_world: None, motion: None });
                    trees.push(builds.shared_tree(&self.shared, || self.shared_tree(threads))?);
                }
                Placement::Joined => {
                    instances.push(BvhInstance { mesh: trees.len() as u32, to_world: None, motion: None });
                    trees.extend(self.joined.clone());
                }
                Placement::Part(number) => {
                    let part = &self.parts[*number as usize];
                    let tree = &mut tree_of_mesh[part.mesh as usize];
                    if *tree == u32::MAX {
                        *tree = trees.len() as u32;
                        trees.extend(self.trees[*number as usize].clone());
                    }
                    let motion = part.motion.as_deref().copied().zip(self.times);
                    let motion = motion.map(|(motion, times)| InstanceMotion { motion, times });
                    let to_world = part.transform.is_some().then_some(*transform);
                    instances.push(BvhInstance { mesh: *tree, to_world, motion });
                }
            }
        }
        // Parts in render space are in the first mesh.
        let first = self.placements.first().copied();
        let count = trees.len();
        let mut bvh = Bvh::from_trees(trees, &instances, threads).map_err(|e| BuildError::Hierarchy(e.to_string()))?;
        if self.parts.iter().any(covers_partly) {
            // A mesh that several parts share is alpha-tested if one of them is. An evaluation of the coverage is correct
            // for all of them.
            let mut alpha_tested_mesh = vec![false; count];
            for part in self.parts.iter().filter(|p| covers_partly(p)) {
                if let Some(tested) = alpha_tested_mesh.get_mut(tree_of_mesh[part.mesh as usize] as usize) {
                    *tested = true;
                }
            }
            bvh.mark_alpha_tested(|mesh, part, triangle| match first {
                Some(Placement::Shared) if mesh == 0 => {
                    covers_partly(&self.parts[self.facets.triangle(triangle).part() as usize])
                }
                Some(Placement::Joined) if mesh == 0 => covers_partly(&self.parts[part as usize]),
                _ => alpha_tested_mesh[mesh as usize],
            });
        }
        Ok(bvh)
    }

    /// The tree of all triangles without a tree of their own.
    fn shared_tree(&self, threads: Threads) -> Result<MeshTree, BuildError> {
        let mut positions = Vec::new();
        let mut triangles = Vec::with_capacity(self.facets.len());
        for part in self.parts.iter().filter(|p| p.facets.is_none()) {
            let mesh = &self.meshes[part.mesh as usize];
            let base = positions.len() as u32;
            positions.extend_from_slice(&mesh.positions);
            triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| base + i)));
        }
        tree_of(&positions, &triangles, threads)
    }
}

/// The frame of an object in metres: lengths are those of the world along each of its axes.
fn in_metres(DAffine3 { matrix3, translation }: DAffine3) -> Option<Box<Transform>> {
    let axes = [matrix3.x_axis, matrix3.y_axis, matrix3.z_axis].map(|axis| axis.normalize_or_zero());
    let frame = DAffine3 { matrix3: DMat3::from_cols(axes[0], axes[1], axes[2]), translation };
    Transform::new(frame).ok().map(Box::new)
}

/// The rounded edges of meshes by their scales, which copies share.
#[derive(Default)]
struct Edges(HashMap<(usize, [u32; 3]), Arc<RoundedEdges>>);

impl Edges {
    fn of(
        &mut self,
        (index, mesh): (usize, &MeshPart),
        place: &Transform,
    ) -> Result<Option<Arc<RoundedEdges>>, BuildError> {
        if mesh.edge_radius == 0.0 {
            return Ok(None);
        }
        let DMat3 { x_axis, y_axis, z_axis } = place.to_world().matrix3;
        let scale = Vec3::new(x_axis.length() as f32, y_axis.length() as f32, z_axis.length() as f32);
        let key = (index, scale.to_array().map(f32::to_bits));
        if let Some(known) = self.0.get(&key) {
            return Ok(Some(known.clone()));
        }
        let edges = RoundedEdges::new(&mesh.mesh, scale, mesh.edge_radius).ok_or_else(|| BuildError::BadValue {
            place: mesh_place(index, &mesh.name),
            problem: format!(
                "its edge radius of {} m reaches over many triangles and edges; write a smaller one",
                mesh.edge_radius
            ),
        })?;
        Ok(Some(self.0.entry(key).or_insert(Arc::new(edges)).clone()))
    }
}

impl Part {
    /// A part at rest in render space, without triangles yet.
    fn of(mesh: &MeshPart) -> Self {
        Self {
            mesh: 0,
            material: mesh.material as u32,
            object: 0,
            transform: None,
            motion: None,
            first_facet: 0,
            facets: None,
            solid: NO_SOLID,
            lights: Vec::new(),
            frame: None,
            edges: None,
        }
    }
}
