//! A receiver and a light on two sides of a stack of covers: the candidate chains between them, and the direction of
//! each in a plate of parallel layers that replaces the stack.

use super::chain::{Chain, Step};
use super::planar_layers::{Leg, PlateRay};
use super::stack::{CoverInterface, CoverStack, MAX_INTERFACES};
use dunkelfeld_geometry::{DVec2, DVec3, Vec3};

/// Sideways shift of a chain between the first and the last interface, over that of the shortest chain: two double
/// passes.
const MAX_PASSES: f64 = 5.0;
/// Relative rounding error of the coordinates of a footprint.
const ROUNDING: f64 = 1e-6;

/// A chain in the plate that replaces the stack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seed {
    /// Unit direction at the receiver, toward the light.
    pub direction: Vec3,
    /// Tangent of the ray's angle to the axis where the index of refraction is lowest.
    pub tangent: f64,
    /// Area at the light, perpendicular to the last segment of the chain, per solid angle at the receiver [m^2/sr]; for
    /// a light at infinity solid angle per solid angle [sr/sr]. The contribution of an area of the light is
    /// proportional to its inverse.
    pub spread: f64,
    /// The ray in the plate.
    ray: PlateRay,
}

/// A candidate chain between a receiver and a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// The order of events.
    pub chain: Chain,
    /// Approximate contribution: transmission without absorption over spread. It is used for the choice among chains.
    pub contribution: f64,
    /// Its ray in the plate, if it was computed.
    pub seed: Option<Seed>,
}

/// A receiver and a light with interfaces of a stack between them.
#[derive(Clone, Copy, Debug)]
pub struct Crossing<'a> {
    pub(super) stack: &'a CoverStack,
    /// The receiver.
    pub(super) x: DVec3,
    pub(super) from: u8,
    pub(super) to: u8,
    /// Index of refraction at the receiver.
    pub(super) start_ior: f64,
    /// Unit vector across the axis from the receiver to the light; zero if both lie on one line along the axis.
    pub(super) sideways: DVec3,
    /// Distance along the axis from the receiver to the first interface.
    pub(super) start_depth: f64,
    pub(super) end: End,
    /// 1 if the light lies further along the axis than the receiver, else -1.
    pub(super) sign: f64,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum End {
    /// At a distance across the axis, at a depth behind the last interface.
    Shift { shift: f64, depth: f64 },
    /// At infinity, at an angle to the axis.
    Direction { sine: f64, cosine: f64 },
}

impl<'a> Crossing<'a> {
    /// The layer of the receiver.
    pub fn from(&self) -> u8 {
        self.from
    }

    /// The layer of the light.
    pub fn to(&self) -> u8 {
        self.to
    }

    /// All chains between the two layers.
    #[inline]
    pub fn chains(&self) -> &'a [Chain] {
        self.stack.chains(self.from, self.to)
    }

    /// The ray of a chain in the plate of parallel layers that replaces the stack. `None` if there is no such ray, or
    /// if the chain does not pass these interfaces.
    pub fn seed(&self, chain: Chain) -> Option<Seed> {
        let mut buffer = [Leg { ior: 1.0, depth: 0.0 }; MAX_INTERFACES + 1];
        let legs = self.legs(chain, &mut buffer)?;
        let (start, end) = (legs.first()?.ior, legs.last()?.ior);
        let (ray, spread) = match self.end {
            End::Shift { shift, .. } => {
                let ray = PlateRay::to_shift(legs, shift)?;
                (ray, ray.spread(legs, start, end))
            }
            End::Direction { sine, cosine } => {
                let ray = PlateRay::from_direction(legs, end, sine, cosine)?;
                (ray, ray.spread_to_infinity(start, end))
            }
        };
        let direction = self.stack.axis * (self.sign * ray.cosine(start)) + self.sideways * ray.sine(start);
        Some(Seed { direction: direction.normalize().as_vec3(), tangent: ray.tangent, spread, ray })
    }

    /// Calls `visit` for the candidate chains. The result depends only on the receiver and the light.
    ///
    /// A chain that passes an interface outside its footprint is no candidate. If the shortest chain stays within all
    /// footprints, the longer ones are candidates as well. Each then has its own transmission at the angle of the
    /// shortest one, which is almost the same. Otherwise each longer chain is tested.
    #[inline]
    pub fn each_candidate(&self, mut visit: impl FnMut(Candidate)) {
        let [shortest, longer @ ..] = self.chains() else { return };
        let mut show = |chain, contribution: f64, seed| {
            if contribution > 0.0 && contribution.is_finite() {
                visit(Candidate { chain, contribution, seed });
            }
        };
        let Some(seed) = self.seed(*shortest) else { return };
        if self.is_within_footprints(*shortest, &seed) {
            let reflected = self.reflected(&seed);
            show(*shortest, transmission(*shortest, &reflected) / seed.spread, Some(seed));
            for &chain in longer {
                show(chain, transmission(chain, &reflected) / seed.spread, None);
            }
        } else {
            for &chain in longer {
                if let Some(seed) = self.seed(chain).filter(|s| self.is_within_footprints(chain, s)) {
                    show(chain, self.transmission(chain, &seed) / seed.spread, Some(seed));
                }
            }
        }
    }

    /// Transmittance of the interfaces for unpolarised light along a chain with the angles of `seed`, without
    /// absorption.
    pub fn transmission(&self, chain: Chain, seed: &Seed) -> f64 {
        transmission(chain, &self.reflected(seed))
    }

    /// Reflectance of each interface, in order from the receiver.
    fn reflected(&self, seed: &Seed) -> [f64; MAX_INTERFACES] {
        let mut reflected = [1.0; MAX_INTERFACES];
        for (k, share) in (0..self.interfaces()).zip(&mut reflected) {
            *share = seed.ray.reflectance(self.ior(k), self.ior(k + 1));
        }
        reflected
    }

    /// The number of interfaces between them.
    fn interfaces(&self) -> usize {
        usize::from(self.from.abs_diff(self.to))
    }

    /// The number in the stack of the layer `k`, counted from the receiver.
    fn layer(&self, k: usize) -> usize {
        if self.sign > 0.0 { usize::from(self.from) + k } else { usize::from(self.from) - k }
    }

    /// The index of refraction of layer `k`, counted from the receiver.
    fn ior(&self, k: usize) -> f64 {
        if k == 0 { self.start_ior } else { self.stack.layers[self.layer(k)].ior }
    }

    /// The interface `k`, counted from the receiver.
    fn interface(&self, k: usize) -> &'a CoverInterface {
        &self.stack.interfaces[if self.sign > 0.0 { self.layer(k) } else { self.layer(k) - 1 }]
    }

    /// The layers in order from the receiver, with the depth that a chain crosses in each.
    fn legs<'b>(&self, chain: Chain, buffer: &'b mut [Leg; MAX_INTERFACES + 1]) -> Option<&'b [Leg]> {
        let interfaces = self.interfaces();
        let legs = buffer.get_mut(..=interfaces)?;
        for (k, leg) in legs.iter_mut().enumerate() {
            leg.ior = self.ior(k);
        }
        // Crossings of inner layers: a forward step ends in the layer behind the interface, a backward step in the
        // layer before it.
        let mut arrived = false;
        for step in chain.steps() {
            if step.interface as usize >= interfaces || arrived {
                return None;
            }
            let beyond = step.forward != step.is_reflection;
            let layer = step.interface as usize + usize::from(beyond);
            arrived = layer == interfaces;
            if layer == 0 {
                return None;
            }
            if !arrived {
                legs[layer].depth += self.stack.thickness(self.layer(layer));
            }
        }
        if !arrived {
            return None;
        }
        legs[0].depth = self.start_depth;
        if let (End::Shift { depth, .. }, Some(last)) = (self.end, legs.last_mut()) {
            last.depth = depth;
        }
        Some(legs)
    }

    /// True if a chain can pass each interface within its footprint.
    ///
    /// With a, S and b the heights in front of, between and behind the interfaces, T the tangent of the straight line
    /// and `w(t)` the tangent in a layer, at most t and increasing: `(a + S + b) T = a w0(t) + S' + b t`. `S'` is the
    /// sideways shift between the first and the last interface, `sum D_i w_i(t)` or, with double passes, up to five
    /// times that. If `t >= T`, the chain passes the first interface no nearer than `a w0(T)` and the last one no
    /// further than the line, at `(a + S) T`. If `t < T`, it passes the first one before the line and the last one
    /// behind it, and between them lie at most `5 sum D_i w_i(T)`.
    pub(super) fn may_pass_footprints(&self) -> bool {
        let count = self.interfaces();
        let uneven = (0..count).map(|k| self.interface(k).deviation).fold(0.0, f64::max);
        let between = (self.interface(count - 1).height - self.interface(0).height).abs();
        let (tangent, most) = match self.end {
            End::Shift { shift, depth } => (shift / (self.start_depth + between + depth), shift),
            End::Direction { sine, cosine } => (sine / cosine, f64::INFINITY),
        };
        if tangent.is_nan() {
            return true;
        }
        // A ray that is refracted less than by a face to air is steeper in every layer than outside.
        let steeper = |ior: f64| tangent / (ior * ior + (ior - 1.0) * (ior + 1.0) * tangent * tangent).sqrt();
        let is_denser = (0..=count).all(|k| self.ior(k) >= 1.0);
        let [mut near, mut far] = [0.0, most];
        if is_denser && tangent.is_finite() {
            let inner: f64 = (1..count).map(|k| self.stack.thickness(self.layer(k)) * steeper(self.ior(k))).sum();
            let [line_first, line_last] = [self.start_depth, self.start_depth + between].map(|h| h * tangent);
            let uneven = 2.0 * uneven * tangent;
            near = (self.start_depth * steeper(self.start_ior)).min(line_last - MAX_PASSES * inner) - uneven;
            far = (line_first + MAX_PASSES * inner).max(line_last) + uneven;
        }
        let [near, far] = [near.clamp(0.0, most), far.clamp(0.0, most)];
        let (origin, sideways) = self.footprint_coordinates();
        let [a, b] =
            [near, far].map(|way| origin + DVec2::select(sideways.cmpeq(DVec2::ZERO), DVec2::ZERO, sideways * way));
        let (low, high) = (a.min(b), a.max(b));
        (0..count).all(|k| {
            let [from, to] = self.interface(k).footprint;
            let slack = rounding(origin, [from, to]) + uneven;
            high.cmpge(from - slack).all() && low.cmple(to + slack).all()
        })
    }

    /// True if a chain in the plate passes each interface within its footprint.
    fn is_within_footprints(&self, chain: Chain, seed: &Seed) -> bool {
        let (origin, sideways) = self.footprint_coordinates();
        let mut way = self.start_depth * seed.ray.slope(self.start_ior);
        chain.steps().all(|step| {
            let interface = self.interface(step.interface as usize);
            let [from, to] = interface.footprint;
            let slack = rounding(origin, [from, to]) + interface.deviation * (1.0 + seed.tangent);
            let place = origin + sideways * way;
            let layer = step.interface as usize + usize::from(step.forward != step.is_reflection);
            if layer < self.interfaces() {
                way += self.stack.thickness(self.layer(layer)) * seed.ray.slope(self.ior(layer));
            }
            place.cmpge(from - slack).all() && place.cmple(to + slack).all()
        })
    }

    /// The receiver and the shift to the light in the coordinates of footprints.
    fn footprint_coordinates(&self) -> (DVec2, DVec2) {
        let [u, v] = self.stack.tangents();
        (DVec2::new(u.dot(self.x), v.dot(self.x)), DVec2::new(u.dot(self.sideways), v.dot(self.sideways)))
    }
}

/// Transmittance of a chain, from the reflectance of each interface.
fn transmission(chain: Chain, reflected: &[f64; MAX_INTERFACES]) -> f64 {
    let passed = |step: Step| {
        let share = reflected.get(step.interface as usize).copied().unwrap_or(1.0);
        if step.is_reflection { share } else { 1.0 - share }
    };
    chain.steps().map(passed).product()
}

/// Rounding error of places on an interface [m].
fn rounding(origin: DVec2, [from, to]: [DVec2; 2]) -> f64 {
    ROUNDING * origin.abs().max(from.abs()).max(to.abs()).max_element()
}
