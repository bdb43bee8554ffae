//! Compiles a builder to a scene: validation, repair, placement, lights, hierarchy.

use crate::build::builder::{EnvironmentSource, Instance, MeshPart, PunctualKind, PunctualLight, SceneBuilder};
use crate::build::effects::{Effect, Effects};
use crate::build::report::BuildReport;
use crate::build::validate::{check_indices, check_values, drop_unusable_attributes, mesh_place, repair_texels};
use crate::covers::scene_covers::Covers;
use crate::features::FeatureSet;
use crate::geometry::triangle_data::Facet;
use crate::light::delta::DeltaLight;
use crate::light::environment::EnvironmentLight;
use crate::light::mesh_light::MeshLight;
use crate::light::sun::Sun;
use crate::light::{AreaLight, AreaShape, Light, LightTable, NO_LIGHT};
use crate::material::texture::Image;
use crate::material::{Material, Surface};
use crate::media::medium::Medium;
use crate::media::nested_dielectrics::{NO_SOLID, SolidPart, Solids, rank_solids};
use crate::media::solid::Solid;
use crate::query::surface::{CompiledMaterial, mean_emission};
use crate::scene::{Part, Placement, Scene};
use dunkelfeld_bsdf::EFFECTS;
use dunkelfeld_bvh::{Bvh, BvhInstance, InstanceMotion, MeshTriangles};
use dunkelfeld_geometry::health::{MeshHealth, Repairs, clean};
use dunkelfeld_geometry::shape::{RectangleSampler, rectangle_from_triangles};
use dunkelfeld_geometry::{Aabb, DAffine3, DMat3, DVec3, Mesh, Transform, Vec3, geometric_normal, triangle_area};
use dunkelfeld_radiometry::Rgb;

/// Meshes used more than once are also moved to render space if their copies have at most this many triangles together.
/// One flat hierarchy is faster, and the memory for this many triangles is small.
const MAX_BAKED_COPIES: usize = 16_384;

/// Beyond this radius [m] the square of a distance, and with it the irradiance, may leave the range of f32.
const LARGEST_RADIUS: f32 = 1e18;

/// Reason why a scene cannot be built.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// An index is out of range.
    #[error("{place} refers to {what} {index}, but there are only {count}")]
    BadIndex {
        /// Object that contains the index.
        place: String,
        /// Kind of the object that the index refers to.
        what: &'static str,
        /// The index.
        index: usize,
        /// Number of objects of that kind.
        count: usize,
    },
    /// A value is not finite or outside its range.
    #[error("{place}: {problem}")]
    BadValue {
        /// Object that contains the value.
        place: String,
        /// The error and the valid range.
        problem: String,
    },
    /// The scene needs an effect, but this build has no effects.
    #[error("{place} requires {effect}, which a build with the feature plain-only does not contain")]
    PlainOnly {
        /// The effect's name, or that of the group it belongs to.
        effect: String,
        /// The object that needs it.
        place: String,
    },
    /// Every triangle was dropped, and there is no environment that would be visible instead.
    #[error("no triangle is left: {lost}")]
    NothingLeft {
        /// The dropped triangles, their objects and the reasons.
        lost: String,
    },
    /// The scene is so large that its light cannot be computed.
    #[error(
        "{place} extends the scene to {radius} from its centre, where squared distances exceed the range of f32; check for a stray object or a wrong unit"
    )]
    TooLarge {
        /// The object that reaches farthest.
        place: String,
        /// Radius of the scene, with its unit.
        radius: String,
    },
    /// The hierarchy could not be built.
    #[error("the bounding volume hierarchy cannot be built: {0}")]
    Hierarchy(String),
}

impl SceneBuilder {
    /// Compiles the scene.
    ///
    /// Triangles that are degenerate, not finite or doubled are dropped. An instance whose transform cannot be inverted
    /// is dropped. The report contains both. It also contains hazards: open or inside-out solids, a scene without
    /// light.
    ///
    /// # Errors
    /// Indices out of range, invalid values, a scene whose triangles were all dropped and that has no environment, a
    /// scene beyond 1e18 m.
    pub fn build(mut self) -> Result<(Scene, BuildReport), BuildError> {
        check_indices(&self)?;
        check_values(&self)?;
        let mut effects = Effects::from_scene(&self);
        let mut report = BuildReport::default();
        repair_texels(&mut self.images, &mut report);
        let had_triangles = self.shows_triangles();
        let closed = self.clean_meshes(&mut report);
        let placed = self.valid_instances(&mut report);
        crate::build::lints::twins(&placed, &self.meshes, &mut report);
        let bounds = world_bounds(&placed, &self.meshes);
        let times = self.shutter.map(|shutter| shutter.times());
        let extent = times.and_then(|times| moving_bounds(bounds, &placed, &self.meshes, times)).or(bounds);
        if bounds.is_none() && had_triangles && !self.has_background() {
            return Err(BuildError::NothingLeft { lost: losses(&report) });
        }
        let world_origin = extent.map_or(DVec3::ZERO, |[lo, hi]| 0.5 * (lo + hi));
        let reach = extent.map_or(0.0, |[lo, hi]| 0.5 * (hi - lo).length());
        let radius = reach as f32;
        if radius > LARGEST_RADIUS {
            return Err(BuildError::TooLarge {
                place: farthest(&placed, &self.meshes),
                radius: format!("{reach:.1e} m"),
            });
        }
        let to_render = DAffine3::from_translation(-world_origin);

        let mut geometry = Placed { times, ..Placed::default() };
        geometry.place(&placed, std::mem::take(&mut self.meshes), world_origin);

        let mut is_painted = vec![false; self.materials.len()];
        for part in &geometry.parts {
            is_painted[part.material as usize] |= !geometry.meshes[part.mesh as usize].colors.is_empty();
        }
        let compiled: Vec<CompiledMaterial> = self
            .materials
            .iter()
            .zip(is_painted)
            .map(|(m, is_painted)| CompiledMaterial::new(m, is_painted, self.energy_compensation))
            .collect();
        let solids = geometry.solids(&self.materials, &compiled, &closed);
        let (mut lights, mesh_lights) = geometry.area_lights(&self.materials, &compiled, &self.images);
        lights.extend(self.lights.iter().map(|light| distant_or_delta(light, &to_render)));
        let environment = self.environment.as_ref().map(|e| EnvironmentLight::new(e, &self.images));
        let lights = LightTable::new(
            lights,
            mesh_lights,
            environment,
            std::mem::take(&mut self.profiles),
            radius,
            self.techniques,
        );
        if lights.lights.iter().all(|l| lights.power(l, radius.max(1.0)).is_black()) {
            report.hazard(
                "scene",
                "there is no light: no emissive material, no punctual light, no environment; the image will be black; add a light or an emissive material to the scene, or `[environment]` with `radiance = 1` to a job",
            );
        }
        self.report_unfindable_light(&geometry.parts, &compiled, &mut report);
        let has_coverage = geometry.parts.iter().any(|p| compiled[p.material as usize].has_coverage);
        let mut features = geometry
            .parts
            .iter()
            .map(|p| compiled[p.material as usize].features())
            .fold(FeatureSet::default(), FeatureSet::union);
        // Shadow rays pass partly covering surfaces. They also pass clear faces between equal indices of refraction, if
        // the scene can have them.
        let is_open = |c: &CompiledMaterial| c.clear_tint.is_some();
        let has_open_faces =
            geometry.parts.iter().any(|p| is_open(&compiled[p.material as usize]) && solids.is_open(p.solid));
        let scatters = solids.list.iter().any(|s| s.medium.scatters());
        if solids.has_nesting {
            effects.add(Effect::Nesting, "solids that touch or overlap".into());
        }
        if lights.has_tree() {
            effects.add(Effect::ManyLights, format!("{} lights", lights.lights.len()));
        }
        if lights.samples_each() {
            effects.add(Effect::EveryLight, format!("{} lights", lights.lights.len()));
        }
        if self.techniques.learned_roulette && !geometry.parts.is_empty() {
            effects.add(Effect::LearnedRoulette, "paths between surfaces".into());
        }
        features.media = scatters || has_open_faces || solids.has_nesting;
        if !EFFECTS && let Some((effect, place)) = effects.first_unsupported(features) {
            return Err(BuildError::PlainOnly { effect, place });
        }
        let bvh = geometry.hierarchy(&|part| {
            let compiled = &compiled[part.material as usize];
            compiled.has_coverage || (has_open_faces && is_open(compiled))
        })?;
        let depends_on_time = effects.has(Effect::Motion) || effects.has(Effect::LineScan);
        let mut scene = Scene {
            world_origin,
            bounds,
            bvh,
            placements: geometry.placements,
            facets: geometry.facets,
            parts: geometry.parts,
            meshes: geometry.meshes,
            object_names: self.instances.iter().map(|i| i.name.clone()).collect(),
            punctual_names: self.lights.iter().map(|l| l.name.clone()).collect(),
            materials: self.materials,
            compiled,
            images: self.images,
            lights,
            cameras: self.cameras,
            radius,
            has_coverage,
            has_open_faces,
            solids: solids.list,
            solid_bounds: solids.bounds,
            has_nesting: solids.has_nesting,
            covers: Covers::default(),
            shutter: self.shutter.filter(|_| depends_on_time),
            features,
            effects,
        };
        if self.techniques.cover_connection {
            scene.find_covers();
        }
        crate::build::lints::check(&scene, &mut report);
        Ok((scene, report))
    }

    /// True if any object has triangles.
    fn shows_triangles(&self) -> bool {
        let mut meshes = self.instances.iter().flat_map(|i| &i.meshes);
        meshes.any(|&m| !self.meshes[m].mesh.triangles.is_empty())
    }

    /// True if the environment emits, so that pixels without an object are not black.
    fn has_background(&self) -> bool {
        self.environment.as_ref().is_some_and(|e| match e.source {
            EnvironmentSource::Constant(radiance) => !radiance.is_black(),
            EnvironmentSource::Image { scale, .. } => !scale.is_black(),
        })
    }

    /// Drops triangles that cannot be traced and reports them. Also reports solids that are open or inside out.
    ///
    /// Returns for each mesh whether it encloses a volume.
    fn clean_meshes(&mut self, report: &mut BuildReport) -> Vec<bool> {
        let mut closed = vec![false; self.meshes.len()];
        for (index, part) in self.meshes.iter_mut().enumerate() {
            let place = mesh_place(index, &part.name);
            drop_unusable_attributes(part, &place, report);
            let repairs = clean(&mut part.mesh);
            if repairs.total() > 0 {
                report.note(&place, describe(&repairs));
            }
            if let Some(message) = crate::build::lints::lost_digits(&part.mesh) {
                report.hazard(&place, message);
            }
            let material = &self.materials[part.material];
            if material.transmission > 0.0 && material.metallic >= 1.0 && material.metallic_texture.is_none() {
                report.hazard(
                    &place,
                    format!("material \"{}\" is metal (metallic 1, glTF's default), so its transmission has no effect; set metallic to 0", material.name),
                );
                continue;
            }
            let passes = material.transmission > 0.0 || material.diffuse_transmission > 0.0;
            if material.surface == Surface::Thin && material.transmission > 0.0 && encloses_a_volume(&part.mesh) {
                report.hazard(
                    &place,
                    format!("is closed, but its clear material \"{}\" is a thin sheet without an inside, as if it was exported without volume: light passes both faces straight; write `solid = true` for it in `[[material]]` of a job, or export the material with a thickness", material.name),
                );
            }
            if !matches!(material.surface, Surface::Solid(_)) || !passes {
                continue;
            }
            let health = MeshHealth::from_mesh(&part.mesh);
            closed[index] = health.is_closed();
            if !health.is_closed() {
                report.hazard(
                    &place,
                    format!(
                        "is the boundary of a clear solid (material \"{}\") but not closed: {} open, {} wrongly wound and {} non-manifold edges; light inside gets lost or is attenuated wrongly; close the mesh, or give the material thickness 0 to make it a sheet",
                        material.name, health.open_edges, health.inconsistent_edges, health.non_manifold_edges
                    ),
                );
            } else if health.is_inside_out() {
                report.hazard(
                    &place,
                    format!(
                        "is a clear solid (material \"{}\") turned inside out: its normals point inward; flip them",
                        material.name
                    ),
                );
            }
        }
        closed
    }

    /// Reports light that no path can find. Light of a light without extent that passes a smooth clear surface arrives
    /// from one direction. Neither scattering nor a straight connection can sample that direction, so the light is
    /// missing from the image.
    fn report_unfindable_light(&self, parts: &[Part], compiled: &[CompiledMaterial], report: &mut BuildReport) {
        let Some(light) = self.lights.first() else { return };
        let clear = parts.iter().map(|p| p.material as usize).find(|&m| compiled[m].is_smooth_clear);
        if let Some(material) = clear {
            report.hazard(
                format!("light \"{}\"", light.name),
                format!(
                    "has no extent, and material \"{}\" is clear and smooth: light that passes it cannot be found, its shadow is black; use an emissive surface for the light, or give the material some roughness",
                    self.materials[material].name
                ),
            );
        }
    }

    /// The instances whose transform can be inverted, each with its position in the list.
    fn valid_instances(&self, report: &mut BuildReport) -> Vec<(u32, Instance, Transform)> {
        let mut valid = Vec::with_capacity(self.instances.len());
        for (object, instance) in self.instances.iter().enumerate() {
            match Transform::new(instance.to_world) {
                Ok(t) => valid.push((object as u32, instance.clone(), t)),
                Err(e) => report.note(format!("object \"{}\"", instance.name), format!("{e}; the object is left out")),
            }
        }
        valid
    }
}

/// Is the mesh closed, other than a sheet that was modelled from both sides?
fn encloses_a_volume(mesh: &Mesh) -> bool {
    let health = MeshHealth::from_mesh(mesh);
    health.is_closed() && health.signed_volume != 0.0
}

/// Maximum number of losses that an error lists.
const MAX_LOSSES: usize = 3;

/// The dropped objects of the report.
fn losses(report: &BuildReport) -> String {
    let all: Vec<String> = report.findings.iter().map(|f| format!("{} {}", f.place, f.message)).collect();
    let more = if all.len() > MAX_LOSSES { format!("; and {} more", all.len() - MAX_LOSSES) } else { String::new() };
    all.iter().take(MAX_LOSSES).cloned().collect::<Vec<_>>().join("; ") + &more
}

/// The object with the corner that lies farthest out.
fn farthest(placed: &[(u32, Instance, Transform)], meshes: &[MeshPart]) -> String {
    let reach = |(_, instance, transform): &(u32, Instance, Transform)| {
        let corners = instance.meshes.iter().flat_map(|&m| used_positions(&meshes[m].mesh));
        corners.map(|p| transform.to_world().transform_point3(p.as_dvec3()).abs().max_element()).fold(0.0, f64::max)
    };
    let object = placed.iter().max_by(|a, b| reach(a).total_cmp(&reach(b)));
    object.map_or_else(|| "the scene".into(), |(_, instance, _)| format!("object \"{}\"", instance.name))
}

/// The repairs of a mesh, in words.
fn describe(r: &Repairs) -> String {
    let reasons = [
        (r.out_of_range, "with indices beyond the vertices"),
        (r.non_finite, "with corners that are not finite"),
        (r.zero_area, "without area"),
        (r.duplicates, "that repeat another"),
        (r.opposite_duplicates, "that repeat another from the other side"),
    ];
    let parts: Vec<String> = reasons.iter().filter(|(n, _)| *n > 0).map(|(n, why)| format!("{n} {why}")).collect();
    format!("dropped {} triangles: {}", r.total(), parts.join(", "))
}

/// Corners of the box around everything, in world space and f64.
fn world_bounds(placed: &[(u32, Instance, Transform)], meshes: &[MeshPart]) -> Option<[DVec3; 2]> {
    let mut bounds: Option<[DVec3; 2]> = None;
    for (_, instance, transform) in placed {
        for p in instance.meshes.iter().flat_map(|&m| used_positions(&meshes[m].mesh)) {
            let q = transform.to_world().transform_point3(p.as_dvec3());
            let [lo, hi] = bounds.get_or_insert([q, q]);
            (*lo, *hi) = (lo.min(q), hi.max(q));
        }
    }
    bounds
}

/// [`world_bounds`] of all poses between two times. `None` if nothing moves.
fn moving_bounds(
    rest: Option<[DVec3; 2]>,
    placed: &[(u32, Instance, Transform)],
    meshes: &[MeshPart],
    [from, to]: [f64; 2],
) -> Option<[DVec3; 2]> {
    let mut bounds = None;
    for object in placed.iter().filter(|(_, instance, _)| !instance.motion.is_static()) {
        let Some([lo, hi]) = world_bounds(std::slice::from_ref(object), meshes) else { continue };
        let swept = object.1.motion.swept(&Aabb { min: lo.as_vec3(), max: hi.as_vec3() }, from, to);
        let [low, high] = bounds.or(rest).unwrap_or([lo, hi]);
        bounds = Some([low.min(swept.min.as_dvec3()), high.max(swept.max.as_dvec3())]);
    }
    bounds
}

fn used_positions(mesh: &Mesh) -> impl Iterator<Item = Vec3> + '_ {
    mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize])
}

/// Geometry as placed: the baked mesh in pieces, and the instanced meshes.
#[derive(Default)]
struct Placed {
    meshes: Vec<Mesh>,
    parts: Vec<Part>,
    placements: Vec<Placement>,
    /// See [`Scene::facets`].
    facets: Vec<Facet>,
    /// Number of triangles of the baked mesh in [`Scene::facets`].
    baked: usize,
    /// Transform of each placement but the baked one.
    transforms: Vec<Transform>,
    /// For each part the index of its mesh in the builder.
    sources: Vec<usize>,
    /// For each part whether its emitting triangles are one light.
    single_lights: Vec<bool>,
    /// First and last time of a sample \[s\]; `None` if everything is at rest.
    times: Option<[f64; 2]>,
}

impl Placed {
    fn place(&mut self, placed: &[(u32, Instance, Transform)], meshes: Vec<MeshPart>, world_origin: DVec3) {
        let to_render = DAffine3::from_translation(-world_origin);
        let has_times = self.times.is_some();
        let moves = |i: &Instance| has_times && !i.motion.is_static();
        let mut uses = vec![0usize; meshes.len()];
        for &m in placed.iter().filter(|(_, i, _)| !moves(i)).flat_map(|(_, i, _)| &i.meshes) {
            uses[m] += 1;
        }
        let bakes = |m: usize| uses[m] == 1 || uses[m] * meshes[m].mesh.triangles.len() <= MAX_BAKED_COPIES;
        // Baked parts come first, so that their triangles are numbered without gaps.
        let baked_any = (0..meshes.len()).any(|m| uses[m] > 0 && bakes(m) && !meshes[m].mesh.triangles.is_empty());
        if baked_any {
            self.placements.push(Placement::Baked);
            self.transforms.push(Transform::IDENTITY);
        }
        let all = || placed.iter().flat_map(|(object, i, t)| i.meshes.iter().map(move |&m| (*object, i, m, t)));
        // A moving part keeps a transform of its own.
        let is_baked = |i: &Instance, m: usize| bakes(m) && !moves(i);
        let mut stored = vec![u32::MAX; meshes.len()];
        for (object, _, m, transform) in all().filter(|(_, i, m, _)| is_baked(i, *m)) {
            let mesh = bake(&meshes[m].mesh, &(to_render * *transform.to_world()));
            let part = self.parts.len() as u32;
            let first_facet = self.facets.len() as u32;
            self.facets.extend(Facet::of_mesh(&mesh, part));
            self.parts.push(Part {
                mesh: self.meshes.len() as u32,
                material: meshes[m].material as u32,
                object,
                transform: None,
                motion: None,
                first_facet,
                solid: NO_SOLID,
                lights: Vec::new(),
            });
            self.meshes.push(mesh);
            self.sources.push(m);
            self.single_lights.push(meshes[m].is_single_light && EFFECTS);
        }
        self.baked = self.facets.len();
        let mut first_facets = vec![0; meshes.len()];
        for (object, instance, m, transform) in all().filter(|(_, i, m, _)| !is_baked(i, *m)) {
            // Invertible in world space and moved: still invertible.
            let Ok(transform) = Transform::new(to_render * *transform.to_world()) else { continue };
            if stored[m] == u32::MAX {
                stored[m] = self.meshes.len() as u32;
                self.meshes.push(meshes[m].mesh.clone());
                first_facets[m] = self.facets.len() as u32;
                self.facets.extend(Facet::of_mesh(&meshes[m].mesh, u32::MAX));
            }
            self.placements.push(Placement::Part(self.parts.len() as u32));
            self.transforms.push(transform);
            self.sources.push(m);
            self.single_lights.push(meshes[m].is_single_light && EFFECTS);
            self.parts.push(Part {
                mesh: stored[m],
                material: meshes[m].material as u32,
                object,
                transform: Some(Box::new(transform)),
                motion: moves(instance).then(|| Box::new(instance.motion.seen_from(world_origin))),
                first_facet: first_facets[m],
                solid: NO_SOLID,
                lights: Vec::new(),
            });
        }
    }

    /// Finds and ranks the solids. Marks the parts that bound them.
    fn solids(&mut self, materials: &[Material], compiled: &[CompiledMaterial], closed: &[bool]) -> Solids {
        let bounds = |part: &Part| {
            let mesh = &self.meshes[part.mesh as usize];
            let to_render = |p: Vec3| part.transform.as_ref().map_or(p, |t| t.point(p));
            let [lo, hi] = used_positions(mesh).map(to_render).fold(None, |b: Option<[Vec3; 2]>, p| {
                let [lo, hi] = b.unwrap_or([p, p]);
                Some([lo.min(p), hi.max(p)])
            })?;
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

    /// Builds the hierarchy over all geometry. Parts that cover partly are marked, so that rays evaluate their
    /// coverage.
    fn hierarchy(&self, covers_partly: &dyn Fn(&Part) -> bool) -> Result<Bvh, BuildError> {
        let mut positions = Vec::new();
        let mut triangles = Vec::with_capacity(self.baked);
        for part in self.parts.iter().filter(|p| p.transform.is_none()) {
            let mesh = &self.meshes[part.mesh as usize];
            let base = positions.len() as u32;
            positions.extend_from_slice(&mesh.positions);
            triangles.extend(mesh.triangles.iter().map(|t| t.map(|i| base + i)));
        }
        let mut sources = Vec::new();
        let mut source_of_mesh = vec![u32::MAX; self.meshes.len()];
        let mut instances = Vec::with_capacity(self.placements.len());
        for (placement, transform) in self.placements.iter().zip(&self.transforms) {
            match placement {
                Placement::Baked => {
                    instances.push(BvhInstance { mesh: sources.len() as u32, to_world: None, motion: None });
                    sources.push(MeshTriangles { positions: &positions, triangles: &triangles });
                }
                Placement::Part(part) => {
                    let part = &self.parts[*part as usize];
                    let mesh = part.mesh as usize;
                    if source_of_mesh[mesh] == u32::MAX {
                        source_of_mesh[mesh] = sources.len() as u32;
                        let m = &self.meshes[mesh];
                        sources.push(MeshTriangles { positions: &m.positions, triangles: &m.triangles });
                    }
                    let motion = part.motion.as_deref().copied().zip(self.times);
                    let motion = motion.map(|(motion, times)| InstanceMotion { motion, times });
                    instances.push(BvhInstance { mesh: source_of_mesh[mesh], to_world: Some(*transform), motion });
                }
            }
        }
        let mut bvh = Bvh::build(&sources, &instances).map_err(|e| BuildError::Hierarchy(e.to_string()))?;
        if self.parts.iter().any(covers_partly) {
            // A mesh that several parts share is alpha-tested if one of them is. An evaluation of the coverage is
            // correct for all of them.
            let mut alpha_tested_mesh = vec![false; sources.len()];
            for part in self.parts.iter().filter(|p| p.transform.is_some() && covers_partly(p)) {
                alpha_tested_mesh[source_of_mesh[part.mesh as usize] as usize] = true;
            }
            let baked = self.placements.iter().any(|p| matches!(p, Placement::Baked)).then_some(0);
            bvh.mark_alpha_tested(|mesh, triangle| {
                if Some(mesh) == baked {
                    covers_partly(&self.parts[self.facets[triangle as usize].part as usize])
                } else {
                    alpha_tested_mesh[mesh as usize]
                }
            });
        }
        Ok(bvh)
    }

    /// One light for each emitting triangle, or for each two in a row that form a rectangle, or for a mesh that is a
    /// single light. Marks the triangles.
    fn area_lights(
        &mut self,
        materials: &[Material],
        compiled: &[CompiledMaterial],
        images: &[Image],
    ) -> (Vec<Light>, Vec<MeshLight>) {
        let (mut lights, mut mesh_lights) = (Vec::new(), Vec::new());
        for (part_index, part) in self.parts.iter_mut().enumerate() {
            let material = &materials[part.material as usize];
            if material.emission.is_black() && !material.unlit {
                continue;
            }
            let mesh = &self.meshes[part.mesh as usize];
            let mean_radiance = mean_emission(material, images);
            part.lights = vec![NO_LIGHT; mesh.triangles.len()];
            let to_render = |p: Vec3| part.transform.as_ref().map_or(p, |t| t.point(p));
            let corners = |t: usize| mesh.corners(t).map(to_render);
            let normal = |t: usize| {
                let n = geometric_normal(&mesh.corners(t));
                part.transform.as_ref().map_or(n, |tr| tr.normal(n))
            };
            if self.single_lights[part_index] {
                let all = 0..mesh.triangles.len();
                let light = MeshLight::new(
                    all.clone().map(corners).collect(),
                    all.map(normal).collect(),
                    material.double_sided || material.unlit,
                    part_index as u32,
                    mean_radiance,
                    material.emission_profile,
                    compiled[part.material as usize].has_varying_radiance,
                );
                if let Some(light) = light {
                    part.lights.fill(lights.len() as u32);
                    lights.push(Light::Mesh(mesh_lights.len() as u32));
                    mesh_lights.push(light);
                }
                continue;
            }
            let mut t = 0;
            while t < mesh.triangles.len() {
                let here = corners(t);
                let next = (t + 1 < mesh.triangles.len()).then(|| corners(t + 1));
                let n = normal(t);
                let pair = next
                    .and_then(|next| rectangle_from_triangles(here, next).map(|r| (r, next)))
                    .filter(|_| normal(t + 1).dot(n) > 0.0);
                let (shape, center, area, second) = match pair {
                    Some((rectangle, next)) => {
                        let area = triangle_area(&here) + triangle_area(&next);
                        let center = rectangle.corner + 0.5 * (rectangle.edge_u + rectangle.edge_v);
                        (AreaShape::Rectangle(RectangleSampler::new(&rectangle)), center, area, t as u32 + 1)
                    }
                    None => {
                        let center = (here[0] + here[1] + here[2]) / 3.0;
                        (AreaShape::Triangle(here), center, triangle_area(&here), u32::MAX)
                    }
                };
                let reach = |c: &[Vec3; 3]| c.iter().map(|v| v.distance(center)).fold(0.0, f32::max);
                let radius = next.filter(|_| second != u32::MAX).map_or(0.0, |next| reach(&next)).max(reach(&here));
                part.lights[t] = lights.len() as u32;
                if second != u32::MAX {
                    part.lights[t + 1] = lights.len() as u32;
                }
                lights.push(Light::Area(AreaLight {
                    shape,
                    normal: n,
                    center,
                    radius,
                    area,
                    two_sided: material.double_sided || material.unlit,
                    part: part_index as u32,
                    triangles: [t as u32, second],
                    mean_radiance,
                    has_varying_radiance: compiled[part.material as usize].has_varying_radiance,
                }));
                t += if second == u32::MAX { 1 } else { 2 };
            }
        }
        (lights, mesh_lights)
    }
}

/// A light without a surface, in render space.
fn distant_or_delta(light: &PunctualLight, to_render: &DAffine3) -> Light {
    match (DeltaLight::new(light, to_render), light.kind) {
        (Some(delta), _) => Light::Delta(delta),
        (None, PunctualKind::Sun { irradiance, half_angle }) => {
            let back = light.to_world.matrix3.z_axis.try_normalize().unwrap_or(DVec3::Z);
            Light::Sun(Sun::new(back.as_vec3(), half_angle, irradiance))
        }
        // The other kinds have no extent.
        (None, _) => Light::Sun(Sun::new(Vec3::Z, 1.0, Rgb::BLACK)),
    }
}

/// Moves a mesh to render space. A mirroring transform reverses the winding, so that front faces stay front faces.
fn bake(mesh: &Mesh, to_render: &DAffine3) -> Mesh {
    let mirrored = to_render.matrix3.determinant() < 0.0;
    // The normals are not normalised one by one. Between the corners of a triangle an uneven scale must turn them as in
    // an instance, where they are interpolated first. A common factor keeps them in range.
    let in_range = |m: DMat3| m * (1.0 / m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length()));
    let (linear, normal_matrix) = (in_range(to_render.matrix3), in_range(to_render.matrix3.inverse().transpose()));
    let direction = |m: &DMat3, v: Vec3| (*m * v.as_dvec3()).as_vec3();
    Mesh {
        positions: mesh.positions.iter().map(|p| to_render.transform_point3(p.as_dvec3()).as_vec3()).collect(),
        triangles: mesh.triangles.iter().map(|&[a, b, c]| if mirrored { [a, c, b] } else { [a, b, c] }).collect(),
        normals: mesh.normals.iter().map(|&n| direction(&normal_matrix, n)).collect(),
        tangents: mesh
            .tangents
            .iter()
            .map(|t| direction(&linear, t.truncate()).extend(if mirrored { -t.w } else { t.w }))
            .collect(),
        uvs: mesh.uvs.clone(),
        colors: mesh.colors.clone(),
    }
}
