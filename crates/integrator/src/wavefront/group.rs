//! Paths at points of one material or medium, one for each lane: the inputs of scattering.

use super::{ARRIVED, Arrival, Layers, MEDIUM, Watch, Wavefront};
use crate::learned_roulette::VertexRoulettes;
use crate::observer::Event;
use crate::path::PathStates;
use crate::ray_state::{EnclosingSolids, SurfaceHit};
use crate::scatterer::OneLane;
use crate::vertex::Vertex;
use dunkelfeld_bsdf::Bsdf;
use dunkelfeld_geometry::{LocalDir, Ray, Vec3};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, V3};
use dunkelfeld_scene::{
    Bsdfs, Interface, LightChoice, Receivers, ShadingFrames, ShadingLanes, SurfacePoint, SurfacePoints,
};

/// Paths at points of one material or medium, one for each lane. Free lanes repeat the first path.
pub(super) struct Group<'g, F: Lanes> {
    pub(super) token: F::Token,
    /// Number of the vertex on each path.
    pub(super) vertex: u32,
    pub(super) in_medium: bool,
    pub(super) choice: LightChoice,
    /// Number of lanes that are used, and their mask.
    pub(super) len: usize,
    pub(super) used: F::Mask,
    /// Lanes with light samples.
    pub(super) lit: F::Mask,
    pub(super) paths: [u32; MAX_WIDTH],
    pub(super) state: PathStates<F>,
    /// Points on surfaces; in a medium their errors are zero.
    pub(super) points: SurfacePoints<F>,
    pub(super) frames: ShadingFrames<F>,
    pub(super) receivers: Receivers<F>,
    /// Directions toward the camera, in the frames of shading.
    pub(super) wo: V3<F>,
    pub(super) bsdfs: Bsdfs<'g>,
    /// The points one by one, where they are found path by path, or where connections begin. Else empty.
    pub(super) vertices: Vec<Vertex<'g>>,
    /// The material, if the surfaces bound solids.
    pub(super) solid: Option<u32>,
    pub(super) rays: [u32; MAX_WIDTH],
    pub(super) learned: VertexRoulettes<'g, F>,
    /// Largest channel of the radiance before the vertex; zero at the first vertex with light samples. That one contributes
    /// most of the light of the pixel. Without training, roulette skips none of its shadow rays.
    pub(super) gathered: F,
    /// Does a lane set its auxiliary layers?
    pub(super) has_layers: bool,
}

/// BSDFs that exist only for the points of a group.
pub(super) type Storage = [Option<Bsdf>; MAX_WIDTH];

impl<'a> Wavefront<'a> {
    /// Loads the paths of some rays into lanes, and adds the emission of the surfaces that they have reached.
    #[inline(never)]
    pub(super) fn group<'g, F: Lanes>(
        &mut self,
        token: F::Token,
        vertex: u32,
        (key, rays, len): (u32, &[u32; MAX_WIDTH], usize),
        (interfaces, storage): (&'g [Interface], &'g mut Storage),
        watch: &mut Watch<'_>,
    ) -> Group<'g, F>
    where
        'a: 'g,
    {
        F::vectorize(
            token,
            #[inline(always)]
            || {
                let scene = self.estimator.scene;
                let (in_medium, is_arrived) = (key & MEDIUM != 0, key & ARRIVED != 0);
                let material = (key & !(MEDIUM | ARRIVED)) / 2;
                let mut paths = [0; MAX_WIDTH];
                for lane in 0..F::WIDTH {
                    paths[lane] = self.rays.paths[rays[lane] as usize];
                }
                let wo = -self.rays.directions::<F>(token, rays);
                let points = if !is_arrived {
                    scene.surface_points(token, &self.hits.lanes(token, rays), self.rays.times(token, rays))
                } else {
                    SurfacePoints::from_lanes(token, &self.surfaces(rays))
                };
                let is_one_by_one = is_arrived || !scene.covers().is_empty() && !scene.is_delta(material);
                let (vertices, bsdfs) = match is_one_by_one {
                    true => self.vertices(rays, len, &points, (interfaces, storage)),
                    false => (Vec::new(), scene.bsdfs(material, &points, &[0.0; MAX_WIDTH], storage)),
                };
                if watch.observer.is_some() || !in_medium && scene.emits(material) {
                    self.add_emission(&rays[..len], (!in_medium, material), &points, watch);
                }
                let all = self.paths.as_slice();
                let mut state = PathStates::<F>::load(
                    token,
                    #[inline(always)]
                    |lane| &all[paths[lane] as usize],
                );
                state.path_length += points.distance;
                let learned = match self.estimator.roulette {
                    Some(roulette) if !in_medium => {
                        let materials = F::splat_word(token, material);
                        roulette.at_lanes(token, points.point, materials, state.gain_scale)
                    }
                    _ => VertexRoulettes::none(token, state.gain_scale),
                };
                state.gain_scale = learned.gain_scale;
                let ShadingLanes { frames, receivers } = match in_medium {
                    true => ShadingLanes::in_medium(points.point),
                    false => scene.shade_lanes(material, &points, wo),
                };
                let used = F::mask(token, u32::MAX >> (32 - len));
                let lit = match bsdfs {
                    Bsdfs::Same(bsdf) if bsdf.is_delta() => F::mask(token, 0),
                    Bsdfs::Same(_) => used,
                    Bsdfs::Each(each) => F::mask(token, lit_lanes(&each[..len])),
                };
                let gathered = state.radiance.max_channel().only(lit & state.light_vertices.is_positive());
                state.light_vertices += state.eta_scale.constant(1.0).only(lit);
                Group {
                    token,
                    vertex,
                    in_medium,
                    choice: if key & 1 == 1 { LightChoice::One } else { scene.light_choice_at(0, false) },
                    len,
                    used,
                    lit,
                    has_layers: paths[..len].iter().any(|path| self.layers[*path as usize] != Layers::Set),
                    paths,
                    learned,
                    state,
                    wo: frames.frame.to_local(wo),
                    points,
                    frames,
                    receivers,
                    bsdfs,
                    vertices,
                    solid: (!in_medium && scene.is_solid(material)).then_some(material),
                    rays: *rays,
                    gathered,
                }
            },
        )
    }

    /// The points that rays have reached, where they are found path by path.
    #[inline(never)]
    fn surfaces(&self, rays: &[u32; MAX_WIDTH]) -> [SurfacePoint; MAX_WIDTH] {
        let nowhere = SurfacePoint::in_medium(&Ray::new(Vec3::ZERO, Vec3::Z), 0.0);
        let mut surfaces = [nowhere; MAX_WIDTH];
        for (surface, &ray) in surfaces.iter_mut().zip(rays) {
            match self.arrivals[ray as usize] {
                Some(Arrival::Surface { point, .. }) => *surface = point,
                Some(Arrival::Medium { distance, .. }) => {
                    *surface = SurfacePoint::in_medium(&self.rays.get(ray as usize), distance);
                }
                None => {}
            }
        }
        surfaces
    }

    /// The points that rays have reached, one by one, and their BSDFs.
    #[inline(never)]
    fn vertices<'g, F: Lanes>(
        &self,
        rays: &[u32; MAX_WIDTH],
        len: usize,
        points: &SurfacePoints<F>,
        (interfaces, storage): (&'g [Interface], &'g mut Storage),
    ) -> (Vec<Vertex<'g>>, Bsdfs<'g>)
    where
        'a: 'g,
    {
        let scene = self.estimator.scene;
        let mut vertices = Vec::with_capacity(len);
        for (lane, (&ray, storage)) in rays[..len].iter().zip(storage).enumerate() {
            let state = self.ray_state(ray as usize);
            let (u_kind, interface) = match self.arrivals.get(ray as usize).copied().flatten() {
                None => (0.0, None),
                Some(Arrival::Surface { u_kind, interface, .. }) => (u_kind, interface),
                Some(Arrival::Medium { distance, .. }) => {
                    vertices.extend(Vertex::in_medium(scene, state, distance, storage));
                    continue;
                }
            };
            let interface = interface.and_then(|number| interfaces.get(number as usize));
            let hit = SurfaceHit { surface: points.lane(lane), interface };
            vertices.push(Vertex::on_surface(scene, state, hit, u_kind, storage));
        }
        let bsdfs = same_or_each(&vertices);
        (vertices, bsdfs)
    }

    /// Adds the emission of the surfaces of a material that rays have reached.
    #[inline(never)]
    fn add_emission<F: Lanes>(
        &mut self,
        rays: &[u32],
        (on_surface, material): (bool, u32),
        points: &SurfacePoints<F>,
        watch: &mut Watch<'_>,
    ) {
        let scene = self.estimator.scene;
        for (lane, &ray) in rays.iter().enumerate() {
            let (number, point) = (self.rays.paths[ray as usize], points.lane(lane));
            let mut path = self.paths[number as usize].get();
            let (position, throughput, in_medium) = (point.point, path.throughput, !on_surface);
            watch.event(number, || Event::Vertex { position, material: Some(material), in_medium, throughput });
            if on_surface && scene.emits(material) {
                let ray = self.rays.get(ray as usize);
                let light = path.add_emission(scene, &ray, &point, self.prefix(number));
                watch.event(number, || Event::Emitted(light));
                self.paths[number as usize].add_radiance(light);
            }
        }
    }
}

impl Wavefront<'_> {
    /// The solids of a path that leaves its point in a direction.
    #[inline]
    pub(super) fn enclosing_beyond<F: Lanes>(
        &self,
        group: &Group<'_, F>,
        lane: usize,
        (normal, wi): (Vec3, Vec3),
    ) -> EnclosingSolids {
        match (group.vertices.get(lane), self.among_solids.get(group.paths[lane] as usize)) {
            (_, None) => EnclosingSolids::Last(None),
            (Some(at), _) => at.spawn_ray(wi).enclosing,
            (None, Some(among)) => {
                let from = self.rays.get(group.rays[lane] as usize).direction;
                among.enclosing.beyond(group.solid, normal, [from, wi])
            }
        }
    }
}

impl<'g, F: Lanes> Group<'g, F> {
    /// The BSDFs one by one.
    #[inline(always)]
    pub(super) fn one_by_one(&self) -> [OneLane<'g>; MAX_WIDTH] {
        let wo = self.wo.to_lanes();
        let mut lanes = [OneLane { bsdf: self.bsdfs.lane(0), wo: LocalDir(wo[0]) }; MAX_WIDTH];
        for lane in 1..F::WIDTH {
            lanes[lane] = OneLane { bsdf: self.bsdfs.lane(lane), wo: LocalDir(wo[lane]) };
        }
        lanes
    }

    /// The origins of rays that leave the points in given directions.
    #[inline(always)]
    pub(super) fn ray_origins(&self, directions: V3<F>) -> V3<F> {
        if self.in_medium { self.points.point } else { self.points.ray_origins(directions) }
    }
}

/// The BSDFs of points. Free lanes repeat the first.
fn same_or_each<'g>(vertices: &[Vertex<'g>]) -> Bsdfs<'g> {
    let first = vertices[0].shading.bsdf;
    if vertices.iter().all(|vertex| std::ptr::eq(vertex.shading.bsdf, first)) {
        return Bsdfs::Same(first);
    }
    let mut each = [first; MAX_WIDTH];
    for (bsdf, vertex) in each.iter_mut().zip(vertices) {
        *bsdf = vertex.shading.bsdf;
    }
    Bsdfs::Each(each)
}

/// Bits of the lanes whose BSDFs are not of single directions.
fn lit_lanes(bsdfs: &[&Bsdf]) -> u32 {
    let bits = bsdfs.iter().enumerate().map(|(lane, bsdf)| u32::from(!bsdf.is_delta()) << lane);
    bits.fold(0, |all, bit| all | bit)
}
