//! Stacks of covers: interfaces along an axis, and the chains of refractions through them.

use super::chain::Chain;
use super::layer_crossing::{Crossing, End};
use dunkelfeld_geometry::{DVec2, DVec3, Vec3};

/// Maximum number of interfaces of a stack. Further sheets are not connected; only scattering samples light through
/// them.
pub const MAX_INTERFACES: usize = 16;
/// Maximum number of chains from one layer to another: those with the highest transmission.
pub const MAX_CHAINS: usize = 16;
/// A chain with less than this share of the transmission of the strongest one of its order, at normal incidence, is
/// left out.
const MIN_RELATIVE_TRANSMISSION: f64 = 1e-3;

/// The end of a connection on a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// A point of a light, in render space \[m\].
    Point(Vec3),
    /// The unit direction towards a light at infinity, behind the cover.
    Direction(Vec3),
}

/// A surface across the axis of a stack, where the index of refraction changes.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CoverInterface {
    /// Mean position along the axis \[m\], area-weighted.
    pub height: f64,
    /// The largest distance of the surface from there, along the axis \[m\].
    pub deviation: f64,
    /// Lowest and highest coordinates along the two tangents of the stack \[m\].
    pub footprint: [DVec2; 2],
}

/// The space between two interfaces, below the lowest one or above the highest one.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CoverLayer {
    /// Index of refraction; 1 for air.
    pub ior: f64,
    /// The materials that fill it; none for air.
    pub materials: Vec<u32>,
}

/// A smooth solid with a scattering medium in contact with the first or the last interface of a stack.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub(crate) struct TouchingSolid {
    pub(crate) material: u32,
    pub(crate) ior: f64,
    /// True if it touches the last interface.
    pub(crate) is_above: bool,
}

/// Clear sheets with a common axis: one cover, or several on one another, glued or with air between them.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CoverStack {
    pub(super) axis: DVec3,
    tangents: [DVec3; 2],
    pub(super) interfaces: Vec<CoverInterface>,
    pub(super) layers: Vec<CoverLayer>,
    is_flat: bool,
    /// Solids with a scattering medium in contact with the outside.
    touching: Vec<TouchingSolid>,
    /// For each layer without material: its number, and the position along the axis where the next one starts.
    air_layers: Vec<(u8, f64)>,
    /// Chains from layer to layer, `layers * from + to`.
    chains: Vec<Vec<Chain>>,
}

impl CoverStack {
    /// `interfaces` ascend along `axis`. `layers` has one element more. The first and the last layer lie outside.
    pub(crate) fn new(
        axis: DVec3,
        tangents: [DVec3; 2],
        interfaces: Vec<CoverInterface>,
        layers: Vec<CoverLayer>,
        is_flat: bool,
    ) -> Self {
        let air_layers = air_layers(&interfaces, &layers);
        let count = layers.len();
        let chains = (0..count * count).map(|k| chains_between(&layers, k / count, k % count)).collect();
        Self { axis, tangents, interfaces, layers, is_flat, touching: Vec::new(), air_layers, chains }
    }

    /// Two unit vectors across the axis: those of the footprints.
    pub(crate) fn tangents(&self) -> [DVec3; 2] {
        self.tangents
    }

    /// Registers a solid in contact with the outside of the stack.
    pub(crate) fn add_touching(&mut self, solid: TouchingSolid) {
        self.touching.push(solid);
    }

    /// Unit vector in the order of the layers, in render space.
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

    /// True if all faces are planes to 1e-5 of their extent, and have no interpolated normals.
    pub fn is_flat(&self) -> bool {
        self.is_flat
    }

    /// The chains from layer `from` to layer `to`, ordered by their number of double passes, at most [`MAX_CHAINS`].
    /// None from a layer to itself, or through more than [`Chain::MAX_EVENTS`] interfaces.
    pub fn chains(&self, from: u8, to: u8) -> &[Chain] {
        let count = self.layers.len();
        let is_known = usize::from(from) < count && usize::from(to) < count;
        if is_known { &self.chains[count * usize::from(from) + usize::from(to)] } else { &[] }
    }

    /// The layer that contains a point in render space. `inside` is the material of the solid around it, `None` outside
    /// of solids. The result is `None` if that solid is no part of the stack and no scattering solid in contact with
    /// it.
    ///
    /// A point in air belongs to the nearest layer of air. So faces that are not planes do not change the layer of a
    /// point.
    pub fn layer_at(&self, point: Vec3, inside: Option<u32>) -> Option<u8> {
        let height = self.axis.dot(point.as_dvec3());
        let Some(material) = inside else {
            return self
                .air_layers
                .iter()
                .find(|(_, end)| height < *end)
                .or(self.air_layers.last())
                .map(|(layer, _)| *layer);
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

    /// The solid of that material in contact with the stack, on the side nearer to a height.
    fn touching_at(&self, height: f64, material: u32) -> Option<&TouchingSolid> {
        let beyond = |t: &&TouchingSolid| {
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

    /// The interfaces between the point `x` in render space and `target`. `inside` is the material of the solid in
    /// which the connection starts, as for [`Self::layer_at`].
    ///
    /// `None` if there is no interface between them, or if every chain would pass one outside its footprint. For plane
    /// faces the latter is certain. [`Crossing::each_candidate`] tests each chain more precisely.
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
        // The solid in contact with the stack replaces the outer layer of air. There is no face between them if it has
        // the index of the outermost sheet.
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
        let crossing = Crossing { stack: self, x: x.as_dvec3(), from, to, start_ior, sideways, start_depth, end, sign };
        crossing.may_pass_footprints().then_some(crossing)
    }
}

/// The layers of air, each with the height where the next one begins: the middle of the solids between them.
fn air_layers(interfaces: &[CoverInterface], layers: &[CoverLayer]) -> Vec<(u8, f64)> {
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
    found
        .retain(|(chain, strength)| *strength > MIN_RELATIVE_TRANSMISSION * strongest[(chain.order() as usize).min(2)]);
    found.sort_by(|(a, s), (b, t)| a.order().cmp(&b.order()).then(t.total_cmp(s)).then(a.events().cmp(&b.events())));
    found.truncate(MAX_CHAINS);
    found.into_iter().map(|(chain, _)| chain).collect()
}

/// Reflectance at normal incidence.
fn normal_reflectance(a: f64, b: f64) -> f64 {
    let r = (a - b) / (a + b);
    r * r
}
