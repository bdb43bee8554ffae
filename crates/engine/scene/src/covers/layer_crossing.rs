//! Receivers and lights with the same interfaces of a stack between them: the chains, each in a plate of parallel layers
//! that replaces the stack.

use super::candidates::Choice;
use super::chain::Chain;
use super::planar_layers::{Leg, PlateRay};
use super::stack::{CoverInterface, CoverStack, MAX_INTERFACES};
use crate::geometry::splat;
use dunkelfeld_lanes::{Double, Lanes, Mask, V3, vectorize};

/// Sideways shift of a chain between the first and the last interface, over that of the shortest chain: two double
/// passes.
const MAX_PASSES: f32 = 5.0;
/// Relative rounding error of the coordinates of a footprint.
const ROUNDING: f32 = 1e-6;

/// The straight line from a receiver to its light, in the coordinates of a stack.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line<F: Lanes> {
    /// Height of the receiver along the axis \[m\].
    pub(super) start: F::Double,
    /// Way along the axis to the light \[m\]; for a light at infinity the cosine of the angle to the axis.
    pub(super) along: F::Double,
    /// Distance across the axis to the light \[m\]; for a light at infinity the sine.
    across: F,
    /// Unit vector across the axis toward the light; zero if both lie on one line along the axis.
    sideways: V3<F>,
    /// The receiver in the coordinates of footprints \[m\], and the largest magnitude of them.
    origin: [F; 2],
    size: F,
    /// `sideways` in the coordinates of footprints.
    shift: [F; 2],
}

impl<F: Lanes> Line<F> {
    /// From a point `x`. `way` leads to the point of the light, or is the direction toward a light at infinity.
    #[inline(always)]
    pub(super) fn new(token: F::Token, stack: &CoverStack, x: V3<F::Double>, way: V3<F::Double>) -> Self {
        let axis = splat::<F>(token, stack.axis());
        let along = axis.dot(way);
        let across = V3::<F>::narrow(way - axis * along);
        let length = across.length();
        let zero = length.constant(0.0);
        let sideways = V3::select(length.is_positive(), across * length.recip(), V3::new(zero, zero, zero));
        let [u, v] = stack.tangents;
        let (u, v) = (splat::<F>(token, u), splat::<F>(token, v));
        let origin = [u.dot(x).narrow(), v.dot(x).narrow()];
        Self {
            start: axis.dot(x),
            along,
            across: length,
            sideways,
            origin,
            size: origin[0].abs().max(origin[1].abs()),
            shift: [V3::<F>::narrow(u).dot(sideways), V3::<F>::narrow(v).dot(sideways)],
        }
    }

    /// True if the part of the line across the axis between two distances from the receiver \[m\] meets the footprint
    /// of a face, enlarged by `slack` \[m\] and rounding errors.
    #[inline(always)]
    fn meets(&self, face: &CoverInterface, near: F, far: F, slack: F) -> F::Mask {
        let [low, high] = face.footprint;
        let size = low.abs().max(high.abs()).max_element() as f32;
        let slack = slack + self.size.max(slack.constant(size)) * ROUNDING;
        self.meets_along(0, face, near, far, slack) & self.meets_along(1, face, near, far, slack)
    }

    #[inline(always)]
    fn meets_along(&self, tangent: usize, face: &CoverInterface, near: F, far: F, slack: F) -> F::Mask {
        let [low, high] = [face.footprint[0][tangent] as f32, face.footprint[1][tangent] as f32];
        let (origin, shift) = (self.origin[tangent], self.shift[tangent]);
        // The distance may be infinite.
        let moves = !shift.eq(shift.constant(0.0));
        let (a, b) = (origin + (shift * near).only(moves), origin + (shift * far).only(moves));
        a.max(b).ge(-slack + low) & a.min(b).le(slack + high)
    }
}

/// Receivers and lights with the same interfaces of a stack between them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing<'a, F: Lanes> {
    stack: &'a CoverStack,
    line: &'a Line<F>,
    from: usize,
    to: usize,
    /// Index of refraction of each layer in order from the receiver, over the lowest one, and the lowest one.
    indices: [f32; MAX_INTERFACES + 1],
    lowest: f32,
    /// Distance along the axis from the receiver to the first interface \[m\].
    start_depth: F,
    /// Distance along the axis from the last interface to the light \[m\]; zero for a light at infinity.
    end_depth: F,
    is_finite: bool,
}

/// The ray of a chain.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seed<F: Lanes> {
    /// Lanes with a ray that passes each interface within its footprint.
    is_some: F::Mask,
    ray: PlateRay<F>,
    /// Unit direction at the receiver, toward the light.
    direction: V3<F>,
    /// Solid angle at the receiver per area at the light perpendicular to the last segment of the chain [sr/m^2]; for a
    /// light at infinity solid angle per solid angle [sr/sr]. The contribution of an area of the light is proportional
    /// to it.
    concentration: F,
}

impl<'a, F: Lanes> Crossing<'a, F> {
    /// From the layer `from`, with the index of refraction `ior` at the receiver, to another layer.
    #[inline(always)]
    pub(super) fn new(
        stack: &'a CoverStack,
        line: &'a Line<F>,
        [from, to]: [usize; 2],
        ior: f32,
        is_finite: bool,
    ) -> Self {
        let zero = line.across.constant(0.0);
        let (indices, lowest) = ([1.0; MAX_INTERFACES + 1], ior);
        let mut crossing =
            Self { stack, line, from, to, indices, lowest, start_depth: zero, end_depth: zero, is_finite };
        let count = crossing.interfaces();
        crossing.indices[0] = ior;
        for k in 1..=count {
            crossing.indices[k] = stack.layers()[crossing.layer(k)].ior as f32;
            crossing.lowest = crossing.lowest.min(crossing.indices[k]);
        }
        for k in 0..=count {
            crossing.indices[k] /= crossing.lowest;
        }
        let (first, last) = (crossing.face(0).height, crossing.face(count - 1).height);
        let [start_depth, end_depth] = if to > from {
            [-line.start + first, line.start + line.along - last]
        } else {
            [line.start - first, -(line.start + line.along) + last]
        };
        crossing.start_depth = start_depth.narrow().max(zero);
        if is_finite {
            crossing.end_depth = end_depth.narrow().max(zero);
        }
        crossing
    }

    /// Offers the candidate chains of `lanes` to a choice. The candidates depend only on the receiver and the light.
    ///
    /// A chain that passes an interface outside its footprint is no candidate. If the shortest chain stays within all
    /// footprints, the longer ones are candidates as well. Each then has its own transmission at the angle of the
    /// shortest one, which is almost the same. Otherwise each longer chain is tested.
    #[inline(always)]
    pub(super) fn offer_candidates(&self, lanes: F::Mask, choice: &mut Choice<F>) {
        let [shortest, longer @ ..] = self.chains() else { return };
        let lanes = lanes & self.may_pass_footprints();
        if !lanes.any() {
            return;
        }
        let (seed, exists) = self.seed(*shortest);
        let within = lanes & seed.is_some;
        let outside = lanes & exists & !within;
        if within.any() {
            let reflected = self.reflected(&seed.ray);
            let transmitted = transmission(*shortest, &reflected);
            choice.offer(within, *shortest, transmitted * seed.concentration, seed.direction);
            let mut is_longer = within & !within;
            for &chain in longer {
                let contribution = transmission(chain, &reflected) * seed.concentration;
                is_longer = is_longer | choice.offer(within, chain, contribution, seed.direction);
            }
            if is_longer.any() {
                // The direction of the shortest chain is replaced by that of the chosen one.
                self.each_longer(
                    #[inline(always)]
                    |chain| {
                        let chosen = is_longer & choice.has_chosen(chain);
                        if chosen.any() {
                            let (seed, exists) = self.seed(chain);
                            choice.set_direction(chosen, exists, seed.direction);
                        }
                    },
                );
            }
        }
        if outside.any() {
            self.each_longer(
                #[inline(always)]
                |chain| {
                    let seed = self.seed(chain).0;
                    let within = outside & seed.is_some;
                    if within.any() {
                        let transmitted = transmission(chain, &self.reflected(&seed.ray));
                        choice.offer(within, chain, transmitted * seed.concentration, seed.direction);
                    }
                },
            );
        }
    }

    /// Calls `f` for each chain except the shortest one.
    #[inline(never)]
    fn each_longer(&self, mut f: impl FnMut(Chain)) {
        vectorize!(F, self.line.across.token(), {
            for &chain in &self.chains()[1..] {
                f(chain);
            }
        });
    }

    /// All chains between the two layers.
    #[inline(always)]
    fn chains(&self) -> &'a [Chain] {
        self.stack.chains(self.from as u8, self.to as u8)
    }

    /// The ray of a chain in the plate of parallel layers that replaces the stack, and the lanes in which it exists, also
    /// outside the footprints.
    #[inline(always)]
    fn seed(&self, chain: Chain) -> (Seed<F>, F::Mask) {
        let mut legs = [Leg { index: 1.0, depth: self.start_depth }; MAX_INTERFACES + 1];
        let legs = self.legs(chain, &mut legs);
        let (start, end) = (self.indices[0], self.indices[self.interfaces()]);
        let (ray, exists, concentration) = if self.is_finite {
            let (ray, exists) = PlateRay::to_shift(legs, self.line.across);
            (ray, exists, ray.spread(legs, start, end).recip())
        } else {
            let (ray, exists) = PlateRay::from_direction(end, self.line.across, self.line.along.narrow().abs());
            (ray, exists, ray.spread_to_infinity(start, end).recip())
        };
        let is_some = exists & self.is_within_footprints(chain, &ray);
        let axis = V3::<F>::narrow(splat::<F>(ray.tangent.token(), self.stack.axis()));
        let along = ray.root(start);
        let along = if self.to > self.from { along } else { -along };
        let direction = (axis * along + self.line.sideways * ray.tangent).normalize();
        (Seed { is_some, ray, direction, concentration }, exists)
    }

    /// Reflectance of each interface, in order from the receiver.
    #[inline(always)]
    fn reflected(&self, ray: &PlateRay<F>) -> [F; MAX_INTERFACES] {
        let mut reflected = [ray.tangent; MAX_INTERFACES];
        for (k, share) in reflected.iter_mut().enumerate().take(self.interfaces()) {
            *share = ray.reflectance(self.indices[k], self.indices[k + 1]);
        }
        reflected
    }

    /// The number of interfaces between them.
    #[inline(always)]
    fn interfaces(&self) -> usize {
        self.from.abs_diff(self.to)
    }

    /// The number in the stack of the layer `k`, counted from the receiver.
    #[inline(always)]
    fn layer(&self, k: usize) -> usize {
        if self.to > self.from { self.from + k } else { self.from - k }
    }

    /// The interface `k`, counted from the receiver.
    #[inline(always)]
    fn face(&self, k: usize) -> &'a CoverInterface {
        &self.stack.interfaces()[if self.to > self.from { self.from + k } else { self.from - k - 1 }]
    }

    /// Thickness of the inner layer `k`, counted from the receiver \[m\].
    #[inline(always)]
    fn thickness(&self, k: usize) -> f32 {
        self.stack.thickness(self.layer(k)) as f32
    }

    /// The layers in order from the receiver, with the depth that a chain crosses in each.
    #[inline(always)]
    fn legs<'b>(&self, chain: Chain, legs: &'b mut [Leg<F>; MAX_INTERFACES + 1]) -> &'b [Leg<F>] {
        let count = self.interfaces();
        let mut crossings = [0.0; MAX_INTERFACES + 1];
        for step in chain.steps() {
            crossings[step.layer_behind()] += 1.0;
        }
        for (k, leg) in legs.iter_mut().enumerate().take(count).skip(1) {
            let depth = crossings[k] * self.thickness(k);
            *leg = Leg { index: self.indices[k], depth: self.start_depth.constant(depth) };
        }
        legs[0].index = self.indices[0];
        legs[count] = Leg { index: self.indices[count], depth: self.end_depth };
        &legs[..=count]
    }

    /// True if a chain can pass each interface within its footprint.
    ///
    /// With a, S and b the heights in front of, between and behind the interfaces, T the tangent of the straight line
    /// and `w(t)` the tangent in a layer, at most t and increasing: `(a + S + b) T = a w0(t) + S' + b t`. `S'` is the
    /// sideways shift between the first and the last interface, `sum D_i w_i(t)` or, with double passes, up to five
    /// times that. If `t >= T`, the chain passes the first interface no nearer than `a w0(T)` and the last one no
    /// further than the line, at `(a + S) T`. If `t < T`, it passes the first one before the line and the last one
    /// behind it, and between them lie at most `5 sum D_i w_i(T)`.
    #[inline(always)]
    fn may_pass_footprints(&self) -> F::Mask {
        let (count, across) = (self.interfaces(), self.line.across);
        let between = (self.face(count - 1).height - self.face(0).height).abs() as f32;
        let mut uneven = 0.0f32;
        for k in 0..count {
            uneven = uneven.max(self.face(k).deviation as f32);
        }
        let zero = across.constant(0.0);
        let (tangent, most) = if self.is_finite {
            (across / (self.start_depth + self.end_depth + between), across)
        } else {
            (across / self.line.along.narrow().abs(), across.constant(f32::INFINITY))
        };
        let [mut near, mut far] = [zero, most];
        // A ray that is refracted less than by a face to air is steeper in every layer than outside.
        if self.lowest == 1.0 {
            let line = PlateRay { tangent };
            let mut inner = zero;
            for k in 1..count {
                inner += line.slope(self.indices[k]) * self.thickness(k);
            }
            let inner = inner * MAX_PASSES;
            let (line_first, line_last) = (self.start_depth * tangent, (self.start_depth + between) * tangent);
            let uneven = tangent * (2.0 * uneven);
            let first = (self.start_depth * line.slope(self.indices[0])).min(line_last - inner) - uneven;
            let last = (line_first + inner).max(line_last) + uneven;
            let is_finite = tangent.is_finite();
            near = is_finite.select(first.max(zero).min(most), near);
            far = is_finite.select(last.max(zero).min(most), far);
        }
        let mut may_pass = zero.le(zero);
        for k in 0..count {
            may_pass = may_pass & self.line.meets(self.face(k), near, far, zero.constant(uneven));
        }
        may_pass
    }

    /// True if a chain in the plate passes each interface within its footprint.
    #[inline(always)]
    fn is_within_footprints(&self, chain: Chain, ray: &PlateRay<F>) -> F::Mask {
        let mut way = self.start_depth * ray.slope(self.indices[0]);
        let mut is_within = way.le(way);
        for step in chain.steps() {
            let face = self.face(step.interface as usize);
            let slack = (ray.tangent + 1.0) * face.deviation as f32;
            is_within = is_within & self.line.meets(face, way, way, slack);
            let layer = step.layer_behind();
            if layer < self.interfaces() {
                way += ray.slope(self.indices[layer]) * self.thickness(layer);
            }
        }
        is_within
    }
}

/// Transmittance of a chain without absorption, from the reflectance of each interface.
#[inline(always)]
fn transmission<F: Lanes>(chain: Chain, reflected: &[F; MAX_INTERFACES]) -> F {
    let mut product = reflected[0].constant(1.0);
    for step in chain.steps() {
        let share = reflected[step.interface as usize];
        product *= if step.is_reflection { share } else { share.one_minus() };
    }
    product
}
