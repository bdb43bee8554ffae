//! Ray generation: from a point on the film through the lens to a ray in render space, and projection from a point of
//! the world to the film.

pub mod distortion;
pub mod lens;
pub mod shutter;

use crate::build::builder::{Camera, Projection};
use crate::camera::distortion::Undistorter;
use crate::camera::lens::{Aperture, Opening, Vignetting};
use dunkelfeld_geometry::{DAffine3, DMat3, DVec3, Ray};
use dunkelfeld_lanes::{Double, Lanes, MAX_WIDTH, Real, V3};

/// Reason why a camera cannot be bound to a film.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// A value that is not finite, out of range, or inconsistent with the others.
    #[error("camera \"{camera}\": {problem}")]
    Value {
        /// The camera.
        camera: String,
        /// The error and the valid range.
        problem: &'static str,
    },
    /// Distortion that maps two directions to one place, or reaches no direction at all, within the film.
    #[error(
        "camera \"{camera}\": its lens distortion is not invertible over the film: it folds back, or ends, {pixels:.1} \
         pixels from the principal point, {degrees:.2} degrees off the axis, as at pixel ({x:.1}, {y:.1}), but the film \
         reaches {reach:.1} pixels"
    )]
    NotInvertible {
        /// The camera.
        camera: String,
        /// A place on the film, on the way to its farthest corner, beyond which there are no rays \[pixels\].
        x: f64,
        /// See `x`.
        y: f64,
        /// The distance of that place from the principal point \[pixels\].
        pixels: f64,
        /// The field angle there.
        degrees: f64,
        /// The distance of the film's farthest corner from the principal point \[pixels\].
        reach: f64,
    },
}

/// A ray of a camera and its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraRay {
    /// The ray in render space.
    pub ray: Ray,
    /// Factor on the radiance: below one if the lens vignettes.
    pub weight: f32,
    /// Distance \[m\] from the camera to the start of the ray. It is above zero if the camera is outside the scene. The
    /// ray then starts close to the scene, so that a camera at a distance of one kilometre is as precise as a near one.
    pub start: f32,
}

/// A ray of a camera per lane. See [`CameraRay`].
#[derive(Clone, Copy, Debug)]
pub struct CameraRays<F> {
    /// Start in render space \[m\].
    pub origin: V3<F>,
    /// Unit vector.
    pub direction: V3<F>,
    /// Factor on the radiance.
    pub weight: F,
    /// Distance from the camera to the start of the ray \[m\].
    pub start: F,
}

/// Rays start no farther from the middle of the scene than this many of its radii.
const CLEARANCE: f64 = 1.5;

/// A camera bound to a film of a certain size.
///
/// Rays are f32 and made in f64. Places on the film are in pixels from its top left corner, x to the right and y down;
/// the middle of the first pixel is at (0.5, 0.5).
#[derive(Clone, Debug, serde::Serialize)]
pub struct RayGenerator {
    /// The camera's position in render space.
    origin: DVec3,
    /// To the right, up, and backward, in world space.
    axes: DMat3,
    /// Half extents of the film: at unit distance for a perspective, in metres for parallel rays.
    half: [f64; 2],
    /// Half of the whole film's extents \[pixels\].
    half_pixels: [f64; 2],
    /// Corner of the rendered window of the film, and the side of a rendered pixel, in pixels of the whole film.
    window: ([f64; 2], f64),
    /// The point where the optical axis meets the film, in units of `half_pixels` from the corner: one is the middle.
    center: [f64; 2],
    parallel: bool,
    darkens: bool,
    aperture: Option<Aperture>,
    undistorter: Option<Box<Undistorter>>,
    spread: Option<f32>,
    world_origin: DVec3,
    clearance: f64,
}

impl RayGenerator {
    /// The camera's position in render space.
    pub(crate) fn origin(&self) -> dunkelfeld_geometry::Vec3 {
        self.origin.as_vec3()
    }

    /// Binds a camera to a film of `width * height` pixels.
    ///
    /// Rays start in render space: world space moved by `-world_origin`, where the scene lies within `radius` \[m\]
    /// around the origin. The vertical extent is that of the camera. The horizontal one follows from the aspect of the
    /// pixels. An orthographic camera keeps its larger extent in the image. If the camera has a window, `width` and
    /// `height` are those of the window, and the extents are those of the whole film.
    ///
    /// # Errors
    /// Invalid values, and a distortion that cannot be inverted over the film.
    pub fn new(
        camera: &Camera,
        width: u32,
        height: u32,
        world_origin: DVec3,
        radius: f32,
    ) -> Result<Self, CameraError> {
        check_camera(camera).map_err(|problem| CameraError::Value { camera: camera.name.clone(), problem })?;
        let m = camera.to_world.matrix3;
        let back = axis(m.z_axis, DVec3::Z);
        let right = axis(m.y_axis.cross(back), axis(back.any_orthonormal_vector(), DVec3::X));
        let [width, height] = camera.window.map_or([width, height], |window| window.full);
        let half_pixels = [0.5 * f64::from(width), 0.5 * f64::from(height)];
        let aspect = f64::from(width) / f64::from(height) * camera.lens.pixel_aspect;
        let (half_height, parallel) = match camera.projection {
            Projection::Perspective { vertical_fov } => (tangent(0.5 * f64::from(vertical_fov)), false),
            Projection::Orthographic { half_width, half_height } => {
                (f64::from(half_height).max(f64::from(half_width) / aspect), true)
            }
        };
        let [dx, dy] = camera.lens.principal_point;
        let mut generator = Self {
            origin: camera.to_world.translation - world_origin,
            axes: DMat3::from_cols(right, back.cross(right), back),
            half: [half_height * aspect, half_height],
            half_pixels,
            window: camera.window.map_or(([0.0; 2], 1.0), |window| (window.origin, window.step)),
            center: [1.0 + dx / half_pixels[0], 1.0 + dy / half_pixels[1]],
            parallel,
            darkens: camera.lens.vignetting == Vignetting::CosineFourth && !parallel,
            aperture: camera.lens.aperture,
            undistorter: None,
            spread: camera.lens.spread,
            world_origin,
            clearance: CLEARANCE * f64::from(radius),
        };
        if !camera.lens.distortion.is_none() {
            generator.undistorter = Some(Box::new(generator.undo(camera)?));
        }
        Ok(generator)
    }

    /// The inverse of the camera's distortion over the film.
    fn undo(&self, camera: &Camera) -> Result<Undistorter, CameraError> {
        let far = |k: usize| if self.center[k] > 1.0 { 0.0 } else { 2.0 };
        let corner = [far(0) - self.center[0], far(1) - self.center[1]];
        let film_radius = (corner[0] * self.half[0]).hypot(corner[1] * self.half[1]);
        Undistorter::new(camera.lens.distortion, film_radius).map_err(|fold| {
            let share = fold.film_radius / film_radius;
            let along = [corner[0] * self.half_pixels[0], corner[1] * self.half_pixels[1]];
            let reach = along[0].hypot(along[1]);
            CameraError::NotInvertible {
                camera: camera.name.clone(),
                x: self.center[0] * self.half_pixels[0] + share * along[0],
                y: self.center[1] * self.half_pixels[1] + share * along[1],
                pixels: share * reach,
                degrees: fold.radius.atan().to_degrees(),
                reach,
            }
        })
    }

    /// The chief ray through the film point (x, y), in pixels from the top left corner: the ray of a pinhole, or the
    /// one through the middle of the lens.
    #[inline]
    pub fn ray(&self, x: f32, y: f32) -> Ray {
        self.camera_ray(x, y, None).ray
    }

    /// True if a ray needs two numbers for its place on the lens.
    #[inline]
    pub fn has_aperture(&self) -> bool {
        self.aperture.is_some()
    }

    /// The box of the samples of a pixel beyond it \[pixels\], in front of a lens that blurs ([`Lens::spread`](lens::Lens)).
    #[inline]
    pub fn spread(&self) -> Option<f32> {
        self.spread
    }

    /// True if rays have different weights.
    pub fn has_vignetting(&self) -> bool {
        self.darkens
    }

    /// The fourth power of the cosine of the angle between axis and chief ray through the film point (x, y), in pixels from
    /// the top left corner: the natural vignetting of a thin lens, whether the camera has it or not. `None` for parallel
    /// rays.
    pub fn natural_vignetting(&self, x: f64, y: f64) -> Option<f64> {
        (!self.parallel).then(|| cosine_fourth(self.seen::<f32>((), x, y)))
    }

    /// The ray through the film point (x, y), in pixels from the top left corner. Two uniform numbers choose the point
    /// of the aperture. Without numbers, or without a finite aperture, the result is the chief ray.
    #[inline]
    pub fn camera_ray(&self, x: f32, y: f32, lens: Option<[f32; 2]>) -> CameraRay {
        let CameraRays { origin, direction, weight, start } = self.camera_rays((), x, y, lens);
        CameraRay { ray: Ray::new(origin.into(), direction.into()), weight, start }
    }

    /// [`Self::camera_ray`] for a film point per lane. Either all lanes have numbers for the aperture or none.
    #[inline(always)]
    pub fn camera_rays<F: Lanes>(&self, token: F::Token, x: F, y: F, lens: Option<[F; 2]>) -> CameraRays<F> {
        let [right, up] = self.seen::<F>(token, F::Double::widen(x), F::Double::widen(y));
        let (origin, axes) = (splat::<F>(token, self.origin), self.axes_of_lanes::<F>(token));
        let across = axes[0] * right + axes[1] * up;
        let chief = if self.parallel { across } else { across - axes[2] };
        let (from, direction) = match (&self.aperture, lens) {
            (Some(aperture), Some(u)) => {
                let (point, direction) = self.through_lens(token, aperture, u, chief);
                (origin + point, direction)
            }
            _ if self.parallel => (origin + chief, -axes[2]),
            _ => (origin, chief.normalize()),
        };
        // The scene lies within its radius of the origin. Up to there the ray meets no surface.
        let start = (-from.dot(direction) - self.clearance).max(right.constant(0.0));
        CameraRays {
            origin: V3::narrow(from + direction * start),
            direction: V3::narrow(direction),
            weight: if self.darkens { cosine_fourth([right, up]).narrow() } else { F::splat(token, 1.0) },
            start: start.narrow(),
        }
    }

    /// Start, relative to the camera, and direction of the ray through a point of the aperture. It intersects the chief ray
    /// in the plane in focus.
    #[inline(always)]
    fn through_lens<F: Lanes>(
        &self,
        token: F::Token,
        aperture: &Aperture,
        u: [F; 2],
        chief: V3<F::Double>,
    ) -> (V3<F::Double>, V3<F::Double>) {
        let [right, up] = aperture.sample_lanes(u);
        let axes = self.axes_of_lanes::<F>(token);
        let point = axes[0] * right + axes[1] * up;
        let distance = aperture.focus_distance;
        match aperture.opening {
            Opening::Radius(_) => {
                let inverse = F::Double::splat(token, 1.0 / distance);
                (point, (chief - point * inverse).normalize())
            }
            Opening::NumericalAperture(_) => {
                // Uniform in the direction sines, as the sine condition requires. The aperture lies in the focal plane
                // behind the lens.
                let cosine = point.length_squared().one_minus().max(right.constant(0.0)).sqrt();
                let direction = point - axes[2] * cosine;
                (chief - point * (F::Double::splat(token, distance) / cosine), direction)
            }
        }
    }

    #[inline(always)]
    fn axes_of_lanes<F: Lanes>(&self, token: F::Token) -> [V3<F::Double>; 3] {
        let DMat3 { x_axis, y_axis, z_axis } = self.axes;
        [splat::<F>(token, x_axis), splat::<F>(token, y_axis), splat::<F>(token, z_axis)]
    }

    /// The undistorted place (right, up) of the film point (x, y) on a film at unit distance, or in metres for parallel
    /// rays.
    #[inline(always)]
    fn seen<F: Lanes>(&self, token: F::Token, x: F::Double, y: F::Double) -> [F::Double; 2] {
        let (([left, top], step), [width, height], center) = (self.window, self.half_pixels, self.center);
        let right = (x * step + left - center[0] * width) * (self.half[0] / width);
        let down = (y * step + top - center[1] * height) * (self.half[1] / height);
        let Some(undistorter) = &self.undistorter else { return [right, -down] };
        let [mut x, mut y] = [[0.0; MAX_WIDTH]; 2];
        right.store(&mut x);
        down.store(&mut y);
        for lane in 0..F::WIDTH {
            // The y axis of OpenCV points down.
            [x[lane], y[lane]] = undistorter.inverse([x[lane], y[lane]]);
        }
        [F::Double::load(token, &x), -F::Double::load(token, &y)]
    }

    /// The film point of a point of world space along its chief ray: pixels from the top left corner, x to the right
    /// and y down. The point may lie outside the film.
    ///
    /// `None` for points behind the camera, and at field angles outside the domain where the distortion is one to one.
    /// All points that map to the film are within that domain.
    pub fn project(&self, world: DVec3) -> Option<[f64; 2]> {
        let local = self.axes.transpose() * (world - self.world_origin - self.origin);
        let depth = -local.z;
        if depth.is_nan() || depth <= 0.0 {
            return None;
        }
        let distance = if self.parallel { 1.0 } else { depth };
        let mut place = [local.x / distance, -local.y / distance];
        if let Some(undistorter) = &self.undistorter {
            if !undistorter.is_valid(place) {
                return None;
            }
            place = undistorter.model().forward(place);
        }
        let (corner, step) = self.window;
        Some([0, 1].map(|k| ((place[k] / self.half[k] + self.center[k]) * self.half_pixels[k] - corner[k]) / step))
    }

    /// The viewing direction, along the optical axis.
    pub fn forward(&self) -> DVec3 {
        -self.axes.z_axis
    }
}

/// The same vector in all lanes.
#[inline(always)]
fn splat<F: Lanes>(token: F::Token, v: DVec3) -> V3<F::Double> {
    V3::<F>::splat_double(token, V3::new(v.x, v.y, v.z))
}

/// The fourth power of the cosine, for a place on a film at unit distance.
#[inline(always)]
fn cosine_fourth<N: Real>([right, up]: [N; 2]) -> N {
    let secant_squared = right * right + up * up + right.constant(1.0);
    (secant_squared * secant_squared).recip()
}

/// The tangent of an angle. The one of the library of C has other bits on other machines.
fn tangent(angle: f64) -> f64 {
    let (cos, sin) = f64::cos_sin(angle);
    sin / cos
}

/// Checks the numbers of a camera. The error contains the problem and the valid range.
pub(crate) fn check_camera(camera: &Camera) -> Result<(), &'static str> {
    let require = |fits: bool, problem| if fits { Ok(()) } else { Err(problem) };
    require(camera.to_world.is_finite(), "its transform must be finite")?;
    let parallel = match camera.projection {
        Projection::Perspective { vertical_fov } => {
            let fits = vertical_fov > 0.0 && vertical_fov < std::f32::consts::PI;
            require(fits, "its field of view must lie between 0 and 180 degrees (0 and pi radians)")?;
            false
        }
        Projection::Orthographic { half_width, half_height } => {
            let fits = |v: f32| v > 0.0 && v.is_finite();
            require(fits(half_width) && fits(half_height), "its size must be finite and above 0")?;
            true
        }
    };
    if let Some(window) = &camera.window {
        let fits = window.full.iter().all(|&n| n > 0) && window.origin.iter().all(|v| v.abs() <= 1e6);
        require(fits && window.step > 0.0 && window.step <= 1e6, "its window must be finite and have a size above 0")?;
    }
    let lens = &camera.lens;
    require((1e-3..=1e3).contains(&lens.pixel_aspect), "the aspect of its pixels must lie between 0.001 and 1000")?;
    require(lens.principal_point.iter().all(|v| v.abs() <= 1e6), "its principal point must lie within 1e6 pixels")?;
    require(lens.distortion.is_finite(), "its distortion must be finite")?;
    require(!parallel || lens.distortion.is_none(), "distortion needs a perspective: its model is one of directions")?;
    let Some(aperture) = &lens.aperture else { return Ok(()) };
    require(aperture.focus_distance > 0.0, "its focus distance must be above 0")?;
    match aperture.opening {
        Opening::Radius(radius) => {
            require(!parallel, "parallel rays need a numerical aperture instead of a radius")?;
            require(radius > 0.0 && radius.is_finite(), "its aperture must be finite and above 0")?;
        }
        Opening::NumericalAperture(sine) => {
            require(parallel, "a numerical aperture needs parallel rays; a perspective has a radius")?;
            require(aperture.focus_distance.is_finite(), "parallel rays need a finite focus distance")?;
            require(sine > 0.0 && sine < 1.0, "its numerical aperture must lie between 0 and 1")?;
        }
    }
    let Some(blades) = &aperture.blades else { return Ok(()) };
    require((3..=1024).contains(&blades.count), "its aperture needs 3 to 1024 blades, or none for a circle")?;
    require(blades.rotation.is_finite(), "the rotation of its aperture must be finite")
}

/// The camera-to-world transform of a camera at `eye` with the viewing direction toward `target`. `up` need not be
/// orthogonal to that direction. If it is parallel to it, another direction is used.
pub fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> DAffine3 {
    let back = axis(eye - target, DVec3::Z);
    let right = axis(up.cross(back), back.any_orthonormal_vector());
    DAffine3 { matrix3: DMat3::from_cols(right, back.cross(right), back), translation: eye }
}

/// `v` at unit length, or the fall-back if `v` cannot be normalised.
fn axis(v: DVec3, fallback: DVec3) -> DVec3 {
    v.try_normalize().unwrap_or(fallback)
}

/// A camera with the whole scene in its image: obliquely from above, with a small margin.
///
/// `vertical_fov` is the full angle \[rad\]. `bounds` are the scene's corners in world space. Without bounds the camera
/// is 1 m away from the origin.
pub fn framing_camera(bounds: Option<[DVec3; 2]>, aspect: f32, vertical_fov: f64) -> Camera {
    let [lo, hi] = bounds.unwrap_or([DVec3::splat(-0.25), DVec3::splat(0.25)]);
    let center = 0.5 * (lo + hi);
    let radius = (0.5 * (hi - lo).length()).max(f64::MIN_POSITIVE.sqrt());
    let half = 0.5 * vertical_fov;
    let narrow = (half.tan() * f64::from(aspect).min(1.0)).atan();
    let distance = 1.02 * radius / narrow.sin();
    let back = DVec3::new(0.45, 0.5, 0.75).normalize();
    Camera {
        name: "framing".into(),
        to_world: look_at(center + back * distance, center, DVec3::Y),
        projection: Projection::Perspective { vertical_fov: vertical_fov as f32 },
        ..Camera::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn framing_contains_every_corner() {
        let (lo, hi) = (DVec3::new(5.0, -1.0, 2.0), DVec3::new(6.0, 4.0, 2.5));
        for aspect in [0.5f32, 1.0, 2.0] {
            let c = framing_camera(Some([lo, hi]), aspect, 40f64.to_radians());
            let inverse = c.to_world.inverse();
            for i in 0..8 {
                let p = DVec3::new([lo.x, hi.x][i & 1], [lo.y, hi.y][(i >> 1) & 1], [lo.z, hi.z][i >> 2]);
                let q = inverse.transform_point3(p);
                let t = 20f64.to_radians().tan();
                assert!(
                    q.z < 0.0 && (q.y / q.z).abs() < t && (q.x / q.z).abs() < t * f64::from(aspect),
                    "{p} at {aspect}"
                );
            }
        }
    }
}
