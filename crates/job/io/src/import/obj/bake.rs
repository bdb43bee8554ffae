//! Maps of OBJ without an equivalent in our materials, converted texel by texel: bumps and Phong exponents.

use dunkelfeld_scene::{Image, Texels};

/// Relief of a bump map of strength (`-bm`) 1: white is higher than black by this part of the image's width. MTL
/// defines no unit for bumps. With a hundredth of the width, the usual strengths of about 1 give a similar image as in
/// common viewers, at any resolution.
pub(super) const RELIEF: f32 = 0.01;

/// Roughness of a Blinn-Phong exponent: the GGX alpha that matches its highlight is sqrt(2 / (n + 2)) (Walter et al. 2007,
/// for the Beckmann width), and roughness is the square root of alpha (Burley 2012).
pub(super) fn roughness_of_exponent(exponent: f32) -> f32 {
    (2.0 / (exponent.max(0.0) + 2.0)).sqrt().sqrt()
}

/// A tangent-space normal map from heights, the mean of red, green and blue, by central differences on square texels. At the borders it repeats like the image, or uses the texels of the edge if `clamp` is
/// set.
pub(super) fn normals_of_heights(image: &Image, strength: f32, clamp: bool) -> Image {
    let (width, height) = (image.width as usize, image.height as usize);
    let step = |i: usize, forward: bool, size: usize| match (forward, clamp) {
        (true, true) => (i + 1).min(size - 1),
        (true, false) => (i + 1) % size,
        (false, true) => i.saturating_sub(1),
        (false, false) => (i + size - 1) % size,
    };
    let at = |x: usize, y: usize| {
        let [r, g, b, _] = texel(image, y * width + x);
        (r + g + b) / 3.0
    };
    let relief = strength * RELIEF * width as f32;
    let texels = (0..width * height).map(|i| {
        let (x, y) = (i % width, i / width);
        let right = 0.5 * (at(step(x, true, width), y) - at(step(x, false, width), y));
        let down = 0.5 * (at(x, step(y, true, height)) - at(x, step(y, false, height)));
        // The surface rises to the right and downwards; green points up in the image.
        let (nx, ny) = (-relief * right, relief * down);
        let scale = 1.0 / (nx * nx + ny * ny + 1.0).sqrt();
        [nx * scale, ny * scale, scale].map(|v| to_u16(0.5 * v + 0.5))
    });
    Image {
        name: format!("{} (normals)", image.name),
        width: image.width,
        height: image.height,
        texels: Texels::Rgb16(texels.collect()).into(),
    }
}

/// Is this a normal map, although it was given as a bump map? Most texels are coloured and encode unit vectors that point
/// up; heights are grey.
pub(super) fn looks_like_normals(image: &Image) -> bool {
    let count = image.width as usize * image.height as usize;
    let stride = (count / 4096).max(1);
    let (mut unit, mut coloured, mut seen) = (0, 0, 0);
    for i in (0..count).step_by(stride) {
        let [r, g, b, _] = texel(image, i);
        let length = [r, g, b].iter().map(|v| (2.0 * v - 1.0).powi(2)).sum::<f32>().sqrt();
        seen += 1;
        unit += usize::from((length - 1.0).abs() < 0.2 && b > 0.5);
        coloured += usize::from(r.max(g).max(b) - r.min(g).min(b) > 0.1);
    }
    10 * unit >= 9 * seen && 2 * coloured >= seen
}

/// A roughness map, of one channel, from a map of exponents in the red channel: `factor` is the exponent of white.
pub(super) fn roughness_of_exponents(image: &Image, factor: f32) -> Image {
    let values =
        (0..image.width as usize * image.height as usize).map(|i| roughness_of_exponent(factor * texel(image, i)[0]));
    let texels = if image.texels.is_float() {
        Texels::GrayF32(values.map(|v| [v]).collect())
    } else {
        Texels::Gray16(values.map(|v| [to_u16(v)]).collect())
    };
    let name = format!("{} (roughness)", image.name);
    Image { name, width: image.width, height: image.height, texels: texels.into() }
}

/// Is the coverage of any texel below one?
pub(super) fn has_alpha(image: &Image) -> bool {
    let covered = |i: usize| image.texels.get(i).is_none_or(|t| t[3] == 1.0);
    matches!(image.texels.channels(), 2 | 4) && !(0..image.texels.len()).all(covered)
}

/// A texel as stored, integers scaled to \[0, 1\]; opaque white if the image has fewer texels than its size.
fn texel(image: &Image, i: usize) -> [f32; 4] {
    image.texels.get(i).unwrap_or([1.0; 4])
}

/// Rounds; the cast saturates, so values outside \[0, 1\] (and NaN) are safe.
fn to_u16(v: f32) -> u16 {
    (v * 65535.0 + 0.5) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: u32, height: u32, f: impl Fn(u32, u32) -> f32) -> Image {
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| [f(x, y); 3]).collect();
        Image { name: "g".into(), width, height, texels: Texels::RgbF32(texels).into() }
    }

    fn normal(image: &Image, i: usize) -> [f32; 3] {
        let [x, y, z, _] = texel(image, i).map(|v| 2.0 * v - 1.0);
        [x, y, z]
    }

    /// A plane that rises by a over the width has the normal (-relief a, 0, 1), normalised. The normal of a plane that
    /// rises to the top of the image has a negative y.
    #[test]
    fn a_ramp_of_heights_becomes_its_normal() {
        for (ramp, lean) in [
            (grey(64, 32, |x, _| x as f32 / 64.0), [-1.0, 0.0]),
            (grey(64, 32, |_, y| 1.0 - y as f32 / 64.0), [0.0, -1.0]),
        ] {
            let strength = 50.0;
            let normals = normals_of_heights(&ramp, strength, true);
            let slope = strength * RELIEF;
            let length = (slope * slope + 1.0_f32).sqrt();
            let n = normal(&normals, 16 * 64 + 30);
            for (got, want) in n.iter().zip([lean[0] * slope / length, lean[1] * slope / length, 1.0 / length]) {
                assert!((got - want).abs() < 1e-4, "{n:?}, lean {lean:?}");
            }
            assert!(looks_like_normals(&normals));
            assert!(!looks_like_normals(&ramp));
        }
    }

    #[test]
    fn borders_repeat_or_hold() {
        let ramp = grey(8, 1, |x, _| x as f32 / 8.0);
        let held = normal(&normals_of_heights(&ramp, 100.0, true), 0);
        let repeated = normal(&normals_of_heights(&ramp, 100.0, false), 0);
        assert!(held[0] < 0.0 && repeated[0] > 0.0, "{held:?} {repeated:?}");
        let single = normals_of_heights(&grey(1, 1, |_, _| 0.3), 1.0, false);
        assert!(normal(&single, 0)[2] > 0.999);
    }

    #[test]
    fn exponents_span_rough_to_smooth() {
        assert_eq!(roughness_of_exponent(0.0), 1.0);
        assert!((roughness_of_exponent(6.0).powi(2) - 0.5).abs() < 1e-6);
        assert!(roughness_of_exponent(1e6) < 0.04);
        let image = roughness_of_exponents(&grey(1, 1, |_, _| 0.5), 12.0);
        assert_eq!(texel(&image, 0)[0], roughness_of_exponent(6.0));
    }
}
