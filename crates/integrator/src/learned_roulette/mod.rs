//! Learned Russian roulette: survival probabilities of paths, shadow rays and connections by their expected gain.
//!
//! A part of a sample with the outcome `X` [W/(m^2 sr)] and the cost `c` \[rays\] is computed with the survival
//! probability `q` and divided by it. That adds `E[X^2] (1/q - 1)` to the variance of the sample and saves `c (1 - q)`
//! of its cost. The product of the variance `V` and the cost `C` of a sample is smallest for
//!
//! ```text
//! q = sqrt(E[X^2] / c) / sqrt(V / C)
//! ```
//!
//! (Bolin and Meyer 1997; Rath et al. 2022). Training paths measure `E[X^2]` and `c` before the render, in cells of
//! position and material (adjoint-driven roulette: Vorba and Křivánek 2016). `V` and `C` are those of the training paths
//! whose first vertex lies in the same cell. `V` leaves out the light samples of that vertex: their points are evenly
//! distributed over the samples of a pixel, so they add little to the variance of its mean.
//!
//! The survivors are divided by `q`, so no learned value changes the expected image.

mod cells;
mod statistics;

pub(crate) use statistics::{Outcomes, Visit};

use crate::learned_roulette::cells::{Cell, CellGrid};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_scene::Scene;

/// Number of lights with statistics of their own: the lights of a vertex that takes a sample of each.
pub(crate) const LIGHTS: usize = Scene::MAX_LIGHT_SAMPLES as usize;

/// Cost of a shadow ray with its light sample, relative to a ray to the next surface with its shading.
pub(crate) const SHADOW_COST: f32 = 0.5;

/// Cost of a ray that is traced through a cover for a connection, relative to a ray to the next surface.
pub(crate) const CONNECTION_COST: f32 = 1.0;

/// Smallest learned survival probability. It bounds the weight of outcomes that training has not met.
const MIN_SURVIVAL: f32 = 0.2;

/// The learned statistics of a scene and a camera.
#[derive(Clone, Debug, serde::Serialize)]
pub struct LearnedRoulette {
    grid: CellGrid,
}

/// The survival probabilities at a vertex.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VertexRoulette<'a> {
    cell: &'a Cell,
    /// `1 / sqrt(V / C)` of the path \[m^2 sr/W\].
    gain_scale: f32,
}

impl LearnedRoulette {
    /// The statistics of batches of training paths: their vertices, path after path. The order of the batches is part of
    /// the result. `None` if no path met a surface.
    pub(crate) fn from_visits(batches: &[&[Visit]]) -> Option<Self> {
        Some(Self { grid: statistics::combine(batches)? })
    }

    /// The survival probabilities at vertices on surfaces of a material. The first surface with statistics sets the
    /// `gain_scale` of a path, which is negative before. A lane has none if its material has no statistics, or if the noise
    /// of the first surface is zero.
    #[inline(always)]
    pub(crate) fn at_lanes<F: Lanes>(
        &self,
        token: F::Token,
        points: V3<F>,
        material: u32,
        gain_scale: &mut F,
    ) -> VertexRoulettes<'_, F> {
        let (points, mut gains) = (points.to_lanes(), gain_scale.to_array());
        let mut vertices = [None; MAX_WIDTH];
        for lane in 0..F::WIDTH {
            let Some(cell) = self.grid.find(points[lane], material) else { continue };
            if gains[lane] < 0.0 {
                gains[lane] = cell.gain_scale;
            }
            let gain_scale = gains[lane];
            if gain_scale > 0.0 && gain_scale.is_finite() {
                vertices[lane] = Some(VertexRoulette { cell, gain_scale });
            }
        }
        *gain_scale = F::load(token, &gains);
        VertexRoulettes::new(token, vertices)
    }
}

impl VertexRoulette<'_> {
    /// Survival probability of the connection of a light sample through a cover. `expected` is an upper bound of its
    /// contribution to the pixel [W/(m^2 sr)] if it is not occluded.
    #[inline]
    pub(crate) fn connection_survival(&self, index: u32, expected: f32) -> f32 {
        clamp(expected * self.gain_scale * self.cell.connection[index as usize % LIGHTS])
    }
}

/// The survival probabilities at the vertices of lanes.
pub(crate) struct VertexRoulettes<'a, F: Lanes> {
    vertices: [Option<VertexRoulette<'a>>; MAX_WIDTH],
    /// Lanes with statistics.
    is_learned: F::Mask,
    gain_scale: F,
    path: F,
}

impl<'a, F: Lanes> VertexRoulettes<'a, F> {
    /// The statistics of each lane.
    #[inline(always)]
    fn new(token: F::Token, vertices: [Option<VertexRoulette<'a>>; MAX_WIDTH]) -> Self {
        let (mut gain_scale, mut path, mut bits) = ([0.0; MAX_WIDTH], [0.0; MAX_WIDTH], 0);
        for lane in 0..F::WIDTH {
            if let Some(vertex) = &vertices[lane] {
                (gain_scale[lane], path[lane]) = (vertex.gain_scale, vertex.cell.path);
                bits |= 1 << lane;
            }
        }
        let is_learned = F::mask(token, bits);
        Self { vertices, is_learned, gain_scale: F::load(token, &gain_scale), path: F::load(token, &path) }
    }

    /// No statistics.
    #[inline(always)]
    pub(crate) fn none(token: F::Token) -> Self {
        Self::new(token, [None; MAX_WIDTH])
    }

    /// The statistics of a lane.
    #[inline]
    pub(crate) fn lane(&self, lane: usize) -> Option<VertexRoulette<'a>> {
        self.vertices[lane]
    }

    /// Survival probability of the path after scattering; the other probability in lanes without statistics. `throughput`
    /// is the largest channel. A path without throughput ends.
    #[inline(always)]
    pub(crate) fn path_survival(&self, throughput: F, other: F) -> F {
        let zero = throughput.constant(0.0);
        let survival = throughput.eq(zero).select(zero, clamp(throughput * self.gain_scale * self.path));
        self.is_learned.select(survival, other)
    }

    /// Survival probability of the shadow ray of a light sample; the other probability in lanes without statistics.
    /// `expected` is an upper bound of its contribution to the pixel [W/(m^2 sr)] if it is not occluded.
    #[inline(always)]
    pub(crate) fn shadow_survival(&self, index: u32, expected: F, other: F) -> F {
        if !self.is_learned.any() {
            return other;
        }
        let mut shares = [0.0; MAX_WIDTH];
        for (share, vertex) in shares.iter_mut().zip(&self.vertices) {
            if let Some(vertex) = vertex {
                *share = vertex.cell.shadow[index as usize % LIGHTS];
            }
        }
        let survival = clamp(expected * self.gain_scale * F::load(expected.token(), &shares));
        self.is_learned.select(survival, other)
    }
}

/// A probability in [[`MIN_SURVIVAL`], 1]. Values that are not a number survive, so that the film can count them.
#[inline(always)]
fn clamp<F: Lanes>(q: F) -> F {
    let one = q.constant(1.0);
    q.lt(one).select(q.max(q.constant(MIN_SURVIVAL)), one)
}
