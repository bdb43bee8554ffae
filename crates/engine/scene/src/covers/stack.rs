//! Stacks of covers: interfaces along an axis, and the chains of refractions through them.

use super::chain::Chain;
use dunkelfeld_geometry::{DVec2, DVec3};
use dunkelfeld_lanes::{Double, Lanes, Mask, Real};

/// Maximum number of interfaces of a stack. Further sheets are not connected; only scattering samples light through
/// them.
pub const MAX_INTERFACES: usize = 16;
/// Maximum number of chains from one layer to another: those with the highest transmission.
pub const MAX_CHAINS: usize = 16;
/// A chain with less than this share of the transmission of the strongest one of its order, at normal incidence, is
/// left out.
const MIN_RELATIVE_TRANSMISSION: f64 = 1e-3;

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
    axis: DVec3,
    /// Two unit vectors across the axis: those of the footprints.
    pub(super) tangents: [DVec3; 2],
    interfaces: Vec<CoverInterface>,
    layers: Vec<CoverLayer>,
    is_flat: bool,
    /// Solids with a scattering medium in contact with the outside.
    pub(super) touching: Vec<TouchingSolid>,
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

    /// Unit vector in the order of the layers, in render space.
    #[inline(always)]
    pub fn axis(&self) -> DVec3 {
        self.axis
    }

    /// The interfaces in ascending order along the axis.
    #[inline(always)]
    pub fn interfaces(&self) -> &[CoverInterface] {
        &self.interfaces
    }

    /// The layers in the same order: layer i lies below interface i.
    #[inline(always)]
    pub fn layers(&self) -> &[CoverLayer] {
        &self.layers
    }

    /// Thickness of a layer between its mean planes \[m\]; infinite for the first and the last, and beyond them.
    #[inline(always)]
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
    #[inline(always)]
    pub fn chains(&self, from: u8, to: u8) -> &[Chain] {
        let count = self.layers.len();
        let is_known = usize::from(from) < count && usize::from(to) < count;
        if is_known { &self.chains[count * usize::from(from) + usize::from(to)] } else { &[] }
    }

    /// The layer of air that is nearest to each height along the axis \[m\]. So faces that are not planes do not change
    /// the layer of a point.
    #[inline(always)]
    pub(super) fn air_layer<F: Lanes>(&self, token: F::Token, height: F::Double) -> F {
        let mut layer = F::splat(token, 0.0);
        for (number, end) in self.air_layers.iter().rev() {
            let is_below = F::Double::narrow_mask(height.lt(F::Double::splat(token, *end)));
            layer = is_below.select(F::splat(token, f32::from(*number)), layer);
        }
        layer
    }

    /// The layer of a receiver in a solid of a material, for light in layer `to`, and the index of refraction at the
    /// receiver. `None` if the solid is no part of the stack and no scattering solid in contact with it, or if no
    /// interface lies between them.
    pub(super) fn layer_in_solid(&self, height: f64, material: u32, to: usize) -> Option<(usize, f64)> {
        let beyond = |layer: usize| {
            let low = layer.checked_sub(1).map_or(f64::NEG_INFINITY, |i| self.interfaces[i].height);
            let high = self.interfaces.get(layer).map_or(f64::INFINITY, |i| i.height);
            (low - height).max(height - high).max(0.0)
        };
        let filled = (0..self.layers.len()).filter(|&l| self.layers[l].materials.contains(&material));
        if let Some(own) = filled.min_by(|&a, &b| beyond(a).total_cmp(&beyond(b))) {
            return Some((own, self.layers[own].ior));
        }
        // The solid in contact with the stack replaces the outer layer of air. There is no face between them if it has
        // the index of the outermost sheet.
        let solid = self.touching_at(height, material)?;
        let outer = if solid.is_above { self.layers.len() - 1 } else { 0 };
        let next = if to > outer { outer + 1 } else { outer.checked_sub(1).filter(|_| to < outer)? };
        Some((if self.layers[next].ior == solid.ior { next } else { outer }, solid.ior))
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
