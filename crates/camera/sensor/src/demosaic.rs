//! Interpolation of a mosaic to three channels for display: gradient-corrected linear interpolation.
//!
//! H. S. Malvar, L. He, R. Cutler, *High-quality linear interpolation for demosaicing of Bayer-patterned color images*,
//! ICASSP 2004. A missing colour of a pixel is the mean of the pixels around it with that colour. The Laplacian of the
//! pixel's own colour corrects the mean, because colours mostly rise and fall together. No measurement uses the result.

use dunkelfeld_film::Plane;

use crate::efficiency::{BayerPattern, FilterColor};

/// Reach of the kernels \[pixels\].
const REACH: usize = 2;

/// Red, green and blue of every pixel of a mosaic. Beyond the edge the image is mirrored at its first and last pixels,
/// which keeps the pattern. Overshoot is not clipped.
pub(crate) fn demosaic(mosaic: &Plane<f32>, pattern: BayerPattern) -> Plane<[f32; 3]> {
    let (width, height) = (mosaic.width() as usize, mosaic.height() as usize);
    let stride = width + 2 * REACH;
    let columns: Vec<usize> = (0..stride).map(|x| mirrored(x, width)).collect();
    let mut padded = Vec::with_capacity(stride * (height + 2 * REACH));
    for y in 0..height + 2 * REACH {
        let start = mirrored(y, height) * width;
        padded.extend(columns.iter().map(|x| mosaic.data().get(start + x).copied().unwrap_or(0.0)));
    }
    Plane::from_fn(mosaic.width(), mosaic.height(), |x, y| {
        let middle = (y as usize + REACH) * stride + x as usize + REACH;
        let near = Neighbours { padded: &padded, stride, middle };
        let own = near.own();
        match pattern.color_at(x, y) {
            FilterColor::Red => [own, near.green(), near.opposite()],
            FilterColor::Blue => [near.opposite(), near.green(), own],
            // The red pixels beside a green pixel lie in its row or in its column. The blue ones lie in the other
            // direction.
            FilterColor::Green if pattern.color_at(x + 1, y) == FilterColor::Red => {
                [near.beside(1, stride), own, near.beside(stride, 1)]
            }
            FilterColor::Green => [near.beside(stride, 1), own, near.beside(1, stride)],
        }
    })
}

/// The coordinate in the image for a coordinate in the padded image.
fn mirrored(padded: usize, size: usize) -> usize {
    let last = size.saturating_sub(1);
    let beyond = |excess: usize| if last == 0 { 0 } else { excess % (2 * last) };
    let at = if padded < REACH { beyond(REACH - padded) } else { beyond(padded - REACH) };
    if at > last { 2 * last - at } else { at }
}

/// A pixel of the padded image, and its neighbours.
struct Neighbours<'a> {
    padded: &'a [f32],
    stride: usize,
    middle: usize,
}

impl Neighbours<'_> {
    fn own(&self) -> f32 {
        self.padded[self.middle]
    }

    /// The sum of the two pixels at a distance.
    #[inline]
    fn pair(&self, distance: usize) -> f32 {
        self.padded[self.middle - distance] + self.padded[self.middle + distance]
    }

    fn diagonal(&self) -> f32 {
        self.pair(self.stride + 1) + self.pair(self.stride - 1)
    }

    /// Green at a red or blue pixel (alpha = 1/2).
    fn green(&self) -> f32 {
        let (near, far) = (self.pair(1) + self.pair(self.stride), self.pair(2) + self.pair(2 * self.stride));
        (4.0 * self.own() + 2.0 * near - far) / 8.0
    }

    /// Blue at a red pixel, or red at a blue one (gamma = 3/4).
    fn opposite(&self) -> f32 {
        let far = self.pair(2) + self.pair(2 * self.stride);
        (6.0 * self.own() + 2.0 * self.diagonal() - 1.5 * far) / 8.0
    }

    /// At a green pixel, the colour of the neighbours in the direction `along` (beta = 5/8).
    fn beside(&self, along: usize, across: usize) -> f32 {
        let own = 5.0 * self.own() + 4.0 * self.pair(along);
        (own - self.diagonal() - self.pair(2 * along) + 0.5 * self.pair(2 * across)) / 8.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mosaic(width: u32, height: u32, pattern: BayerPattern, rgb: impl Fn(u32, u32) -> [f32; 3]) -> Plane<f32> {
        Plane::from_fn(width, height, |x, y| rgb(x, y)[pattern.color_at(x, y) as usize])
    }

    #[test]
    fn a_colour_without_structure_stays_as_it_is_up_to_the_edge_and_in_the_smallest_images() {
        for pattern in BayerPattern::ALL {
            for (width, height) in [(1, 1), (2, 1), (1, 3), (2, 2), (3, 5), (8, 8)] {
                let got = demosaic(&mosaic(width, height, pattern, |_, _| [0.5; 3]), pattern);
                assert!(got.data().iter().all(|v| *v == [0.5; 3]), "{width} x {height}: {got:?}");
            }
            let got = demosaic(&mosaic(6, 4, pattern, |_, _| [0.25, 0.5, 1.0]), pattern);
            assert!(got.data().iter().all(|v| *v == [0.25, 0.5, 1.0]), "{}: {got:?}", pattern.name());
        }
        assert!(demosaic(&Plane::new(0, 0, 0.0), BayerPattern::Rggb).data().is_empty());
    }

    /// Values of another implementation of the paper, `demosaicing_CFA_Bayer_Malvar2004` of the Python package
    /// colour-demosaicing, on an irregular image.
    #[test]
    fn an_implementation_of_others_agrees() {
        let raw = Plane::from_fn(9, 8, |x, y| ((37 * x * x + 91 * y + 13 * x * y) % 101) as f32);
        let red = [[16.4375, 35.375, 16.0], [36.25, 11.0, 24.0625], [26.5, 45.0, 38.6875], [53.0, 47.125, 66.0625]];
        let green = [[41.25, 16.0, 29.0625], [11.4375, 30.375, 11.0], [45.0, 39.125, 58.0625], [34.5, 53.0, 46.6875]];
        let swapped = |v: [[f32; 3]; 4]| v.map(|[r, g, b]| [b, g, r]);
        for (pattern, expected) in [
            (BayerPattern::Rggb, red),
            (BayerPattern::Bggr, swapped(red)),
            (BayerPattern::Grbg, green),
            (BayerPattern::Gbrg, swapped(green)),
        ] {
            let got = demosaic(&raw, pattern);
            for ((x, y), expected) in [(3, 3), (4, 3), (3, 4), (4, 4)].into_iter().zip(expected) {
                assert_eq!(*got.at(x, y), expected, "{} at ({x}, {y})", pattern.name());
            }
        }
    }
}
