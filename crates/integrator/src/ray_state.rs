//! The state of a ray among solids: its next intersection, and the solids around its origin.

use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Boundary, Features, Interface, Interior, Medium, Scene, ShadingPoint, SurfacePoint};

/// A ray and the solids that contain its origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayState {
    pub(crate) ray: Ray,
    place: Place,
}

/// The solids around a point. Kernels with media store all of them (`around`). Other kernels store the material of the
/// solid entered last (`material`).
#[derive(Clone, Copy, Debug)]
struct Place {
    /// Material of the solid that was entered last, for scenes in which no solids touch.
    material: Option<u32>,
    around: Interior,
}

/// An intersection of a ray with a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfaceHit<'a> {
    /// The surface that provides the material. Of coincident faces it is the one of the interface.
    pub(crate) hit: SurfacePoint,
    /// The interface between the solids on both sides; `None` in kernels without media.
    interface: Option<&'a Interface>,
}

impl RayState {
    /// The state of a ray from the camera.
    #[inline]
    pub(crate) fn from_camera<F: Features>(scene: &Scene, ray: Ray) -> Self {
        let around = if F::MEDIA { scene.interior_at(ray.origin) } else { Interior::OUTSIDE };
        Self { ray, place: Place { material: None, around } }
    }

    /// The next intersection along the ray. In kernels with media its interface is stored in `own`.
    #[inline]
    pub(crate) fn intersect_next<'a, F: Features>(
        &self,
        scene: &Scene,
        own: &'a mut Option<Interface>,
    ) -> Option<SurfaceHit<'a>> {
        // Intersects a copy of the ray, so that the path state is not kept in memory because of a reference.
        let ray = self.ray;
        let hit = scene.intersect(&ray)?;
        if F::MEDIA {
            let interface = own.insert(scene.interface(&self.ray, &hit, &self.place.around));
            Some(SurfaceHit { hit: interface.surface, interface: Some(interface) })
        } else {
            Some(SurfaceHit { hit, interface: None })
        }
    }

    /// The medium around the origin of the ray, in kernels with media. Other kernels use absorption only.
    #[inline]
    pub(crate) fn medium<'a>(&self, scene: &'a Scene) -> Option<&'a Medium> {
        scene.medium(&self.place.around)
    }

    /// The transmittance over a distance \[m\] along the ray.
    #[inline]
    pub(crate) fn transmittance<F: Features>(&self, scene: &Scene, distance: f32) -> Rgb {
        if F::MEDIA {
            self.medium(scene).map_or(Rgb::WHITE, |m| m.transmittance(distance))
        } else if F::SOLIDS {
            attenuation(scene, self.place.material, distance)
        } else {
            Rgb::WHITE
        }
    }

    /// The same origin with another direction on the same side of its surface.
    #[inline]
    pub(crate) fn aimed(&self, direction: Vec3) -> Self {
        Self { ray: Ray::new(self.ray.origin, direction), place: self.place }
    }

    /// The material of the solid around the origin of the ray.
    #[inline]
    pub(crate) fn solid<F: Features>(&self, scene: &Scene) -> Option<u32> {
        if F::MEDIA { scene.material_inside(&self.place.around) } else { self.place.material }
    }

    /// A ray from a point inside the medium in a new direction.
    #[inline]
    pub(crate) fn turned(&self, point: Vec3, wi: Vec3) -> Self {
        Self { ray: Ray::new(point, wi), place: self.place }
    }

    /// Continues behind a surface in the same direction, as if the surface were absent.
    #[inline]
    pub(crate) fn pass_through<F: Features>(&self, met: &SurfaceHit<'_>) -> Self {
        let mut place = self.place;
        if F::MEDIA
            && let Some(interface) = met.interface.filter(|i| matches!(i.boundary, Boundary::Open { .. }))
        {
            place.around = interface.far();
        }
        Self { ray: Ray::new(met.hit.leave(self.ray.direction), self.ray.direction), place }
    }

    /// Leaves a surface in the direction `wi`. `wo` points to the previous vertex.
    #[inline]
    pub(crate) fn leave<F: Features>(
        &self,
        met: &SurfaceHit<'_>,
        shading: &ShadingPoint<'_>,
        wo: Vec3,
        wi: Vec3,
    ) -> Self {
        let mut place = self.place;
        let (inward, from_inside) = (wi.dot(met.hit.normal) < 0.0, wo.dot(met.hit.normal) < 0.0);
        if F::MEDIA {
            if let Some(interface) = met.interface {
                place.around = interface.beyond(wi);
            }
        } else if F::SOLIDS && shading.is_solid && inward != from_inside {
            place.material = inward.then_some(shading.material);
        }
        Self { ray: Ray::new(met.hit.leave(wi), wi), place }
    }

    /// Transmittance along a shadow ray that starts at this state and ends before a light: the open share of the
    /// surfaces, and the transmittance of the medium. Zero if the ray is occluded.
    #[inline]
    pub(crate) fn light_along<F: Features>(&self, scene: &Scene, ray: &Ray) -> (f32, Rgb) {
        if F::MEDIA {
            return (1.0, scene.light_through(ray, &self.place.around));
        }
        let open = scene.transmittance_with::<F>(ray);
        if F::SOLIDS && open > 0.0 {
            (open, attenuation(scene, self.place.material, ray.t_max))
        } else {
            (open, Rgb::WHITE)
        }
    }
}

impl SurfaceHit<'_> {
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
