//! Parts of a compiled scene that the build of a changed description uses again.

use crate::build::builder::MeshPart;
use crate::build::compile::BuildError;
use crate::build::lints::lost_digits;
use crate::build::placed::bake;
use crate::build::validate::drop_unusable_attributes;
use crate::geometry::triangle_data::Facet;
use dunkelfeld_bvh::{MeshTree, MeshTriangles};
use dunkelfeld_geometry::health::{MeshHealth, Repairs, clean};
use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, Transform, Vec3};
use std::collections::HashMap;
use std::convert::Infallible;
use std::sync::Arc;

/// The data of a mesh stay for this many builds after the last one that used it: an object that is hidden and shown
/// again needs no new tree.
const KEPT_BUILDS: u64 = 16;

/// Results of earlier builds, for [`SceneBuilder::build_with`](crate::SceneBuilder::build_with). They depend on a mesh
/// alone, or on a mesh and its place. A mesh is recognised by its identity: copies of a description share their meshes
/// ([`MeshPart::mesh`]). So a build after a change computes the changed parts only. Its scene has the bits of a build
/// without a cache.
#[derive(Debug, Default)]
pub struct BuildCache {
    builds: u64,
    meshes: HashMap<usize, MeshResults>,
    shared: Option<SharedTree>,
}

/// Results for a mesh.
#[derive(Debug)]
struct MeshResults {
    /// Keeps the address, which is the key.
    mesh: Arc<Mesh>,
    last_build: u64,
    repaired: Option<(Arc<Mesh>, Repaired)>,
    health: Option<MeshHealth>,
    instanced: Option<OwnTree>,
    bounds: Vec<ByPlace<Option<[DVec3; 2]>>>,
    places: Vec<ByPlace<PlacedMesh>>,
}

/// A result for a mesh in a place.
#[derive(Debug)]
struct ByPlace<T> {
    place: DAffine3,
    last_build: u64,
    result: T,
}

/// Removes the results for places that the present build did not use. If it used none, all stay: the object is hidden.
fn keep_present<T>(results: &mut Vec<ByPlace<T>>, build: u64) {
    if results.iter().any(|r| r.last_build == build) {
        results.retain(|r| r.last_build == build);
    }
}

/// The result for a place: the earlier one, or a new one.
fn result<T: Clone, E>(
    results: &mut Vec<ByPlace<T>>,
    (place, build): (&DAffine3, u64),
    compute: impl FnOnce() -> Result<T, E>,
) -> Result<T, E> {
    if let Some(earlier) = results.iter_mut().find(|r| r.place == *place) {
        earlier.last_build = build;
        return Ok(earlier.result.clone());
    }
    let result = compute()?;
    results.push(ByPlace { place: *place, last_build: build, result: result.clone() });
    Ok(result)
}

/// A mesh in render space.
#[derive(Clone, Debug)]
pub(crate) struct PlacedMesh {
    pub(crate) mesh: Arc<Mesh>,
    pub(crate) own: OwnTree,
}

/// The common tree of the meshes without a tree of their own, with these meshes and their places in render space.
#[derive(Debug)]
struct SharedTree {
    parts: Vec<(Arc<Mesh>, DAffine3)>,
    tree: Arc<MeshTree>,
}

/// The tree of a mesh, and its triangles.
#[derive(Clone, Debug)]
pub(crate) struct OwnTree {
    pub(crate) tree: Arc<MeshTree>,
    pub(crate) facets: Arc<[Facet]>,
}

impl OwnTree {
    fn new(mesh: &Mesh) -> Result<Self, BuildError> {
        let tree = Arc::new(tree_of(&mesh.positions, &mesh.triangles)?);
        Ok(Self { tree, facets: Facet::of_mesh(mesh, u32::MAX).collect() })
    }
}

/// The tree of triangles.
pub(crate) fn tree_of(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<MeshTree, BuildError> {
    MeshTree::build(&MeshTriangles { positions, triangles }).map_err(|e| BuildError::Hierarchy(e.to_string()))
}

/// The repair of a mesh.
#[derive(Clone, Debug)]
pub(crate) struct Repaired {
    pub(crate) repairs: Repairs,
    /// Notes about attributes that were dropped.
    pub(crate) attributes: Vec<String>,
    pub(crate) lost_digits: Option<String>,
}

/// Computes the results for meshes, or takes them from a cache.
pub(crate) struct Builds<'a>(pub(crate) Option<&'a mut BuildCache>);

impl Builds<'_> {
    /// Begins a build.
    pub(crate) fn begin(&mut self) {
        if let Some(cache) = &mut self.0 {
            cache.builds += 1;
        }
    }

    /// Removes the results that no recent build used.
    pub(crate) fn finish(self) {
        if let Some(cache) = self.0 {
            let build = cache.builds;
            cache.meshes.retain(|_, known| known.last_build + KEPT_BUILDS > build);
            for known in cache.meshes.values_mut() {
                keep_present(&mut known.bounds, build);
                keep_present(&mut known.places, build);
            }
        }
    }

    fn known(&mut self, mesh: &Arc<Mesh>) -> Option<&mut MeshResults> {
        let cache = self.0.as_mut()?;
        let builds = cache.builds;
        let known = cache.meshes.entry(Arc::as_ptr(mesh).addr()).or_insert_with(|| MeshResults {
            mesh: mesh.clone(),
            last_build: builds,
            repaired: None,
            health: None,
            instanced: None,
            bounds: Vec::new(),
            places: Vec::new(),
        });
        debug_assert!(Arc::ptr_eq(mesh, &known.mesh), "the address is that of another mesh");
        known.last_build = builds;
        Some(known)
    }

    /// Removes triangles and attributes that cannot be used.
    pub(crate) fn repair(&mut self, part: &mut MeshPart) -> Repaired {
        let Some(known) = self.known(&part.mesh) else { return repair(Arc::make_mut(&mut part.mesh)) };
        let (mesh, repaired) = known.repaired.get_or_insert_with(|| {
            let mut sound = (*part.mesh).clone();
            let repaired = repair(&mut sound);
            // A mesh without a fault stays the same one.
            let is_same = repaired.repairs.total() == 0 && repaired.attributes.is_empty();
            (if is_same { part.mesh.clone() } else { Arc::new(sound) }, repaired)
        });
        part.mesh = mesh.clone();
        repaired.clone()
    }

    /// Edges, volume and bounds of a mesh.
    pub(crate) fn health(&mut self, mesh: &Arc<Mesh>) -> MeshHealth {
        match self.known(mesh) {
            Some(known) => *known.health.get_or_insert_with(|| MeshHealth::from_mesh(mesh)),
            None => MeshHealth::from_mesh(mesh),
        }
    }

    /// Corners of the box around a placed mesh in the world; `None` for a mesh without triangles.
    pub(crate) fn bounds(&mut self, mesh: &Arc<Mesh>, transform: &Transform) -> Option<[DVec3; 2]> {
        let to_world = transform.to_world();
        let compute = || {
            let placed = mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize].as_dvec3());
            let corners = placed.map(|p| to_world.transform_point3(p));
            corners.map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
        };
        let Some(known) = self.known(mesh) else { return compute() };
        let key = (to_world, known.last_build);
        result(&mut known.bounds, key, || Ok::<_, Infallible>(compute())).unwrap_or_else(|e| match e {})
    }

    /// A mesh in render space, with a tree of its own.
    pub(crate) fn placed(&mut self, mesh: &Arc<Mesh>, to_render: &DAffine3) -> Result<PlacedMesh, BuildError> {
        let compute = || {
            let mesh = Arc::new(bake(mesh, to_render));
            let own = OwnTree::new(&mesh)?;
            Ok(PlacedMesh { mesh, own })
        };
        let Some(known) = self.known(mesh) else { return compute() };
        let key = (to_render, known.last_build);
        result(&mut known.places, key, compute)
    }

    /// The tree of a mesh in its own space.
    pub(crate) fn instanced(&mut self, mesh: &Arc<Mesh>) -> Result<OwnTree, BuildError> {
        let Some(known) = self.known(mesh) else { return OwnTree::new(mesh) };
        match &known.instanced {
            Some(own) => Ok(own.clone()),
            None => Ok(known.instanced.insert(OwnTree::new(mesh)?).clone()),
        }
    }

    /// The common tree of meshes in render space, which `compute` builds.
    pub(crate) fn shared_tree(
        &mut self,
        parts: &[(Arc<Mesh>, DAffine3)],
        compute: impl FnOnce() -> Result<MeshTree, BuildError>,
    ) -> Result<Arc<MeshTree>, BuildError> {
        let Some(cache) = &mut self.0 else { return Ok(Arc::new(compute()?)) };
        let is_same = |a: &(Arc<Mesh>, DAffine3), b: &(Arc<Mesh>, DAffine3)| Arc::ptr_eq(&a.0, &b.0) && a.1 == b.1;
        if let Some(known) = &cache.shared
            && known.parts.len() == parts.len()
            && known.parts.iter().zip(parts).all(|(a, b)| is_same(a, b))
        {
            return Ok(known.tree.clone());
        }
        let tree = Arc::new(compute()?);
        cache.shared = Some(SharedTree { parts: parts.to_vec(), tree: tree.clone() });
        Ok(tree)
    }
}

/// Removes triangles and attributes of a mesh that cannot be used.
fn repair(mesh: &mut Mesh) -> Repaired {
    let attributes = drop_unusable_attributes(mesh);
    let repairs = clean(mesh);
    Repaired { repairs, attributes, lost_digits: lost_digits(mesh) }
}
