//! A rendered film together with the object and material ids of its pixels.

use dunkelfeld_film::{Film, Plane};
use dunkelfeld_integrator::PixelIds;
use dunkelfeld_scene::Scene;

/// Exact sums per pixel, and the surface at the centre of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderedFilm {
    /// Sums of radiance and of auxiliary layers.
    pub sums: Film,
    /// Are the samples of a pixel spread over its neighbours ([`MeanImage::SPREAD`](dunkelfeld_film::MeanImage::SPREAD))?
    pub is_spread: bool,
    /// Object and material at the centre of each pixel; `None` where no surface is hit.
    pub ids: Plane<Option<PixelIds>>,
    /// Names of the objects, by id.
    pub object_names: Vec<String>,
    /// Names of the materials, by id. A file of an earlier version has none.
    pub material_names: Vec<String>,
}

impl RenderedFilm {
    /// A film without objects in its pixels.
    pub fn without_ids(sums: Film) -> Self {
        let ids = Plane::new(sums.width(), sums.height(), None);
        Self { sums, is_spread: false, ids, object_names: Vec::new(), material_names: Vec::new() }
    }

    /// A copy of some rows of tiles.
    pub(crate) fn copy_of_tile_rows(&self, rows: std::ops::Range<usize>) -> Self {
        let sums = self.sums.copy_of_tile_rows(rows.clone());
        let first = rows.start * Film::TILE as usize * sums.width() as usize;
        let ids = self.ids.data()[first..first + sums.pixels()].to_vec();
        Self {
            ids: Plane::of_pixels(sums.width(), sums.height(), ids),
            sums,
            is_spread: self.is_spread,
            object_names: self.object_names.clone(),
            material_names: self.material_names.clone(),
        }
    }
}

/// Names of the materials, by id.
pub(crate) fn material_names(scene: &Scene) -> Vec<String> {
    scene.materials().iter().map(|material| material.name.clone()).collect()
}
