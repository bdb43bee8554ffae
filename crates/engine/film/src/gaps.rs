//! Fills pixels without samples from their neighbours, for display only and never for a statistic.

use crate::plane::Plane;

/// An image in which each pixel that is not `known` has the mean of the known ones in the smallest block around it.
/// Blocks are squares of 2, 4, 8, ... pixels on a fixed grid (the pull-push of Gortler et al. 1996, without its
/// interpolation). If no pixel is known, the values stay.
///
/// # Panics
/// If the planes differ in size.
pub fn fill_gaps(values: &Plane<[f32; 3]>, known: &Plane<bool>) -> Plane<[f32; 3]> {
    let (width, height) = (values.width(), values.height());
    assert_eq!((width, height), (known.width(), known.height()), "values and what is known of them differ in size");
    let mut levels: Vec<Plane<Block>> = Vec::new();
    while has_gaps(levels.last(), known) && (width.max(height) - 1) >> levels.len() > 0 {
        let next = match levels.last() {
            None => pull(width, height, |x, y| match known.at(x, y) {
                true => Block { sum: values.at(x, y).map(f64::from), count: 1.0 },
                false => Block::default(),
            }),
            Some(finer) => pull(finer.width(), finer.height(), |x, y| *finer.at(x, y)),
        };
        levels.push(next);
    }
    Plane::from_fn(width, height, |x, y| {
        let around = || (1..).zip(&levels).find_map(|(shift, level)| level.at(x >> shift, y >> shift).mean());
        if *known.at(x, y) { *values.at(x, y) } else { around().unwrap_or(*values.at(x, y)) }
    })
}

/// The known values of a block: their sum and their number.
#[derive(Clone, Copy, Default)]
struct Block {
    sum: [f64; 3],
    count: f64,
}

impl Block {
    fn mean(&self) -> Option<[f32; 3]> {
        (self.count > 0.0).then(|| self.sum.map(|s| (s / self.count) as f32))
    }
}

fn has_gaps(level: Option<&Plane<Block>>, known: &Plane<bool>) -> bool {
    match level {
        None => known.data().contains(&false),
        Some(level) => level.data().iter().any(|b| b.count == 0.0),
    }
}

/// The next coarser level: each block joins the four (at the edges fewer) below it.
fn pull(width: u32, height: u32, finer: impl Fn(u32, u32) -> Block) -> Plane<Block> {
    Plane::from_fn(width.div_ceil(2), height.div_ceil(2), |x, y| {
        let mut block = Block::default();
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| (2 * x + dx, 2 * y + dy)) {
            if x < width && y < height {
                let part = finer(x, y);
                block.sum.iter_mut().zip(part.sum).for_each(|(sum, s)| *sum += s);
                block.count += part.count;
            }
        }
        block
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(x: u32, y: u32) -> [f32; 3] {
        [x as f32, y as f32, (x * y) as f32]
    }

    #[test]
    fn gaps_take_the_mean_of_the_smallest_block_with_samples() {
        let values = Plane::from_fn(5, 3, value);
        let all = fill_gaps(&values, &Plane::new(5, 3, true));
        assert_eq!(all, values);
        // (1, 0) is between known neighbours. (4, 2) is alone in its blocks up to the whole image.
        let known = Plane::from_fn(5, 3, |x, y| x < 4 && (x, y) != (1, 0));
        let filled = fill_gaps(&values, &known);
        assert_eq!(*filled.at(1, 0), [1.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0], "mean of (0,0), (0,1) and (1,1)");
        let sums = (0..3).flat_map(|y| (0..4).map(move |x| (x, y))).filter(|&p| p != (1, 0));
        let mean = sums.fold([0.0; 3], |m, (x, y)| [0, 1, 2].map(|c| m[c] + value(x, y)[c] / 11.0));
        filled.at(4, 2).iter().zip(mean).for_each(|(f, m)| assert!((f - m).abs() < 1e-5, "{f} against {m}"));
        for (x, y) in [(0, 0), (3, 2), (2, 1)] {
            assert_eq!(*filled.at(x, y), value(x, y));
        }
    }

    #[test]
    fn one_valid_pixel_fills_an_image_of_any_shape() {
        for (w, h) in [(1, 1), (1, 300), (300, 1), (17, 64), (0, 0)] {
            let values = Plane::new(w, h, [7.0; 3]);
            assert_eq!(fill_gaps(&values, &Plane::new(w, h, false)), values);
            if w > 0 {
                let dark = Plane::from_fn(w, h, |x, y| if (x, y) == (w - 1, h / 2) { [7.0; 3] } else { [0.0; 3] });
                let known = Plane::from_fn(w, h, |x, y| (x, y) == (w - 1, h / 2));
                assert_eq!(fill_gaps(&dark, &known), values);
            }
        }
    }
}
