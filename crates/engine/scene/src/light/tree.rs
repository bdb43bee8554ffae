//! The choice among many lights: a binary tree of bounds. The traversal starts at the root and chooses each child in
//! proportion to its importance.
//!
//! Conty Estevez & Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting" (2018), without the
//! splitting. Each node bounds its lights by a ball, by a cone of the directions of their axes, and by an angle around
//! these axes within which they emit. Light from infinitely far away is not in the tree. It has a fixed share of the
//! choices.

use crate::light::emission_profile::EmissionProfile;
use crate::light::sample::Receivers;
use dunkelfeld_geometry::{Aabb, Vec3};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask};
use dunkelfeld_sampling::Distribution1D;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// The bounds of a light with a position.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightBounds {
    pub(crate) bounds: Aabb,
    pub(crate) cone: EmissionCone,
    /// Radiant intensity in the brightest direction [W/sr], mean over the channels.
    pub(crate) peak: f32,
}

/// The directions in which lights emit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EmissionCone {
    /// Unit axis of the cone that contains the axes of the lights.
    pub(crate) axis: Vec3,
    /// Half-angle of that cone \[rad\].
    pub(crate) spread: f32,
    /// Angle \[rad\] around its axis beyond which no light emits, at most pi/2. Within it the intensity falls with the
    /// cosine.
    pub(crate) emission: f32,
    /// True if a light emits to the other side as well.
    pub(crate) two_sided: bool,
}

impl EmissionCone {
    /// A flat emitter.
    pub(crate) fn surface(normal: Vec3, two_sided: bool) -> Self {
        Self { axis: normal, spread: 0.0, emission: FRAC_PI_2, two_sided }
    }

    /// Light with an arbitrary distribution up to an angle around an axis.
    pub(crate) fn beam(axis: Vec3, angle: f32) -> Self {
        Self { axis, spread: angle, emission: 0.0, two_sided: false }
    }

    /// A narrow cone that contains both (Conty Estevez & Kulla 2018, algorithm 1).
    fn union(self, other: Self) -> Self {
        let (a, b) = if self.spread >= other.spread { (self, other) } else { (other, self) };
        let emission = a.emission.max(b.emission);
        let two_sided = a.two_sided || b.two_sided;
        let between = angle_between(a.axis, b.axis);
        if (between + b.spread).min(PI) <= a.spread {
            return Self { emission, two_sided, ..a };
        }
        // Slightly wider than needed, so that rounding excludes no light.
        let spread = 0.5 * (a.spread + between + b.spread) * (1.0 + 1e-5);
        let across = (b.axis - a.axis * a.axis.dot(b.axis)).try_normalize();
        match across {
            Some(across) if spread < PI => {
                let (sin, cos) = (spread - a.spread).sin_cos();
                let axis = (a.axis * cos + across * sin).normalize();
                Self { axis, spread, emission, two_sided }
            }
            _ => Self { axis: a.axis, spread: PI, emission, two_sided },
        }
    }

    /// The measure M_Omega of directions, which the build minimises (Conty Estevez & Kulla 2018, equation 1).
    fn measure(&self) -> f32 {
        let (o, w) = (self.spread, (self.spread + self.emission).min(PI));
        let (sin, cos) = o.sin_cos();
        TAU * (1.0 - cos) + FRAC_PI_2 * (2.0 * w * sin - (o - 2.0 * w).cos() - 2.0 * o * sin + cos)
    }
}

/// The angle between two unit vectors, precise near 0 and pi.
fn angle_between(a: Vec3, b: Vec3) -> f32 {
    2.0 * (a - b).length().atan2((a + b).length())
}

impl LightBounds {
    fn union(self, other: &Self) -> Self {
        Self {
            bounds: self.bounds.union(other.bounds),
            cone: self.cone.union(other.cone),
            peak: self.peak + other.peak,
        }
    }
}

/// The tree, and the lights outside it. A light is identified by its index in the list from which the tree was built.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct LightTree {
    /// The root is the first node. The two children of a node are neighbours.
    nodes: Vec<Node>,
    /// For each light its place.
    places: Vec<LightPlace>,
    depth: u32,
    /// Lights infinitely far away. They are chosen by power.
    infinite: Vec<u32>,
    infinite_choice: Distribution1D,
    /// Probability that one of them is chosen.
    infinite_share: f32,
    /// The profile of all lights with a surface.
    profile: EmissionProfile,
}

/// The place of a light.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
enum LightPlace {
    /// Dark: never chosen.
    Nowhere,
    /// In the tree: the children from the root down, the first in the lowest bit. A set bit is the second child.
    Leaf { turns: u64 },
    /// Its index among the lights infinitely far away.
    Infinite(u32),
}

/// A node in the form that the traversal needs.
#[derive(Clone, Copy, Debug, serde::Serialize)]
struct Node {
    center: Vec3,
    radius2: f32,
    axis: Vec3,
    sin_spread: f32,
    cos_spread: f32,
    cos_emission: f32,
    /// Sum of the lights' peaks, as a share of all.
    peak: f32,
    two_sided: bool,
    is_leaf: bool,
    /// Index of the first child, or of the light.
    next: u32,
}

/// Number of bins along an axis for candidate splits.
const BINS: usize = 12;

/// From this depth on lights are split by half. So the depth of a tree is at most 64, the number of bits of `turns`.
const MEDIAN_SPLIT_DEPTH: u32 = 31;

/// Tolerance of the tests for darkness, and the least value of a cosine. Sines computed from cosines lose half of their
/// digits near 0 and pi. A light that reaches the receiver at a grazing angle must not have probability zero.
const SLACK: f32 = 1e-3;

/// Least share of the tree and of the lights outside it, if both emit.
const MIN_SHARE: f32 = 0.1;

impl LightTree {
    /// Builds the tree in O(n log n). `local` contains the bounds and `power` the power \[W\] of each light. A light
    /// without bounds is infinitely far away.
    pub(crate) fn new(local: &[Option<LightBounds>], power: &[f32]) -> Self {
        let mut places = vec![LightPlace::Nowhere; local.len()];
        let (mut infinite, mut infinite_powers) = (Vec::new(), Vec::new());
        let (mut local_power, mut infinite_power) = (0.0, 0.0);
        let mut order = Vec::with_capacity(local.len());
        for (i, (bounds, power)) in local.iter().zip(power).enumerate() {
            match bounds {
                Some(b) if b.peak > 0.0 => {
                    order.push((i as u32, *b));
                    local_power += f64::from(*power);
                }
                None if *power > 0.0 => {
                    places[i] = LightPlace::Infinite(infinite.len() as u32);
                    infinite.push(i as u32);
                    infinite_powers.push(f64::from(*power));
                    infinite_power += f64::from(*power);
                }
                _ => {}
            }
        }
        let infinite_share = match (order.is_empty(), infinite.is_empty()) {
            (_, true) => 0.0,
            (true, false) => 1.0,
            _ => {
                let share = (infinite_power / (infinite_power + local_power)) as f32;
                // The quotient of overflowed powers is undefined.
                if share.is_nan() { 0.5 } else { share.clamp(MIN_SHARE, 1.0 - MIN_SHARE) }
            }
        };
        // Shares of the sum, so that a division by the square of a small distance cannot overflow.
        let total: f64 = order.iter().map(|(_, b)| f64::from(b.peak)).sum();
        for (_, b) in &mut order {
            b.peak = (f64::from(b.peak) / total).max(f64::from(f32::MIN_POSITIVE)) as f32;
        }
        let mut tree = Self {
            nodes: Vec::with_capacity(2 * order.len()),
            places,
            depth: 0,
            infinite,
            infinite_choice: Distribution1D::new(infinite_powers),
            infinite_share,
            profile: EmissionProfile::Lambertian,
        };
        if !order.is_empty() {
            tree.nodes.push(Node::leaf(0, &order[0].1));
            tree.build(0, &mut order, 0, 0);
        }
        tree
    }

    /// The tree for lights that all have the same emission profile.
    pub(crate) fn with_profile(self, profile: EmissionProfile) -> Self {
        Self { profile, ..self }
    }

    /// Number of lights that have a leaf.
    pub(crate) fn leaves(&self) -> usize {
        self.nodes.len().div_ceil(2)
    }

    /// Depth of the tree: number of decisions to the deepest leaf.
    pub(crate) fn depth(&self) -> u32 {
        self.depth
    }

    /// Number of lights outside the tree.
    pub(crate) fn infinite(&self) -> usize {
        self.infinite.len()
    }

    /// Makes the existing node `at` the root of some lights. Returns their bounds.
    fn build(&mut self, at: usize, lights: &mut [(u32, LightBounds)], turns: u64, depth: u32) -> LightBounds {
        self.depth = self.depth.max(depth);
        if let [(light, bounds)] = lights {
            self.nodes[at] = Node::leaf(*light, bounds);
            self.places[*light as usize] = LightPlace::Leaf { turns };
            return *bounds;
        }
        let middle = split(lights, depth >= MEDIAN_SPLIT_DEPTH);
        let first = self.nodes.len();
        self.nodes.extend([self.nodes[at]; 2]);
        let (left, right) = lights.split_at_mut(middle);
        let left = self.build(first, left, turns, depth + 1);
        let right = self.build(first + 1, right, turns | 1 << depth, depth + 1);
        let all = left.union(&right);
        self.nodes[at] = Node { is_leaf: false, next: first as u32, ..Node::leaf(0, &all) };
        all
    }

    /// Chooses a light: its index and the probability of the choice. `None` if no light can reach the receiver.
    #[inline]
    pub(crate) fn choose(&self, receiver: &Receivers<f32>, u: f32) -> Option<(usize, f32)> {
        self.descend(receiver, u).map(|(light, probability, _)| (light, probability))
    }

    /// Chooses a light: its index, and a number that is uniform in [0, 1) again.
    pub(crate) fn choose_with_rest(&self, receiver: &Receivers<f32>, u: f32) -> Option<(usize, f32)> {
        self.descend(receiver, u).map(|(light, _, rest)| (light, rest))
    }

    /// The chosen light, its probability, and the number that is left.
    #[inline]
    fn descend(&self, receiver: &Receivers<f32>, u: f32) -> Option<(usize, f32, f32)> {
        if u < self.infinite_share {
            let choice = self.infinite_choice.sample_discrete(below_one(u / self.infinite_share));
            let light = *self.infinite.get(choice.index)?;
            return Some((light as usize, choice.probability * self.infinite_share, choice.remapped));
        }
        let mut u = below_one((u - self.infinite_share) / (1.0 - self.infinite_share));
        let mut probability = 1.0 - self.infinite_share;
        let mut node = self.nodes.first().filter(|root| root.importance(receiver, &self.profile) > 0.0)?;
        while !node.is_leaf {
            let children = self.children(node)?;
            let first = first_share(children, receiver, &self.profile)?;
            if u < first {
                u = below_one(u / first);
                probability *= first;
                node = &children[0];
            } else {
                u = below_one((u - first) / (1.0 - first));
                probability *= 1.0 - first;
                node = &children[1];
            }
        }
        Some((node.next as usize, probability, u))
    }

    /// The probability with which [`Self::choose`] chooses a light.
    #[inline]
    pub(crate) fn probability(&self, receiver: &Receivers<f32>, light: usize) -> f32 {
        match self.places.get(light) {
            None | Some(LightPlace::Nowhere) => 0.0,
            Some(LightPlace::Infinite(i)) => self.infinite_choice.pdf_discrete(*i as usize) * self.infinite_share,
            Some(&LightPlace::Leaf { mut turns }) => {
                let mut probability = 1.0 - self.infinite_share;
                let Some(mut node) = self.nodes.first().filter(|root| root.importance(receiver, &self.profile) > 0.0)
                else {
                    return 0.0;
                };
                while let (false, Some(children)) = (node.is_leaf, self.children(node)) {
                    let Some(first) = first_share(children, receiver, &self.profile) else { return 0.0 };
                    probability *= if turns & 1 == 0 { first } else { 1.0 - first };
                    node = &children[(turns & 1) as usize];
                    turns >>= 1;
                }
                probability
            }
        }
    }

    /// [`Self::probability`] of the light of each lane of a mask; zero in others.
    #[inline(always)]
    pub(crate) fn probabilities<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &[Receivers<f32>; MAX_WIDTH],
        lights: &[u32; MAX_WIDTH],
        lanes: F::Mask,
    ) -> F {
        let mut probabilities = [0.0; MAX_WIDTH];
        for lane in lanes.lanes() {
            probabilities[lane] = self.probability(&receivers[lane], lights[lane] as usize);
        }
        F::load(token, &probabilities)
    }

    #[inline]
    fn children(&self, node: &Node) -> Option<&[Node; 2]> {
        self.nodes.get(node.next as usize..)?.first_chunk()
    }
}

/// The probability of the first of two children; `None` if neither can contribute.
#[inline]
fn first_share(children: &[Node; 2], receiver: &Receivers<f32>, profile: &EmissionProfile) -> Option<f32> {
    let [a, b] = [children[0].importance(receiver, profile), children[1].importance(receiver, profile)];
    // The probability of a child that can contribute must not round to zero.
    let least = 0.5 * f32::EPSILON;
    match (a > 0.0, b > 0.0) {
        (true, true) => Some((a / (a + b)).clamp(least, 1.0 - least)),
        (true, false) => Some(1.0),
        (false, true) => Some(0.0),
        (false, false) => None,
    }
}

impl Node {
    fn leaf(light: u32, lights: &LightBounds) -> Self {
        let LightBounds { bounds, cone, peak } = lights;
        let radius = 0.5 * bounds.size().length() * (1.0 + 1e-6);
        let (sin_spread, cos_spread) = cone.spread.min(PI).sin_cos();
        Self {
            center: bounds.center(),
            radius2: radius * radius,
            axis: cone.axis,
            sin_spread,
            cos_spread,
            cos_emission: cone.emission.cos(),
            peak: *peak,
            two_sided: cone.two_sided,
            is_leaf: true,
            next: light,
        }
    }

    /// The importance of the node: an estimate, up to a constant, of the irradiance at the receiver. It is zero only if
    /// the irradiance is (Conty Estevez & Kulla 2018, equation 3; the distance is that of the centre).
    #[inline]
    fn importance(&self, receiver: &Receivers<f32>, profile: &EmissionProfile) -> f32 {
        let (to_light, normal) = (self.center - Vec3::from(receiver.point), Vec3::from(receiver.normal));
        let d2 = to_light.length_squared();
        if d2 <= self.radius2 {
            // Inside the ball lights may lie in any direction.
            return self.peak / self.radius2.max(NEAREST);
        }
        let inverse = 1.0 / d2.sqrt();
        // Half-angle of the ball at the receiver.
        let sin2_ball = self.radius2 / d2;
        let ball = Angle { sin: sin2_ball.sqrt(), cos: (1.0 - sin2_ball).max(0.0).sqrt() };

        // The least angle between a light and the normal. In a medium there is no normal.
        let cos_facing = to_light.dot(normal) * inverse;
        let cos_facing = if normal == Vec3::ZERO {
            1.0
        } else {
            Angle::from_cos(if receiver.both_sides { cos_facing.abs() } else { cos_facing }).less(ball).cos
        };
        if cos_facing < -SLACK {
            return 0.0;
        }
        // The least angle between the receiver and the axis of a light.
        let cos_axis = -to_light.dot(self.axis) * inverse;
        let cos_emitted = Angle::from_cos(if self.two_sided { cos_axis.abs() } else { cos_axis })
            .less(Angle { sin: self.sin_spread, cos: self.cos_spread })
            .less(ball)
            .cos;
        if cos_emitted < self.cos_emission - SLACK {
            return 0.0;
        }
        let emitted = (cos_emitted * profile.eval(cos_emitted)).max(SLACK);
        self.peak * cos_facing.max(SLACK) * emitted / d2.max(NEAREST)
    }
}

/// The least square of a distance [m^2]. With shares up to one, the quotient does not overflow.
const NEAREST: f32 = 1e-30;

/// An angle in [0, pi], stored as sine and cosine.
#[derive(Clone, Copy)]
struct Angle {
    sin: f32,
    cos: f32,
}

impl Angle {
    #[inline]
    fn from_cos(cos: f32) -> Self {
        Self { sin: (1.0 - cos * cos).max(0.0).sqrt(), cos }
    }

    /// The difference of the angle and another one, at least zero.
    #[inline]
    fn less(self, other: Self) -> Self {
        if self.cos >= other.cos {
            return Self { sin: 0.0, cos: 1.0 };
        }
        Self {
            sin: (self.sin * other.cos - self.cos * other.sin).max(0.0),
            cos: self.cos * other.cos + self.sin * other.sin,
        }
    }
}

#[inline]
pub(crate) fn below_one(u: f32) -> f32 {
    u.clamp(0.0, 1.0 - f32::EPSILON / 2.0)
}

/// Sorts lights into two groups and returns the size of the first. The split is the plane between bins with the least
/// cost: area of the boxes, measure of the cones, peak (the surface area orientation heuristic, Conty Estevez & Kulla
/// 2018). If there is none, the lights are split by half.
fn split(lights: &mut [(u32, LightBounds)], by_half: bool) -> usize {
    let centers = lights.iter().fold(Aabb::EMPTY, |b, (_, l)| b.including(l.bounds.center()));
    let size = centers.size();
    let longest = size.max_element();
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| !by_half && size[axis] > 0.0) {
        let mut bins: [Option<LightBounds>; BINS] = [None; BINS];
        for (_, l) in lights.iter() {
            let bin = &mut bins[bin_of(l, axis, &centers)];
            *bin = Some(bin.map_or(*l, |b| b.union(l)));
        }
        // Costs of the lights before each plane, then of those behind it.
        let mut before = [None; BINS];
        let mut so_far: Option<LightBounds> = None;
        for (cost, bin) in before.iter_mut().zip(&bins) {
            *cost = so_far.map(|b| cost_of(&b));
            so_far = join(so_far, bin);
        }
        let mut behind: Option<LightBounds> = None;
        for plane in (1..BINS).rev() {
            behind = join(behind, &bins[plane]);
            let (Some(first), Some(second)) = (before[plane], behind) else { continue };
            // A thin group is split across its length (the regularisation of the heuristic).
            let cost = longest / size[axis] * (first + cost_of(&second));
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, plane));
            }
        }
    }
    match best {
        Some((cost, axis, plane)) if cost > 0.0 && cost.is_finite() => {
            // Stable, so that the tree is the same for the same list.
            lights.sort_by_key(|(_, l)| bin_of(l, axis, &centers) >= plane);
            lights.partition_point(|(_, l)| bin_of(l, axis, &centers) < plane)
        }
        _ => {
            let axis = (0..3).max_by(|a, b| size[*a].total_cmp(&size[*b])).unwrap_or(0);
            let key = |l: &LightBounds| l.bounds.center()[axis];
            let middle = lights.len() / 2;
            lights.select_nth_unstable_by(middle, |(i, a), (j, b)| key(a).total_cmp(&key(b)).then(i.cmp(j)));
            middle
        }
    }
}

fn join(a: Option<LightBounds>, b: &Option<LightBounds>) -> Option<LightBounds> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.union(b)),
        (a, b) => a.or(*b),
    }
}

fn bin_of(l: &LightBounds, axis: usize, centers: &Aabb) -> usize {
    let place = (l.bounds.center()[axis] - centers.min[axis]) / (centers.max[axis] - centers.min[axis]);
    ((place * BINS as f32) as usize).min(BINS - 1)
}

fn cost_of(l: &LightBounds) -> f32 {
    l.peak * l.cone.measure() * l.bounds.half_area()
}

#[cfg(test)]
#[path = "tree_tests.rs"]
mod tests;
