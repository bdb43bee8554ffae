//! The 8-bit gamma-encoded pilot image and its Sobel magnitude: the allocation of the founding paper.
//!
//! Kludt et al. found that the temporal variance of a rendered image resembles the Sobel magnitude of a single
//! rendering. The magnitude costs one rendering, the variance fifty. This module follows their steps: clip at white,
//! gamma 2.2, eight bits, Sobel.

use dunkelfeld_film::Plane;

/// The 8-bit image of a linear plane: `round(255 (v / white)^(1/2.2))`, clipped to \[0, 255\].
///
/// `linear` and `white` share any unit (radiance, electrons, DN). The curve is the plain power of the paper, not the
/// piecewise sRGB one. NaN and negative values become 0. If `white` is not a positive number, the brightness is
/// undefined and every pixel becomes black.
pub fn gamma_image(linear: &Plane<f32>, white: f32) -> Plane<u8> {
    let scale = if white > 0.0 && white.is_finite() { 1.0 / f64::from(white) } else { 0.0 };
    // A NaN passes through the clamp and is cast to zero; infinity times a zero scale is such a NaN.
    linear.map(|&v| (255.0 * (f64::from(v) * scale).clamp(0.0, 1.0).powf(1.0 / 2.2)).round() as u8)
}

/// Sobel gradient magnitude [DN per pixel] of an 8-bit image.
///
/// The kernels are those of Sobel and Feldman (1968), `[-1 0 1] x [1 2 1]^T` and its transpose, divided by eight. So a
/// ramp that climbs one DN per pixel has magnitude one, and a step of 255 DN has magnitude 127.5 on both of its sides.
/// At a border, the difference is that of the two pixels beside the border pixel, and the smoothing across it repeats
/// the outermost row or column. So the magnitude of a pixel does not depend on its own value, and neither does its
/// number of samples.
pub fn magnitude(image: &Plane<u8>) -> Plane<f32> {
    let (width, height) = (image.width(), image.height());
    Plane::from_fn(width, height, |x, y| {
        let (left, right) = beside(x, width);
        let (above, below) = beside(y, height);
        let v = |x, y| i32::from(*image.at(x, y));
        let across = |y| v(right, y) - v(left, y);
        let down = |x| v(x, below) - v(x, above);
        let gx = across(y.saturating_sub(1)) + 2 * across(y) + across((y + 1).min(height - 1));
        let gy = down(x.saturating_sub(1)) + 2 * down(x) + down((x + 1).min(width - 1));
        (gx as f32).hypot(gy as f32) / 8.0
    })
}

/// The two coordinates whose difference is taken at `x`: those beside it, or the next two at a border. Never `x` itself
/// if there are three.
fn beside(x: u32, size: u32) -> (u32, u32) {
    match x {
        0 => (1.min(size - 1), 2.min(size - 1)),
        x if x + 1 == size => (size.saturating_sub(3), size.saturating_sub(2)),
        x => (x - 1, x + 1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_pixel_has_influence_on_its_own_magnitude() {
        for (w, h) in [(7, 5), (3, 3)] {
            let image = Plane::from_fn(w, h, |x, y| (x * x * 9 + y * 13 + x * y) as u8);
            let before = magnitude(&image);
            for i in 0..(w * h) as usize {
                let mut other = image.clone();
                other.data_mut()[i] = 255 - other.data()[i];
                assert_eq!(magnitude(&other).data()[i], before.data()[i], "pixel {i} of {w} x {h}");
            }
        }
        for (w, h) in [(1, 1), (2, 1), (1, 9), (2, 2)] {
            assert!(magnitude(&Plane::new(w, h, 77)).data().iter().all(|m| *m == 0.0), "{w} x {h}");
        }
    }

    #[test]
    fn an_impulse_shows_the_kernel() {
        let impulse = Plane::from_fn(7, 7, |x, y| if (x, y) == (3, 3) { 80 } else { 0 });
        let sobel = magnitude(&impulse);
        let (edge, corner) = (20.0, 10.0 * std::f32::consts::SQRT_2);
        let ring = [[corner, edge, corner], [edge, 0.0, edge], [corner, edge, corner]];
        for y in 0..7 {
            for x in 0..7 {
                let inside = (2..5).contains(&x) && (2..5).contains(&y);
                let expected = if inside { ring[y as usize - 2][x as usize - 2] } else { 0.0 };
                assert!((sobel.at(x, y) - expected).abs() < 1e-5, "({x}, {y})");
            }
        }
    }
}
