//! Cells of position and material, in a hash table.

use super::LIGHTS;
use dunkelfeld_geometry::Vec3;

/// Cells along the radius of the visible part of the scene.
const CELLS_PER_RADIUS: f32 = 24.0;

/// Learned values of a cell. A root is taken once here, so that a decision is a product.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) struct Cell {
    /// See [`Lattice::key`].
    pub(crate) key: u64,
    /// `1 / sqrt(V / C)` of the paths with their first scattering here \[(m^2 sr)/W\].
    pub(crate) gain_scale: f32,
    /// `sqrt(E[X^2] / c)` of the rest of a path, for the throughput 1 [W/(m^2 sr)].
    pub(crate) path: f32,
    /// `sqrt(a / c)` of shadow rays to each light, where `a` is the share of the light that is not occluded.
    pub(crate) shadow: [f32; LIGHTS],
    /// The same of connections through covers.
    pub(crate) connection: [f32; LIGHTS],
}

/// Position of the cells: a uniform grid.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) struct Lattice {
    origin: Vec3,
    cells_per_metre: f32,
}

/// The cells that training paths have visited.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct CellGrid {
    lattice: Lattice,
    /// Open addressing with linear probing; `EMPTY` marks free slots. At most half of the slots are used.
    slots: Vec<u32>,
    cells: Vec<Cell>,
    /// Index of the cell of each material, for places that training has not visited; `EMPTY` for unknown materials.
    materials: Vec<u32>,
}

/// Marks a slot without a cell.
const EMPTY: u32 = u32::MAX;

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

    /// The key of the cell of a point and a material. Cells far outside the visible part share keys.
    #[inline]
    pub(crate) fn key(&self, point: Vec3, material: u32) -> u64 {
        let p = (point - self.origin) * self.cells_per_metre;
        // `as` saturates; 16 bits per axis and 16 bits of the material.
        let part = |x: f32| u64::from((x.floor().clamp(-32768.0, 32767.0) as i32 + 32768) as u16);
        part(p.x) | part(p.y) << 16 | part(p.z) << 32 | u64::from(material as u16) << 48
    }
}

impl CellGrid {
    /// A grid with these cells, which have different keys, and a cell for each material.
    pub(crate) fn new(lattice: Lattice, mut cells: Vec<Cell>, materials: Vec<Option<Cell>>) -> Self {
        let size = (2 * cells.len()).next_power_of_two().max(2);
        let mut slots = vec![EMPTY; size];
        for (index, cell) in (0u32..).zip(&cells) {
            let mut slot = hash(cell.key) as usize & (size - 1);
            while slots[slot] != EMPTY {
                slot = (slot + 1) & (size - 1);
            }
            slots[slot] = index;
        }
        let materials = materials
            .into_iter()
            .map(|cell| {
                cell.map_or(EMPTY, |cell| {
                    cells.push(cell);
                    cells.len() as u32 - 1
                })
            })
            .collect();
        Self { lattice, slots, cells, materials }
    }

    /// The cell of a point; that of its material if training has not visited the cell.
    #[inline]
    pub(crate) fn find(&self, point: Vec3, material: u32) -> Option<&Cell> {
        let key = self.lattice.key(point, material);
        let mask = self.slots.len() - 1;
        let mut slot = hash(key) as usize & mask;
        loop {
            match self.slots[slot] {
                EMPTY => {
                    let index = *self.materials.get(material as usize)?;
                    return self.cells.get(index as usize);
                }
                index => {
                    let cell = &self.cells[index as usize];
                    if cell.key == key {
                        return Some(cell);
                    }
                }
            }
            slot = (slot + 1) & mask;
        }
    }
}

/// A hash of a key: multiplication by the golden ratio (Knuth 1998, section 6.4), folded.
#[inline]
fn hash(key: u64) -> u64 {
    let product = u128::from(key ^ key >> 32) * 0x9e37_79b9_7f4a_7c15;
    (product >> 64) as u64 ^ product as u64
}
