//! Paths that leave the scene, one for each lane: light of the environment and of suns.

use super::{Watch, Wavefront};
use crate::observer::Event;
use crate::path::PathStates;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, V3, vectorize};

impl Wavefront<'_> {
    /// Adds the light of the environment and of suns to the paths whose rays leave the scene.
    #[inline(never)]
    pub(super) fn escape<F: Lanes>(&mut self, token: F::Token, watch: &mut Watch<'_>) {
        let scene = self.estimator.scene;
        if !scene.has_environment() && watch.observer.is_none() {
            return;
        }
        vectorize!(F, token, {
            for group in self.escaped.chunks(F::WIDTH) {
                let (mut rays, mut paths) = ([group[0]; MAX_WIDTH], [0; MAX_WIDTH]);
                rays[..group.len()].copy_from_slice(group);
                for lane in 0..F::WIDTH {
                    paths[lane] = self.rays.paths[rays[lane] as usize];
                }
                let (prefixes, all) = (self.prefixes(&paths[..group.len()]), self.paths.as_slice());
                let state = PathStates::<F>::load(
                    token,
                    #[inline(always)]
                    |lane| &all[paths[lane] as usize],
                );
                let (direction, none) = (self.rays.directions::<F>(token, &rays), V3::splat(token, Vec3::ZERO));
                let (last, chosen, end) = (&state.last, state.last_choice_is_one, (false, [direction, none]));
                let (groups, mut of_groups) = (self.group_light.groups, Vec::new());
                let mut light = state.contributions(
                    scene,
                    scene.environment_radiance(direction),
                    end,
                    &prefixes,
                    #[inline(always)]
                    || scene.environment_pdf(last, chosen, direction),
                );
                of_groups.extend(groups.map(|groups| (groups.of_environment(), light)));
                for sun in scene.suns() {
                    let of_sun = state.contributions(
                        scene,
                        scene.sun_radiance(sun, direction),
                        end,
                        &prefixes,
                        #[inline(always)]
                        || scene.sun_pdf(last, chosen, sun, direction),
                    );
                    light += of_sun;
                    of_groups.extend(groups.map(|groups| (groups.of_light(sun), of_sun)));
                }
                let (directions, throughputs) = (direction.to_lanes(), state.throughput.to_lanes());
                for (lane, light) in light.to_lanes().into_iter().enumerate().take(group.len()) {
                    let (position, throughput) = (directions[lane], throughputs[lane]);
                    watch.event(paths[lane], || Event::Vertex {
                        position,
                        material: None,
                        in_medium: false,
                        throughput,
                    });
                    watch.event(paths[lane], || Event::Emitted(light));
                    self.paths[paths[lane] as usize].add_radiance(light);
                }
                for (of_group, light) in of_groups {
                    for (path, light) in paths[..group.len()].iter().zip(light.to_lanes()) {
                        self.group_light.add(*path, of_group, light);
                    }
                }
            }
        });
    }
}
