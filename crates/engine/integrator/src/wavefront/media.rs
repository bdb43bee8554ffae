//! Media along rays, one for each lane.

use super::Wavefront;
use crate::dimensions;
use crate::path::PathStates;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, vectorize};
use dunkelfeld_scene::{MediumEvents, MediumLanes};

impl Wavefront<'_> {
    /// The media of the rays whose points are found path by path: weights of the paths, and the distances at which they are
    /// scattered.
    #[inline(never)]
    pub(super) fn pass_media<F: Lanes>(&mut self, token: F::Token, vertex: u32) {
        let scene = self.estimator.scene;
        if !scene.has_solids() {
            return;
        }
        vectorize!(F, token, {
            for group in self.arriving.chunks_mut(F::WIDTH) {
                let ([mut rays, mut paths], mut media) =
                    ([[group[0].0; MAX_WIDTH]; 2], [MediumLanes::CLEAR; MAX_WIDTH]);
                for lane in 0..F::WIDTH {
                    rays[lane] = group.get(lane).unwrap_or(&group[0]).0;
                    paths[lane] = self.rays.paths[rays[lane] as usize];
                    media[lane] = self.among_solids[paths[lane] as usize].enclosing.coefficients(scene);
                }
                let all = self.paths.as_mut_slice();
                let mut state = PathStates::<F>::load(
                    token,
                    #[inline(always)]
                    |lane| &all[paths[lane] as usize],
                );
                let numbers = state.sampler.numbers(dimensions::surface_kind(vertex));
                let ([_, u_distance], [u_channel, u_digits]) = (numbers.first_two(), numbers.last_two());
                let (u, end) = ([u_distance, u_channel, u_digits], self.hits.lanes::<F>(token, &rays).t);
                let MediumEvents { is_scattered, distance, weight } =
                    MediumLanes::from_lanes(token, &media).sample(state.throughput, end, u);
                state.throughput *= weight;
                state.store(
                    F::mask(token, u32::MAX >> (32 - group.len())),
                    #[inline(always)]
                    |lane, state| all[paths[lane] as usize] = state,
                );
                let distances = is_scattered.select(distance, end.constant(f32::INFINITY)).to_array();
                for ((_, scattered), distance) in group.iter_mut().zip(distances) {
                    *scattered = distance;
                }
            }
        });
    }
}
