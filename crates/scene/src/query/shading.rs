//! Shading: from a point on a surface to a frame and a BSDF.

use crate::features::{AllFeatures, Features};
use crate::light::sample::{LightSample, LightSampleContext, LightSamples, Receivers};
use crate::light::{FoundLights, LightChoice, MAX_LIGHTS_FOR_EACH, NO_LIGHT};
use crate::query::intersect::{SurfacePoint, mix};
use crate::query::surface::{self, TexturePoint};
use crate::scene::Scene;
use dunkelfeld_bsdf::{Bsdf, EFFECTS};
use dunkelfeld_geometry::{Frame as PointFrame, Vec2, Vec3};
use dunkelfeld_lanes::{Frame, Lanes, MAX_WIDTH, Mask, V3};
use dunkelfeld_radiometry::Rgb;

/// All data about a point that scattering needs.
#[derive(Clone, Debug)]
pub struct ShadingPoint<'a> {
    /// Shading frame: +z on the outside of solids, on the viewer's side of all other surfaces.
    pub frame: PointFrame,
    /// The BSDF of the surface.
    pub bsdf: &'a Bsdf,
    /// Index of the material.
    pub material: u32,
    /// True if the surface is the boundary of a solid that light can enter.
    pub is_solid: bool,
    /// The point as the receiver of a light sample.
    pub receiver: LightSampleContext,
    /// True if the frame's normal lies on the side of the geometric one.
    along: bool,
    /// True if the frame's normal may differ from the geometric one by more than its sign.
    is_bent: bool,
}

/// Shading frames of surfaces beside their geometric normals, one for each lane.
#[derive(Clone, Copy, Debug)]
pub struct ShadingFrames<F: Lanes> {
    /// Shading frames.
    pub frame: Frame<F>,
    /// Unit geometric normals, on the side given by the winding.
    pub normal: V3<F>,
    /// Lanes whose shading normal lies on the side of the geometric one.
    along: F::Mask,
    /// Lanes whose shading normal may differ from the geometric one by more than its sign.
    is_bent: F::Mask,
}

impl<F: Lanes> ShadingFrames<F> {
    /// The frames of shading points with their geometric normals, one for each lane.
    #[inline(always)]
    pub fn of<'a>(token: F::Token, points: impl Iterator<Item = (&'a ShadingPoint<'a>, Vec3)>) -> Self {
        let [mut tangents, mut bitangents, mut normals, mut geometric] = [[Vec3::ZERO; MAX_WIDTH]; 4];
        let (mut along, mut is_bent) = (0, 0);
        for (lane, (point, normal)) in points.enumerate().take(F::WIDTH) {
            let frame = &point.frame;
            (tangents[lane], bitangents[lane], normals[lane]) = (frame.tangent, frame.bitangent, frame.normal);
            geometric[lane] = normal;
            along |= u32::from(point.along) << lane;
            is_bent |= u32::from(point.is_bent) << lane;
        }
        Self {
            frame: Frame {
                tangent: V3::from_lanes(token, &tangents),
                bitangent: V3::from_lanes(token, &bitangents),
                normal: V3::from_lanes(token, &normals),
            },
            normal: V3::from_lanes(token, &geometric),
            along: F::mask(token, along),
            is_bent: F::mask(token, is_bent),
        }
    }

    /// Lanes whose shading normal may differ from the geometric one by more than its sign. In all other lanes the local
    /// frame and the geometric normal agree about the side of a direction up to rounding.
    #[inline(always)]
    pub fn is_bent(&self) -> F::Mask {
        self.is_bent
    }

    /// Lanes in which local frame and geometric normal agree about the side of a direction. Light must not leak through
    /// the surface in a direction about which they disagree.
    #[inline(always)]
    pub fn consistent(&self, world: V3<F>, local: V3<F>) -> F::Mask {
        let is_above = self.normal.dot(world).is_positive();
        // Up in the frame if above and along, or neither: the parity of the three.
        local.z.is_positive() ^ is_above ^ self.along
    }

    /// The mirror image of a direction at the opposite facet, and the cosine between both and its normal, without sign,
    /// in lanes with a bent normal. Light that leaves the facet in an inconsistent direction continues in its image.
    ///
    /// A shading normal is that of a facet of a relief that is not modelled. As in the valleys of Torrance and Sparrow
    /// (1967), light that leaves the facet below the surface meets the facet with the opposite slope. Where the slope is
    /// above 45 degrees, the opposite facet is perpendicular to this one. So the image of an inconsistent direction is
    /// consistent, and no light is lost.
    ///
    /// The BSDF is reciprocal about the normal of the facet, not about the geometric one. A model that is reciprocal
    /// about the geometric normal and loses no light, such as that of Schuessler et al. (2017), reflects as much light
    /// as a flat surface receives. So a white slope that faces the light would not be brighter than one that turns away
    /// from it.
    #[inline(always)]
    pub fn image(&self, world: V3<F>) -> (V3<F>, F) {
        let normal = self.frame.normal;
        let slope = self.normal.dot(normal);
        let is_flat = (slope * slope).ge(slope.constant(0.5));
        let steep = (self.normal - normal * slope) / (slope * slope).one_minus().sqrt();
        let opposite = V3::select(is_flat, self.normal * (slope * 2.0) - normal, steep);
        let cos = opposite.dot(world);
        (world - opposite * (cos * 2.0), cos.abs().min(cos.constant(1.0)))
    }

    /// [`Self::image`] of a direction in the local frame, and the lanes in which it is inconsistent. Then light of the
    /// image arrives from this direction.
    #[inline(always)]
    pub fn inconsistent_image(&self, world: V3<F>) -> (V3<F>, F, F::Mask) {
        let (image, cos) = self.image(world);
        let local = self.frame.to_local(image);
        (local, cos, self.is_bent & !self.consistent(image, local))
    }
}

impl<'a> ShadingPoint<'a> {
    /// A point in the medium of a material. Its frame is that of render space.
    pub fn in_medium(point: Vec3, phase: &'a Bsdf, material: u32) -> Self {
        let frame = PointFrame { tangent: Vec3::X, bitangent: Vec3::Y, normal: Vec3::Z };
        // It accepts light from all directions.
        let receiver = LightSampleContext { point, normal: Vec3::ZERO, both_sides: true };
        Self { frame, bsdf: phase, material, is_solid: false, receiver, along: true, is_bent: false }
    }

    /// The frame of this point alone.
    #[inline]
    pub fn frames(&self, geometric_normal: Vec3) -> ShadingFrames<f32> {
        let frame = Frame {
            tangent: self.frame.tangent.into(),
            bitangent: self.frame.bitangent.into(),
            normal: self.frame.normal.into(),
        };
        ShadingFrames { frame, normal: geometric_normal.into(), along: self.along, is_bent: self.is_bent }
    }
}

impl Scene {
    /// Frame and BSDF at a point for the direction `wo` (unit, away from the surface). `u` in `[0, 1)` chooses the kind
    /// of a stochastic material. A BSDF that exists only for this point is stored in `storage`.
    #[inline]
    pub fn shade<'a>(&'a self, p: &SurfacePoint, wo: Vec3, u: f32, storage: &'a mut Option<Bsdf>) -> ShadingPoint<'a> {
        self.shade_with::<AllFeatures>(p, wo, u, storage)
    }

    /// [`Self::shade`] in a scene that needs no more features than `F`.
    #[inline]
    pub fn shade_with<'a, F: Features>(
        &'a self,
        p: &SurfacePoint,
        wo: Vec3,
        u: f32,
        storage: &'a mut Option<Bsdf>,
    ) -> ShadingPoint<'a> {
        self.shade_as::<F>(p, wo, u, None, storage)
    }

    /// [`Self::shade`] for a face between two solids: `eta` is the index of refraction on the inside of the surface
    /// over that on its outside.
    pub fn shade_between<'a>(
        &'a self,
        p: &SurfacePoint,
        wo: Vec3,
        u: f32,
        eta: f32,
        storage: &'a mut Option<Bsdf>,
    ) -> ShadingPoint<'a> {
        self.shade_as::<AllFeatures>(p, wo, u, Some(eta), storage)
    }

    #[inline(always)]
    fn shade_as<'a, F: Features>(
        &'a self,
        p: &SurfacePoint,
        wo: Vec3,
        u: f32,
        eta: Option<f32>,
        storage: &'a mut Option<Bsdf>,
    ) -> ShadingPoint<'a> {
        let compiled = &self.compiled[p.material as usize];
        let between = eta.filter(|eta| *eta != self.materials[p.material as usize].ior);
        // Only a smooth surface or a normal map can have a shading normal that differs from the geometric one.
        let mut is_bent = EFFECTS && p.is_smooth;
        let normal = if is_bent { self.shading_normal(*p) } else { p.normal };
        let (mut frame, bsdf) = if F::TEXTURED && (compiled.varies || compiled.needs_tangent || between.is_some()) {
            let material = &self.materials[p.material as usize];
            let at = self.texture_point(p);
            is_bent |= compiled.needs_tangent;
            let frame = if compiled.needs_tangent {
                self.tangent_frame(p, normal, material, &at)
            } else {
                PointFrame::from_normal(normal)
            };
            let bsdf = match between {
                Some(eta) => storage.insert(compiled.bsdf_between(material, eta, &self.images, &at, u)),
                None => compiled.bsdf(material, &self.images, &at, u, storage),
            };
            (frame, bsdf)
        } else {
            (PointFrame::from_normal(normal), compiled.constant_bsdf(u))
        };
        if is_bent && let Some(normal) = visible_normal(frame.normal, p.normal, wo) {
            frame = PointFrame::from_normal_tangent(normal, frame.tangent);
        }
        let is_behind = p.normal.dot(wo) < 0.0;
        let facing = if is_behind { -p.normal } else { p.normal };
        let along = EFFECTS && compiled.is_solid || !is_behind;
        if !along {
            frame = PointFrame { tangent: frame.tangent, bitangent: -frame.bitangent, normal: -frame.normal };
        }
        let receiver = LightSampleContext { point: p.point, normal: facing, both_sides: compiled.both_sides };
        let is_solid = compiled.is_solid;
        ShadingPoint { frame, bsdf, material: p.material, is_solid, receiver, along, is_bent }
    }

    /// The interpolated unit normal, on the side of the geometric one. The geometric normal if a mesh has no normals or
    /// if they cancel.
    // The point is passed by value, as to all rare functions (`CONVENTIONS.md`).
    pub(crate) fn shading_normal(&self, p: SurfacePoint) -> Vec3 {
        let part = &self.parts[p.part as usize];
        let facet = self.facet(part, p.triangle);
        if !facet.is_smooth {
            return p.normal;
        }
        let mixed = mix(&p.barycentrics, facet.normals);
        match part.transform_at(p.time).map_or(mixed, |t| t.normal(mixed)).try_normalize() {
            Some(n) if n.dot(p.normal) < 0.0 => -n,
            Some(n) => n,
            None => p.normal,
        }
    }

    /// The frame around the shading normal with the surface's storage tangent, and with the normal map.
    fn tangent_frame(
        &self,
        p: &SurfacePoint,
        normal: Vec3,
        material: &crate::Material,
        at: &TexturePoint,
    ) -> PointFrame {
        let part = &self.parts[p.part as usize];
        let mesh = &self.meshes[part.mesh as usize];
        let vertices = mesh.triangles[p.triangle as usize].map(|i| i as usize);
        let transform = part.transform_at(p.time);
        let to_render_vector = |v: Vec3| transform.as_ref().map_or(v, |t| t.vector(v));
        let (tangent, handedness) = if mesh.tangents.is_empty() {
            let set = material.normal_texture.or(material.anisotropy_texture).map_or(0, |t| usize::from(t.uv_set & 1));
            let (t, w) = uv_tangent(&mesh.corners(p.triangle as usize), vertices, &mesh.uvs[set]);
            (to_render_vector(t), w)
        } else {
            let t = mix(&p.barycentrics, vertices.map(|v| mesh.tangents[v].truncate()));
            (to_render_vector(t), mesh.tangents[vertices[0]].w)
        };
        let mut frame = PointFrame::from_normal_tangent(normal, tangent);
        // The bitangent of a mirrored instance keeps the handedness of its storage space.
        let mirrored = transform.as_ref().is_some_and(|t| t.swaps_handedness());
        let handedness = if mirrored { -handedness } else { handedness };
        if let Some(texture) = &material.normal_texture {
            let [x, y, z, _] = texture.eval(&self.images, at.uvs[usize::from(texture.uv_set & 1)]);
            let scale = material.normal_scale;
            let map = Vec3::new((2.0 * x - 1.0) * scale, (2.0 * y - 1.0) * scale, 2.0 * z - 1.0);
            let bent = frame.tangent * map.x + frame.bitangent * (handedness * map.y) + frame.normal * map.z;
            if let Some(n) = bent.try_normalize()
                && n.dot(p.normal) > 0.0
            {
                frame = PointFrame::from_normal_tangent(n, frame.tangent);
            }
        }
        if material.anisotropy != 0.0 {
            let (sin, cos) = surface::anisotropy(material, &self.images, at).1.sin_cos();
            let axis = frame.tangent * cos + frame.bitangent * (handedness * sin);
            frame = PointFrame::from_normal_tangent(frame.normal, axis);
        }
        frame
    }

    /// Absorption coefficient [1/m] inside the solid of a material.
    #[inline]
    pub fn absorption(&self, material: u32) -> Rgb {
        self.compiled[material as usize].absorption
    }

    /// Object and material of a point, as indices.
    pub fn ids(&self, p: &SurfacePoint) -> (u32, u32) {
        let part = &self.parts[p.part as usize];
        (part.object, part.material)
    }

    /// Maximum number of light samples of a vertex.
    pub const MAX_LIGHT_SAMPLES: u32 = MAX_LIGHTS_FOR_EACH as u32;

    /// The light samples of the scattering vertex with this number (from 0, counted along a path). With at most eight
    /// lights, vertices on surfaces and the first two vertices in media take a sample of each light, unless the
    /// technique is left out. All other vertices take a sample of one light.
    #[inline]
    pub fn light_choice_at(&self, vertex: u32, in_medium: bool) -> LightChoice {
        self.lights.choice_at(vertex, in_medium)
    }

    /// Number of light samples of a vertex, one for each call of [`Self::sample_light`].
    #[inline]
    pub fn num_light_samples(&self, choice: LightChoice) -> u32 {
        self.lights.num_light_samples(choice) as u32
    }

    /// A light sample: a direction toward a light, with the radiance that arrives unoccluded. The light is that of the
    /// index `index` (below [`Self::num_light_samples`]), or is chosen by `u_choice`. The light samples of a
    /// vertex are summed.
    #[inline]
    pub fn sample_light(
        &self,
        receiver: &LightSampleContext,
        choice: LightChoice,
        index: u32,
        u_choice: f32,
        u: [f32; 2],
    ) -> Option<LightSample> {
        self.sample_lights::<f32>((), &receiver.into(), choice, index, u_choice, u, true).single()
    }

    /// [`Self::sample_light`] of each active lane. With [`LightChoice::Each`] all lanes sample the same light.
    #[inline(always)]
    #[expect(clippy::too_many_arguments)]
    pub fn sample_lights<F: Lanes>(
        &self,
        token: F::Token,
        receivers: &Receivers<F>,
        choice: LightChoice,
        index: u32,
        u_choice: F,
        u: [F; 2],
        active: F::Mask,
    ) -> LightSamples<F> {
        let FoundLights { mut samples, varying, surfaces } =
            self.lights.sample(token, receivers, choice, index, (u_choice, u), active);
        let varying = varying & samples.pdf.is_positive().bits();
        if varying != 0 {
            let (points, directions) = (samples.point.to_lanes(), samples.direction.to_lanes());
            let Rgb { r, g, b } = samples.radiance;
            let (mut r, mut g, mut b) = (r.to_array(), g.to_array(), b.to_array());
            for lane in 0..F::WIDTH {
                if varying >> lane & 1 == 1 {
                    let [part, triangle] = surfaces[lane];
                    let radiance = self.radiance_at(part, triangle, points[lane], -directions[lane]);
                    [r[lane], g[lane], b[lane]] = radiance.to_array();
                }
            }
            samples.radiance = Rgb::new(F::load(token, &r), F::load(token, &g), F::load(token, &b));
        }
        samples
    }

    /// Radiance [W/(m^2 sr)] of a point on a light whose radiance is not constant.
    #[inline(never)]
    fn radiance_at(&self, part: u32, triangle: u32, point: Vec3, toward: Vec3) -> Rgb {
        let p = self.locate(part, triangle, point);
        self.emitted(&p, toward) * self.coverage(&p, -toward)
    }

    /// The surface point of a light at a position. It lies on the given triangle or, if that does not contain it, on
    /// the other triangle of the light's rectangle.
    fn locate(&self, part_index: u32, triangle: u32, point: Vec3) -> SurfacePoint {
        let part = &self.parts[part_index as usize];
        let mesh = &self.meshes[part.mesh as usize];
        let to_render = |p: Vec3| part.transform.as_ref().map_or(p, |t| t.point(p));
        let light = part.lights.get(triangle as usize).copied().unwrap_or(NO_LIGHT);
        let candidates = match self.lights.lights.get(light as usize) {
            Some(crate::light::Light::Area(a)) => a.triangles,
            _ => [triangle, u32::MAX],
        };
        let inside = |t: u32| {
            let b = barycentrics(mesh.corners(t as usize).map(to_render), point);
            (b[0].min(b[1]).min(b[2]), b, t)
        };
        let mut best = inside(candidates[0]);
        if candidates[1] != u32::MAX {
            let other = inside(candidates[1]);
            if other.0 > best.0 {
                best = other;
            }
        }
        let (_, b, t) = best;
        let normal = to_render_normal_of(part, mesh, t);
        SurfacePoint {
            point,
            error: Vec3::ZERO,
            normal,
            distance: 0.0,
            part: part_index,
            material: part.material,
            triangle: t,
            is_smooth: self.facet(part, t).is_smooth,
            barycentrics: b,
            // No light moves.
            time: 0.0,
        }
    }

    /// The density [1/sr] of a point on a surface in [`Self::sample_light`]; 0 if the surface does not emit.
    #[inline]
    pub fn light_pdf(&self, receiver: &LightSampleContext, choice: LightChoice, p: &SurfacePoint) -> f32 {
        match self.parts[p.part as usize].lights.get(p.triangle as usize) {
            Some(&light) if light != NO_LIGHT => {
                self.lights.pdf_area(receiver, choice, light, (p.triangle, p.point, p.normal))
            }
            _ => 0.0,
        }
    }

    /// The lights of kind sun whose disc contains a direction, as pairs of index and radiance [W/(m^2 sr)].
    #[inline]
    pub fn suns_along(&self, direction: Vec3) -> impl Iterator<Item = (u32, Rgb)> {
        let lit = self.lights.suns().map(move |(index, sun)| (index as u32, sun.radiance(direction)));
        lit.filter(|(_, radiance)| !radiance.is_black())
    }

    /// The density [1/sr] of a direction toward the sun of an index in [`Self::sample_light`].
    pub fn sun_pdf(&self, receiver: &LightSampleContext, choice: LightChoice, sun: u32, direction: Vec3) -> f32 {
        self.lights.pdf_sun(receiver, choice, sun, direction)
    }

    /// Radiance [W/(m^2 sr)] of the environment along a direction, without suns.
    #[inline]
    pub fn environment_radiance(&self, direction: Vec3) -> Rgb {
        if EFFECTS {
            self.lights.environment.as_ref().map_or(Rgb::BLACK, |e| e.radiance(direction))
        } else {
            Rgb::BLACK
        }
    }

    /// The density [1/sr] of a direction toward the environment in [`Self::sample_light`].
    #[inline]
    pub fn environment_pdf(&self, receiver: &LightSampleContext, choice: LightChoice, direction: Vec3) -> f32 {
        self.lights.pdf_environment(receiver, choice, direction)
    }
}

/// The least cosine between the direction to the viewer and a shading normal, as a share of that to the geometric one.
const MIN_COSINE: f32 = 0.2;

/// The shading normal for a viewer that is below it, or nearly: turned toward the geometric normal until its cosine is
/// [`MIN_COSINE`] times that of the geometric one. `None` if it stays. Both normals are unit vectors on one side.
#[inline]
pub(crate) fn visible_normal(normal: Vec3, geometric: Vec3, wo: Vec3) -> Option<Vec3> {
    let side = geometric.dot(wo);
    let (cos, least) = (normal.dot(wo) * 1f32.copysign(side), side.abs());
    (cos < MIN_COSINE * least).then(|| turned_to_viewer(normal, geometric, [cos, least]))
}

/// The normal `normal * cosines[1] + geometric * t` of [`visible_normal`]. Its condition is quadratic in t.
#[inline(never)]
fn turned_to_viewer(normal: Vec3, geometric: Vec3, [cos, side]: [f32; 2]) -> Vec3 {
    const SQUARE: f32 = MIN_COSINE * MIN_COSINE;
    let between = normal.dot(geometric).clamp(-1.0, 1.0);
    let off = cos - side * between;
    let root = MIN_COSINE * (off * off + side * side * (1.0 - between * between) * (1.0 - SQUARE)).sqrt();
    let t = (SQUARE * side * between - cos + root) / (1.0 - SQUARE);
    (normal * side + geometric * t).try_normalize().unwrap_or(geometric)
}

fn to_render_normal_of(part: &crate::scene::Part, mesh: &dunkelfeld_geometry::Mesh, triangle: u32) -> Vec3 {
    let n = dunkelfeld_geometry::geometric_normal(&mesh.corners(triangle as usize));
    part.transform.as_ref().map_or(n, |t| t.normal(n))
}

/// Barycentric coordinates of a point in (or near) a triangle's plane, by projected areas in f64.
fn barycentrics(corners: [Vec3; 3], point: Vec3) -> [f32; 3] {
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let p = point.as_dvec3();
    let n = (b - a).cross(c - a);
    let inverse = 1.0 / n.length_squared();
    let b1 = (c - a).cross(a - p).dot(n) * inverse;
    let b2 = (a - p).cross(b - a).dot(n) * inverse;
    [(1.0 - b1 - b2) as f32, b1 as f32, b2 as f32]
}

/// The direction in which u grows, from the texture coordinates of a triangle, and the sign of the bitangent. If the
/// image is not mirrored, v grows against the bitangent, because v points down and the bitangent up (glTF). Zero and 1
/// if the coordinates are degenerate or missing.
fn uv_tangent(corners: &[Vec3; 3], vertices: [usize; 3], uvs: &[Vec2]) -> (Vec3, f32) {
    if uvs.is_empty() {
        return (Vec3::ZERO, 1.0);
    }
    let [t0, t1, t2] = vertices.map(|v| uvs[v]);
    let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
    let (d1, d2) = (t1 - t0, t2 - t0);
    let determinant = d1.x * d2.y - d2.x * d1.y;
    if determinant == 0.0 || !determinant.is_finite() {
        return (Vec3::ZERO, 1.0);
    }
    ((e1 * d2.y - e2 * d1.y) * determinant.signum(), -determinant.signum())
}
