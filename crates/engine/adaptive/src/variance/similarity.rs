//! The pixels of a block that may share estimates, compared many at a time.

use std::ops::Range;

use crate::variance::inputs::{NoiseInputs, SIMILAR};

/// Side of a block \[pixels\].
pub(crate) const SIDE: u32 = 16;
/// Slots of a block.
pub(crate) const SLOTS: usize = (SIDE * SIDE) as usize;

/// The cosine of half of the largest angle between similar normals is 0.9747. Normals that are as near to one of them are
/// similar to each other, with a margin for rounding.
const NEAR: f32 = 0.975;

/// The slot of a pixel of the block, in Z-order: the pixels of each aligned cell of 4 x 4, 8 x 8 or
/// 16 x 16 pixels are a range of slots.
pub(crate) const fn slot(x: u32, y: u32) -> usize {
    let (mut slot, mut bit) = (0, 0);
    while bit < 4 {
        slot |= (x >> bit & 1) << (2 * bit) | (y >> bit & 1) << (2 * bit + 1);
        bit += 1;
    }
    slot as usize
}

/// The slots of the aligned cell of `side` x `side` pixels that contains a slot.
pub(crate) fn cell(slot: usize, side: u32) -> Range<usize> {
    let size = (side * side) as usize;
    let start = slot / size * size;
    start..start + size
}

/// The properties of the pixels of a block that decide which of them may share estimates: they show the same surface
/// ([`crate::variance::inputs::PixelFeatures::is_like`]), have a similar brightness
/// ([`crate::variance::inputs::SensorVarianceRange::is_like`]), and half to twice as many samples.
pub(crate) struct Similarity {
    object: [u32; SLOTS],
    /// The unit normal, or zero with 1 (a border) or -1 (no normal) as the fourth number. So the scalar product decides.
    normal: [[f32; SLOTS]; 4],
    /// Bounds of the sensor variance; the upper one is doubled. The lower one of an unknown pixel is NaN.
    least: [f32; SLOTS],
    most: [f32; SLOTS],
    /// Number of samples, and half of it, rounded up.
    count: [i32; SLOTS],
    half: [i32; SLOTS],
}

impl Similarity {
    pub(crate) fn new() -> Self {
        Self {
            object: [0; SLOTS],
            normal: [[0.0; SLOTS]; 4],
            least: [f32::NAN; SLOTS],
            most: [0.0; SLOTS],
            count: [0; SLOTS],
            half: [0; SLOTS],
        }
    }

    /// Sets the properties of the pixel (x, y) of the image.
    pub(crate) fn set(&mut self, slot: usize, evidence: &NoiseInputs, x: u32, y: u32) {
        let (surface, level, count) = (evidence.surface.at(x, y), evidence.level.at(x, y), *evidence.counts.at(x, y));
        let [nx, ny, nz] = surface.normal;
        let normal = match surface.border {
            true => [0.0, 0.0, 0.0, 1.0],
            false if surface.normal == [0.0; 3] => [0.0, 0.0, 0.0, -1.0],
            false => [nx, ny, nz, 0.0],
        };
        self.object[slot] = surface.object;
        self.normal.iter_mut().zip(normal).for_each(|(all, v)| all[slot] = v);
        (self.least[slot], self.most[slot]) = (level.least, 2.0 * level.most);
        let whole = |n: u32| i32::try_from(n).unwrap_or(i32::MAX);
        (self.count[slot], self.half[slot]) = (whole(count), whole(count.div_ceil(2)));
    }

    /// Sets the weights of a range of slots: 1 for the pixels with which a known pixel may share estimates, including itself,
    /// and 0 for the others.
    pub(crate) fn weigh(&self, pixel: usize, range: Range<usize>, weights: &mut [f32; SLOTS]) {
        let (object, least, most) = (self.object[pixel], self.least[pixel], self.most[pixel]);
        let (count, half) = (self.count[pixel], self.half[pixel]);
        let own = [0, 1, 2, 3].map(|i| self.normal[i][pixel]);
        let [nx, ny, nz, nw] = [0, 1, 2, 3].map(|i| &self.normal[i][range.clone()]);
        let (objects, counts, halves) =
            (&self.object[range.clone()], &self.count[range.clone()], &self.half[range.clone()]);
        let (leasts, mosts) = (&self.least[range.clone()], &self.most[range.clone()]);
        for (i, weight) in weights[range.clone()].iter_mut().enumerate() {
            let dot = own[0] * nx[i] + own[1] * ny[i] + own[2] * nz[i] + own[3] * nw[i];
            let is_like = (objects[i] == object)
                & (dot >= SIMILAR)
                & (least <= mosts[i])
                & (leasts[i] <= most)
                & (half <= counts[i])
                & (halves[i] <= count);
            *weight = f32::from(u8::from(is_like));
        }
        if range.contains(&pixel) {
            weights[pixel] = 1.0;
        }
    }

    /// May all known pixels of a range share estimates with each other? The answer is never wrongly yes.
    pub(crate) fn is_uniform(&self, range: Range<usize>) -> bool {
        let mut known = range.filter(|&slot| !self.least[slot].is_nan());
        let Some(first) = known.next() else { return true };
        let normal = |slot: usize| [0, 1, 2, 3].map(|i| self.normal[i][slot]);
        let of_first = normal(first);
        let (mut least, mut most) = (self.least[first], self.most[first]);
        let (mut count, mut half) = (self.count[first], self.half[first]);
        for slot in known {
            let dot: f32 = normal(slot).iter().zip(&of_first).map(|(a, b)| a * b).sum();
            // A scalar product that is NaN is not near.
            let is_near = dot >= NEAR;
            if self.object[slot] != self.object[first] || !is_near {
                return false;
            }
            (least, most) = (least.max(self.least[slot]), most.min(self.most[slot]));
            (count, half) = (count.min(self.count[slot]), half.max(self.half[slot]));
        }
        least <= most && half <= count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::variance::inputs::{PixelFeatures, SensorVarianceRange};
    use dunkelfeld_film::Plane;

    /// Blocks of some surfaces with some brightnesses and numbers of samples, against the definitions of similarity.
    #[test]
    fn weights_follow_the_definitions_and_uniform_cells_are_uniform() {
        let mut state = 3u64;
        let mut draw = move |n: u64| {
            state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
            (state >> 33) % n
        };
        let mut uniform = 0;
        for trial in 0..60 {
            let kinds = 1 + trial % 3;
            let turn = |i: u64| [0.0f32, 0.1, 0.3, 0.6][i as usize % 4].sin_cos();
            let features = Plane::from_fn(SIDE, SIDE, |_, _| {
                let (s, c) = turn(draw(kinds));
                let normal = if draw(40 / kinds) == 0 && kinds > 1 { [0.0; 3] } else { [s, 0.0, c] };
                PixelFeatures { object: draw(kinds) as u32, normal, border: kinds > 1 && draw(5) == 0 }
            });
            let evidence = NoiseInputs {
                counts: Plane::from_fn(SIDE, SIDE, |_, _| 16 + draw(1 + 13 * kinds) as u32),
                mean: Plane::new(SIDE, SIDE, 1.0),
                variance: Plane::new(SIDE, SIDE, 1.0),
                scatter: Plane::new(SIDE, SIDE, None),
                largest: Plane::new(SIDE, SIDE, 1.0),
                surface: features,
                level: Plane::from_fn(SIDE, SIDE, |_, _| {
                    let least = 10.0 + draw(1 + 8 * kinds) as f32;
                    SensorVarianceRange { least, most: least + draw(3) as f32 }
                }),
            };
            let mut similarity = Similarity::new();
            let is_known = |x: u32, y: u32| !(x * 7 + y * 3).is_multiple_of(11);
            let pixels = || (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
            pixels().filter(|&(x, y)| is_known(x, y)).for_each(|(x, y)| similarity.set(slot(x, y), &evidence, x, y));
            let like = |a: (u32, u32), b: (u32, u32)| {
                let (n, m) = (*evidence.counts.at(a.0, a.1), *evidence.counts.at(b.0, b.1));
                n <= 2 * m
                    && m <= 2 * n
                    && evidence.level.at(a.0, a.1).is_like(evidence.level.at(b.0, b.1))
                    && evidence.surface.at(a.0, a.1).is_like(evidence.surface.at(b.0, b.1))
            };
            let known: Vec<(u32, u32)> = pixels().filter(|&(x, y)| is_known(x, y)).collect();
            let mut weights = [0.5; SLOTS];
            for &a in &known {
                similarity.weigh(slot(a.0, a.1), 0..SLOTS, &mut weights);
                for b in pixels() {
                    let wanted = is_known(b.0, b.1) && (a == b || like(a, b));
                    assert_eq!(weights[slot(b.0, b.1)] == 1.0, wanted, "{a:?} {b:?}");
                }
            }
            for side in [4, 8, 16] {
                for start in (0..SLOTS).step_by((side * side) as usize) {
                    let range = cell(start, side);
                    if similarity.is_uniform(range.clone()) {
                        uniform += 1;
                        let inside: Vec<_> = known.iter().filter(|p| range.contains(&slot(p.0, p.1))).collect();
                        assert!(inside.iter().all(|a| inside.iter().all(|b| a == b || like(**a, **b))));
                    }
                }
            }
        }
        assert!(uniform > 20, "{uniform}");
    }
}
