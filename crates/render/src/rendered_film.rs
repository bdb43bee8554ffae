//! A rendered film together with the ids of what its pixels show.

use dunkelfeld_film::{Film, Plane};
use dunkelfeld_integrator::Label;

/// Exact sums per pixel, and what the centre of each pixel shows.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderedFilm {
    /// Sums of radiance and of auxiliary layers.
    pub sums: Film,
    /// Object and material at the centre of each pixel; `None` where nothing is hit.
    pub ids: Plane<Option<Label>>,
    /// Names of the objects, by id.
    pub object_names: Vec<String>,
}

impl RenderedFilm {
    /// A film whose pixels show no objects.
    pub fn without_ids(sums: Film) -> Self {
        let ids = Plane::new(sums.width(), sums.height(), None);
        Self { sums, ids, object_names: Vec::new() }
    }
}
