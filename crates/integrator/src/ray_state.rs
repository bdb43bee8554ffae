//! A ray on its way through solids: what it meets next, and where it is after that.

use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Boundary, Features, Interface, Interior, Medium, Scene, ShadingPoint, SurfacePoint};

/// A ray, and the solids that its start lies in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayState {
    pub(crate) ray: Ray,
    place: Place,
}

/// The solids around a place. Kernels with media know all of them, others the one that was entered last.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// The material of the solid, where none touches another.
    material: Option<u32>,
    around: Interior,
}

/// A surface that a ray meets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfaceHit<'a> {
    /// The surface whose material counts.
    pub(crate) hit: SurfacePoint,
    /// What it means for light, with media.
    interface: Option<&'a Interface>,
}

impl RayState {
    /// A ray from the camera.
    #[inline]
    pub(crate) fn from_camera<F: Features>(scene: &Scene, ray: Ray) -> Self {
        let around = if F::MEDIA { scene.interior_at(ray.origin) } else { Interior::OUTSIDE };
        Self { ray, place: Place { material: None, around } }
    }

    /// The next surface on the way; with media, what it means for light is put in `own`.
    #[inline]
    pub(crate) fn intersect_next<'a, F: Features>(
        &self,
        scene: &Scene,
        own: &'a mut Option<Interface>,
    ) -> Option<SurfaceHit<'a>> {
        // Of a copy, so that the path does not lie in memory for it.
        let ray = self.ray;
        let hit = scene.intersect(&ray)?;
        if F::MEDIA {
            let interface = own.insert(scene.interface(&self.ray, &hit, &self.place.around));
            Some(SurfaceHit { hit: interface.surface, interface: Some(interface) })
        } else {
            Some(SurfaceHit { hit, interface: None })
        }
    }

    /// The medium that the ray travels in; only kernels with media know more than that it absorbs.
    #[inline]
    pub(crate) fn medium<'a>(&self, scene: &'a Scene) -> Option<&'a Medium> {
        scene.medium(&self.place.around)
    }

    /// What is left of light over a distance \[m\] of the way.
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

    /// The same place, another direction on the same side of its surface.
    #[inline]
    pub(crate) fn aimed(&self, direction: Vec3) -> Self {
        Self { ray: Ray::new(self.ray.origin, direction), place: self.place }
    }

    /// The material of the solid that the ray travels in.
    #[inline]
    pub(crate) fn solid<F: Features>(&self, scene: &Scene) -> Option<u32> {
        if F::MEDIA { scene.material_inside(&self.place.around) } else { self.place.material }
    }

    /// From a place inside the medium in a new direction.
    #[inline]
    pub(crate) fn turned(&self, point: Vec3, wi: Vec3) -> Self {
        Self { ray: Ray::new(point, wi), place: self.place }
    }

    /// Through a surface that lets the ray pass as if it were not there.
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

    /// Away from a surface that was met, seen from `wo`, in the direction `wi`.
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

    /// What comes through along a ray that starts where this walk does and ends before a light: the share that surfaces
    /// leave open, and what the medium leaves. Zero if anything stops it.
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
    /// The tint of a face that bends no light.
    #[inline]
    pub(crate) fn open_tint(&self) -> Option<Rgb> {
        match self.interface?.boundary {
            Boundary::Open { tint } => Some(tint),
            _ => None,
        }
    }

    /// The index of refraction on the inside of the surface over the outside, if two solids meet here.
    #[inline]
    pub(crate) fn relative_index(&self) -> Option<f32> {
        match self.interface?.boundary {
            Boundary::Between { eta } => Some(eta),
            _ => None,
        }
    }
}

/// What absorption leaves over a distance [m] (Beer and Lambert).
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
