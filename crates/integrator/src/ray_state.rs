//! The state of a ray among solids: its next intersection, and the solids around its origin.

use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Boundary, Features, Interface, Interior, Medium, Scene, ShadingPoint, SurfacePoint};

/// A ray and the solids that contain its origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayState {
    pub(crate) ray: Ray,
    enclosing: EnclosingSolids,
}

/// The solids around a point. Kernels with media store all of them (`interior`). Other kernels store the material of
/// the solid entered last (`material`).
#[derive(Clone, Copy, Debug)]
struct EnclosingSolids {
    /// Material of the solid that was entered last, for scenes in which no solids touch.
    material: Option<u32>,
    interior: Interior,
}

/// An intersection of a ray with a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfaceHit<'a> {
    /// The surface that provides the material. Of coincident faces it is the one of the interface.
    pub(crate) surface: SurfacePoint,
    /// The interface between the solids on both sides; `None` in kernels without media.
    interface: Option<&'a Interface>,
}

impl RayState {
    /// The state of a ray from the camera.
    #[inline]
    pub(crate) fn from_camera<F: Features>(scene: &Scene, ray: Ray) -> Self {
        let interior = if F::MEDIA { scene.interior_at_time(ray.origin, ray.time) } else { Interior::OUTSIDE };
        Self { ray, enclosing: EnclosingSolids { material: None, interior } }
    }

    /// The next intersection along the ray. In kernels with media its interface is stored in `storage`.
    #[inline]
    pub(crate) fn intersect_next<'a, F: Features>(
        &self,
        scene: &Scene,
        storage: &'a mut Option<Interface>,
    ) -> Option<SurfaceHit<'a>> {
        // Intersects a copy of the ray, so that the path state is not kept in memory because of a reference.
        let ray = self.ray;
        let hit = scene.intersect(&ray)?;
        Some(self.hit_at::<F>(scene, hit, storage))
    }

    /// The intersection at a point of the ray. In kernels with media its interface is stored in `storage`.
    #[inline]
    pub(crate) fn hit_at<'a, F: Features>(
        &self,
        scene: &Scene,
        point: SurfacePoint,
        storage: &'a mut Option<Interface>,
    ) -> SurfaceHit<'a> {
        if F::MEDIA {
            let interface = storage.insert(scene.interface(&self.ray, &point, &self.enclosing.interior));
            SurfaceHit { surface: interface.surface, interface: Some(interface) }
        } else {
            SurfaceHit { surface: point, interface: None }
        }
    }

    /// The medium around the origin of the ray, in kernels with media. Other kernels use absorption only.
    #[inline]
    pub(crate) fn medium<'a>(&self, scene: &'a Scene) -> Option<&'a Medium> {
        scene.medium(&self.enclosing.interior)
    }

    /// The transmittance over a distance \[m\] along the ray.
    #[inline]
    pub(crate) fn transmittance<F: Features>(&self, scene: &Scene, distance: f32) -> Rgb {
        if F::MEDIA {
            self.medium(scene).map_or(Rgb::WHITE, |m| m.transmittance(distance))
        } else if F::SOLIDS {
            attenuation(scene, self.enclosing.material, distance)
        } else {
            Rgb::WHITE
        }
    }

    /// The same origin with another direction on the same side of its surface.
    #[inline]
    pub(crate) fn with_direction(&self, direction: Vec3) -> Self {
        Self { ray: Ray::new(self.ray.origin, direction).at_time(self.ray.time), enclosing: self.enclosing }
    }

    /// The material of the solid around the origin of the ray.
    #[inline]
    pub(crate) fn solid<F: Features>(&self, scene: &Scene) -> Option<u32> {
        if F::MEDIA { scene.material_inside(&self.enclosing.interior) } else { self.enclosing.material }
    }

    /// A ray from a point inside the medium in a new direction.
    #[inline]
    pub(crate) fn spawn_in_medium(&self, point: Vec3, wi: Vec3) -> Self {
        Self { ray: Ray::new(point, wi).at_time(self.ray.time), enclosing: self.enclosing }
    }

    /// Continues behind a surface in the same direction, as if the surface were absent. Faces that coincide with it are
    /// stepped over: [`Scene::next_coincident`] gives them.
    #[inline]
    pub(crate) fn pass_through<F: Features>(&self, hit: &SurfaceHit<'_>) -> Self {
        let mut enclosing = self.enclosing;
        if F::MEDIA
            && let Some(interface) = hit.interface.filter(|i| matches!(i.boundary, Boundary::Open { .. }))
        {
            enclosing.interior = interface.far();
        }
        let ray = Ray::new(hit.surface.ray_origin(self.ray.direction), self.ray.direction).at_time(self.ray.time);
        Self { ray, enclosing }
    }

    /// Leaves a surface in the direction `wi`. `wo` points to the previous vertex.
    #[inline]
    pub(crate) fn spawn_ray<F: Features>(
        &self,
        hit: &SurfaceHit<'_>,
        shading: &ShadingPoint<'_>,
        wo: Vec3,
        wi: Vec3,
    ) -> Self {
        let enclosing = self.enclosing_toward::<F>(hit, shading, wo, wi);
        Self { ray: Ray::new(hit.surface.ray_origin(wi), wi).at_time(self.ray.time), enclosing }
    }

    /// The solids around a ray that leaves a surface in the direction `wi`.
    #[inline]
    fn enclosing_toward<F: Features>(
        &self,
        hit: &SurfaceHit<'_>,
        shading: &ShadingPoint<'_>,
        wo: Vec3,
        wi: Vec3,
    ) -> EnclosingSolids {
        let mut enclosing = self.enclosing;
        let (inward, from_inside) = (wi.dot(hit.surface.normal) < 0.0, wo.dot(hit.surface.normal) < 0.0);
        if F::MEDIA {
            if let Some(interface) = hit.interface {
                enclosing.interior = interface.beyond(wi);
            }
        } else if F::SOLIDS && shading.is_solid && inward != from_inside {
            enclosing.material = inward.then_some(shading.material);
        }
        enclosing
    }

    /// The transmittance of an absorbing solid over a distance \[m\] along a ray that leaves a surface in the direction
    /// `wi`, in scenes in which no solids touch.
    #[inline]
    pub(crate) fn transmittance_toward<F: Features>(
        &self,
        scene: &Scene,
        (hit, shading): (&SurfaceHit<'_>, &ShadingPoint<'_>),
        [wo, wi]: [Vec3; 2],
        distance: f32,
    ) -> Rgb {
        attenuation(scene, self.enclosing_toward::<F>(hit, shading, wo, wi).material, distance)
    }

    /// Transmittance along a shadow ray that starts at this state and ends before a light: the open share of the
    /// surfaces, and the transmittance of the medium. Zero if the ray is occluded.
    #[inline]
    pub(crate) fn shadow_transmittance<F: Features>(&self, scene: &Scene, ray: &Ray) -> (f32, Rgb) {
        if F::MEDIA {
            return (1.0, scene.shadow_transmittance(ray, &self.enclosing.interior));
        }
        let open = scene.transmittance_with::<F>(ray);
        if F::SOLIDS && open > 0.0 {
            (open, attenuation(scene, self.enclosing.material, ray.t_max))
        } else {
            (open, Rgb::WHITE)
        }
    }
}

impl SurfaceHit<'_> {
    /// The intersection with a surface that bounds no solid.
    #[inline]
    pub(crate) fn of_surface(surface: SurfacePoint) -> Self {
        Self { surface, interface: None }
    }

    /// The tint of a face that bends no light; `None` for other faces.
    #[inline]
    pub(crate) fn open_tint(&self) -> Option<Rgb> {
        match self.interface?.boundary {
            Boundary::Open { tint } => Some(tint),
            _ => None,
        }
    }

    /// The index of refraction inside the surface over that outside, if two solids meet here.
    #[inline]
    pub(crate) fn relative_index(&self) -> Option<f32> {
        match self.interface?.boundary {
            Boundary::Between { eta } => Some(eta),
            _ => None,
        }
    }
}

/// Transmittance of an absorbing solid over a distance [m] (Beer and Lambert).
#[inline]
fn attenuation(scene: &Scene, inside: Option<u32>, distance: f32) -> Rgb {
    let Some(material) = inside else { return Rgb::WHITE };
    let absorption = scene.absorption(material);
    if absorption.is_black() {
        Rgb::WHITE
    } else {
        absorption.map(|a| if a > 0.0 { (-a * distance).exp() } else { 1.0 })
    }
}
