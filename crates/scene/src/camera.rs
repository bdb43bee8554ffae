//! Cameras that make rays: from a point on the film to a ray in render space.

use crate::builder::{Camera, Projection};
use dunkelfeld_geometry::{DAffine3, DMat3, DVec3, Ray, Vec3};

/// A camera bound to a film of a certain size.
#[derive(Clone, Copy, Debug)]
pub struct RayGenerator {
    origin: Vec3,
    right: Vec3,
    up: Vec3,
    forward: Vec3,
    width: f32,
    height: f32,
    /// Half extents of the film: at unit distance for a perspective, in metres for parallel rays.
    half: [f32; 2],
    parallel: bool,
}

impl RayGenerator {
    /// Binds a camera to a film of `width * height` pixels.
    ///
    /// Rays start in render space: world space moved by `-world_origin`. The vertical extent is the camera's; the
    /// horizontal one follows from square pixels. An orthographic camera keeps its larger extent in view.
    pub fn new(camera: &Camera, width: u32, height: u32, world_origin: DVec3) -> Self {
        let m = camera.to_world.matrix3;
        let back = axis(m.z_axis, DVec3::Z);
        let right = axis(m.y_axis.cross(back), axis(back.any_orthonormal_vector(), DVec3::X));
        let up = back.cross(right);
        let aspect = width as f32 / height as f32;
        let (half, parallel) = match camera.projection {
            Projection::Perspective { vertical_fov } => {
                let h = (0.5 * vertical_fov).tan();
                ([h * aspect, h], false)
            }
            Projection::Orthographic { half_width, half_height } => {
                let h = half_height.max(half_width / aspect);
                ([h * aspect, h], true)
            }
        };
        Self {
            origin: (camera.to_world.translation - world_origin).as_vec3(),
            right: right.as_vec3(),
            up: up.as_vec3(),
            forward: -back.as_vec3(),
            width: width as f32,
            height: height as f32,
            half,
            parallel,
        }
    }

    /// The ray through the film point (x, y), in pixels from the top left corner.
    #[inline]
    pub fn ray(&self, x: f32, y: f32) -> Ray {
        let sx = (2.0 * x / self.width - 1.0) * self.half[0];
        let sy = (1.0 - 2.0 * y / self.height) * self.half[1];
        let offset = self.right * sx + self.up * sy;
        if self.parallel {
            Ray::new(self.origin + offset, self.forward)
        } else {
            Ray::new(self.origin, (self.forward + offset).normalize())
        }
    }

    /// The viewing direction.
    pub fn forward(&self) -> Vec3 {
        self.forward
    }
}

/// The camera-to-world transform of a camera at `eye` that looks at `target`. `up` need not be orthogonal to the view; if
/// it is parallel to it, some other direction is up.
pub fn look_at(eye: DVec3, target: DVec3, up: DVec3) -> DAffine3 {
    let back = axis(eye - target, DVec3::Z);
    let right = axis(up.cross(back), back.any_orthonormal_vector());
    DAffine3 { matrix3: DMat3::from_cols(right, back.cross(right), back), translation: eye }
}

/// `v` at unit length, or the fall-back where that is impossible.
fn axis(v: DVec3, fallback: DVec3) -> DVec3 {
    v.try_normalize().unwrap_or(fallback)
}

/// A camera that sees the whole scene: obliquely from above, 40 degrees of vertical field, a little margin.
///
/// `bounds` are the scene's corners in world space; without any the camera looks at the origin from 1 m.
pub fn framing_camera(bounds: Option<[DVec3; 2]>, aspect: f32) -> Camera {
    let [lo, hi] = bounds.unwrap_or([DVec3::splat(-0.25), DVec3::splat(0.25)]);
    let center = 0.5 * (lo + hi);
    let radius = (0.5 * (hi - lo).length()).max(f64::MIN_POSITIVE.sqrt());
    let vertical_fov = 40f64.to_radians();
    let half = 0.5 * vertical_fov;
    let narrow = (half.tan() * f64::from(aspect).min(1.0)).atan();
    let distance = 1.02 * radius / narrow.sin();
    let back = DVec3::new(0.45, 0.5, 0.75).normalize();
    Camera {
        name: "framing".into(),
        to_world: look_at(center + back * distance, center, DVec3::Y),
        projection: Projection::Perspective { vertical_fov: vertical_fov as f32 },
        aspect: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(projection: Projection) -> Camera {
        let to_world = DAffine3::from_translation(DVec3::new(1000.0, 2.0, 3.0));
        Camera { name: "c".into(), to_world, projection, aspect: None }
    }

    #[test]
    fn the_film_centre_looks_along_minus_z_and_corners_span_the_field() {
        let c = camera(Projection::Perspective { vertical_fov: 1.0 });
        let g = RayGenerator::new(&c, 200, 100, DVec3::new(1000.0, 0.0, 0.0));
        let r = g.ray(100.0, 50.0);
        assert!((r.direction - Vec3::NEG_Z).length() < 1e-6);
        assert_eq!(r.origin, Vec3::new(0.0, 2.0, 3.0));
        let top = g.ray(100.0, 0.0).direction;
        assert!((top.y.atan2(-top.z) - 0.5).abs() < 1e-6, "top edge at half the field, +y up");
        let right = g.ray(200.0, 50.0).direction;
        assert!((right.x / -right.z - 2.0 * 0.5f32.tan()).abs() < 1e-5, "square pixels, +x to the right");
    }

    #[test]
    fn parallel_rays_are_parallel_and_start_on_the_film() {
        let c = camera(Projection::Orthographic { half_width: 2.0, half_height: 1.0 });
        let g = RayGenerator::new(&c, 100, 100, DVec3::ZERO);
        let (a, b) = (g.ray(0.0, 0.0), g.ray(100.0, 100.0));
        assert_eq!(a.direction, b.direction);
        assert!((b.origin - a.origin - Vec3::new(4.0, -4.0, 0.0)).length() < 1e-3);
    }

    #[test]
    fn framing_sees_every_corner() {
        let (lo, hi) = (DVec3::new(5.0, -1.0, 2.0), DVec3::new(6.0, 4.0, 2.5));
        for aspect in [0.5f32, 1.0, 2.0] {
            let c = framing_camera(Some([lo, hi]), aspect);
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
