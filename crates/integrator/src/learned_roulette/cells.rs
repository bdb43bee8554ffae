//! Cells of position and material.

use super::LIGHTS;
use dunkelfeld_geometry::Vec3;
use rustc_hash::FxHashMap;

/// Cells along the radius of the visible part of the scene.
const CELLS_PER_RADIUS: f32 = 24.0;

/// Learned values of a cell. A root is taken once here, so that a decision is a product.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub(crate) struct Cell {
    /// `1 / sqrt(V / C)` of the paths whose first vertex lies here \[(m^2 sr)/W\].
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
    /// Cells by [`Lattice::key`].
    cells: FxHashMap<u64, Cell>,
    /// Values of each material, for places that training has not visited.
    materials: Vec<Option<Cell>>,
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
    /// A grid with cells by their keys, and values by the index of a material.
    pub(crate) fn new(lattice: Lattice, cells: FxHashMap<u64, Cell>, materials: Vec<Option<Cell>>) -> Self {
        Self { lattice, cells, materials }
    }

    /// The cell of a point. The values of its material if training has not visited the cell.
    #[inline]
    pub(crate) fn find(&self, point: Vec3, material: u32) -> Option<&Cell> {
        let key = self.lattice.key(point, material);
        self.cells.get(&key).or_else(|| self.materials.get(material as usize)?.as_ref())
    }
}
