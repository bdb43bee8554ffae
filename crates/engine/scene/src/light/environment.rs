//! Light from infinitely far away: constant, or an equirectangular image with importance sampling.

use crate::build::builder::{Environment, EnvironmentSource};
use crate::light::sample::Receivers;
use crate::material::texture::Image;
use dunkelfeld_lanes::{Frame, Lanes, MAX_WIDTH, Mask, Real, V3, atan2, cos_sin_of_angle, cos_sin_of_turn};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Distribution2D;
use dunkelfeld_sampling::warp::lanes::{sample_cosine_hemisphere, sample_sphere};
use std::f32::consts::{FRAC_1_PI, PI, TAU};

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
    /// 1 if the nearer pole is that of +y, else -1.
    side: f32,
    /// Solid angle of the row over its share of the image's area \[sr\].
    jacobian: f32,
}

impl EnvironmentLight {
    /// Compiles an environment; the image index must be valid.
    pub(crate) fn new(environment: &Environment, images: &[Image]) -> Self {
        let (cos, sin) = cos_sin_of_angle(environment.rotation);
        let (source, mean) = match &environment.source {
            EnvironmentSource::Constant(radiance) => (Source::Constant(*radiance), *radiance),
            EnvironmentSource::Image { image, scale } => {
                let (map, mean) = Map::new(&images[image.0 as usize], *scale);
                (Source::Map(Box::new(map)), mean)
            }
        };
        Self { rotation: [sin, cos], source, mean }
    }

    /// World directions to directions of the image: rotation about +y.
    #[inline(always)]
    fn to_map<F: Lanes>(&self, d: V3<F>) -> V3<F> {
        let [s, c] = self.rotation;
        V3::new(d.x * c - d.z * s, d.y, d.x * s + d.z * c)
    }

    #[inline(always)]
    fn to_world<F: Lanes>(&self, d: V3<F>) -> V3<F> {
        let [s, c] = self.rotation;
        V3::new(d.x * c + d.z * s, d.y, d.z * c - d.x * s)
    }

    /// Radiance arriving from directions.
    #[inline(always)]
    pub(crate) fn radiance<F: Lanes>(&self, direction: V3<F>) -> Rgb<F> {
        let token = direction.x.token();
        match &self.source {
            Source::Constant(radiance) => Rgb::in_lanes(token, *radiance),
            Source::Map(map) => {
                let ([u, v], mut texels) = (map_coordinates(self.to_map(direction)), [Rgb::BLACK; MAX_WIDTH]);
                let (u, v) = (u.to_array(), v.to_array());
                for lane in 0..F::WIDTH {
                    texels[lane] = map.radiance(map.texel(u[lane], v[lane]));
                }
                Rgb::from_lanes(token, &texels)
            }
        }
    }

    /// Directions with their radiance and the density [1/sr]. If the environment is constant and the surface scatters
    /// light from above only, the directions follow the cosine.
    #[inline(always)]
    pub(crate) fn sample<F: Lanes>(&self, receivers: &Receivers<F>, u: [F; 2]) -> (V3<F>, Rgb<F>, F) {
        let token = u[0].token();
        match &self.source {
            Source::Constant(radiance) => {
                let above = Frame::from_normal(receivers.normal).to_world(sample_cosine_hemisphere(u).normalize());
                let direction = V3::select(receivers.both_sides, sample_sphere(u), above);
                (direction, Rgb::in_lanes(token, *radiance), self.pdf(receivers, direction))
            }
            Source::Map(map) => {
                let (u, v) = (u[0].to_array(), u[1].to_array());
                let [mut across, mut place, mut side, mut pdf] = [[0.0; MAX_WIDTH]; 4];
                let mut radiance = [Rgb::BLACK; MAX_WIDTH];
                for lane in 0..F::WIDTH {
                    let ([u, v], density) = map.distribution.sample_continuous([u[lane], v[lane]]);
                    let [x, y] = map.texel(u, v);
                    let row = &map.rows[y];
                    (across[lane], place[lane]) = (u, row.place(v * map.height as f32 - y as f32));
                    (side[lane], pdf[lane]) = (row.side, density / row.jacobian);
                    radiance[lane] = map.radiance([x, y]);
                }
                let [u, s, side] = [F::load(token, &across), F::load(token, &place), F::load(token, &side)];
                let direction = self.to_world(map_direction(u, s, side));
                (direction, Rgb::from_lanes(token, &radiance), F::load(token, &pdf))
            }
        }
    }

    /// The densities [1/sr] of directions in [`Self::sample`].
    #[inline(always)]
    pub(crate) fn pdf<F: Lanes>(&self, receivers: &Receivers<F>, direction: V3<F>) -> F {
        match &self.source {
            Source::Constant(_) => {
                let cosine = direction.dot(receivers.normal);
                let uniform = cosine.constant(0.25 * FRAC_1_PI);
                receivers.both_sides.select(uniform, cosine.max(cosine.constant(0.0)) * FRAC_1_PI)
            }
            Source::Map(map) => {
                let ([u, v], mut pdf) = (map_coordinates(self.to_map(direction)), [0.0; MAX_WIDTH]);
                let (u, v) = (u.to_array(), v.to_array());
                for lane in 0..F::WIDTH {
                    let [_, y] = map.texel(u[lane], v[lane]);
                    pdf[lane] = map.distribution.pdf_continuous([u[lane], v[lane]]) / map.rows[y].jacobian;
                }
                F::load(direction.x.token(), &pdf)
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
    fn radiance(&self, [x, y]: [usize; 2]) -> Rgb {
        self.texels[y * self.width as usize + x]
    }
}

impl Row {
    fn new(y: u32, height: u32) -> Self {
        let angle = |y: u32| std::f64::consts::PI * f64::from(y) / f64::from(height);
        let (a, b) = (angle(y), angle(y + 1));
        // The middle row of an odd number of rows counts with the upper half.
        let upper = 2 * y < height;
        let s = [a, b].map(|t| {
            let (cos, sin) = f64::cos_sin(0.5 * t);
            if upper { (sin * sin) as f32 } else { (cos * cos) as f32 }
        });
        // cos a - cos b, without cancellation.
        let band = 2.0 * f64::cos_sin(0.5 * (a + b)).1 * f64::cos_sin(0.5 * (b - a)).1;
        Self {
            s,
            side: if upper { 1.0 } else { -1.0 },
            jacobian: (2.0 * std::f64::consts::PI * band * f64::from(height)) as f32,
        }
    }

    /// s at fraction `t` of the row's solid angle, counted from the edge nearer to image row 0.
    #[inline]
    fn place(&self, t: f32) -> f32 {
        (self.s[0] + t * (self.s[1] - self.s[0])).clamp(0.0, 1.0)
    }
}

/// The directions at the image coordinates `u`, at the places `s` of rows on one side.
#[inline(always)]
fn map_direction<F: Lanes>(u: F, s: F, side: F) -> V3<F> {
    let sin_theta = (s * s.one_minus()).sqrt() * 2.0;
    let (cos_phi, sin_phi) = cos_sin_of_turn(u - 0.5);
    V3::new(sin_theta * sin_phi, (s * 2.0).one_minus() * side, -sin_theta * cos_phi)
}

/// Image coordinates of directions: v = 0 at +y, the centre column has the direction -z, u grows to the right (+x).
#[inline(always)]
fn map_coordinates<F: Lanes>(d: V3<F>) -> [F; 2] {
    let u = atan2(d.x, -d.z) / TAU + 0.5;
    // The arc cosine would lose half of the digits near the poles, for example for a sun at the zenith.
    let v = atan2((d.x * d.x + d.z * d.z).sqrt(), d.y) / PI;
    [u.clamp(0.0, ONE_MINUS), v.clamp(0.0, ONE_MINUS)]
}

/// The largest float below one.
const ONE_MINUS: f32 = 1.0 - f32::EPSILON / 2.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::texture::{ImageId, Texels};
    use dunkelfeld_geometry::Vec3;

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
            let (direction, radiance, pdf) = light.sample::<f32>(&any(), u);
            // A direction on the edge of a texel may be rounded into the next one.
            off += u32::from((light.pdf::<f32>(&any(), direction) / pdf - 1.0).abs() > 1e-4);
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
                let (pdf, want) = (light.pdf::<f32>(&any(), d.into()), light.radiance::<f32>(d.into()).g / total);
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
            let (d, radiance, pdf) = light.sample::<f32>(&any(), u);
            let d = Vec3::from(d);
            let angle = d.x.hypot(d.z).atan2(d.y);
            assert!(angle <= cap * 1.0001 && radiance.g == 1e7, "{d} has {radiance:?}");
            assert!((pdf * 4.0 * PI * light.mean.g / 1e7 - 1.0).abs() < 1e-4);
            inner += i32::from(angle < cap * std::f32::consts::FRAC_1_SQRT_2);
        }
        let share = f64::from(inner) / f64::from(n);
        assert!((share - 0.5).abs() < 0.01, "{share} of the samples lie in the inner half");
    }
}
