//! A receiver and a light with a stack of covers between them: which chains may connect them, and how each runs in the
//! plate of parallel layers that stands for the stack.

use super::chain::{Chain, Step};
use super::planar_layers::{Leg, PlateRay};
use super::stack::{CoverInterface, CoverStack, MAX_INTERFACES};
use dunkelfeld_geometry::{DVec2, DVec3, Vec3};

/// Sideways ways of a chain between the first and the last interface, over those of the shortest one: two double passes.
const MAX_PASSES: f64 = 5.0;
/// A footprint is known up to this share of what its coordinates are.
const ROUNDING: f64 = 1e-6;

/// What a chain looks like in the plate that stands for the stack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seed {
    /// Unit direction at the receiver, toward the light.
    pub direction: Vec3,
    /// Tangent of the ray's angle to the axis where the index of refraction is lowest.
    pub tangent: f64,
    /// Area at the light, at right angles to the chain's last leg, per solid angle at the receiver [m^2/sr]; for a light at
    /// infinity solid angle per solid angle [sr/sr]. Its inverse is what a light's area counts for.
    pub spread: f64,
    /// The ray in the plate.
    ray: PlateRay,
}

/// A chain that may connect a receiver and a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// The order of events.
    pub chain: Chain,
    /// About what it brings: its transmission, without absorption, per spread. For choosing among chains.
    pub brings: f64,
    /// Its ray in the plate, where that had to be worked out.
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
    /// Unit vector across the axis from the receiver to the light; zero if they lie on one axis.
    pub(super) sideways: DVec3,
    /// Way along the axis from the receiver to the first interface.
    pub(super) start_depth: f64,
    pub(super) end: End,
    /// 1 if light lies further along the axis, -1 if the receiver does.
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

    /// The chains that may connect them.
    #[inline]
    pub fn chains(&self) -> &'a [Chain] {
        self.stack.chains(self.from, self.to)
    }

    /// A chain in the plate of parallel layers that stands for the stack. `None` if there is no such ray, or if the chain
    /// does not lead through these interfaces.
    pub fn seed(&self, chain: Chain) -> Option<Seed> {
        let mut room = [Leg { ior: 1.0, depth: 0.0 }; MAX_INTERFACES + 1];
        let legs = self.legs(chain, &mut room)?;
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

    /// Shows the chains that may connect them. A function of the receiver and the light alone.
    ///
    /// A chain that would pass the footprint of an interface on its way is none of them. If the shortest one stays within them
    /// all, the others are shown as well, each with its own transmission at the same angle, which hardly differs; else each
    /// is looked at.
    #[inline]
    pub fn each_candidate(&self, mut visit: impl FnMut(Candidate)) {
        let [shortest, longer @ ..] = self.chains() else { return };
        let mut show = |chain, brings: f64, seed| {
            if brings > 0.0 && brings.is_finite() {
                visit(Candidate { chain, brings, seed });
            }
        };
        let Some(seed) = self.seed(*shortest) else { return };
        if self.stays_within(*shortest, &seed) {
            let reflected = self.reflected(&seed);
            show(*shortest, transmission(*shortest, &reflected) / seed.spread, Some(seed));
            for &chain in longer {
                show(chain, transmission(chain, &reflected) / seed.spread, None);
            }
        } else {
            for &chain in longer {
                if let Some(seed) = self.seed(chain).filter(|s| self.stays_within(chain, s)) {
                    show(chain, self.transmission(chain, &seed) / seed.spread, Some(seed));
                }
            }
        }
    }

    /// Share of unpolarised light that the interfaces let through along a chain that runs like `seed`, without absorption.
    pub fn transmission(&self, chain: Chain, seed: &Seed) -> f64 {
        transmission(chain, &self.reflected(seed))
    }

    /// What each interface reflects, from the receiver on.
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

    /// The layers from the receiver on, with the depth that a chain has in each.
    fn legs<'b>(&self, chain: Chain, room: &'b mut [Leg; MAX_INTERFACES + 1]) -> Option<&'b [Leg]> {
        let interfaces = self.interfaces();
        let legs = room.get_mut(..=interfaces)?;
        for (k, leg) in legs.iter_mut().enumerate() {
            leg.ior = self.ior(k);
        }
        // Crossings of inner layers: a step forward ends in the layer behind the interface, one back in the one before it.
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

    /// Can a chain pass each interface within its footprint?
    ///
    /// With a, S and b the heights in front of, between and behind the interfaces, T the tangent of the straight line and
    /// `w(t)` the tangent in a layer, at most t and increasing: `(a + S + b) T = a w0(t) + S' + b t`, where `S'` is the sideways way
    /// between the first and the last interface, `sum D_i w_i(t)` or, with double passes, up to five times that. If `t >= T`, the
    /// chain passes the first interface no nearer than `a w0(T)` and the last one no further than the line, at `(a + S) T`.
    /// If `t < T`, it passes the first one before the line and the last one behind it, and between them lie at most `5 sum D_i
    /// w_i(T)`.
    pub(super) fn meets_footprints(&self) -> bool {
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
        // Bent less than by a face to air, a ray runs steeper in every layer than outside.
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
        let (origin, sideways) = self.footing();
        let [a, b] =
            [near, far].map(|way| origin + DVec2::select(sideways.cmpeq(DVec2::ZERO), DVec2::ZERO, sideways * way));
        let (low, high) = (a.min(b), a.max(b));
        (0..count).all(|k| {
            let [from, to] = self.interface(k).footprint;
            let slack = rounding(origin, [from, to]) + uneven;
            high.cmpge(from - slack).all() && low.cmple(to + slack).all()
        })
    }

    /// Does a chain in the plate pass each interface on its way within its footprint?
    fn stays_within(&self, chain: Chain, seed: &Seed) -> bool {
        let (origin, sideways) = self.footing();
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

    /// The receiver and the way to the light in the coordinates of footprints.
    fn footing(&self) -> (DVec2, DVec2) {
        let [u, v] = self.stack.tangents();
        (DVec2::new(u.dot(self.x), v.dot(self.x)), DVec2::new(u.dot(self.sideways), v.dot(self.sideways)))
    }
}

/// What the interfaces let through of light along a chain, by what each reflects.
fn transmission(chain: Chain, reflected: &[f64; MAX_INTERFACES]) -> f64 {
    let passed = |step: Step| {
        let share = reflected.get(step.interface as usize).copied().unwrap_or(1.0);
        if step.is_reflection { share } else { 1.0 - share }
    };
    chain.steps().map(passed).product()
}

/// How far places on an interface are known [m].
fn rounding(origin: DVec2, [from, to]: [DVec2; 2]) -> f64 {
    ROUNDING * origin.abs().max(from.abs()).max(to.abs()).max_element()
}
