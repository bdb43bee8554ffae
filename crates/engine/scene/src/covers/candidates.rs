//! The choice among the candidate chains from receivers to lights, one for each lane.

use super::chain::Chain;
use super::layer_crossing::{Crossing, Line};
use super::stack::CoverStack;
use crate::scene::Scene;
use dunkelfeld_lanes::{Double, Lanes, MAX_WIDTH, Mask, Real, V3, vectorize};

/// Ends of connections on lights, one for each lane.
#[derive(Clone, Copy, Debug)]
pub struct Targets<F: Lanes> {
    /// Points of lights, in render space \[m\]; unused where the light is at infinity.
    pub point: V3<F>,
    /// Unit directions toward the lights. For lights with a point they are not used here.
    pub direction: V3<F>,
    /// Lanes whose light has a point.
    pub is_finite: F::Mask,
}

/// A candidate chain of each lane.
#[derive(Clone, Copy, Debug)]
pub struct CandidateChains<F: Lanes> {
    /// Lanes with a candidate. The other fields are only defined in these.
    pub is_some: F::Mask,
    /// Index of the stack of each lane, and the order of events.
    pub chain: [(u16, Chain); MAX_WIDTH],
    /// First unit direction in the plate that replaces the stack.
    pub direction: V3<F>,
    /// The probability with which the candidate is chosen.
    pub probability: F,
}

/// The candidates that [`Scene::choose_chains`] takes.
#[derive(Clone, Copy, Debug)]
pub enum Wanted<F> {
    /// One of them, in proportion to its estimated contribution, by numbers in [0, 1).
    Random(F),
    /// That of a given stack and chain in each lane.
    Given([(u16, Chain); MAX_WIDTH]),
}

impl Scene {
    /// Takes one of the candidate chains of all stacks in each lane.
    ///
    /// `from` are the receivers, in render space \[m\]. `inside` is the material of the solid around the receiver of each
    /// lane, `None` in air. The candidates of a lane depend only on the receiver and the light.
    #[inline(always)]
    pub fn choose_chains<F: Lanes>(
        &self,
        wanted: Wanted<F>,
        lanes: F::Mask,
        from: V3<F>,
        inside: &[Option<u32>; MAX_WIDTH],
        targets: &Targets<F>,
    ) -> CandidateChains<F> {
        let token = from.x.token();
        let zero = F::splat(token, 0.0);
        let none = V3::new(zero, zero, zero);
        let mut choice = Choice {
            wanted,
            total: zero,
            is_some: F::mask(token, 0),
            offering: 0,
            stack: zero,
            chain: zero,
            contribution: zero,
            direction: none,
        };
        let mut in_solid = 0;
        for (lane, inside) in inside.iter().enumerate().take(F::WIDTH) {
            in_solid |= u32::from(inside.is_some()) << lane;
        }
        let in_solid = lanes & F::mask(token, in_solid);
        let origin = V3::select(targets.is_finite, from, none);
        let end = V3::select(targets.is_finite, targets.point, targets.direction);
        let (x, way) = (from.widen(), end.widen() - origin.widen());
        for (number, stack) in self.covers.stacks.iter().enumerate() {
            choice.offering = number as u16;
            let line = Line::new(token, stack, x, way);
            let last = F::splat(token, stack.interfaces().len() as f32);
            let is_upward = F::Double::narrow_mask(Real::is_positive(line.along));
            let air = stack.air_layer::<F>(token, line.start + line.along);
            let to = targets.is_finite.select(air, last.only(is_upward));
            let (mut from, mut ior) = (stack.air_layer::<F>(token, line.start), F::splat(token, 1.0));
            if in_solid.any() {
                (from, ior) = in_solids(token, in_solid, stack, inside, line.start, from, to);
            }
            let mut rest = lanes & !from.eq(to);
            if !rest.any() {
                continue;
            }
            let (froms, tos, iors) = (from.to_array(), to.to_array(), ior.to_array());
            while rest.any() {
                let first = rest.bits().trailing_zeros() as usize;
                let is_finite = targets.is_finite.bits() >> first & 1 == 1;
                let alike = if is_finite { targets.is_finite } else { !targets.is_finite };
                let [a, b, n] = [froms[first], tos[first], iors[first]];
                let same = from.eq(zero + a) & to.eq(zero + b) & ior.eq(zero + n) & alike;
                let crossing = Crossing::new(stack, &line, [a as usize, b as usize], n, is_finite);
                crossing.offer_candidates(rest & same, &mut choice);
                rest = rest & !same;
            }
        }
        let (stacks, chains) = (choice.stack.to_array(), choice.chain.to_array());
        let mut chain = [(0, Chain::EMPTY); MAX_WIDTH];
        for lane in 0..F::WIDTH {
            chain[lane] = (stacks[lane] as u16, Chain(chains[lane] as u16));
        }
        CandidateChains {
            is_some: choice.is_some,
            chain,
            direction: choice.direction,
            probability: choice.contribution / choice.total,
        }
    }
}

/// The choice among the candidates so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Choice<F: Lanes> {
    /// Random numbers are those for the next choice.
    wanted: Wanted<F>,
    /// Sum of the contributions.
    total: F,
    is_some: F::Mask,
    /// The number of the stack that offers candidates.
    offering: u16,
    /// Number of the stack, bits of the chain, contribution and first direction of the candidate.
    stack: F,
    chain: F,
    contribution: F,
    direction: V3<F>,
}

impl<F: Lanes> Choice<F> {
    /// Offers a chain to `lanes`. Returns the lanes that have chosen it.
    ///
    /// A contribution is approximate: transmission without absorption over spread. A chain without any is no candidate.
    #[inline(always)]
    pub(super) fn offer(&mut self, lanes: F::Mask, chain: Chain, contribution: F, direction: V3<F>) -> F::Mask {
        let lanes = lanes & contribution.is_positive() & contribution.is_finite();
        let token = contribution.token();
        let number = F::splat(token, f32::from(chain.0));
        let total = self.total + contribution;
        let chosen = match &mut self.wanted {
            Wanted::Random(u) => {
                let scaled = *u * total;
                let is_less = scaled.lt(contribution);
                // The rescaled random number is uniform again and is used for the next choice.
                let rest = is_less.select(scaled, scaled - contribution) / is_less.select(contribution, self.total);
                *u = lanes.select(rest, *u);
                lanes & is_less
            }
            Wanted::Given(given) => {
                let mut same = 0;
                for (lane, given) in given.iter().enumerate().take(F::WIDTH) {
                    same |= u32::from(*given == (self.offering, chain)) << lane;
                }
                lanes & F::mask(token, same)
            }
        };
        self.total = lanes.select(total, self.total);
        self.stack = chosen.select(F::splat(token, f32::from(self.offering)), self.stack);
        self.chain = chosen.select(number, self.chain);
        self.contribution = chosen.select(contribution, self.contribution);
        self.set_direction(chosen, chosen, direction);
        chosen
    }

    /// The lanes of which a chain is the candidate.
    #[inline(always)]
    pub(super) fn has_chosen(&self, chain: Chain) -> F::Mask {
        self.chain.eq(self.chain.constant(f32::from(chain.0)))
    }

    /// Sets the first direction of the candidate of `lanes`. Those without `exists` have none.
    #[inline(always)]
    pub(super) fn set_direction(&mut self, lanes: F::Mask, exists: F::Mask, direction: V3<F>) {
        self.direction = V3::select(lanes, direction, self.direction);
        self.is_some = (self.is_some & !lanes) | (lanes & exists);
    }
}

/// The layers of receivers, and the indices of refraction there, some of them in solids. Without an interface to the light
/// the layer is that of the light.
#[inline(never)]
fn in_solids<F: Lanes>(
    token: F::Token,
    in_solid: F::Mask,
    stack: &CoverStack,
    inside: &[Option<u32>; MAX_WIDTH],
    height: F::Double,
    from: F,
    to: F,
) -> (F, F) {
    vectorize!(F, token, {
        let (mut from, to, mut ior) = (from.to_array(), to.to_array(), [1.0; MAX_WIDTH]);
        let mut heights = [0.0; MAX_WIDTH];
        height.store(&mut heights);
        for lane in in_solid.lanes() {
            if let Some(material) = inside[lane] {
                let layer = stack.layer_in_solid(heights[lane], material, to[lane] as usize);
                (from[lane], ior[lane]) = layer.map_or((to[lane], 1.0), |(layer, ior)| (layer as f32, ior as f32));
            }
        }
        (F::load(token, &from), F::load(token, &ior))
    })
}
