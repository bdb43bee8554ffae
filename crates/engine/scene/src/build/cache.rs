//! Parts of a compiled scene that the build of a changed description uses again.

use crate::build::bake::{PlacedObject, bake};
use crate::build::builder::MeshPart;
use crate::build::error::BuildError;
use crate::build::lints::{Shape, lost_digits};
use crate::build::validate::drop_unusable_attributes;
use crate::geometry::triangle_data::Facets;
use dunkelfeld_bvh::{MeshTree, MeshTriangles};
use dunkelfeld_geometry::health::{Defects, MeshHealth, Repairs};
use dunkelfeld_geometry::{DAffine3, DVec3, Mesh, Threads, Vec2, Vec3, Vec4};
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::Arc;

/// The data of a mesh stay for this many builds after the last one that used it: an object that is hidden and shown
/// again needs no new tree.
const KEPT_BUILDS: u64 = 16;

/// Results of earlier builds, for [`SceneBuilder::build_with`](crate::SceneBuilder::build_with). They depend on a mesh
/// alone, or on a mesh and its place. A mesh is recognised by its address, as copies of a description share their meshes
/// ([`MeshPart::mesh`]), or by its content. So a build after a change computes the changed parts only. Its scene has the
/// bits of a build without a cache.
#[derive(Debug, Default)]
pub struct BuildCache {
    builds: u64,
    meshes: HashMap<usize, MeshResults>,
    /// Addresses of meshes by their [`digest`].
    by_digest: HashMap<u64, Vec<usize>>,
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
    bounds: ByPlace<Option<[DVec3; 2]>>,
    shapes: ByPlace<Shape>,
    places: ByPlace<PlacedMesh>,
}

/// Results for a mesh by place, each with the number of the last build that used it. The key has the bits of the place.
type ByPlace<T> = HashMap<[u64; 12], (u64, T)>;

/// The bits of a place.
fn bits(place: &DAffine3) -> [u64; 12] {
    place.to_cols_array().map(f64::to_bits)
}

/// Removes the results for places that the present build did not use. If it used none, all stay: the object is hidden.
fn keep_present<T>(results: &mut ByPlace<T>, build: u64) {
    if results.values().any(|(last, _)| *last == build) {
        results.retain(|_, (last, _)| *last == build);
    }
}

/// The earlier result for a place, which the present build uses.
fn earlier<T: Clone>(results: &mut ByPlace<T>, place: &DAffine3, build: u64) -> Option<T> {
    let (last, earlier) = results.get_mut(&bits(place))?;
    *last = build;
    Some(earlier.clone())
}

/// A mesh and its place. Results that do not depend on the place have the identity.
pub(crate) type Key<'a> = (&'a Arc<Mesh>, DAffine3);

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
    pub(crate) facets: Arc<Facets>,
}

impl OwnTree {
    fn new(mesh: &Mesh, threads: Threads) -> Result<Self, BuildError> {
        let tree = Arc::new(tree_of(&mesh.positions, &mesh.triangles, threads)?);
        Ok(Self { tree, facets: Arc::new(Facets::of_mesh(mesh)) })
    }
}

/// The tree of triangles.
pub(crate) fn tree_of(positions: &[Vec3], triangles: &[[u32; 3]], threads: Threads) -> Result<MeshTree, BuildError> {
    MeshTree::build(&MeshTriangles { positions, triangles }, threads).map_err(|e| BuildError::Hierarchy(e.to_string()))
}

/// The repair of a mesh.
#[derive(Clone, Debug)]
pub(crate) struct Repaired {
    pub(crate) repairs: Repairs,
    /// Notes about attributes that were dropped.
    pub(crate) attributes: Vec<String>,
    pub(crate) lost_digits: Option<String>,
}

/// Computes the results for meshes, or takes them from a cache. What is not known is computed for several meshes at the same
/// time, and for large meshes by several threads.
pub(crate) struct Builds<'a> {
    cache: Option<&'a mut BuildCache>,
    threads: Threads,
}

impl<'a> Builds<'a> {
    /// Begins a build. Removes the results that no recent build used.
    pub(crate) fn begin(cache: Option<&'a mut BuildCache>, threads: Threads) -> Self {
        let mut this = Self { cache, threads };
        if let Some(cache) = &mut this.cache {
            cache.builds += 1;
            let build = cache.builds;
            cache.meshes.retain(|_, known| known.last_build + KEPT_BUILDS >= build);
            let BuildCache { meshes, by_digest, .. } = &mut **cache;
            by_digest.retain(|_, addresses| {
                addresses.retain(|address| meshes.contains_key(address));
                !addresses.is_empty()
            });
        }
        this
    }

    /// The threads of the build.
    pub(crate) fn threads(&self) -> Threads {
        self.threads
    }

    /// Ends a build. Removes the places of a mesh that it did not use.
    pub(crate) fn finish(self) {
        if let Some(cache) = self.cache {
            let build = cache.builds;
            for known in cache.meshes.values_mut() {
                keep_present(&mut known.bounds, build);
                keep_present(&mut known.shapes, build);
                keep_present(&mut known.places, build);
            }
        }
    }

    /// The number of the build; 0 without a cache.
    fn build(&self) -> u64 {
        self.cache.as_ref().map_or(0, |cache| cache.builds)
    }

    fn known(&mut self, mesh: &Arc<Mesh>) -> Option<&mut MeshResults> {
        let cache = self.cache.as_mut()?;
        let builds = cache.builds;
        let known = cache.meshes.entry(Arc::as_ptr(mesh).addr()).or_insert_with(|| {
            cache.by_digest.entry(digest(mesh)).or_default().push(Arc::as_ptr(mesh).addr());
            MeshResults {
                mesh: mesh.clone(),
                last_build: builds,
                repaired: None,
                health: None,
                instanced: None,
                bounds: HashMap::new(),
                shapes: HashMap::new(),
                places: HashMap::new(),
            }
        });
        debug_assert!(Arc::ptr_eq(mesh, &known.mesh), "the address is that of another mesh");
        known.last_build = builds;
        Some(known)
    }

    /// The earlier mesh with the content of a new one, such as a primitive that a job has made again.
    fn same(&self, mesh: &Arc<Mesh>) -> Option<Arc<Mesh>> {
        let cache = self.cache.as_ref()?;
        if cache.meshes.contains_key(&Arc::as_ptr(mesh).addr()) {
            return None;
        }
        let addresses = cache.by_digest.get(&digest(mesh))?;
        let known = addresses.iter().filter_map(|address| cache.meshes.get(address));
        known.map(|known| &known.mesh).find(|known| has_same_bits(known, mesh)).cloned()
    }

    /// Results of keys in their order: `earlier` ones from the cache, and those that `compute` gives for the others, which
    /// `store` puts into the cache. A key that occurs several times is computed once.
    fn results<R: Clone + Send>(
        &mut self,
        keys: &[Key<'_>],
        earlier: impl Fn(&mut MeshResults, &DAffine3) -> Option<R>,
        compute: impl Fn(&Arc<Mesh>, &DAffine3, Threads) -> R + Sync,
        store: impl Fn(&mut MeshResults, &DAffine3, R),
    ) -> Vec<R> {
        let mut numbers: HashMap<(usize, [u64; 12]), usize> = HashMap::new();
        let mut missing: Vec<&Key<'_>> = Vec::new();
        let mut known: Vec<Result<R, usize>> = Vec::with_capacity(keys.len());
        for key @ (mesh, place) in keys {
            let result = self.known(mesh).and_then(|known| earlier(known, place));
            known.push(result.ok_or_else(|| {
                *numbers.entry((Arc::as_ptr(mesh).addr(), bits(place))).or_insert_with(|| {
                    missing.push(key);
                    missing.len() - 1
                })
            }));
        }
        let triangles = |(mesh, _): &&Key<'_>| mesh.triangles.len();
        let computed =
            self.threads.map_sized(missing.clone(), triangles, |(mesh, place), threads| compute(mesh, place, threads));
        for ((mesh, place), result) in missing.into_iter().zip(&computed) {
            if let Some(known) = self.known(mesh) {
                store(known, place, result.clone());
            }
        }
        known.into_iter().map(|result| result.unwrap_or_else(|number| computed[number].clone())).collect()
    }

    /// Removes triangles and attributes that cannot be used.
    pub(crate) fn repair(&mut self, parts: &mut [MeshPart]) -> Vec<Repaired> {
        for part in parts.iter_mut() {
            if let Some(earlier) = self.same(&part.mesh) {
                part.mesh = earlier;
            }
            // Registered, so that the same content in a later part is found.
            let _ = self.known(&part.mesh);
        }
        let keys: Vec<Key<'_>> = parts.iter().map(|part| (&part.mesh, DAffine3::IDENTITY)).collect();
        let repaired = self.results(
            &keys,
            |known, _| known.repaired.clone(),
            |mesh, _, threads| repaired(mesh, threads),
            |known, _, result| known.repaired = Some(result),
        );
        let of_part = |(part, (mesh, repaired)): (&mut MeshPart, (Arc<Mesh>, Repaired))| {
            part.mesh = mesh;
            repaired
        };
        parts.iter_mut().zip(repaired).map(of_part).collect()
    }

    /// Edges, volume and bounds of meshes.
    pub(crate) fn health(&mut self, meshes: &[&Arc<Mesh>]) -> Vec<MeshHealth> {
        let keys: Vec<Key<'_>> = meshes.iter().map(|mesh| (*mesh, DAffine3::IDENTITY)).collect();
        self.results(
            &keys,
            |known, _| known.health,
            |mesh, _, _| MeshHealth::from_mesh(mesh),
            |known, _, health| known.health = Some(health),
        )
    }

    /// Corners of the boxes around placed meshes in the world; `None` for a mesh without triangles.
    pub(crate) fn bounds(&mut self, placed: &[Key<'_>]) -> Vec<Option<[DVec3; 2]>> {
        let build = self.build();
        self.results(
            placed,
            |known, place| earlier(&mut known.bounds, place, build),
            |mesh, to_world, _| {
                let placed = mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize].as_dvec3());
                let corners = placed.map(|p| to_world.transform_point3(p));
                corners.map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
            },
            |known, place, bounds| {
                known.bounds.insert(bits(place), (build, bounds));
            },
        )
    }

    /// The shapes of objects in the world.
    pub(crate) fn shapes(&mut self, objects: &[&PlacedObject], meshes: &[MeshPart]) -> Vec<Shape> {
        let build = self.build();
        // The shape of several meshes is not that of one of them.
        let of_one = |(_, instance, transform): &PlacedObject| match instance.meshes.as_slice() {
            [mesh] => Some((&meshes[*mesh].mesh, *transform.to_world())),
            _ => None,
        };
        let mut known: Vec<Option<Shape>> = Vec::with_capacity(objects.len());
        for object in objects {
            let result = of_one(object).and_then(|(mesh, place)| earlier(&mut self.known(mesh)?.shapes, &place, build));
            known.push(result);
        }
        let missing: Vec<&PlacedObject> =
            objects.iter().zip(&known).filter(|(_, shape)| shape.is_none()).map(|(object, _)| *object).collect();
        let triangles =
            |(_, i, _): &&PlacedObject| i.meshes.iter().map(|&m| meshes[m].mesh.triangles.len()).sum::<usize>();
        let computed = self.threads.map_sized(missing.clone(), triangles, |object, _| Shape::of(object, meshes));
        for (object, shape) in missing.into_iter().zip(&computed) {
            if let Some((mesh, place)) = of_one(object)
                && let Some(known) = self.known(mesh)
            {
                known.shapes.insert(bits(&place), (build, *shape));
            }
        }
        let mut computed = computed.into_iter();
        known.into_iter().filter_map(|shape| shape.or_else(|| computed.next())).collect()
    }

    /// Meshes in render space, each with a tree of its own.
    pub(crate) fn placed(&mut self, placed: &[Key<'_>]) -> Result<Vec<PlacedMesh>, BuildError> {
        let build = self.build();
        let meshes = self.results(
            placed,
            |known, place| earlier(&mut known.places, place, build).map(Ok),
            |mesh, to_render, threads| {
                let mesh = Arc::new(bake(mesh, to_render));
                let own = OwnTree::new(&mesh, threads)?;
                Ok(PlacedMesh { mesh, own })
            },
            |known, place, result: Result<PlacedMesh, BuildError>| {
                known.places.extend(result.ok().map(|placed| (bits(place), (build, placed))));
            },
        );
        meshes.into_iter().collect()
    }

    /// The trees of meshes in their own spaces.
    pub(crate) fn instanced(&mut self, meshes: &[&Arc<Mesh>]) -> Result<Vec<OwnTree>, BuildError> {
        let keys: Vec<Key<'_>> = meshes.iter().map(|mesh| (*mesh, DAffine3::IDENTITY)).collect();
        let trees = self.results(
            &keys,
            |known, _| known.instanced.clone().map(Ok),
            |mesh, _, threads| OwnTree::new(mesh, threads),
            |known, _, result: Result<OwnTree, BuildError>| known.instanced = result.ok(),
        );
        trees.into_iter().collect()
    }

    /// The common tree of meshes in render space, which `compute` builds.
    pub(crate) fn shared_tree(
        &mut self,
        parts: &[(Arc<Mesh>, DAffine3)],
        compute: impl FnOnce() -> Result<MeshTree, BuildError>,
    ) -> Result<Arc<MeshTree>, BuildError> {
        let Some(cache) = &mut self.cache else { return Ok(Arc::new(compute()?)) };
        let is_same =
            |a: &(Arc<Mesh>, DAffine3), b: &(Arc<Mesh>, DAffine3)| Arc::ptr_eq(&a.0, &b.0) && bits(&a.1) == bits(&b.1);
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

/// A number that meshes of the same content share, from their sizes and a few vertices.
fn digest(mesh: &Mesh) -> u64 {
    let Mesh { positions, triangles, normals, tangents, uvs, colors } = mesh;
    let mut hasher = DefaultHasher::new();
    let sizes =
        [positions.len(), triangles.len(), normals.len(), tangents.len(), uvs[0].len(), uvs[1].len(), colors.len()];
    sizes.hash(&mut hasher);
    for at in [0, positions.len() / 3, positions.len() / 2, positions.len().saturating_sub(1)] {
        positions.get(at).map(|p| p.to_array().map(f32::to_bits)).hash(&mut hasher);
    }
    hasher.finish()
}

/// Do two meshes have the same bits?
fn has_same_bits(a: &Mesh, b: &Mesh) -> bool {
    fn same<T: Copy, const N: usize>(a: &[T], b: &[T], bits: impl Fn(T) -> [u32; N]) -> bool {
        a.len() == b.len() && a.iter().zip(b).all(|(&a, &b)| bits(a) == bits(b))
    }
    let two = |v: Vec2| v.to_array().map(f32::to_bits);
    let three = |v: Vec3| v.to_array().map(f32::to_bits);
    let four = |v: Vec4| v.to_array().map(f32::to_bits);
    same(&a.positions, &b.positions, three)
        && a.triangles == b.triangles
        && same(&a.normals, &b.normals, three)
        && same(&a.tangents, &b.tangents, four)
        && same(&a.uvs[0], &b.uvs[0], two)
        && same(&a.uvs[1], &b.uvs[1], two)
        && same(&a.colors, &b.colors, four)
}

/// A mesh without the triangles and attributes that cannot be used. A mesh without a fault stays the same one.
fn repaired(mesh: &Arc<Mesh>, threads: Threads) -> (Arc<Mesh>, Repaired) {
    let mut sound = mesh.clone();
    let attributes = drop_unusable_attributes(&mut sound);
    let defects = Defects::of(mesh, threads);
    let repairs = *defects.repairs();
    if repairs.total() > 0 {
        defects.remove_from(Arc::make_mut(&mut sound));
    }
    let lost_digits = lost_digits(&sound);
    (sound, Repaired { repairs, attributes, lost_digits })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use crate::shapes::{cuboid, sphere};
    use crate::{Environment, EnvironmentSource, Material, SceneBuilder};
    use dunkelfeld_geometry::{DVec3, Ray};
    use dunkelfeld_radiometry::Rgb;

    /// A floor, and three balls with enough triangles for trees of their own.
    fn balls(rings: u32) -> SceneBuilder {
        let mut b = SceneBuilder::default();
        let grey = b.add_material(Material { base_color: Rgb::splat(0.5).into(), ..Material::default() });
        b.add_object("floor", cuboid(Vec3::new(-2.0, -1.0, -0.2), Vec3::new(2.0, 1.0, -0.1)), grey);
        for (i, name) in ["left", "middle", "right"].into_iter().enumerate() {
            b.add_object(name, sphere(Vec3::new(i as f32 - 1.0, 0.1, 0.3), 0.3, rings, true), grey);
        }
        b.environment = Some(Environment { source: EnvironmentSource::Constant(Rgb::WHITE), rotation: 0.0 });
        b
    }

    fn hits(scene: &Scene) -> Vec<Option<[u32; 4]>> {
        let ray = |i: u32| {
            let [x, y] = [(i % 64) as f32 / 16.0 - 2.0, (i / 64) as f32 / 16.0 - 2.0];
            Ray::new(Vec3::new(x, y, 3.0) - scene.world_origin().as_vec3(), Vec3::new(0.1, -0.05, -1.0).normalize())
        };
        let bits = |p: crate::SurfacePoint| [p.distance.to_bits(), p.part, p.triangle, p.point.x.to_bits()];
        (0..64 * 64).map(|i| scene.intersect(&ray(i)).map(bits)).collect()
    }

    #[track_caller]
    fn assert_same(builder: &SceneBuilder, cache: &mut BuildCache) -> Scene {
        let fresh = builder.clone().build().expect("a scene").0;
        let again = builder.clone().build_with(cache).expect("a scene").0;
        assert_eq!(fresh.fingerprint(), again.fingerprint());
        let seen = hits(&fresh);
        assert!(seen.iter().flatten().count() > 500, "the test does not test");
        assert!(seen == hits(&again));
        again
    }

    fn shares_facets(a: &Scene, b: &Scene, object: u32) -> bool {
        let facets = |s: &Scene| s.parts.iter().find(|p| p.object == object).and_then(|p| p.facets.clone());
        matches!((facets(a), facets(b)), (Some(a), Some(b)) if Arc::ptr_eq(&a, &b))
    }

    #[test]
    fn a_moved_object_alone_is_built_again() {
        let mut b = balls(155);
        let mut cache = BuildCache::default();
        let first = assert_same(&b, &mut cache);
        assert!(first.parts.iter().all(|p| p.facets.is_some()), "each object has a tree of its own");
        b.instances[2].to_world = DAffine3::from_translation(DVec3::new(0.1, 0.2, 0.05));
        let moved = assert_same(&b, &mut cache);
        assert_eq!(moved.world_origin(), first.world_origin());
        assert_eq!([0, 1, 2, 3].map(|i| shares_facets(&first, &moved, i)), [true, true, false, true]);
        // A hidden object is shown again without a new tree.
        let hidden = b.instances.remove(1);
        assert_same(&b, &mut cache);
        b.instances.insert(1, hidden);
        let shown = assert_same(&b, &mut cache);
        assert!(shares_facets(&first, &shown, 1));
        // Far away the origin changes, and with it all coordinates.
        b.instances[2].to_world = DAffine3::from_translation(DVec3::new(90.0, 0.0, 0.0));
        assert_ne!(assert_same(&b, &mut cache).world_origin(), first.world_origin());
    }

    #[test]
    fn a_shared_tree_is_built_again_where_a_part_of_it_changes() {
        let mut b = balls(12);
        let mut cache = BuildCache::default();
        let first = assert_same(&b, &mut cache);
        assert!(first.parts.iter().all(|p| p.facets.is_none()));
        let tree = |cache: &BuildCache| cache.shared.as_ref().map(|s| s.tree.clone()).expect("a tree");
        let before = tree(&cache);
        b.materials[0].roughness.factor = 0.2;
        assert_same(&b, &mut cache);
        assert!(Arc::ptr_eq(&before, &tree(&cache)), "a material changes no tree");
        b.instances[1].to_world = DAffine3::from_translation(DVec3::X);
        assert_same(&b, &mut cache);
        assert!(!Arc::ptr_eq(&before, &tree(&cache)));
    }

    #[test]
    fn a_repaired_mesh_is_repaired_once_and_reported_each_time() {
        let mut b = balls(12);
        let mesh = Arc::make_mut(&mut b.meshes[1].mesh);
        mesh.triangles.push([0, 0, 1]);
        mesh.uvs[0] = vec![Vec2::ZERO];
        let (_, fresh) = b.clone().build().expect("a scene");
        let mut cache = BuildCache::default();
        for _ in 0..2 {
            let (scene, mut report) = b.clone().build_with(&mut cache).expect("a scene");
            scene.report_hazards(&mut report);
            assert_eq!(report.findings, fresh.findings);
            assert!(report.findings.iter().any(|f| f.message.contains("without area")), "{report:?}");
        }
    }

    #[test]
    fn a_mesh_that_is_made_again_is_recognised_by_its_content() {
        let mut cache = BuildCache::default();
        let first = assert_same(&balls(155), &mut cache);
        let second = assert_same(&balls(155), &mut cache);
        assert_eq!([0, 1, 2, 3].map(|i| shares_facets(&first, &second, i)), [true; 4]);
        let mut b = balls(155);
        let mesh = Arc::make_mut(&mut b.meshes[1].mesh);
        let vertex = mesh.positions.iter().position(|p| p.z == 0.3).expect("a vertex at the height of the middle");
        mesh.positions[vertex].y += 1e-3;
        let third = assert_same(&b, &mut cache);
        assert_eq!([0, 1, 2, 3].map(|i| shares_facets(&first, &third, i)), [true, false, true, true]);
        assert_eq!(cache.meshes.len(), 5, "four meshes, and one of another shape");
    }
}
