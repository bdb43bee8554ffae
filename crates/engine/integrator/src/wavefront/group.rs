//! Paths at points of one material or medium, one for each lane: the inputs of scattering.

use super::{ARRIVED, Arrival, Layers, MEDIUM, Watch, Wavefront};
use crate::direct::{GATHERED_SHARE, MIN_SURVIVAL};
use crate::learned_roulette::VertexRoulettes;
use crate::observer::Event;
use crate::path::PathStates;
use crate::ray_state::EnclosingSolids;
use crate::scatterer::Scattering;
use dunkelfeld_bsdf::Bsdf;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3, vectorize};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{Bsdfs, Interface, LightChoice, Receivers, ShadingLanes, SurfacePoint, SurfacePoints};
use smallvec::SmallVec;

/// Paths at points of one material or medium, one for each lane. Free lanes repeat the first path.
pub(super) struct Group<'g, F: Lanes> {
    /// The points with their BSDFs.
    pub(super) at: Scattering<'g, F>,
    /// Number of the vertex on each path.
    pub(super) vertex: u32,
    pub(super) in_medium: bool,
    pub(super) choice: LightChoice,
    /// Lanes that are used.
    pub(super) used: F::Mask,
    /// Lanes with light samples.
    pub(super) lit: F::Mask,
    pub(super) paths: [u32; MAX_WIDTH],
    pub(super) state: PathStates<F>,
    /// Points on surfaces; in a medium their errors are zero.
    pub(super) points: SurfacePoints<F>,
    pub(super) receivers: Receivers<F>,
    /// Directions of the rays.
    pub(super) from: V3<F>,
    pub(super) arrived: Arrived<'g>,
    /// Albedo of single scattering in the medium.
    pub(super) medium_albedo: Option<Rgb>,
    /// The material, if the surfaces bound solids.
    pub(super) solid: Option<u32>,
    pub(super) learned: VertexRoulettes<'g, F>,
    /// The binary logarithm of the number of paths that paths are split into, and the lanes where they are.
    pub(super) splits: u32,
    is_split: F::Mask,
    /// Lanes with the first light samples of their path.
    pub(super) is_first_light: F::Mask,
    /// Largest channel of the radiance that the path has gathered before the vertex; zero at the first vertex with light
    /// samples, and until the rest behind it has met light. Without training, roulette skips no shadow rays there.
    pub(super) gathered: F,
    /// See [`Observer::needs_outcomes`](crate::observer::Observer::needs_outcomes).
    needs_outcomes: bool,
    /// Does a lane set its auxiliary layers?
    pub(super) has_layers: bool,
}

/// The data of points that are found path by path. Empty for other points.
#[derive(Default)]
pub(super) struct Arrived<'g> {
    /// The interfaces of solids.
    interfaces: SmallVec<[Option<&'g Interface>; MAX_WIDTH]>,
    /// Indices of refraction at these, and the numbers that decide the kinds of the surfaces.
    eta: SmallVec<[Option<f32>; MAX_WIDTH]>,
    u_kind: SmallVec<[f32; MAX_WIDTH]>,
}

impl<'g> Arrived<'g> {
    /// Appends some arrivals. Returns their points, and replaces their numbers by those of their rays.
    #[inline(never)]
    fn points(&mut self, arrivals: &'g [Arrival], numbers: &mut [u32; MAX_WIDTH]) -> [SurfacePoint; MAX_WIDTH] {
        let mut points = [arrivals[numbers[0] as usize].point; MAX_WIDTH];
        for (its, number) in points.iter_mut().zip(numbers) {
            let Arrival { ray, point, u_kind, interface } = &arrivals[*number as usize];
            (*its, *number) = (*point, *ray);
            self.interfaces.push(interface.as_ref());
            self.eta.push(interface.as_ref().and_then(Interface::relative_index));
            self.u_kind.push(*u_kind);
        }
        points
    }
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
        (key, mut rays, len): (u32, [u32; MAX_WIDTH], usize),
        (arrivals, storage): (&'g [Arrival], &'g mut Storage),
        watch: &mut Watch<'_>,
    ) -> Group<'g, F>
    where
        'a: 'g,
    {
        vectorize!(F, token, {
            let scene = self.estimator.scene;
            let (in_medium, is_arrived) = (key & MEDIUM != 0, key & ARRIVED != 0);
            let material = (key & !(MEDIUM | ARRIVED)) / 2;
            let mut arrived = Arrived::default();
            let mut points = if is_arrived {
                SurfacePoints::from_lanes(token, &arrived.points(arrivals, &mut rays))
            } else {
                scene.surface_points(token, &self.hits.lanes::<F>(token, &rays), self.rays.times(token, &rays))
            };
            let paths = rays.map(|ray| self.rays.paths[ray as usize]);
            let from = self.rays.directions::<F>(token, &rays);
            let wo = -from;
            if !in_medium {
                scene.round_edges(material, &mut points, wo);
            }
            let medium = if in_medium { self.ray_state(rays[0] as usize).medium(scene) } else { None };
            let bsdfs = match in_medium {
                true => Bsdfs::Same(storage[0].insert(medium.map_or(Bsdf::Absorber, |m| Bsdf::Phase(m.phase)))),
                false => scene.bsdfs(material, &points, (&arrived.u_kind, &arrived.eta), storage),
            };
            let mut state = self.states(token, &paths, points.distance, is_arrived);
            if watch.observer.is_some() || !in_medium && scene.emits(material) {
                self.add_emission(&paths[..len], (in_medium, material), &points, (wo, &mut state), watch);
            }
            state.path_length += points.distance;
            let learned = self.learned(token, (!in_medium).then_some(material), points.point, state.gain_scale);
            state.gain_scale = learned.gain_scale;
            let ShadingLanes { frames, receivers, visible } = match in_medium {
                true => ShadingLanes::in_medium(points.point),
                false => scene.shade_lanes(material, &points, wo),
            };
            if let Some(visible) = visible {
                state.throughput *= visible;
            }
            let used = F::mask(token, u32::MAX >> (32 - len));
            let lit = lit_lanes::<F>(token, &bsdfs, len, used);
            let is_first_light = lit & !state.light_vertices.is_positive();
            let gathered = state.radiance.max_channel().only(lit & state.light_vertices.is_positive());
            state.light_vertices += state.eta_scale.constant(1.0).only(lit);
            let is_split = is_first_light & learned.is_learned;
            let is_free = is_split.any() && !watch.needs_outcomes();
            let splits = self.estimator.roulette.filter(|_| is_free).map_or(0, |roulette| roulette.splits);
            Group {
                splits,
                is_split,
                is_first_light,
                at: Scattering { token, len, frames, wo: frames.frame.to_local(wo), bsdfs },
                vertex,
                in_medium,
                choice: if key & 1 == 1 { LightChoice::One } else { scene.light_choice_at(0, false) },
                used,
                lit,
                has_layers: paths[..len].iter().any(|path| self.layers[*path as usize] != Layers::Set),
                paths,
                learned,
                state,
                from,
                points,
                receivers,
                arrived,
                needs_outcomes: watch.needs_outcomes(),
                medium_albedo: medium.map(|medium| medium.albedo()),
                solid: (!in_medium && scene.is_solid(material)).then_some(material),
                gathered,
            }
        })
    }

    /// The states of paths behind the solids on their way of the given length. Paths that were found one by one
    /// (`is_arrived`) have passed these already.
    #[inline(always)]
    fn states<F: Lanes>(
        &self,
        token: F::Token,
        paths: &[u32; MAX_WIDTH],
        distance: F,
        is_arrived: bool,
    ) -> PathStates<F> {
        let scene = self.estimator.scene;
        let mut transmittance = Rgb::splat(F::splat(token, 1.0));
        if !is_arrived && scene.has_solids() {
            let mut enclosing = [EnclosingSolids::Last(None); MAX_WIDTH];
            for lane in 0..F::WIDTH {
                enclosing[lane] = self.among_solids[paths[lane] as usize].enclosing;
            }
            transmittance = EnclosingSolids::transmittances(&enclosing, scene, distance);
        }
        let all = self.paths.as_slice();
        let mut state = PathStates::<F>::load(
            token,
            #[inline(always)]
            |lane| &all[paths[lane] as usize],
        );
        state.throughput *= transmittance;
        state
    }

    /// Learned survival probabilities at points on a material; of none in a medium.
    #[inline(always)]
    fn learned<F: Lanes>(
        &self,
        token: F::Token,
        material: Option<u32>,
        points: V3<F>,
        gain_scale: F,
    ) -> VertexRoulettes<'a, F> {
        match (self.estimator.roulette, material) {
            (Some(roulette), Some(material)) => {
                roulette.at_lanes(token, points, F::splat_word(token, material), gain_scale)
            }
            _ => VertexRoulettes::none(token, gain_scale),
        }
    }

    /// Adds the emission of the surfaces of a material that paths have reached.
    #[inline(never)]
    fn add_emission<F: Lanes>(
        &mut self,
        paths: &[u32],
        (in_medium, material): (bool, u32),
        points: &SurfacePoints<F>,
        (toward, state): (V3<F>, &mut PathStates<F>),
        watch: &mut Watch<'_>,
    ) {
        vectorize!(F, points.distance.token(), {
            let (scene, mut light) = (self.estimator.scene, Rgb::splat(points.distance.constant(0.0)));
            let emits = !in_medium && scene.emits(material);
            if emits {
                light = state.contributions(
                    scene,
                    scene.emitted_lanes(material, points, toward),
                    (true, [points.point, points.normal]),
                    &self.prefixes(paths),
                    #[inline(always)]
                    || scene.light_pdf(&state.last, state.last_choice_is_one, points),
                );
                state.radiance += light;
            }
            let (positions, throughputs) = (points.point.to_lanes(), state.throughput.to_lanes());
            for (lane, (&number, light)) in paths.iter().zip(light.to_lanes()).enumerate() {
                let (position, throughput) = (positions[lane], throughputs[lane]);
                watch.event(number, || Event::Vertex { position, material: Some(material), in_medium, throughput });
                if emits {
                    watch.event(number, || Event::Emitted(light));
                    self.paths[number as usize].add_radiance(light);
                }
            }
            if let Some(groups) = self.group_light.groups.filter(|_| emits) {
                let parts = F::word_to_array(points.part);
                for (lane, (&number, light)) in paths.iter().zip(light.to_lanes()).enumerate() {
                    self.group_light.add(number, groups.of_part(parts[lane]), light);
                }
            }
        });
    }
}

impl Wavefront<'_> {
    /// The solids of paths that leave their points in given directions.
    #[inline(always)]
    pub(super) fn enclosing_beyond<F: Lanes>(&self, group: &Group<'_, F>, wi: V3<F>) -> [EnclosingSolids; MAX_WIDTH] {
        let mut enclosing = [EnclosingSolids::Last(None); MAX_WIDTH];
        let normal = group.points.normal;
        let from_inside = normal.dot(group.from).is_positive().bits();
        let inward = (-normal.dot(wi)).is_positive().bits();
        for (lane, (enclosing, &path)) in enclosing.iter_mut().zip(&group.paths[..group.at.len]).enumerate() {
            if let Some(among) = self.among_solids.get(path as usize) {
                let [from_inside, inward] = [from_inside, inward].map(|bits| bits >> lane & 1 == 1);
                *enclosing = among.enclosing.beyond(group.solid, from_inside, inward);
            }
        }
        for (lane, interface) in group.arrived.interfaces.iter().enumerate() {
            if let Some(interface) = interface {
                enclosing[lane] = EnclosingSolids::All(interface.beyond(wi.to_lanes()[lane]));
            }
        }
        enclosing
    }
}

impl<F: Lanes> Group<'_, F> {
    /// Survival probability of the shadow ray or the connection (`kind`) of a light sample in Russian roulette before it is
    /// traced (Veach 1997, section 10.4), for an expected radiance at the vertex [W/(m^2 sr)]. Without statistics it depends
    /// on the light that the path has gathered: most shadow rays of long paths would be traced for samples that add almost
    /// nothing. Where a light was chosen, it is then one. Samples that are not a number survive, so that the film can count
    /// them.
    #[inline(always)]
    pub(super) fn ray_survival(&self, kind: usize, index: u32, expected: Rgb<F>) -> F {
        let (brightest, expected) = (self.state.throughput.max_channel(), expected.max_channel());
        let (scale, one) = (brightest / (self.gathered * GATHERED_SHARE), brightest.constant(1.0));
        if self.needs_outcomes {
            return one;
        }
        let relative = scale * expected;
        let is_rare = self.gathered.is_positive() & scale.is_positive() & relative.lt(one);
        let importance = brightest * self.state.children;
        let gathered = match self.choice {
            LightChoice::Each => is_rare.select(relative.max(one.constant(MIN_SURVIVAL)), one),
            LightChoice::One => one,
        };
        self.learned.ray_survival(kind, index, importance * expected * self.split_gain(), gathered)
    }

    /// The number of paths that each path is split into.
    #[inline(always)]
    pub(super) fn num_children(&self) -> F {
        let one = self.at.wo.x.constant(1.0);
        self.is_split.select(one * (1 << self.splits) as f32, one)
    }

    /// Factor of light samples before a split on the root of the gain in efficiency: the variance of the rest is divided by
    /// the number of children.
    #[inline(always)]
    fn split_gain(&self) -> F {
        if self.splits == 0 { self.at.wo.x.constant(1.0) } else { self.num_children().sqrt() }
    }

    /// The sampler of a child.
    #[inline(always)]
    pub(super) fn sampler(&self, child: u32) -> Sampler<F> {
        match self.splits {
            0 => self.state.sampler,
            splits => self.state.sampler.child(child, splits, self.is_split),
        }
    }

    /// The origins of rays that leave the points in given directions.
    #[inline(always)]
    pub(super) fn ray_origins(&self, directions: V3<F>) -> V3<F> {
        if self.in_medium { self.points.point } else { self.points.ray_origins(directions) }
    }
}

/// The used lanes whose BSDFs are not of single directions. The first `len` are used.
#[inline(always)]
fn lit_lanes<F: Lanes>(token: F::Token, bsdfs: &Bsdfs<'_>, len: usize, used: F::Mask) -> F::Mask {
    match bsdfs {
        Bsdfs::Same(bsdf) if bsdf.is_delta() => F::mask(token, 0),
        Bsdfs::Same(_) => used,
        Bsdfs::Each(each) => F::mask(token, lit_bits(&each[..len])),
    }
}

/// Bits of the lanes whose BSDFs are not of single directions.
fn lit_bits(bsdfs: &[&Bsdf]) -> u32 {
    let bits = bsdfs.iter().enumerate().map(|(lane, bsdf)| u32::from(!bsdf.is_delta()) << lane);
    bits.fold(0, |all, bit| all | bit)
}
