//! Compiles a builder to a scene: validation, repair, placement, lights, hierarchy.

use crate::build::bake::PlacedObject;
use crate::build::builder::{EnvironmentSource, MeshPart, SceneBuilder};
use crate::build::cache::{BuildCache, Builds, Repaired};
use crate::build::effects::{Effect, Effects};
use crate::build::error::BuildError;
use crate::build::placed::{Baking, PlacedScene};
use crate::build::report::BuildReport;
use crate::build::validate::{check_indices, check_values, mesh_place, repair_texels};
use crate::covers::scene_covers::Covers;
use crate::light::LightTable;
use crate::light::delta::DeltaLight;
use crate::light::environment::EnvironmentLight;
use crate::material::{Material, Surface};
use crate::query::surface::{CompiledMaterial, SurfaceOptions};
use crate::scene::{Part, Scene};
use dunkelfeld_geometry::health::{MeshHealth, Repairs};
use dunkelfeld_geometry::{Aabb, DAffine3, DVec3, Mesh, Threads, Transform, Vec3};
use std::sync::Arc;

/// Beyond this radius [m] the square of a distance, and with it the irradiance, may leave the range of f32.
const LARGEST_RADIUS: f64 = 1e18;

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
    pub fn build(self) -> Result<(Scene, BuildReport), BuildError> {
        let (scene, mut report) = self.compile(None)?;
        scene.report_hazards(&mut report);
        Ok((scene, report))
    }

    /// [`Self::build`] with the results of earlier builds. The scene has the same bits. The report contains only the
    /// findings of the compilation: [`Scene::report_hazards`] adds those of the compiled scene, which take longer.
    ///
    /// # Errors
    /// As [`Self::build`].
    pub fn build_with(self, cache: &mut BuildCache) -> Result<(Scene, BuildReport), BuildError> {
        self.compile(Some(cache))
    }

    fn compile(mut self, cache: Option<&mut BuildCache>) -> Result<(Scene, BuildReport), BuildError> {
        let mut builds = Builds::begin(cache, Threads::new(self.threads));
        check_indices(&self)?;
        check_values(&self)?;
        self.leave_clear_edges_sharp();
        let mut effects = Effects::from_scene(&self);
        let mut report = BuildReport::default();
        repair_texels(&mut self.images, &mut report);
        let had_triangles = self.shows_triangles();
        let closed = self.clean_meshes(&mut builds, &mut report);
        let placed = self.valid_instances(&mut report);
        let shapes = &mut |objects: &[&PlacedObject]| builds.shapes(objects, &self.meshes);
        crate::build::lints::small_objects(&placed, &self.meshes, &mut report);
        crate::build::lints::twins(&placed, &self.meshes, shapes, &mut report);
        let times = self.shutter.map(|shutter| shutter.times());
        let baking = Baking::new(&placed, &self.meshes, times.is_some());
        let bounds = world_bounds(&placed, &self.meshes, &mut builds);
        if bounds.is_none() && had_triangles && !self.has_background() {
            return Err(BuildError::NothingLeft { lost: losses(&report) });
        }
        let Space { world_origin, radius } = self.space(&placed, bounds, baking.has_own_trees(), &mut builds)?;
        let radius = radius as f32;
        let to_render = DAffine3::from_translation(-world_origin);
        let has_frame = |part: &MeshPart| part.edge_radius > 0.0 || self.materials[part.material].is_of_object();
        let mut geometry =
            PlacedScene::new(&placed, &self.meshes, (&baking, times, &has_frame), world_origin, &mut builds)?;
        drop(std::mem::take(&mut self.meshes));

        let compiled = self.compiled_materials(&geometry);
        let solids = geometry.solids(&self.materials, &compiled, &closed);
        geometry.check_density(&solids.list, &closed).map_err(|(part, problem)| self.too_dense(part, problem))?;
        let lights = self.light_table(&mut geometry, &compiled, (&to_render, radius), &mut report);
        self.report_unfindable_light(&geometry.parts, &compiled, &mut report);
        let material = |part: &Part| &compiled[part.material as usize];
        let has_coverage = geometry.parts.iter().any(|p| material(p).has_coverage);
        let has_solids = geometry.parts.iter().any(|p| material(p).is_solid);
        // Shadow rays pass partly covering surfaces. They also pass clear faces between equal indices of refraction, if
        // the scene can have them.
        let is_open = |part: &Part| material(part).clear_tint.is_some();
        let has_open_faces = geometry.parts.iter().any(|p| is_open(p) && solids.is_open(p.solid));
        let scatters = solids.list.iter().any(|s| s.medium.scatters());
        let learns = self.techniques.learned_roulette && !geometry.parts.is_empty();
        add_compiled_effects(&mut effects, solids.has_nesting, &lights, learns);
        let covers_partly = |part: &Part| material(part).has_coverage || (has_open_faces && is_open(part));
        let bvh = geometry.hierarchy(&covers_partly, &mut builds)?;
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
            has_solids,
            has_media: scatters || has_open_faces || solids.has_nesting,
            effects,
        };
        if self.techniques.cover_connection {
            scene.find_covers();
        }
        builds.finish();
        Ok((scene, report))
    }

    /// The space of the render.
    ///
    /// # Errors
    /// If the scene is too large.
    fn space(
        &self,
        placed: &[PlacedObject],
        bounds: Option<[DVec3; 2]>,
        is_coarse: bool,
        builds: &mut Builds<'_>,
    ) -> Result<Space, BuildError> {
        let times = self.shutter.map(|shutter| shutter.times());
        let extent = times.and_then(|times| moving_bounds(bounds, placed, &self.meshes, times, builds)).or(bounds);
        let space = Space::new(extent, is_coarse);
        if space.radius > LARGEST_RADIUS {
            let place = farthest(placed, &self.meshes);
            return Err(BuildError::TooLarge { place, radius: format!("{:.1e} m", space.radius) });
        }
        Ok(space)
    }

    /// All lights: emitting triangles, punctual ones in the space of the render, and the environment.
    fn light_table(
        &mut self,
        geometry: &mut PlacedScene,
        compiled: &[CompiledMaterial],
        (to_render, radius): (&DAffine3, f32),
        report: &mut BuildReport,
    ) -> LightTable {
        let (mut lights, mesh_lights) = geometry.area_lights(&self.materials, compiled, &self.images);
        lights.extend(self.lights.iter().map(|light| DeltaLight::light(light, to_render)));
        let environment = self.environment.as_ref().map(|e| EnvironmentLight::new(e, &self.images));
        let profiles = std::mem::take(&mut self.profiles);
        let lights = LightTable::new(lights, mesh_lights, environment, profiles, radius, self.techniques);
        if lights.lights.iter().all(|l| lights.power(l, radius.max(1.0)).is_black()) {
            report.hazard(
                "scene",
                "there is no light: no emissive material, no punctual light, no environment; the image will be black; add a light or an emissive material to the scene, or `[environment]` with `radiance = 1` to a job",
            );
        }
        lights
    }

    /// The materials in the form that paths use.
    fn compiled_materials(&self, geometry: &PlacedScene) -> Vec<CompiledMaterial> {
        let [mut is_painted, mut is_rounded] = [0; 2].map(|_| vec![false; self.materials.len()]);
        for part in &geometry.parts {
            is_painted[part.material as usize] |= !geometry.meshes[part.mesh as usize].colors.is_empty();
            is_rounded[part.material as usize] |= part.edges.is_some();
        }
        let options = SurfaceOptions { energy_compensation: self.energy_compensation, principled: self.principled };
        let materials = self.materials.iter().zip(is_painted).zip(is_rounded);
        let compile = |((m, is_painted), has_rounded_edges): ((&Material, bool), bool)| {
            let mut compiled = CompiledMaterial::new(m, is_painted, options, &self.images);
            compiled.has_rounded_edges = has_rounded_edges;
            compiled
        };
        materials.map(compile).collect()
    }

    /// The place of a path on a fillet is that of its shading only, so light must neither pass nor leave it.
    fn leave_clear_edges_sharp(&mut self) {
        for part in &mut self.meshes {
            let material = &self.materials[part.material];
            if !material.is_opaque() || material.emits() {
                part.edge_radius = 0.0;
            }
        }
    }

    fn too_dense(&self, part: &Part, problem: String) -> BuildError {
        let (object, material) = (&self.instances[part.object as usize], &self.materials[part.material as usize]);
        BuildError::TooDense {
            place: format!("object \"{}\" of material \"{}\"", object.name, material.name),
            problem,
            help: "make it an opaque white surface (leave out `solid` and `transmission`), lower its scattering, or give it absorption",
        }
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
    fn clean_meshes(&mut self, builds: &mut Builds<'_>, report: &mut BuildReport) -> Vec<bool> {
        let mut closed = vec![false; self.meshes.len()];
        let repaired = builds.repair(&mut self.meshes);
        let is_examined = |part: &&MeshPart| may_bound_a_volume(&self.materials[part.material]);
        let examined: Vec<&Arc<Mesh>> = self.meshes.iter().filter(is_examined).map(|part| &part.mesh).collect();
        let mut healths = builds.health(&examined).into_iter();
        for (index, (part, repaired)) in self.meshes.iter().zip(repaired).enumerate() {
            let place = mesh_place(index, &part.name);
            let Repaired { attributes, repairs, lost_digits } = repaired;
            attributes.into_iter().for_each(|note| report.note(&place, note));
            if repairs.total() > 0 {
                // A part of the object is missing then, which triangles without an area and copies do not show.
                let is_lost = repairs.out_of_range > 0 || repairs.non_finite > 0;
                let report_as = if is_lost { BuildReport::hazard } else { BuildReport::note };
                report_as(report, place.clone(), describe(&repairs));
            }
            lost_digits.into_iter().for_each(|message| report.hazard(&place, message));
            let material = &self.materials[part.material];
            let health = if may_bound_a_volume(material) { healths.next() } else { None };
            if material.transmission.factor > 0.0 && material.is_metal() {
                report.hazard(
                    &place,
                    format!("material \"{}\" is metal (metallic 1, glTF's default), so its transmission has no effect; set metallic to 0", material.name),
                );
                continue;
            }
            let Some(health) = health else { continue };
            if material.surface == Surface::Thin && encloses_a_volume(&health) {
                report.hazard(
                    &place,
                    format!("is closed, but its clear material \"{}\" is a thin sheet without an inside, as if it was exported without volume: light passes both faces straight; write `solid = true` for it in `[[material]]` of a job, or export the material with a thickness", material.name),
                );
            }
            if material.surface == Surface::Thin {
                continue;
            }
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
    fn valid_instances(&self, report: &mut BuildReport) -> Vec<PlacedObject> {
        let mut valid = Vec::with_capacity(self.instances.len());
        for (object, instance) in self.instances.iter().enumerate() {
            match Transform::new(instance.to_world) {
                Ok(t) => valid.push((object as u32, instance.clone(), t)),
                Err(e) => {
                    report.hazard(format!("object \"{}\"", instance.name), format!("{e}; the object is left out"))
                }
            }
        }
        valid
    }
}

/// Adds the effects that follow from compiled solids and lights.
fn add_compiled_effects(effects: &mut Effects, has_nesting: bool, lights: &LightTable, learns: bool) {
    if has_nesting {
        effects.add(Effect::Nesting, "solids that touch or overlap".into());
    }
    if lights.has_tree() {
        effects.add(Effect::ManyLights, format!("{} lights", lights.lights.len()));
    }
    if lights.samples_each() {
        effects.add(Effect::EveryLight, format!("{} lights", lights.lights.len()));
    }
    if learns {
        effects.add(Effect::LearnedRoulette, "paths between surfaces".into());
    }
}

/// Does it matter whether a mesh of this material is closed?
fn may_bound_a_volume(material: &Material) -> bool {
    let is_solid = matches!(material.surface, Surface::Solid(_));
    material.transmission.factor > 0.0 || is_solid && material.diffuse_transmission.share.factor > 0.0
}

/// Is the mesh closed, other than a sheet that was modelled from both sides?
fn encloses_a_volume(health: &MeshHealth) -> bool {
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
fn farthest(placed: &[PlacedObject], meshes: &[MeshPart]) -> String {
    let reach = |(_, instance, transform): &PlacedObject| {
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
fn world_bounds(placed: &[PlacedObject], meshes: &[MeshPart], builds: &mut Builds<'_>) -> Option<[DVec3; 2]> {
    let parts = placed
        .iter()
        .flat_map(|(_, i, transform)| i.meshes.iter().map(move |m| (&meshes[*m].mesh, *transform.to_world())));
    let boxes = builds.bounds(&parts.collect::<Vec<_>>());
    boxes.into_iter().flatten().reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
}

/// [`world_bounds`] of all poses between two times. `None` if nothing moves.
fn moving_bounds(
    rest: Option<[DVec3; 2]>,
    placed: &[PlacedObject],
    meshes: &[MeshPart],
    [from, to]: [f64; 2],
    builds: &mut Builds<'_>,
) -> Option<[DVec3; 2]> {
    let mut bounds = None;
    for object in placed.iter().filter(|(_, instance, _)| !instance.motion.is_static()) {
        let Some([lo, hi]) = world_bounds(std::slice::from_ref(object), meshes, builds) else { continue };
        let swept = object.1.motion.swept(&Aabb { min: lo.as_vec3(), max: hi.as_vec3() }, from, to);
        let [low, high] = bounds.or(rest).unwrap_or([lo, hi]);
        bounds = Some([low.min(swept.min.as_dvec3()), high.max(swept.max.as_dvec3())]);
    }
    bounds
}

/// Origin and radius of render space.
struct Space {
    world_origin: DVec3,
    /// Radius of the sphere around the origin that contains everything \[m\].
    radius: f64,
}

impl Space {
    /// The origin is the middle of the extent. With `is_coarse` it is a point of a grid with a step of about half of the
    /// radius. So it stays the same if an object moves a little, and everything else keeps its coordinates.
    fn new(extent: Option<[DVec3; 2]>, is_coarse: bool) -> Self {
        let middle = extent.map_or(DVec3::ZERO, |[lo, hi]| 0.5 * (lo + hi));
        let reach = extent.map_or(0.0, |[lo, hi]| 0.5 * (hi - lo).length());
        if !is_coarse || !reach.is_normal() {
            return Self { world_origin: middle, radius: reach };
        }
        let step = (reach.log2().ceil() - 1.0).exp2();
        let world_origin = (middle / step).round() * step;
        Self { world_origin, radius: reach + middle.distance(world_origin) }
    }
}

fn used_positions(mesh: &Mesh) -> impl Iterator<Item = Vec3> + '_ {
    mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize])
}
