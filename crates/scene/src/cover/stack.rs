//! Covers that lie on one another: interfaces along an axis, and the chains of refractions that lead through them.

use super::chain::Chain;
use super::plate::{Leg, PlateRay};
use dunkelfeld_geometry::{DVec2, DVec3, Vec3};

/// A stack has at most this many interfaces; more sheets than that are left to chance.
pub const MOST_INTERFACES: usize = 16;
/// At most so many chains lead from one layer to another: the ones that carry most light.
pub const MOST_CHAINS: usize = 16;
/// A chain that carries less than this share of the strongest one of its order, seen at right angles, is left out.
const WEAKEST_CHAIN: f64 = 1e-3;

/// Where light comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// A point of a light, in render space \[m\].
    Point(Vec3),
    /// The unit direction towards a light at infinity, as it is behind the cover.
    Direction(Vec3),
}

/// A surface across the axis of a stack, where the index of refraction changes.
#[derive(Clone, Debug, PartialEq)]
pub struct CoverInterface {
    /// Mean position along the axis \[m\], area-weighted.
    pub height: f64,
    /// The largest distance of the surface from there, along the axis \[m\].
    pub deviation: f64,
    /// Lowest and highest coordinates along the two tangents of the stack \[m\].
    pub footprint: [DVec2; 2],
}

/// What lies between two interfaces, below the lowest one or above the highest one.
#[derive(Clone, Debug, PartialEq)]
pub struct CoverLayer {
    /// Index of refraction; 1 for air.
    pub ior: f64,
    /// The materials that fill it; none for air.
    pub materials: Vec<u32>,
}

/// A smooth solid that scatters light and lies on the first or the last interface of a stack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Touching {
    pub(crate) material: u32,
    pub(crate) ior: f64,
    /// Does it lie on the last interface?
    pub(crate) is_above: bool,
}

/// Clear sheets with a common axis: one cover, or several that lie on one another, glued or with air between them.
#[derive(Clone, Debug, PartialEq)]
pub struct CoverStack {
    axis: DVec3,
    tangents: [DVec3; 2],
    interfaces: Vec<CoverInterface>,
    layers: Vec<CoverLayer>,
    is_flat: bool,
    /// Solids on the outside whose inside scatters light.
    touching: Vec<Touching>,
    /// For each layer without material: its number, and where along the axis the next one takes over.
    rooms: Vec<(u8, f64)>,
    /// Chains from layer to layer, `layers * from + to`.
    chains: Vec<Vec<Chain>>,
}

impl CoverStack {
    /// `interfaces` ascend along `axis`; `layers`, one more, lie between them, the first and the last outside.
    pub(crate) fn new(
        axis: DVec3,
        tangents: [DVec3; 2],
        interfaces: Vec<CoverInterface>,
        layers: Vec<CoverLayer>,
        is_flat: bool,
    ) -> Self {
        let rooms = rooms(&interfaces, &layers);
        let count = layers.len();
        let chains = (0..count * count).map(|k| chains_between(&layers, k / count, k % count)).collect();
        Self { axis, tangents, interfaces, layers, is_flat, touching: Vec::new(), rooms, chains }
    }

    /// Two unit vectors across the axis: those of the footprints.
    pub(crate) fn tangents(&self) -> [DVec3; 2] {
        self.tangents
    }

    /// Notes that a solid lies on the stack from outside.
    pub(crate) fn touch(&mut self, solid: Touching) {
        self.touching.push(solid);
    }

    /// Unit vector along which the layers follow each other, in render space.
    pub fn axis(&self) -> DVec3 {
        self.axis
    }

    /// The interfaces in ascending order along the axis.
    pub fn interfaces(&self) -> &[CoverInterface] {
        &self.interfaces
    }

    /// The layers in the same order: layer i lies below interface i.
    pub fn layers(&self) -> &[CoverLayer] {
        &self.layers
    }

    /// Thickness of a layer between its mean planes \[m\]; infinite for the first and the last, and beyond them.
    pub fn thickness(&self, layer: usize) -> f64 {
        match (layer.checked_sub(1).and_then(|below| self.interfaces.get(below)), self.interfaces.get(layer)) {
            (Some(below), Some(above)) => (above.height - below.height).max(0.0),
            _ => f64::INFINITY,
        }
    }

    /// Are all faces planes, to 1e-5 of their extent, with normals of their own?
    pub fn is_flat(&self) -> bool {
        self.is_flat
    }

    /// The chains that lead from layer `from` to layer `to`, in the order of their double passes, at most
    /// [`MOST_CHAINS`]. None from a layer to itself, or through more than [`Chain::MOST_EVENTS`] interfaces.
    pub fn chains(&self, from: u8, to: u8) -> &[Chain] {
        let count = self.layers.len();
        let is_known = usize::from(from) < count && usize::from(to) < count;
        if is_known { &self.chains[count * usize::from(from) + usize::from(to)] } else { &[] }
    }

    /// The layer that a point in render space lies in; `inside` is the material of the solid around it, `None` outside of
    /// solids. `None` if that solid is no part of the stack, nor one in contact with it that light scatters in.
    ///
    /// A point in air belongs to the air layer that is nearest to it: faces that are not planes do not part it from where it
    /// is.
    pub fn layer_at(&self, point: Vec3, inside: Option<u32>) -> Option<u8> {
        let height = self.axis.dot(point.as_dvec3());
        let Some(material) = inside else {
            return self.rooms.iter().find(|(_, end)| height < *end).or(self.rooms.last()).map(|(layer, _)| *layer);
        };
        let beyond = |layer: usize| {
            let low = layer.checked_sub(1).map_or(f64::NEG_INFINITY, |i| self.interfaces[i].height);
            let high = self.interfaces.get(layer).map_or(f64::INFINITY, |i| i.height);
            (low - height).max(height - high).max(0.0)
        };
        let filled = (0..self.layers.len()).filter(|&l| self.layers[l].materials.contains(&material));
        let own = filled.min_by(|&a, &b| beyond(a).total_cmp(&beyond(b))).map(|layer| layer as u8);
        own.or_else(|| self.touching_at(height, material).map(|t| self.outer(t.is_above)))
    }

    /// The solid of that material that touches the stack, on the side nearer to a height.
    fn touching_at(&self, height: f64, material: u32) -> Option<&Touching> {
        let beyond = |t: &&Touching| {
            let face = if t.is_above { self.interfaces.last() } else { self.interfaces.first() };
            face.map_or(f64::INFINITY, |face| (face.height - height).abs())
        };
        let solids = self.touching.iter().filter(|t| t.material == material);
        solids.min_by(|a, b| beyond(a).total_cmp(&beyond(b)))
    }

    /// The last layer, or the first.
    fn outer(&self, is_above: bool) -> u8 {
        if is_above { self.layers.len() as u8 - 1 } else { 0 }
    }

    /// The ways of light from `target` to the point `x` in render space through the stack; `inside` is the material of the
    /// solid that the connection starts in, as for [`Self::layer_at`].
    ///
    /// `None` if there is no interface between them, or if light would have to pass it beside its footprint. For faces that
    /// are planes the latter is certain: whoever asks on the way back as well may rely on it.
    pub fn crossing(&self, x: Vec3, inside: Option<u32>, target: Target) -> Option<Crossing<'_>> {
        let mut from = self.layer_at(x, inside)?;
        let (to, toward) = match target {
            Target::Point(y) => (self.layer_at(y, None)?, y.as_dvec3() - x.as_dvec3()),
            Target::Direction(d) => {
                let d = d.as_dvec3();
                (self.outer(self.axis.dot(d) > 0.0), d)
            }
        };
        if from == to {
            return None;
        }
        let along = self.axis.dot(toward);
        let across = toward - self.axis * along;
        let length = across.length();
        let sideways = if length > 0.0 { across / length } else { DVec3::ZERO };
        let up = to > from;
        let start = self.axis.dot(x.as_dvec3());
        // Whatever touches the stack stands for the air there; without a face if it has the index of the outermost sheet.
        let mut start_ior = self.layers[usize::from(from)].ior;
        if let Some(solid) = inside.and_then(|m| self.touching_at(start, m)).filter(|t| self.outer(t.is_above) == from)
        {
            start_ior = solid.ior;
            let next = if up { from + 1 } else { from - 1 };
            if self.layers[usize::from(next)].ior == start_ior {
                from = next;
            }
            if from == to {
                return None;
            }
        }
        let (first, last) = if up { (from, to - 1) } else { (from - 1, to) };
        let [first, last] = [first, last].map(|i| self.interfaces[usize::from(i)].height);
        let sign = if up { 1.0 } else { -1.0 };
        let start_depth = (sign * (first - start)).max(0.0);
        let end = match target {
            Target::Point(_) => {
                let depth = (sign * (start + along - last)).max(0.0);
                End::Shift { shift: length, depth }
            }
            Target::Direction(_) => End::Direction { sine: length, cosine: along.abs() },
        };
        let crossing = Crossing { stack: self, from, to, start_ior, sideways, start_depth, end, sign };
        crossing.meets_footprints(x).then_some(crossing)
    }
}

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
    /// Share of unpolarised light that the interfaces let through: an estimate for choosing among chains. Without
    /// absorption.
    pub transmission: f64,
    /// The ray in the plate.
    ray: PlateRay,
}

/// A receiver and a light with interfaces of a stack between them.
#[derive(Clone, Copy, Debug)]
pub struct Crossing<'a> {
    stack: &'a CoverStack,
    from: u8,
    to: u8,
    /// Index of refraction at the receiver.
    start_ior: f64,
    /// Unit vector across the axis from the receiver to the light; zero if they lie on one axis.
    sideways: DVec3,
    /// Way along the axis from the receiver to the first interface.
    start_depth: f64,
    end: End,
    /// 1 if light lies further along the axis, -1 if the receiver does.
    sign: f64,
}

#[derive(Clone, Copy, Debug)]
enum End {
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
        let mut room = [Leg { ior: 1.0, depth: 0.0 }; MOST_INTERFACES + 1];
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
        let mut transmission = 1.0;
        for step in chain.steps() {
            let (near, far) = (legs[step.interface as usize].ior, legs[step.interface as usize + 1].ior);
            let (from, to) = if step.forward { (near, far) } else { (far, near) };
            let reflected = ray.reflectance(from, to);
            transmission *= if step.is_reflection { reflected } else { 1.0 - reflected };
        }
        let direction = self.stack.axis * (self.sign * ray.cosine(start)) + self.sideways * ray.sine(start);
        Some(Seed { direction: direction.normalize().as_vec3(), tangent: ray.tangent, spread, transmission, ray })
    }

    /// About what a chain brings that runs like `seed`, the seed of another chain: its own transmission at the same angle, per
    /// spread. Between chains of one crossing the angle hardly differs.
    #[inline]
    pub fn brings(&self, chain: Chain, seed: &Seed) -> f64 {
        let interfaces = u32::from(self.from.abs_diff(self.to));
        let ior = |k: u32| {
            let layer = if self.sign > 0.0 { u32::from(self.from) + k } else { u32::from(self.from) - k };
            if k == 0 { self.start_ior } else { self.stack.layers[layer as usize].ior }
        };
        let mut reflected = [0.0; MOST_INTERFACES];
        for (k, share) in (0..interfaces).zip(&mut reflected) {
            *share = seed.ray.reflectance(ior(k), ior(k + 1));
        }
        let passed = |step: super::chain::Step| {
            let share = reflected.get(step.interface as usize).copied().unwrap_or(1.0);
            if step.is_reflection { share } else { 1.0 - share }
        };
        chain.steps().map(passed).product::<f64>() / seed.spread
    }

    /// The layers from the receiver on, with the depth that a chain has in each.
    fn legs<'b>(&self, chain: Chain, room: &'b mut [Leg; MOST_INTERFACES + 1]) -> Option<&'b [Leg]> {
        let interfaces = u32::from(self.from.abs_diff(self.to));
        let legs = room.get_mut(..=interfaces as usize)?;
        for (k, leg) in legs.iter_mut().enumerate() {
            let layer = if self.sign > 0.0 { usize::from(self.from) + k } else { usize::from(self.from) - k };
            leg.ior = self.stack.layers[layer].ior;
        }
        // Crossings of inner layers: a step forward ends in the layer behind the interface, one back in the one before it.
        let mut arrived = false;
        for step in chain.steps() {
            if step.interface >= interfaces || arrived {
                return None;
            }
            let beyond = step.forward != step.is_reflection;
            let layer = step.interface as usize + usize::from(beyond);
            arrived = layer == interfaces as usize;
            if layer == 0 {
                return None;
            }
            if !arrived {
                let k = if self.sign > 0.0 { usize::from(self.from) + layer } else { usize::from(self.from) - layer };
                legs[layer].depth += self.stack.thickness(k);
            }
        }
        if !arrived {
            return None;
        }
        legs[0] = Leg { ior: self.start_ior, depth: self.start_depth };
        if let (End::Shift { depth, .. }, Some(last)) = (self.end, legs.last_mut()) {
            last.depth = depth;
        }
        Some(legs)
    }

    /// Can a chain pass each interface within its footprint?
    ///
    /// With A the heights in front of the first and behind the last interface together, S the height between these two and T
    /// the tangent of the straight line, `(A + S) T = A t + S' / q` holds for a chain whose way between them is `S' <= 5 S`, a
    /// double pass counted twice. So its crossings lie at most `5 S T` beside those of the line; nor do they lie outside of
    /// the line's ends.
    fn meets_footprints(&self, x: Vec3) -> bool {
        let stack = self.stack;
        let (first, last) = if self.sign > 0.0 { (self.from, self.to - 1) } else { (self.to, self.from - 1) };
        let crossed = &stack.interfaces[usize::from(first)..=usize::from(last)];
        let uneven = crossed.iter().map(|i| i.deviation).fold(0.0, f64::max);
        let height = |i: usize| crossed[i].height;
        let between = (height(crossed.len() - 1) - height(0)).abs();
        let (tangent, most) = match self.end {
            End::Shift { shift, depth } => (shift / (self.start_depth + between + depth), shift),
            End::Direction { sine, cosine } => (sine / cosine, f64::INFINITY),
        };
        // A receiver inside of a sheet: the rest of the sheet's height bends as well.
        let span = between + 2.0 * uneven + if self.start_ior != 1.0 { self.start_depth } else { 0.0 };
        if tangent.is_nan() {
            return true;
        }
        let margin = (5.0 * span * tangent).min(most);
        let x = x.as_dvec3();
        let [origin, sideways] =
            [x, self.sideways].map(|v| DVec2::new(stack.tangents[0].dot(v), stack.tangents[1].dot(v)));
        let start = stack.axis.dot(x);
        crossed.iter().all(|interface| {
            let depth = (self.sign * (interface.height - start)).max(0.0);
            let place = origin + sideways * (depth * tangent).min(most);
            let [low, high] = interface.footprint;
            place.cmpge(low - margin).all() && place.cmple(high + margin).all()
        })
    }
}

/// The layers of air, each with the height where the next one begins: in the middle of the solids between them.
fn rooms(interfaces: &[CoverInterface], layers: &[CoverLayer]) -> Vec<(u8, f64)> {
    let air: Vec<usize> = (0..layers.len()).filter(|&l| layers[l].materials.is_empty()).collect();
    let end = |k: usize| match (interfaces.get(air[k]), air.get(k + 1).and_then(|&l| interfaces.get(l - 1))) {
        (Some(bottom), Some(top)) => 0.5 * (bottom.height + top.height),
        _ => f64::INFINITY,
    };
    (0..air.len()).map(|k| (air[k] as u8, end(k))).collect()
}

/// The chains from one layer to another, the strongest of each order first.
fn chains_between(layers: &[CoverLayer], from: usize, to: usize) -> Vec<Chain> {
    let interfaces = from.abs_diff(to);
    let ior = |k: usize| layers[if from < to { from + k } else { from - k }].ior;
    let strength = |chain: &Chain| -> f64 {
        let reflections = chain.steps().filter(|s| s.is_reflection);
        reflections.map(|s| normal_reflectance(ior(s.interface as usize), ior(s.interface as usize + 1))).product()
    };
    let mut found: Vec<(Chain, f64)> =
        Chain::through(interfaces as u32).into_iter().map(|c| (c, strength(&c))).collect();
    let mut strongest = [0.0f64; 3];
    for (chain, strength) in &found {
        let best = &mut strongest[(chain.order() as usize).min(2)];
        *best = best.max(*strength);
    }
    found.retain(|(chain, strength)| *strength > WEAKEST_CHAIN * strongest[(chain.order() as usize).min(2)]);
    found.sort_by(|(a, s), (b, t)| a.order().cmp(&b.order()).then(t.total_cmp(s)).then(a.events().cmp(&b.events())));
    found.truncate(MOST_CHAINS);
    found.into_iter().map(|(chain, _)| chain).collect()
}

/// Reflectance at right angles.
fn normal_reflectance(a: f64, b: f64) -> f64 {
    let r = (a - b) / (a + b);
    r * r
}
