//! The light of groups of lights, beside that of all lights.

use super::Wavefront;
use super::group::Group;
use super::scatter::LIGHTS;
use crate::dimensions;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, vectorize};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{LightChoice, LightGroups};
use smallvec::SmallVec;

/// The light that each group of lights has added to each path. Without groups it is empty.
#[derive(Debug, Default)]
pub(super) struct GroupLight<'a> {
    pub(super) groups: Option<&'a LightGroups>,
    /// Radiance of each path [W/(m^2 sr)], group by group.
    light: Vec<Rgb>,
    /// For each light sample of the present points the groups of its lights, lane by lane.
    pub(super) sampled: SmallVec<[[u8; MAX_WIDTH]; LIGHTS]>,
}

impl<'a> GroupLight<'a> {
    pub(super) fn new(groups: Option<&'a LightGroups>) -> Self {
        Self { groups, ..Self::default() }
    }

    /// The number of groups.
    pub(super) fn len(&self) -> usize {
        self.groups.map_or(0, LightGroups::len)
    }

    /// Removes all light.
    pub(super) fn clear(&mut self) {
        self.light.clear();
    }

    /// Makes room for the light of so many paths. New ones have none.
    #[inline]
    pub(super) fn resize(&mut self, paths: usize) {
        self.light.resize(paths * self.len(), Rgb::BLACK);
    }

    /// Adds light of a group to a path.
    #[inline]
    pub(super) fn add(&mut self, path: u32, group: u8, light: Rgb) {
        let place = path as usize * self.len() + usize::from(group);
        self.light[place] += light;
    }

    /// The light of a group on a path.
    #[inline]
    pub(super) fn of(&self, path: usize, group: usize) -> Rgb {
        self.light[path * self.len() + group]
    }
}

impl Wavefront<'_> {
    /// Finds the groups of the lights that the light samples of points choose.
    #[inline(never)]
    pub(super) fn find_groups<F: Lanes>(&mut self, group: &Group<'_, F>) {
        let (scene, token, choice) = (self.estimator.scene, group.at.token, group.choice);
        let Some(groups) = self.group_light.groups else { return };
        self.group_light.sampled.clear();
        vectorize!(F, token, {
            for index in 0..scene.num_light_samples(choice) {
                let lights = match choice {
                    LightChoice::Each => [index; MAX_WIDTH],
                    LightChoice::One => {
                        let numbers = group.state.sampler.numbers(dimensions::light(group.vertex, index));
                        let [u_choice, _] = numbers.last_two();
                        scene.chosen_lights(token, &group.receivers, u_choice, group.lit)
                    }
                };
                self.group_light.sampled.push(lights.map(|light| groups.of_light(light)));
            }
        });
    }
}
