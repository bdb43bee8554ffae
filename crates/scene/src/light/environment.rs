//! Light from infinitely far away: constant, or an equirectangular image with importance sampling.

use crate::build::builder::{Environment, EnvironmentSource};
use crate::light::sample::Receivers;
use crate::material::texture::Image;
use dunkelfeld_geometry::{Frame, LocalDir, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Distribution2D;
use dunkelfeld_sampling::warp::{pdf_sphere, sample_cosine_hemisphere, sample_sphere};
use std::f32::consts::{FRAC_1_PI, PI};

/// The compiled environment.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct EnvironmentLight {
    rotation: [f32; 2],
    source: Source,
    /// Mean radiance over the sphere [W/(m^2 sr)].
    pub(crate) mean: Rgb,
}

#[derive(Clone, Debug, serde::Serialize)]
enum Source {
    Constant(Rgb),
    Map(Box<Map>),
}

#[derive(Clone, Debug, serde::Serialize)]
struct Map {
    width: u32,
    height: u32,
    texels: Vec<Rgb>,
    /// Distribution over the texels, in proportion to radiance times solid angle.
    distribution: Distribution2D,
    rows: Vec<Row>,
}

/// A row of texels as a band of the sphere.
///
/// In s = sin^2 (half the angle to the nearer pole) the solid angle is uniform (Archimedes). Near the poles s keeps the
/// precision that the cosine loses.
#[derive(Clone, Copy, Debug, serde::Serialize)]
struct Row {
    /// s at the edge nearer to image row 0 and at the other edge.
    s: [f32; 2],
    /// True if the nearer pole is that of +y.
    upper: bool,
    /// Solid angle of the row over its share of the image's area \[sr\].
    jacobian: f32,
}

impl EnvironmentLight {
    /// Compiles an environment; the image index must be valid.
    pub(crate) fn new(environment: &Environment, images: &[Image]) -> Self {
        let (sin, cos) = environment.rotation.sin_cos();
        let (source, mean) = match &environment.source {
            EnvironmentSource::Constant(radiance) => (Source::Constant(*radiance), *radiance),
            EnvironmentSource::Image { image, scale } => {
                let (map, mean) = Map::new(&images[image.0 as usize], *scale);
                (Source::Map(Box::new(map)), mean)
            }
        };
        Self { rotation: [sin, cos], source, mean }
    }

    /// World direction to the image's own direction: rotation about +y.
    #[inline]
    fn to_map(&self, d: Vec3) -> Vec3 {
        let [s, c] = self.rotation;
        Vec3::new(c * d.x - s * d.z, d.y, s * d.x + c * d.z)
    }

    #[inline]
    fn to_world(&self, d: Vec3) -> Vec3 {
        let [s, c] = self.rotation;
        Vec3::new(c * d.x + s * d.z, d.y, c * d.z - s * d.x)
    }

    /// Radiance arriving from a direction.
    #[inline]
    pub(crate) fn radiance(&self, direction: Vec3) -> Rgb {
        match &self.source {
            Source::Constant(radiance) => *radiance,
            Source::Map(map) => map.radiance(map_coordinates(self.to_map(direction))),
        }
    }

    /// A direction with its radiance and the density [1/sr]. If the environment is constant and the surface scatters
    /// light from above only, the directions follow the cosine.
    #[inline]
    pub(crate) fn sample(&self, receiver: &Receivers<f32>, u: [f32; 2]) -> (Vec3, Rgb, f32) {
        match &self.source {
            Source::Constant(radiance) => {
                let direction = if receiver.both_sides {
                    sample_sphere(u)
                } else {
                    let local = sample_cosine_hemisphere(u).normalize();
                    Frame::from_normal(receiver.normal.into()).to_world(LocalDir(local))
                };
                (direction, *radiance, self.pdf(receiver, direction))
            }
            Source::Map(map) => {
                let ([u, v], density) = map.distribution.sample_continuous(u);
                let [x, y] = map.texel(u, v);
                let row = &map.rows[y];
                let direction = row.direction(u, v * map.height as f32 - y as f32);
                (self.to_world(direction), map.texels[y * map.width as usize + x], density / row.jacobian)
            }
        }
    }

    /// The density [1/sr] of a direction in [`Self::sample`].
    #[inline]
    pub(crate) fn pdf(&self, receiver: &Receivers<f32>, direction: Vec3) -> f32 {
        match &self.source {
            Source::Constant(_) if receiver.both_sides => pdf_sphere(direction),
            Source::Constant(_) => direction.dot(receiver.normal.into()).max(0.0) * FRAC_1_PI,
            Source::Map(map) => {
                let [u, v] = map_coordinates(self.to_map(direction));
                map.distribution.pdf_continuous([u, v]) / map.rows[map.texel(u, v)[1]].jacobian
            }
        }
    }
}

impl Map {
    fn new(image: &Image, scale: Rgb) -> (Self, Rgb) {
        let (width, height) = (image.width, image.height);
        let mut texels = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            for x in 0..width {
                let [r, g, b, _] = image.linear_texel(x, y);
                // An invalid texel must not make the sums invalid. Values that are no radiance count as dark.
                let clean = |v: f32| if v.is_finite() { v.max(0.0) } else { 0.0 };
                texels.push(scale * Rgb::new(clean(r), clean(g), clean(b)));
            }
        }
        let rows: Vec<Row> = (0..height).map(|y| Row::new(y, height)).collect();
        let mut mean = [0f64; 3];
        let mut sphere = 0f64;
        for (texels, row) in texels.chunks(width as usize).zip(&rows) {
            let band = f64::from(row.jacobian);
            sphere += band * f64::from(width);
            for t in texels {
                for (m, v) in mean.iter_mut().zip(t.to_array()) {
                    *m += band * f64::from(v);
                }
            }
        }
        let [r, g, b] = mean.map(|m| (m / sphere) as f32);
        let lights = texels.chunks(width as usize).zip(&rows);
        let weights = lights.flat_map(|(t, row)| t.iter().map(|t| f64::from(row.jacobian) * f64::from(t.mean())));
        let distribution = Distribution2D::new(width as usize, height as usize, weights);
        (Self { width, height, texels, distribution, rows }, Rgb::new(r, g, b))
    }

    /// Column and row of image coordinates.
    #[inline]
    fn texel(&self, u: f32, v: f32) -> [usize; 2] {
        let at = |f: f32, n: u32| ((f * n as f32) as usize).min(n as usize - 1);
        [at(u, self.width), at(v, self.height)]
    }

    /// Piecewise constant, like the density. Both agree in every texel, so a sample of a texel has no variance in
    /// radiance over density.
    #[inline]
    fn radiance(&self, [u, v]: [f32; 2]) -> Rgb {
        let [x, y] = self.texel(u, v);
        self.texels[y * self.width as usize + x]
    }
}

impl Row {
    fn new(y: u32, height: u32) -> Self {
        let angle = |y: u32| std::f64::consts::PI * f64::from(y) / f64::from(height);
        let (a, b) = (angle(y), angle(y + 1));
        // The middle row of an odd number of rows counts with the upper half.
        let upper = 2 * y < height;
        let s = [a, b].map(|t| if upper { (0.5 * t).sin() } else { (0.5 * t).cos() }.powi(2) as f32);
        // cos a - cos b, without cancellation.
        let band = 2.0 * (0.5 * (a + b)).sin() * (0.5 * (b - a)).sin();
        Self { s, upper, jacobian: (2.0 * std::f64::consts::PI * band * f64::from(height)) as f32 }
    }

    /// The direction at fraction `t` of the row's solid angle, counted from the edge nearer to image row 0.
    #[inline]
    fn direction(&self, u: f32, t: f32) -> Vec3 {
        let s = (self.s[0] + t * (self.s[1] - self.s[0])).clamp(0.0, 1.0);
        let sin_theta = 2.0 * (s * (1.0 - s)).sqrt();
        let cos_theta = if self.upper { 1.0 - 2.0 * s } else { 2.0 * s - 1.0 };
        let (sin_phi, cos_phi) = (2.0 * PI * (u - 0.5)).sin_cos();
        Vec3::new(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi)
    }
}

/// Image coordinates of a direction: v = 0 at +y, the centre column has the direction -z, u grows to the right (+x).
#[inline]
fn map_coordinates(d: Vec3) -> [f32; 2] {
    let u = 0.5 + d.x.atan2(-d.z) / (2.0 * PI);
    // The arc cosine would lose half of the digits near the poles, for example for a sun at the zenith.
    let v = d.x.hypot(d.z).atan2(d.y) / PI;
    [u.clamp(0.0, ONE_MINUS), v.clamp(0.0, ONE_MINUS)]
}

/// The largest float below one.
const ONE_MINUS: f32 = 1.0 - f32::EPSILON / 2.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::texture::{ImageId, Texels};

    /// The density of an image does not depend on the receiver.
    fn any() -> Receivers<f32> {
        Receivers::single(Vec3::ZERO, Vec3::Z, false)
    }

    fn map() -> EnvironmentLight {
        let texels: Vec<[f32; 3]> =
            (0..32 * 16).map(|i| [(i % 7) as f32, 1.0, if i == 100 { 500.0 } else { 0.1 }]).collect();
        let image = Image { name: "sky".into(), width: 32, height: 16, texels: Texels::RgbF32(texels).into() };
        let source = EnvironmentSource::Image { image: ImageId(0), scale: Rgb::splat(2.0) };
        EnvironmentLight::new(&Environment { source, rotation: 0.7 }, &[image])
    }

    #[test]
    fn sampling_and_density_agree_and_integrate_the_map() {
        let light = map();
        let mut sum = [0f64; 2];
        let n = 1024;
        let mut off = 0;
        for i in 0..n * n {
            let u = [((i % n) as f32 + 0.5) / n as f32, ((i / n) as f32 + 0.5) / n as f32];
            let (direction, radiance, pdf) = light.sample(&any(), u);
            // A direction on the edge of a texel may be rounded into the next one.
            off += u32::from((light.pdf(&any(), direction) / pdf - 1.0).abs() > 1e-4);
            sum[0] += f64::from(radiance.b / pdf);
            sum[1] += 1.0 / f64::from(pdf);
        }
        assert!(off < 100, "{off} densities differ");
        let count = f64::from(n * n);
        let expected = f64::from(light.mean.b) * 4.0 * std::f64::consts::PI;
        // Midpoint rule; the marginal and conditional steps fall between grid lines, hence 1/n of a bright row.
        assert!((sum[0] / count / expected - 1.0).abs() < 4e-3, "{} against {expected}", sum[0] / count);
        assert!((sum[1] / count / (4.0 * std::f64::consts::PI) - 1.0).abs() < 4e-3);
    }

    #[test]
    fn the_density_is_that_of_the_light_everywhere_and_flat_up_to_both_poles() {
        // A grey map: the density is radiance over the total, texel by texel, whatever the latitude.
        for height in [1, 2, 5, 32] {
            let texels = (0..2 * height * height).map(|i| [1.0 + (i % 5) as f32; 3]).collect();
            let image = Image { name: "grey".into(), width: 2 * height, height, texels: Texels::RgbF32(texels).into() };
            let source = EnvironmentSource::Image { image: ImageId(0), scale: Rgb::WHITE };
            let light = EnvironmentLight::new(&Environment { source, rotation: 0.3 }, &[image]);
            let total = 4.0 * PI * light.mean.g;
            let near_poles = [1.0f32, -1.0].into_iter().flat_map(|y| {
                [0.0, 1e-30, 1e-12, 1e-7, 1e-4, 0.02].map(|r| Vec3::new(0.6 * r, y, -0.8 * r).normalize())
            });
            for d in near_poles.chain([Vec3::X, Vec3::new(0.3, -0.2, 0.4).normalize()]) {
                let (pdf, want) = (light.pdf(&any(), d), light.radiance(d).g / total);
                assert!((pdf / want - 1.0).abs() < 1e-4, "{pdf} instead of {want} toward {d} for height {height}");
            }
        }
    }

    #[test]
    fn a_bright_texel_at_the_zenith_is_sampled_there() {
        // The first row of 4096 is a cap of 7.7e-4 rad that holds nearly all light. Its samples lie in it and are
        // uniform: half of them within the angle that halves its solid angle, 1 / sqrt 2 of the whole.
        let (width, height) = (16, 4096);
        let texels: Vec<[f32; 3]> = (0..width * height).map(|i| [if i < width { 1e7 } else { 1e-3 }; 3]).collect();
        let image = Image { name: "zenith".into(), width, height, texels: Texels::RgbF32(texels).into() };
        let source = EnvironmentSource::Image { image: ImageId(0), scale: Rgb::WHITE };
        let light = EnvironmentLight::new(&Environment { source, rotation: 0.3 }, &[image]);
        let cap = PI / height as f32;
        let (mut inner, n) = (0, 4096);
        for i in 0..n {
            let u = [(i as f32 * 0.618_034).fract(), (i as f32 + 0.5) / n as f32 * 0.99];
            let (d, radiance, pdf) = light.sample(&any(), u);
            let angle = d.x.hypot(d.z).atan2(d.y);
            assert!(angle <= cap * 1.0001 && radiance.g == 1e7, "{d} has {radiance:?}");
            assert!((pdf * 4.0 * PI * light.mean.g / 1e7 - 1.0).abs() < 1e-4);
            inner += i32::from(angle < cap * std::f32::consts::FRAC_1_SQRT_2);
        }
        let share = f64::from(inner) / f64::from(n);
        assert!((share - 0.5).abs() < 0.01, "{share} of the samples lie in the inner half");
    }

    #[test]
    fn directions_and_coordinates_are_inverse() {
        let rows: Vec<Row> = (0..64).map(|y| Row::new(y, 64)).collect();
        for [u, v] in [[0.1, 0.203_125], [0.5, 0.5], [0.93, 0.781_25], [0.4, 0.0], [0.7, 1.0 - 1.0 / 64.0]] {
            // On the edge between two rows the fraction of solid angle and that of the angle agree.
            let row = (v * 64.0) as usize;
            let back = map_coordinates(rows[row].direction(u, 0.0));
            assert!((v == 0.0 || (back[0] - u).abs() < 1e-5) && (back[1] - v).abs() < 1e-5, "{back:?} for {u}, {v}");
        }
        assert!((rows[32].direction(0.5, 0.0) - Vec3::NEG_Z).length() < 1e-6);
    }

    #[test]
    fn a_black_environment_is_sampled() {
        let image = Image {
            name: "night".into(),
            width: 2,
            height: 1,
            texels: Texels::RgbF32(vec![[0.0; 3], [f32::NAN; 3]]).into(),
        };
        let source = EnvironmentSource::Image { image: ImageId(0), scale: Rgb::WHITE };
        let light = EnvironmentLight::new(&Environment { source, rotation: 0.0 }, &[image]);
        let (d, l, pdf) = light.sample(&any(), [0.3, 0.6]);
        assert!(d.is_finite() && l.is_black() && pdf.is_finite() && pdf > 0.0);
    }
}
