//! The state of a ray among solids: its next intersection, and the solids around its origin.

use dunkelfeld_geometry::{Ray, Vec3};
use dunkelfeld_lanes::{Lanes, MAX_WIDTH};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::{Boundary, Interface, Interior, Medium, MediumLanes, Scene, SurfacePoint, transmittance};

/// A ray and the solids that contain its origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayState {
    pub(crate) ray: Ray,
    pub(crate) enclosing: EnclosingSolids,
}

/// The solids around a point.
#[derive(Clone, Copy, Debug)]
pub(crate) enum EnclosingSolids {
    /// The material of the solid that was entered last: enough where no solids touch and no medium scatters.
    Last(Option<u32>),
    /// All of them.
    All(Interior),
}

/// An intersection of a ray with a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfaceHit<'a> {
    /// The surface that provides the material. Of coincident faces it is the one of the interface.
    pub(crate) surface: SurfacePoint,
    /// The interface between the solids on both sides, for [`EnclosingSolids::All`].
    pub(crate) interface: Option<&'a Interface>,
}

impl RayState {
    /// The state of a ray from the camera.
    #[inline]
    pub(crate) fn from_camera(scene: &Scene, ray: Ray) -> Self {
        // A ray may start inside a solid only within the bounds of the solids of the scene. This is tested for each ray,
        // because a lens has an extent.
        let is_nested = scene.has_media() || scene.has_solids() && scene.may_be_inside(ray.origin);
        let enclosing = if is_nested {
            EnclosingSolids::All(scene.interior_at_time(ray.origin, ray.time))
        } else {
            EnclosingSolids::Last(None)
        };
        Self { ray, enclosing }
    }

    /// The intersection at a point of the ray. Its interface is stored in `storage`.
    #[inline]
    pub(crate) fn hit_at<'a>(
        &self,
        scene: &Scene,
        surface: SurfacePoint,
        storage: &'a mut Option<Interface>,
    ) -> SurfaceHit<'a> {
        match &self.enclosing {
            EnclosingSolids::Last(_) => SurfaceHit { surface, interface: None },
            EnclosingSolids::All(interior) => {
                let interface = storage.insert(scene.interface(&self.ray, &surface, interior));
                SurfaceHit { surface: interface.surface, interface: Some(interface) }
            }
        }
    }

    /// The medium around the origin of the ray that may scatter it.
    #[inline]
    pub(crate) fn medium<'a>(&self, scene: &'a Scene) -> Option<&'a Medium> {
        match &self.enclosing {
            EnclosingSolids::Last(_) => None,
            EnclosingSolids::All(interior) => scene.medium(interior),
        }
    }

    /// Continues behind a surface in the same direction, as if the surface were absent. Faces that coincide with it are
    /// stepped over: [`Scene::next_coincident`] gives them.
    #[inline]
    pub(crate) fn pass_through(&self, hit: &SurfaceHit<'_>) -> Self {
        let direction = self.ray.direction;
        let ray = Ray::new(hit.surface.ray_origin(direction), direction).at_time(self.ray.time);
        let mut next = Self { ray, ..*self };
        if let Some(interface) = hit.interface.filter(|i| matches!(i.boundary, Boundary::Open { .. })) {
            next.enclosing = EnclosingSolids::All(interface.far());
        }
        next
    }

    /// Leaves a surface in the direction `wi`.
    #[inline]
    pub(crate) fn spawn_ray(&self, scene: &Scene, hit: &SurfaceHit<'_>, wi: Vec3) -> Self {
        let enclosing = match hit.interface {
            Some(interface) => EnclosingSolids::All(interface.beyond(wi)),
            None => {
                let material = hit.surface.material();
                let solid = scene.is_solid(material).then_some(material);
                let [from, to] = [self.ray.direction, wi].map(|direction| direction.dot(hit.surface.normal));
                self.enclosing.beyond(solid, from > 0.0, to < 0.0)
            }
        };
        Self { ray: Ray::new(hit.surface.ray_origin(wi), wi).at_time(self.ray.time), enclosing }
    }
}

impl EnclosingSolids {
    /// The material of the solid around the point.
    #[inline]
    pub(crate) fn material(&self, scene: &Scene) -> Option<u32> {
        match self {
            Self::Last(material) => *material,
            Self::All(interior) => scene.material_inside(interior),
        }
    }

    /// The medium around the point. It scatters only if all solids are stored.
    #[inline]
    pub(crate) fn coefficients(&self, scene: &Scene) -> MediumLanes {
        match self {
            Self::Last(None) => MediumLanes::CLEAR,
            Self::Last(Some(m)) => MediumLanes { extinction: scene.absorption(*m), ..MediumLanes::CLEAR },
            Self::All(interior) => scene.medium(interior).map_or(MediumLanes::CLEAR, Medium::coefficients),
        }
    }

    /// The transmittance over a distance \[m\] to the next surface.
    #[inline]
    pub(crate) fn transmittance(&self, scene: &Scene, distance: f32) -> Rgb {
        transmittance(self.coefficients(scene).extinction, distance)
    }

    /// [`Self::transmittance`] in lanes. It is one in lanes with several solids.
    #[inline(always)]
    pub(crate) fn transmittances<F: Lanes>(enclosing: &[Self; MAX_WIDTH], scene: &Scene, distance: F) -> Rgb<F> {
        let mut absorption = [Rgb::BLACK; MAX_WIDTH];
        let mut is_clear = true;
        for lane in 0..F::WIDTH {
            if let Self::Last(Some(material)) = enclosing[lane] {
                absorption[lane] = scene.absorption(material);
                is_clear &= absorption[lane].is_black();
            }
        }
        if is_clear {
            return Rgb::splat(distance.constant(1.0));
        }
        transmittance(Rgb::from_lanes(distance.token(), &absorption), distance)
    }

    /// The solids around a ray that leaves a surface, which bounds a solid of the given material or none: whether the
    /// ray that arrives comes from inside, and whether the one that leaves goes inward.
    #[inline]
    pub(crate) fn beyond(self, solid: Option<u32>, from_inside: bool, inward: bool) -> Self {
        match (self, solid) {
            (Self::Last(_), Some(material)) if inward != from_inside => Self::Last(inward.then_some(material)),
            _ => self,
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
}
