//! Cells of position and material.

use super::LIGHTS;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, One, V3};

/// Cells along the radius of the visible part of the scene. Four times as many were a tenth to a third worse.
const CELLS_PER_RADIUS: f32 = 24.0;

/// Learned values of a cell. A root is taken once here, so that a decision is a product.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) struct Cell {
    /// `1 / sqrt(V / C)` of the paths whose first vertex lies here \[(m^2 sr)/W\].
    pub(crate) gain_scale: f32,
    /// `sqrt(E[X^2] / c)` of the rest of a path, for the throughput 1 [W/(m^2 sr)].
    pub(crate) path: f32,
    /// `sqrt(a / c)` of shadow rays ([`SHADOW`](super::SHADOW)) and of connections through covers
    /// ([`CONNECTION`](super::CONNECTION)) to each light, where `a` is the share of the light that arrives.
    pub(crate) rays: [[f32; LIGHTS]; 2],
}

/// Position of the cells: a uniform grid.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) struct Lattice {
    origin: Vec3,
    cells_per_metre: f32,
}

/// Index where there is no cell.
pub(crate) const NONE: u32 = u32::MAX;

/// The cells that training paths have visited.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct CellGrid {
    lattice: Lattice,
    /// An open-addressed hash table with a power of two of slots. At least half of them are empty.
    slots: Vec<Slot>,
    /// The bits of a hash below those of the number of its first slot.
    shift: u32,
    cells: Vec<Cell>,
    /// Index of the cell of each material, for places that training has not visited, or [`NONE`].
    materials: Vec<u32>,
}

/// A slot of the hash table.
#[derive(Clone, Copy, Debug, serde::Serialize)]
struct Slot {
    key: [u32; 2],
    /// Index of the cell, or [`NONE`].
    cell: u32,
}

impl Lattice {
    /// A lattice around the mean of points, with cells of a part of their root mean square distance from it.
    pub(crate) fn around(points: &[Vec3]) -> Option<Self> {
        let n = points.len() as f64;
        let sum = points
            .iter()
            .fold([0.0f64; 3], |s, p| [s[0] + f64::from(p.x), s[1] + f64::from(p.y), s[2] + f64::from(p.z)]);
        let mean = sum.map(|s| s / n);
        let square: f64 = points
            .iter()
            .map(|p| {
                let d = [f64::from(p.x) - mean[0], f64::from(p.y) - mean[1], f64::from(p.z) - mean[2]];
                d.iter().map(|x| x * x).sum::<f64>()
            })
            .sum();
        let radius = (square / n).sqrt();
        let [x, y, z] = mean.map(|m| m as f32);
        let cells_per_metre = (f64::from(CELLS_PER_RADIUS) / radius) as f32;
        (radius > 0.0 && cells_per_metre.is_finite()).then_some(Self { origin: Vec3::new(x, y, z), cells_per_metre })
    }

    /// The key of the cell of a point and a material: low and high half. Cells far outside the visible part share keys.
    #[inline(always)]
    pub(crate) fn key<F: Lanes>(&self, point: V3<F>, material: F::Word) -> [F::Word; 2] {
        let p = (point - V3::splat(point.x.token(), self.origin)) * point.x.constant(self.cells_per_metre);
        let [x, y, z] = [part(p.x), part(p.y), part(p.z)];
        [x | (y << 16), z | (material << 16)]
    }
}

/// The number of a cell along an axis, in 16 bits.
#[inline(always)]
fn part<F: Lanes>(x: F) -> F::Word {
    x.clamp(-32768.0, 32767.0).floor().round_to_word() + 32768
}

/// A hash of a key (the last steps of MurmurHash3 by Appleby). Its high bits are the number of a slot.
#[inline(always)]
fn hash<F: Lanes>([low, high]: [F::Word; 2]) -> F::Word {
    let h = (low * 0x9e37_79b1) ^ (high * 0x85eb_ca77);
    let h = (h ^ (h >> 16)) * 0x85eb_ca6b;
    (h ^ (h >> 13)) * 0xc2b2_ae35
}

impl CellGrid {
    /// A grid with cells by their keys, and values by the index of a material.
    pub(crate) fn new(
        lattice: Lattice,
        by_key: impl ExactSizeIterator<Item = ([u32; 2], Cell)>,
        by_material: impl Iterator<Item = Option<Cell>>,
    ) -> Self {
        let bits = (2 * by_key.len()).next_power_of_two().ilog2().clamp(1, 31);
        let empty = Slot { key: [0; 2], cell: NONE };
        let mut grid =
            Self { lattice, slots: vec![empty; 1 << bits], shift: 32 - bits, cells: Vec::new(), materials: Vec::new() };
        for (key, cell) in by_key {
            let mut at = hash::<f32>(key.map(One)).0 as usize >> grid.shift;
            while grid.slots[at].cell != NONE {
                at = (at + 1) % grid.slots.len();
            }
            grid.slots[at] = Slot { key, cell: grid.cells.len() as u32 };
            grid.cells.push(cell);
        }
        for cell in by_material {
            grid.materials.push(if cell.is_some() { grid.cells.len() as u32 } else { NONE });
            grid.cells.extend(cell);
        }
        grid
    }

    /// All cells.
    pub(crate) fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// The index of the cell of each point, or [`NONE`]. That of its material if training has not visited the cell.
    #[inline(always)]
    pub(crate) fn find<F: Lanes>(&self, point: V3<F>, material: F::Word) -> [u32; MAX_WIDTH] {
        let key = self.lattice.key(point, material);
        let first = F::word_to_array(hash::<F>(key) >> self.shift);
        let [low, high, material] = [F::word_to_array(key[0]), F::word_to_array(key[1]), F::word_to_array(material)];
        let mut found = [NONE; MAX_WIDTH];
        for lane in 0..F::WIDTH {
            found[lane] = self.probe(first[lane], [low[lane], high[lane]]);
            if found[lane] == NONE {
                found[lane] = self.materials.get(material[lane] as usize).copied().unwrap_or(NONE);
            }
        }
        found
    }

    /// The cell of a key, from its first slot.
    #[inline(always)]
    fn probe(&self, first: u32, key: [u32; 2]) -> u32 {
        let mut at = first as usize;
        loop {
            let slot = &self.slots[at & (self.slots.len() - 1)];
            if slot.key == key || slot.cell == NONE {
                return slot.cell;
            }
            at += 1;
        }
    }
}
