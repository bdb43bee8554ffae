//! The state of a path, the light that its rays hit, and the coverage of surfaces, which is sampled path by path.

use crate::dimensions;
use crate::direct;
use crate::mnee::{self, End, SpecularPrefix};
use crate::ray_state::{RayState, SurfaceHit};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, One, V3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Sampler;
use dunkelfeld_scene::{Interface, Receivers, Scene, SurfacePoint};

/// From this bounce at a surface on the survival probability is below one, also for a path without any loss. So light
/// between perfect mirrors ends. A path in a medium leaves it, and ends by its loss only: a limit would end a share of
/// the long paths in a dense white medium and increase the weight of the others, with infinite variance.
const FORCED_RR_BOUNCES: f32 = 64.0;
/// Survival probability of such a path. The variance of a closed cavity is finite up to an albedo of the square root of
/// this value, 0.9899. A value nearer to one would give finite variance for brighter cavities, but light trapped in
/// clear sheets would be traced for longer.
const MAX_SURVIVAL: f32 = 0.98;

/// Scale of Russian roulette (Arvo and Kirk 1990): a path whose throughput, without the factor eta^2, is a third or more
/// always survives. Termination on dark surfaces produces rare bright samples. On the inspection scenes this factor reduces
/// the variance of the image by a third and costs a tenth more time (`validation/README.md`).
pub(crate) const RR_SCALE: f32 = 3.0;

/// The state of a path. Lanes load and store it by rows of four numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathState([[f32; 4]; 6]);

/// [`PathState`] of each lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathStates<F: Lanes> {
    /// Path throughput: the weight of all further contributions.
    pub(crate) throughput: Rgb<F>,
    /// Change of radiance by refraction (the factor eta^2). Russian roulette must not treat it as loss.
    pub(crate) eta_scale: F,
    /// Radiance of the sample so far [W/(m^2 sr)].
    pub(crate) radiance: Rgb<F>,
    /// Scale of the learned survival probabilities; negative before the first surface with statistics.
    pub(crate) gain_scale: F,
    pub(crate) sampler: Sampler<F>,
    /// Distance from the camera along the path \[m\].
    pub(crate) path_length: F,
    /// Number of scatterings at surfaces.
    pub(crate) bounces: F,
    /// Number of vertices with light samples so far.
    pub(crate) light_vertices: F,
    /// Number of paths that the sample was split into.
    pub(crate) children: F,
    /// Density [1/sr] of the last scattered direction, if light sampling could have sampled it as well. Else zero, and the
    /// path has full weight.
    pub(crate) last_pdf: F,
    /// The vertex of that direction.
    pub(crate) last: Receivers<F>,
    /// Lanes that chose one light there.
    pub(crate) last_choice_is_one: F::Mask,
}

impl<F: Lanes> PathStates<F> {
    /// Loads the state `of(lane)` of each lane.
    #[inline(always)]
    pub(crate) fn load<'p>(token: F::Token, of: impl Fn(usize) -> &'p PathState) -> Self {
        let [
            (t, eta_scale),
            (l, gain_scale),
            (words, path_length),
            (counts, children),
            (point, both_sides),
            (normal, is_one),
        ] = V3::<F>::load_records(
            token,
            #[inline(always)]
            |lane| &of(lane).0,
        );
        let words = [words.x.to_bits(), words.y.to_bits(), words.z.to_bits()];
        Self {
            throughput: Rgb::new(t.x, t.y, t.z),
            eta_scale,
            radiance: Rgb::new(l.x, l.y, l.z),
            gain_scale,
            sampler: Sampler::from_words(token, words),
            path_length,
            bounces: counts.x,
            light_vertices: counts.y,
            children,
            last_pdf: counts.z,
            last: Receivers { point, normal, both_sides: both_sides.is_positive() },
            last_choice_is_one: is_one.is_positive(),
        }
    }

    /// Stores the states of the lanes of a mask, in ascending order.
    #[inline(always)]
    pub(crate) fn store(&self, lanes: F::Mask, mut to: impl FnMut(usize, PathState)) {
        let (t, l, last, one) = (self.throughput, self.radiance, &self.last, self.eta_scale.constant(1.0));
        let [low, high, index] = self.sampler.words();
        let rows = [
            (V3::new(t.r, t.g, t.b), self.eta_scale),
            (V3::new(l.r, l.g, l.b), self.gain_scale),
            (V3::new(F::from_bits(low), F::from_bits(high), F::from_bits(index)), self.path_length),
            (V3::new(self.bounces, self.light_vertices, self.last_pdf), self.children),
            (last.point, one.only(last.both_sides)),
            (last.normal, one.only(self.last_choice_is_one)),
        ];
        V3::store_records(
            rows,
            lanes,
            #[inline(always)]
            |lane, rows| to(lane, PathState(rows)),
        );
    }

    /// Contributions of light that scattered rays have hit: surfaces (`is_finite`) or infinity, with the points or
    /// directions, and the normals there, for [`End`]. `light_pdf` [1/sr] is the density with which light sampling draws the
    /// same directions. Both techniques share the light by the power heuristic. Behind covers the other technique is the
    /// connection, if it finds the chain to the end.
    #[inline(always)]
    pub(crate) fn contributions(
        &self,
        scene: &Scene,
        emitted: Rgb<F>,
        end: (bool, [V3<F>; 2]),
        prefixes: &[Option<&SpecularPrefix>; MAX_WIDTH],
        light_pdf: impl FnOnce() -> F,
    ) -> Rgb<F> {
        let light = self.throughput * emitted;
        let shared = light.is_lit() & self.last_pdf.is_positive();
        if !shared.any() {
            return light;
        }
        let light_pdf = light_pdf();
        let mut weight = direct::power_heuristic(self.last_pdf, light_pdf);
        let is_behind_covers = prefixes.iter().flatten().any(
            #[inline(always)]
            |prefix| !prefix.is_direct(),
        );
        if is_behind_covers {
            weight = self.weight_behind_covers(scene, (shared, weight), light_pdf, end, prefixes);
        }
        light * shared.select(weight, weight.constant(1.0))
    }

    /// Replaces the weights of some lanes where their rays have passed covers.
    #[inline(never)]
    fn weight_behind_covers(
        &self,
        scene: &Scene,
        (lanes, weight): (F::Mask, F),
        light_pdf: F,
        (is_finite, [place, normal]): (bool, [V3<F>; 2]),
        prefixes: &[Option<&SpecularPrefix>; MAX_WIDTH],
    ) -> F {
        let (receivers, mut weights) = (self.last.to_lanes(), weight.to_array());
        let (pdf, light_pdf) = (self.last_pdf.to_array(), light_pdf.to_array());
        let (places, normals) = (place.to_lanes(), normal.to_lanes());
        for lane in lanes.lanes() {
            if let Some(prefix) = prefixes[lane].filter(|prefix| !prefix.is_direct()) {
                let (receiver, end) = (&receivers[lane], End { is_finite, place: places[lane], normal: normals[lane] });
                weights[lane] = mnee::scattering_mis_weight(scene, receiver, prefix, end, pdf[lane], light_pdf[lane]);
            }
        }
        F::load(weight.token(), &weights)
    }
}

impl PathState {
    /// The path of a ray from the camera.
    pub(crate) fn new(sampler: &Sampler) -> Self {
        let [One(low), One(high), One(index)] = sampler.words();
        let mut state = Self([[0.0; 4]; 6]);
        state.0[0] = [1.0; 4];
        state.0[1][3] = -1.0;
        state.0[3][3] = 1.0;
        state.0[2] = [f32::from_bits(low), f32::from_bits(high), f32::from_bits(index), 0.0];
        state
    }

    /// This state alone.
    #[inline]
    pub(crate) fn get(&self) -> Path {
        PathStates::load((), |_| self)
    }

    /// Replaces the state.
    #[inline]
    pub(crate) fn put(&mut self, path: &Path) {
        path.store(true, |_, state| *self = state);
    }

    /// Radiance of the sample so far [W/(m^2 sr)].
    #[inline]
    pub(crate) fn radiance(&self) -> Rgb {
        let [r, g, b, _] = self.0[1];
        Rgb::new(r, g, b)
    }

    /// Adds radiance.
    #[inline]
    pub(crate) fn add_radiance(&mut self, light: Rgb) {
        let [r, g, b, _] = &mut self.0[1];
        *r += light.r;
        *g += light.g;
        *b += light.b;
    }
}

/// The state of one path.
pub(crate) type Path = PathStates<f32>;

impl Path {
    /// Samples which surface is present at a hit, of those that coincide with it. Returns it with a number in `[0, 1)` that is
    /// still unused, for surfaces with two random kinds. If none is, the path passes all of them, and `ray` is the one behind
    /// them.
    pub(crate) fn sample_presence<'b>(
        &mut self,
        scene: &Scene,
        ray: &mut RayState,
        vertex: u32,
        hit: SurfaceHit<'b>,
        storage: &'b mut Option<Interface>,
    ) -> Option<(SurfaceHit<'b>, f32)> {
        if let Some(tint) = hit.open_tint() {
            self.throughput *= tint;
            self.pass(ray, &hit);
            return None;
        }
        let (sampler, direction) = (self.sampler, ray.ray.direction);
        let mut number = None;
        let mut sample = |point: &SurfacePoint| {
            if !scene.is_random(point.material()) {
                return Some(0.0);
            }
            let u = number.unwrap_or_else(|| sampler.get_1d(dimensions::surface_kind(vertex)));
            // Both numbers are uniform again.
            let coverage = scene.coverage(point, direction);
            if u < coverage {
                return Some(u / coverage);
            }
            number = Some(((u - coverage) / (1.0 - coverage)).min(BELOW_ONE));
            None
        };
        if let Some(u_kind) = sample(&hit.surface) {
            return Some((hit, u_kind));
        }
        let mut last = None;
        while let Some(point) = scene.next_coincident(&ray.ray, hit.surface, last) {
            last = Some(point);
            let Some(u_kind) = sample(&point) else { continue };
            let found = ray.hit_at(scene, point, storage);
            let Some(tint) = found.open_tint() else { return Some((found, u_kind)) };
            self.throughput *= tint;
            self.pass(ray, &found);
            return None;
        }
        self.pass(ray, &SurfaceHit { surface: hit.surface, interface: None });
        None
    }

    /// The path continues behind a surface in the same direction.
    fn pass(&mut self, ray: &mut RayState, hit: &SurfaceHit<'_>) {
        // This is no vertex. So the last scattering stays the one that is combined with light sampling.
        self.path_length += hit.surface.distance;
        *ray = ray.pass_through(hit);
    }
}

/// The largest number below 1.
const BELOW_ONE: f32 = 1.0 - 0.5 * f32::EPSILON;

/// The survival probability of a path without loss after a number of scatterings at surfaces.
#[inline(always)]
pub(crate) fn max_survival<F: Lanes>(bounces: F) -> F {
    let one = bounces.constant(1.0);
    bounces.lt(bounces.constant(FORCED_RR_BOUNCES)).select(one, bounces.constant(MAX_SURVIVAL))
}
