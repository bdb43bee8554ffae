//! Light from infinitely far away: constant, or an equirectangular image sampled by importance.

use crate::builder::{Environment, EnvironmentSource};
use crate::texture::Image;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Distribution2D;
use dunkelfeld_sampling::warp::{pdf_sphere, sample_sphere};
use std::f32::consts::PI;

/// The compiled environment.
#[derive(Clone, Debug)]
pub(crate) struct EnvironmentLight {
    rotation: [f32; 2],
    source: Source,
    /// Mean radiance over the sphere [W/(m^2 sr)].
    pub(crate) mean: Rgb,
}

#[derive(Clone, Debug)]
enum Source {
    Constant(Rgb),
    Map(Box<Map>),
}

#[derive(Clone, Debug)]
struct Map {
    width: u32,
    height: u32,
    texels: Vec<Rgb>,
    distribution: Distribution2D,
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

    /// A direction with the radiance from there and the density [1/sr].
    #[inline]
    pub(crate) fn sample(&self, u: [f32; 2]) -> (Vec3, Rgb, f32) {
        match &self.source {
            Source::Constant(radiance) => (sample_sphere(u), *radiance, pdf_sphere(Vec3::Z)),
            Source::Map(map) => {
                let (uv, density) = map.distribution.sample_continuous(u);
                let (direction, jacobian) = map_direction(uv);
                (self.to_world(direction), map.radiance(uv), density / jacobian)
            }
        }
    }

    /// The density [1/sr] with which [`Self::sample`] finds a direction.
    #[inline]
    pub(crate) fn pdf(&self, direction: Vec3) -> f32 {
        match &self.source {
            Source::Constant(_) => pdf_sphere(direction),
            Source::Map(map) => {
                let d = self.to_map(direction);
                map.distribution.pdf_continuous(map_coordinates(d)) / jacobian(d.x.hypot(d.z))
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
                // A broken texel must not poison the sums: what is not a radiance counts as dark.
                let clean = |v: f32| if v.is_finite() { v.max(0.0) } else { 0.0 };
                texels.push(scale * Rgb::new(clean(r), clean(g), clean(b)));
            }
        }
        let mut mean = [0f64; 3];
        let mut solid_angle = 0f64;
        // The exact share of a row in the sphere: the difference of the cosines of its edges.
        let cosine = |y: u32| (std::f64::consts::PI * f64::from(y) / f64::from(height)).cos();
        let bands: Vec<f64> = (0..height).map(|y| cosine(y) - cosine(y + 1)).collect();
        for (row, band) in texels.chunks(width as usize).zip(&bands) {
            for t in row {
                for (m, v) in mean.iter_mut().zip(t.to_array()) {
                    *m += band * f64::from(v);
                }
                solid_angle += band;
            }
        }
        let [r, g, b] = mean.map(|m| (m / solid_angle) as f32);
        let weights = texels.iter().enumerate().map(|(i, t)| bands[i / width as usize] * f64::from(t.mean()));
        let distribution = Distribution2D::new(width as usize, height as usize, weights);
        (Self { width, height, texels, distribution }, Rgb::new(r, g, b))
    }

    /// Piecewise constant, like the density: the two match texel by texel, so importance sampling is as good as it gets.
    #[inline]
    fn radiance(&self, [u, v]: [f32; 2]) -> Rgb {
        let x = ((u * self.width as f32) as u32).min(self.width - 1);
        let y = ((v * self.height as f32) as u32).min(self.height - 1);
        self.texels[y as usize * self.width as usize + x as usize]
    }
}

/// Image coordinates of a direction: v = 0 at +y, the centre column looks along -z, u grows to the right (+x).
#[inline]
fn map_coordinates(d: Vec3) -> [f32; 2] {
    let u = 0.5 + d.x.atan2(-d.z) / (2.0 * PI);
    // Not the arc cosine, which loses half of the digits near the poles, where a sun in the zenith would stand.
    let v = d.x.hypot(d.z).atan2(d.y) / PI;
    [u.clamp(0.0, ONE_MINUS), v.clamp(0.0, ONE_MINUS)]
}

/// The Jacobian d(solid angle)/d(u v) = 2 pi^2 sin(theta), kept above zero.
#[inline]
fn jacobian(sin_theta: f32) -> f32 {
    (2.0 * PI * PI * sin_theta).max(1e-12)
}

/// The direction of image coordinates, with the Jacobian of the map.
#[inline]
fn map_direction([u, v]: [f32; 2]) -> (Vec3, f32) {
    let (sin_theta, cos_theta) = (PI * v).sin_cos();
    let (sin_phi, cos_phi) = (2.0 * PI * (u - 0.5)).sin_cos();
    (Vec3::new(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi), jacobian(sin_theta))
}

/// The largest float below one.
const ONE_MINUS: f32 = 1.0 - f32::EPSILON / 2.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::{ImageId, Texels};

    fn map() -> EnvironmentLight {
        let texels: Vec<[f32; 3]> =
            (0..32 * 16).map(|i| [(i % 7) as f32, 1.0, if i == 100 { 500.0 } else { 0.1 }]).collect();
        let image = Image { name: "sky".into(), width: 32, height: 16, texels: Texels::RgbF32(texels) };
        let source = EnvironmentSource::Image { image: ImageId(0), scale: Rgb::splat(2.0) };
        EnvironmentLight::new(&Environment { source, rotation: 0.7 }, &[image])
    }

    #[test]
    fn sampling_and_density_agree_and_integrate_the_map() {
        let light = map();
        let mut sum = [0f64; 2];
        let n = 1024;
        for i in 0..n * n {
            let u = [((i % n) as f32 + 0.5) / n as f32, ((i / n) as f32 + 0.5) / n as f32];
            let (direction, radiance, pdf) = light.sample(u);
            let again = light.pdf(direction);
            assert!((again / pdf - 1.0).abs() < 1e-4, "density {pdf} sampled, {again} looked up, for {u:?}");
            sum[0] += f64::from(radiance.b / pdf);
            sum[1] += 1.0 / f64::from(pdf);
        }
        let count = f64::from(n * n);
        let expected = f64::from(light.mean.b) * 4.0 * std::f64::consts::PI;
        // Midpoint rule; the marginal and conditional steps fall between grid lines, hence 1/n of a bright row.
        assert!((sum[0] / count / expected - 1.0).abs() < 4e-3, "{} against {expected}", sum[0] / count);
        assert!((sum[1] / count / (4.0 * std::f64::consts::PI) - 1.0).abs() < 4e-3);
    }

    #[test]
    fn density_holds_its_digits_up_to_the_poles() {
        // A sun in the zenith: within a thousandth of a radian the density is that of the sampling to a few roundings.
        let texels: Vec<[f32; 3]> = (0..64 * 32).map(|i| [if i < 64 { 1e4 } else { 1.0 }; 3]).collect();
        let image = Image { name: "zenith".into(), width: 64, height: 32, texels: Texels::RgbF32(texels) };
        let source = EnvironmentSource::Image { image: ImageId(0), scale: Rgb::WHITE };
        let light = EnvironmentLight::new(&Environment { source, rotation: 0.3 }, &[image]);
        for i in 0..1000 {
            // The marginal sends u1 below 0.9 to the first row; its first hundredth lies within 1e-3 rad of the pole.
            let u = [(i as f32 * 0.618_034).fract(), i as f32 * 1e-5];
            let (direction, _, pdf) = light.sample(u);
            let again = light.pdf(direction);
            assert!(i == 0 || (again / pdf - 1.0).abs() < 1e-4, "density {pdf} sampled, {again} looked up, for {u:?}");
        }
    }

    #[test]
    fn directions_and_coordinates_are_inverse() {
        for uv in [[0.1, 0.2], [0.5, 0.5], [0.93, 0.8]] {
            let back = map_coordinates(map_direction(uv).0);
            assert!((back[0] - uv[0]).abs() < 1e-5 && (back[1] - uv[1]).abs() < 1e-5);
        }
        assert!((map_direction([0.5, 0.5]).0 - Vec3::NEG_Z).length() < 1e-6);
    }

    #[test]
    fn an_environment_without_light_still_samples() {
        let image =
            Image { name: "night".into(), width: 2, height: 1, texels: Texels::RgbF32(vec![[0.0; 3], [f32::NAN; 3]]) };
        let source = EnvironmentSource::Image { image: ImageId(0), scale: Rgb::WHITE };
        let light = EnvironmentLight::new(&Environment { source, rotation: 0.0 }, &[image]);
        let (d, l, pdf) = light.sample([0.3, 0.6]);
        assert!(d.is_finite() && l.is_black() && pdf.is_finite() && pdf > 0.0);
    }
}
