//! The solids that contain a point, and the one that fills it (Schmidt and Budge 2002).

/// Maximum number of solids around a point. Boundaries of further solids are ignored.
const CAPACITY: usize = 12;

/// The solids around a point, by rank. Where solids overlap, the one of the highest rank fills the place.
///
/// A solid whose mesh overlaps itself is counted once for each time that it was entered. If more than twelve solids
/// overlap, those entered last are ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interior {
    /// Ranks in ascending order; the first `count` are valid.
    solids: [u32; CAPACITY],
    count: u8,
}

impl Interior {
    /// Outside of everything.
    pub const OUTSIDE: Self = Self { solids: [0; CAPACITY], count: 0 };

    /// The solid that fills the place.
    #[inline]
    pub fn top(&self) -> Option<u32> {
        self.ranks().last().copied()
    }

    /// All solids that the point lies in, in ascending order of rank.
    #[inline]
    pub fn ranks(&self) -> &[u32] {
        &self.solids[..usize::from(self.count).min(CAPACITY)]
    }

    /// Crosses into a solid.
    #[inline]
    pub fn enter(&mut self, solid: u32) {
        let count = usize::from(self.count);
        if count >= CAPACITY {
            return;
        }
        let place = self.ranks().partition_point(|&s| s <= solid);
        self.solids.copy_within(place..count, place + 1);
        self.solids[place] = solid;
        self.count += 1;
    }

    /// Crosses out of a solid; nothing changes if the point did not lie in it.
    #[inline]
    pub fn leave(&mut self, solid: u32) {
        let count = usize::from(self.count);
        if let Some(place) = self.ranks().iter().position(|&s| s == solid) {
            self.solids.copy_within(place + 1..count, place);
            self.count -= 1;
            // Unused entries are zero, so that equal interiors are equal values.
            self.solids[count - 1] = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solid_of_highest_rank_is_on_top_in_any_order_of_entry() {
        let mut numbers = 0x2545_f491u32;
        let mut random = |n: u32| {
            numbers = numbers.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (numbers >> 16) % n
        };
        for _ in 0..2000 {
            let (mut interior, mut model) = (Interior::OUTSIDE, Vec::new());
            for _ in 0..40 {
                let solid = random(6);
                if random(2) == 0 {
                    if model.len() < CAPACITY {
                        model.push(solid);
                    }
                    interior.enter(solid);
                } else {
                    if let Some(i) = model.iter().position(|&s| s == solid) {
                        model.remove(i);
                    }
                    interior.leave(solid);
                }
                model.sort_unstable();
                assert_eq!(interior.ranks(), model.as_slice());
                assert_eq!(interior.top(), model.last().copied());
            }
        }
    }
}
