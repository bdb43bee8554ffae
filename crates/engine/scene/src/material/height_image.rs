//! Height images: the slopes of a user's grey image.

use crate::material::finish::PLASTIC;
use crate::material::texture::{Image, Texture};
use dunkelfeld_geometry::{Vec2, Vec3};

/// Heights of an image: black is lowest. Between texels they are cubic B-splines, whose slopes have no steps.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct HeightImage {
    /// The image, linear. Its filter has no effect. Without a texture the surface is flat.
    pub texture: Option<Texture>,
    /// Height of white \[m\], above 0.
    pub depth: f32,
    /// Width of one image \[m\], above 0: it is repeated along the axes of the object, in three planes. `None` uses the texture
    /// coordinates of the mesh.
    pub size: Option<f32>,
}

impl HeightImage {
    pub(crate) fn is_valid(&self) -> bool {
        let is_length = |v: f32| v > 0.0 && v.is_finite();
        is_length(self.depth) && self.size.is_none_or(is_length)
    }
}

/// A place of an image on a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Projection {
    /// Texture coordinates.
    pub(crate) uv: Vec2,
    /// Their tangential gradients [1/m].
    pub(crate) gradients: [Vec3; 2],
    /// Share of the image in the slope.
    pub(crate) weight: f32,
}

/// A height image with all values precomputed that do not depend on the place.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct ImageRelief {
    pub(crate) texture: Texture,
    depth: f32,
    /// Width and height of one image on the planes of the object \[m\].
    size: Option<Vec2>,
    visible: VisibleArea,
}

impl ImageRelief {
    /// `None` for an image without a texture.
    pub(crate) fn new(height: &HeightImage, images: &[Image]) -> Option<Self> {
        let texture = height.texture?;
        let image = images.get(texture.image.0 as usize)?;
        let size = height.size.map(|size| Vec2::new(size, size * image.height as f32 / image.width as f32));
        let mut relief = Self { texture, depth: height.depth, size, visible: VisibleArea::default() };
        let places = (0..SLOPES).map(|i| Vec2::from(PLASTIC.map(|step| (i as f64 * step).fract() as f32)));
        relief.visible = VisibleArea::new(&places.map(|uv| relief.slope(uv, images)).collect::<Vec<_>>());
        Some(relief)
    }

    /// Change of the height \[m\] per texture coordinate.
    fn slope(&self, uv: Vec2, images: &[Image]) -> Vec2 {
        self.texture.gradient(images, uv) * self.depth
    }

    /// The places of the image at a point \[m\] with a unit normal in the frame of the object. `by_uv` is that of the texture
    /// coordinates of the mesh.
    ///
    /// The slopes of three projections are mixed, not their heights: these belong to different planes (surface gradients,
    /// Mikkelsen 2020).
    pub(crate) fn projections(&self, point: Vec3, normal: Vec3, by_uv: impl FnOnce() -> Projection) -> [Projection; 3] {
        let Some(size) = self.size else {
            let none = Projection { uv: Vec2::ZERO, gradients: [Vec3::ZERO; 2], weight: 0.0 };
            return [by_uv(), none, none];
        };
        let shares = (normal * normal - LEAST_SHARE).max(Vec3::ZERO);
        let shares = shares * shares;
        [(0, 1, 2), (1, 2, 0), (2, 0, 1)].map(|(axis, u, v)| {
            let gradients = [Vec3::AXES[u] / size.x, -Vec3::AXES[v] / size.y];
            Projection {
                uv: Vec2::from(gradients.map(|gradient| gradient.dot(point))),
                gradients: gradients.map(|gradient| gradient - normal * normal.dot(gradient)),
                weight: shares[axis] / shares.element_sum(),
            }
        })
    }

    /// The slope at projections, a tangent vector along the steepest ascent, and its visible area over the mean, as in
    /// [`Slopes`](crate::material::finish::Slopes), for a viewer in a direction over its cosine.
    pub(crate) fn seen(&self, images: &[Image], projections: &[Projection], view: Vec3) -> (Vec3, f32) {
        let (mut total, mut mean) = (Vec3::ZERO, 1.0);
        for &Projection { uv, gradients: [u, v], weight } in projections.iter().filter(|p| p.weight > 0.0) {
            let slope = self.slope(uv, images) * weight;
            total += u * slope.x + v * slope.y;
            mean += self.visible.mean(Vec2::new(u.dot(view), v.dot(view)) * weight) - 1.0;
        }
        (total, (1.0 - total.dot(view)).max(0.0) / mean)
    }
}

/// A plane has no share where the square of its cosine is below this one, half of the least that the largest can be.
const LEAST_SHARE: f32 = 1.0 / 6.0;
/// Number of slopes that stand for an image.
const SLOPES: usize = 1 << 14;
/// Directions and steps of the table of visible areas.
const DIRECTIONS: usize = 128;
const STEPS: usize = 32;

/// The mean of max(0, 1 - s a) over the slopes s of an image, for vectors a.
#[derive(Clone, Debug, Default, serde::Serialize)]
struct VisibleArea {
    /// Roots of the mean squares of the slopes along both axes.
    deviations: Vec2,
    /// By direction and step x = d / (1 + d), where d is the length of a times the deviations: the mean times 1 - x.
    table: Vec<f32>,
}

impl VisibleArea {
    fn new(slopes: &[Vec2]) -> Self {
        let mean_square =
            |of: fn(&Vec2) -> f32| slopes.iter().map(|s| f64::from(of(s)).powi(2)).sum::<f64>() / slopes.len() as f64;
        let squares = [mean_square(|s| s.x), mean_square(|s| s.y)];
        let deviations = Vec2::from(squares.map(|square| (square.sqrt() as f32).max(f32::MIN_POSITIVE)));
        let slopes: Vec<Vec2> = slopes.iter().map(|s| s / deviations).collect();
        let entry = |i: usize| {
            let x = (i % (STEPS + 1)) as f32 / STEPS as f32;
            let a = direction(i / (STEPS + 1)) * x;
            let sum: f64 = slopes.iter().map(|s| f64::from((1.0 - x - s.dot(a)).max(0.0))).sum();
            (sum / slopes.len() as f64) as f32
        };
        Self { deviations, table: (0..DIRECTIONS * (STEPS + 1)).map(entry).collect() }
    }

    fn mean(&self, a: Vec2) -> f32 {
        let a = a * self.deviations;
        let distance = a.length();
        let x = distance / (1.0 + distance);
        let [turn, step] = [quadrants(a) * (DIRECTIONS / 4) as f32, x * STEPS as f32];
        let [from, low] = [(turn as usize).min(DIRECTIONS - 1), (step as usize).min(STEPS - 1)];
        let along = |direction: usize| {
            let row = &self.table[direction % DIRECTIONS * (STEPS + 1)..][low..];
            row[0] + (row[1] - row[0]) * (step - low as f32)
        };
        (along(from) + (along(from + 1) - along(from)) * (turn - from as f32)) * (1.0 + distance)
    }
}

/// The direction of a vector from 0 to 4, along the sides of a square: without transcendental functions, which differ between
/// machines.
fn quadrants(Vec2 { x, y }: Vec2) -> f32 {
    let sum = (x.abs() + y.abs()).max(f32::MIN_POSITIVE);
    match (x >= 0.0, y >= 0.0) {
        (true, true) => y / sum,
        (false, true) => 1.0 - x / sum,
        (false, false) => 2.0 - y / sum,
        (true, false) => 3.0 + x / sum,
    }
}

/// The unit vector of a direction of the table, the inverse of [`quadrants`].
fn direction(number: usize) -> Vec2 {
    const QUARTER: usize = DIRECTIONS / 4;
    let t = (number % QUARTER) as f32 / QUARTER as f32;
    let first = Vec2::new(1.0 - t, t).normalize();
    (0..number / QUARTER).fold(first, |v, _| v.perp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::texture::{ColorEncoding, ImageId, Texels};
    use std::f64::consts::{PI, TAU};

    /// A wave of amplitude a and length L has the slope 2 pi a / L cos(2 pi x / L), of variance (2 pi a / L)^2 / 2. The spline
    /// over N texels of a length multiplies it by sinc(1 / N)^4.
    #[test]
    fn a_wave_has_its_slopes() {
        const N: u32 = 48;
        let (depth, length) = (40e-6, 2e-3);
        let texel = |i: u32| [(32767.5 * (1.0 + ((f64::from(i) + 0.5) / f64::from(N) * TAU).sin())).round() as u16];
        let texels = Texels::Gray16((0..3).flat_map(|_| (0..N).map(texel)).collect());
        let images = [Image { name: String::new(), width: N, height: 3, texels: texels.into() }];
        let texture = Some(Texture::new(ImageId(0), ColorEncoding::Linear));
        let size = Some(length as f32);
        let relief = ImageRelief::new(&HeightImage { texture, depth: depth as f32, size }, &images).expect("a texture");
        let sinc = (PI / f64::from(N)).sin() / (PI / f64::from(N));
        let steepest = TAU * 0.5 * depth / length * sinc.powi(4);
        let (mut squares, n) = (0.0, 4096);
        for i in 0..n {
            let x = length * 7.0 * (f64::from(i) * 0.618_034).fract();
            let point = Vec3::new(x as f32, 1e-4 * i as f32, 0.3);
            let places = relief.projections(point, Vec3::Z, || panic!("by size"));
            let (slope, _) = relief.seen(&images, &places, Vec3::Z);
            let stated = steepest * (x / length * TAU).cos();
            // Heights have 16 bits, and places have f32.
            let error = (f64::from(slope.x) - stated).abs().max(f64::from(slope.y.abs()));
            assert!(error < 1e-3 * steepest, "{i}: {slope}, stated {stated}");
            squares += f64::from(slope.x).powi(2) / f64::from(n);
        }
        assert!((squares / (0.5 * steepest * steepest) - 1.0).abs() < 1e-3, "{squares}");
    }

    /// On the plane between two axes the slopes of both projections have equal parts, and the gradients lie in the plane.
    #[test]
    fn projections_share_an_oblique_surface() {
        let images = [Image { name: String::new(), width: 1, height: 1, texels: Texels::Gray8(vec![[0]]).into() }];
        let texture = Some(Texture::new(ImageId(0), ColorEncoding::Linear));
        let relief = ImageRelief::new(&HeightImage { texture, depth: 1.0, size: Some(0.5) }, &images).expect("texture");
        let normal = Vec3::new(1.0, 0.0, 1.0).normalize();
        let places = relief.projections(Vec3::ONE, normal, || panic!("by size"));
        assert_eq!(places.map(|p| p.weight), [0.5, 0.0, 0.5]);
        let gradients = places.iter().flat_map(|p| p.gradients);
        assert!(gradients.into_iter().all(|gradient| gradient.dot(normal).abs() < 1e-6));
    }

    /// The table of areas against sums over the slopes, up to nearly the plane.
    #[test]
    fn visible_areas_are_those_of_the_slopes() {
        let slope =
            |i: u32| Vec2::new(((i * 37) % 101) as f32 / 400.0 - 0.1, if i.is_multiple_of(9) { 0.8 } else { -0.1 });
        let slopes: Vec<Vec2> = (0..909).map(slope).collect();
        let area = VisibleArea::new(&slopes);
        for k in 0..200 {
            let (cos, sin) = dunkelfeld_lanes::cos_sin_of_turn::<f32>((k as f32 * 0.618).fract());
            let a = Vec2::new(cos, sin) * (0.05 * 1.04f32.powi(k));
            let mean = slopes.iter().map(|s| (1.0 - s.dot(a)).max(0.0)).sum::<f32>() / slopes.len() as f32;
            assert!((area.mean(a) / mean - 1.0).abs() < 0.01, "{a}: {} against {mean}", area.mean(a));
        }
    }
}
