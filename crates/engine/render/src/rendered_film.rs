//! A rendered film together with the object and material ids of its pixels.

use crate::error::Error;
use crate::settings::{Capture, CaptureRows};
use dunkelfeld_film::{Film, Plane};
use dunkelfeld_integrator::PixelIds;
use dunkelfeld_scene::Scene;
use rayon::prelude::*;

/// Exact sums per pixel, and the surface at the centre of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderedFilm {
    /// Sums of radiance and of auxiliary layers.
    pub sums: Film,
    /// The light of each group of lights in the same samples ([`RunSettings::light_groups`](crate::RunSettings::light_groups)), and then
    /// that of the lights of no group, if there are any. Albedo, normal and depth are zero. Empty without groups.
    ///
    /// The sums of these films add up to `sums`, to the rounding of each sample in single precision.
    pub groups: Vec<Film>,
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
        Self { sums, groups: Vec::new(), is_spread: false, ids, object_names: Vec::new(), material_names: Vec::new() }
    }

    /// The film of the same samples with a factor on the light of each group, and without groups: a render with other lights.
    /// Mean and variance are those of a render with these factors. Where all factors are 1, it is this film. Runs on the
    /// threads of the current pool.
    ///
    /// # Errors
    /// Another number of factors than of [`Self::groups`], a factor that is not finite or below zero, too little memory.
    pub fn weighted(&self, factors: &[f64]) -> Result<Self, Error> {
        if factors.len() != self.groups.len() {
            let problem = format!("there are {} groups of lights, and {} factors", self.groups.len(), factors.len());
            return Err(Error::setting("light groups", problem, "pass a factor for each group"));
        }
        if let Some(factor) = factors.iter().find(|factor| !(factor.is_finite() && **factor >= 0.0)) {
            return Err(Error::setting(
                "light groups",
                format!("the factor {factor} is out of range"),
                "use 0 or more",
            ));
        }
        let (ids, object_names, material_names) =
            (self.ids.clone(), self.object_names.clone(), self.material_names.clone());
        let sums = match factors.iter().all(|factor| *factor == 1.0) {
            true => self.sums.clone(),
            false => self.weighted_sums(factors)?,
        };
        Ok(Self { sums, groups: Vec::new(), is_spread: self.is_spread, ids, object_names, material_names })
    }

    /// The film of a capture: its light, in its rows.
    ///
    /// # Errors
    /// As [`Self::weighted`].
    pub fn of_capture(&self, capture: &Capture) -> Result<Self, Error> {
        // The last group is that of the lights that no group names.
        let mut factors = capture.factors.clone();
        factors.resize(self.groups.len().max(factors.len()), 0.0);
        let film = self.weighted(&factors)?;
        if capture.rows == CaptureRows::ALL { Ok(film) } else { film.with_rows(capture.rows) }
    }

    /// The film of some of its rows, without groups.
    fn with_rows(self, rows: CaptureRows) -> Result<Self, Error> {
        let (width, height) = (self.sums.width(), self.sums.height());
        let chosen: Vec<u32> = (rows.first..height).step_by(rows.step as usize).collect();
        let mut sums = Film::with_layers(width, chosen.len() as u32, self.sums.layers());
        let (mut next, mut band) = (0, Vec::new());
        for top in (0..height).step_by(Film::TILE as usize) {
            band.clear();
            self.sums.read_rows(top..height.min(top + Film::TILE), &mut band);
            let lines = (top..).zip(band.chunks(width as usize)).filter(|(y, _)| y % rows.step == rows.first);
            let lines: Vec<_> = lines.flat_map(|(_, line)| line).copied().collect();
            sums.add_rows(next, &lines).map_err(|_| Error::film_memory())?;
            next += lines.len() as u32 / width;
        }
        let ids = Plane::from_fn(width, next, |x, y| *self.ids.at(x, chosen[y as usize]));
        Ok(Self { sums, ids, ..self })
    }

    fn weighted_sums(&self, factors: &[f64]) -> Result<Film, Error> {
        let mut sums = Film::with_layers(self.sums.width(), self.sums.height(), self.sums.layers());
        let rows = sums.tile_rows_mut().par_iter_mut().zip(self.sums.tile_rows()).enumerate();
        rows.try_for_each(|(number, (row, whole))| {
            let groups: Vec<_> =
                self.groups.iter().map(|film| &film.tile_rows()[number]).zip(factors.iter().copied()).collect();
            row.add_weighted(whole, &groups)
        })
        .map_err(|_| Error::film_memory())?;
        Ok(sums)
    }

    /// A copy of some rows of tiles.
    pub(crate) fn copy_of_tile_rows(&self, rows: std::ops::Range<usize>) -> Self {
        let sums = self.sums.copy_of_tile_rows(rows.clone());
        let first = rows.start * Film::TILE as usize * sums.width() as usize;
        let ids = self.ids.data()[first..first + sums.pixels()].to_vec();
        Self {
            ids: Plane::of_pixels(sums.width(), sums.height(), ids),
            sums,
            groups: self.groups.iter().map(|film| film.copy_of_tile_rows(rows.clone())).collect(),
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
