//! Shading: from a point on a surface to a frame and a BSDF.

use crate::geometry::triangle_data::FLAT;
use crate::light::sample::Receivers;
use crate::light::{Light, NO_LIGHT};
use crate::material::finish::{Relief, Slopes};
use crate::material::height_image::Projection;
use crate::material::texture::Texture;
use crate::query::intersect::{SurfacePoint, mix};
use crate::query::surface;
use crate::query::surface_points::{CornerLanes, SurfacePoints};
use crate::scene::Scene;
use dunkelfeld_bsdf::Bsdf;
use dunkelfeld_geometry::{Frame as PointFrame, Transform, Vec2, Vec3};
use dunkelfeld_lanes::{Frame, Lanes, MAX_WIDTH, Mask, V3, vectorize};
use dunkelfeld_radiometry::Rgb;

/// Shading frames of surfaces beside their geometric normals, one for each lane.
#[derive(Clone, Copy, Debug)]
pub struct ShadingFrames<F: Lanes> {
    /// Shading frames: +z on the outside of solids, on the viewer's side of all other surfaces.
    pub frame: Frame<F>,
    /// Unit geometric normals, on the side given by the winding.
    pub normal: V3<F>,
    /// Lanes whose shading normal lies on the side of the geometric one.
    pub along: F::Mask,
    /// Lanes whose shading normal may differ from the geometric one by more than its sign. In all other lanes the local
    /// frame and the geometric normal agree about the side of a direction up to rounding.
    pub is_bent: F::Mask,
}

impl<F: Lanes> ShadingFrames<F> {
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

/// Shading frames and receivers of points, one for each lane.
#[derive(Clone, Copy, Debug)]
pub struct ShadingLanes<F: Lanes> {
    /// Shading frames.
    pub frames: ShadingFrames<F>,
    /// The points as receivers of light samples.
    pub receivers: Receivers<F>,
    /// Factor on the light toward the viewer: the visible area of the slope of a finish over that of the plane. `None` stands for
    /// one.
    pub visible: Option<F>,
}

impl<F: Lanes> ShadingLanes<F> {
    /// Points in a medium. Their frames are those of render space, and they accept light from all directions.
    #[inline(always)]
    pub fn in_medium(points: V3<F>) -> Self {
        let token = points.x.token();
        let (no, all) = (F::mask(token, 0), F::mask(token, u32::MAX >> (32 - F::WIDTH)));
        let [x, y, z] = [V3::splat(token, Vec3::X), V3::splat(token, Vec3::Y), V3::splat(token, Vec3::Z)];
        let frame = Frame { tangent: x, bitangent: y, normal: z };
        let receivers = Receivers { point: points, normal: V3::splat(token, Vec3::ZERO), both_sides: all };
        Self { frames: ShadingFrames { frame, normal: z, along: all, is_bent: no }, receivers, visible: None }
    }
}

/// The BSDFs of points of one material.
#[derive(Clone, Copy, Debug)]
pub enum Bsdfs<'a> {
    /// That of all points.
    Same(&'a Bsdf),
    /// One for each lane. Entries of lanes that are not used mean nothing.
    Each([&'a Bsdf; MAX_WIDTH]),
}

impl<'a> Bsdfs<'a> {
    /// Those of the first `len` lanes.
    #[inline(always)]
    pub fn of_lanes(each: [&'a Bsdf; MAX_WIDTH], len: usize) -> Self {
        let mut is_same = true;
        for bsdf in &each[1..len] {
            is_same &= std::ptr::eq(*bsdf, each[0]);
        }
        if is_same { Self::Same(each[0]) } else { Self::Each(each) }
    }

    /// The BSDF of a lane.
    #[inline(always)]
    pub fn lane(&self, lane: usize) -> &'a Bsdf {
        match self {
            Self::Same(bsdf) => bsdf,
            Self::Each(each) => each[lane],
        }
    }
}

impl Scene {
    /// True if surfaces of a material are boundaries of a solid that light can enter.
    #[inline(always)]
    pub fn is_solid(&self, material: u32) -> bool {
        self.compiled[material as usize].is_solid
    }

    /// True if no light passes surfaces of a material.
    #[inline]
    pub fn is_opaque(&self, material: u32) -> bool {
        let compiled = &self.compiled[material as usize];
        !compiled.has_coverage && !compiled.both_sides
    }

    /// The BSDF of a material, if it is the same at all points.
    #[inline(always)]
    pub fn only_bsdf(&self, material: u32) -> Option<&Bsdf> {
        self.compiled[material as usize].only_bsdf()
    }

    /// The BSDF at a point. `u` in `[0, 1)` chooses the kind of a stochastic material. `eta` is the index of refraction
    /// on the inside of the surface over that on its outside, if it is not that of the material. A BSDF that exists only
    /// for this point is stored in `storage`.
    #[inline(always)]
    pub fn bsdf<'a>(&'a self, p: &SurfacePoint, u: f32, eta: Option<f32>, storage: &'a mut Option<Bsdf>) -> &'a Bsdf {
        match self.compiled[p.material as usize].constant_bsdf(u) {
            Some(bsdf) if eta.is_none() => bsdf,
            constant => self.bsdf_at(*p, u, (eta, constant), storage),
        }
    }

    /// [`Self::bsdf`] of a material that varies, or at a face between two solids.
    #[inline(never)]
    fn bsdf_at<'a>(
        &'a self,
        p: SurfacePoint,
        u: f32,
        (eta, constant): (Option<f32>, Option<&'a Bsdf>),
        storage: &'a mut Option<Bsdf>,
    ) -> &'a Bsdf {
        let (compiled, material) = (&self.compiled[p.material as usize], &self.materials[p.material as usize]);
        let eta = eta.unwrap_or(material.ior);
        match constant {
            Some(bsdf) if eta == material.ior => bsdf,
            _ => storage.insert(compiled.bsdf_between(material, eta, &self.images, &self.texture_point(&p), u)),
        }
    }

    /// The BSDFs of points on one material: one for all lanes, if it is constant and no mixture. The numbers `u` and the
    /// indices of refraction `eta` of the lanes are as in [`Self::bsdf`]; empty lists stand for zero and `None`. BSDFs that
    /// exist only for one point are stored in `storage`.
    #[inline(always)]
    pub fn bsdfs<'a, F: Lanes>(
        &'a self,
        material: u32,
        points: &SurfacePoints<F>,
        (u, eta): (&[f32], &[Option<f32>]),
        storage: &'a mut [Option<Bsdf>; MAX_WIDTH],
    ) -> Bsdfs<'a> {
        match self.only_bsdf(material) {
            Some(bsdf) if eta.iter().all(Option::is_none) => Bsdfs::Same(bsdf),
            _ => self.each_bsdf(points, (u, eta), storage),
        }
    }

    #[inline(never)]
    fn each_bsdf<'a, F: Lanes>(
        &'a self,
        points: &SurfacePoints<F>,
        (u, eta): (&[f32], &[Option<f32>]),
        storage: &'a mut [Option<Bsdf>; MAX_WIDTH],
    ) -> Bsdfs<'a> {
        vectorize!(F, points.distance.token(), {
            let mut each = [&Bsdf::Absorber; MAX_WIDTH];
            for (lane, (bsdf, storage)) in each.iter_mut().zip(storage).enumerate().take(F::WIDTH) {
                let (u, eta) = (u.get(lane).copied().unwrap_or(0.0), eta.get(lane).copied().flatten());
                *bsdf = self.bsdf(&points.lane(lane), u, eta, storage);
            }
            Bsdfs::of_lanes(each, F::WIDTH)
        })
    }

    /// Frames and receivers of points on one material for the directions `wo` (unit, away from the surface).
    #[inline(always)]
    pub fn shade_lanes<F: Lanes>(&self, material: u32, points: &SurfacePoints<F>, wo: V3<F>) -> ShadingLanes<F> {
        let token = wo.x.token();
        let (no, all) = (F::mask(token, 0), F::mask(token, (1 << F::WIDTH) - 1));
        let compiled = &self.compiled[material as usize];
        // Only a smooth surface, a normal map or heights can have a shading normal that differs from the geometric one.
        let mut is_bent = points.is_smooth;
        let normal = self.interpolated_normals(token, points);
        let mut frame = if compiled.needs_tangent {
            is_bent = all;
            self.tangent_frames(token, points, normal)
        } else {
            Frame::from_normal(normal)
        };
        let mut visible = None;
        if let Some(relief) = &compiled.relief {
            is_bent = all;
            let (finished, seen) = self.finished(token, relief, (points, wo), frame);
            (frame, visible) = (finished, Some(seen));
        }
        if is_bent.any() {
            let (normal, is_turned) = visible_normals(frame.normal, points.normal, wo);
            let is_turned = is_turned & is_bent;
            if is_turned.any() {
                frame = Frame::select(is_turned, Frame::from_normal_tangent(normal, frame.tangent), frame);
            }
        }
        let is_behind = points.normal.dot(wo).lt(wo.x.constant(0.0));
        let along = if compiled.is_solid { all } else { !is_behind };
        frame.bitangent = V3::select(along, frame.bitangent, -frame.bitangent);
        frame.normal = V3::select(along, frame.normal, -frame.normal);
        ShadingLanes {
            frames: ShadingFrames { frame, normal: points.normal, along, is_bent },
            receivers: Receivers {
                point: points.point,
                normal: V3::select(is_behind, -points.normal, points.normal),
                both_sides: if compiled.both_sides { all } else { no },
            },
            visible,
        }
    }

    /// Replaces points on rounded edges by the places of fillets that viewers in the directions `wo` (unit, away from the surface)
    /// see: with their normals, so far above the face that no direction above such a normal meets the mesh at the edge.
    #[inline(always)]
    pub fn round_edges<F: Lanes>(&self, material: u32, points: &mut SurfacePoints<F>, wo: V3<F>) {
        if self.compiled[material as usize].has_rounded_edges {
            *points = self.rounded(points, wo);
        }
    }

    #[inline(never)]
    fn rounded<F: Lanes>(&self, points: &SurfacePoints<F>, wo: V3<F>) -> SurfacePoints<F> {
        vectorize!(F, wo.x.token(), {
            let token = wo.x.token();
            let normals = self.interpolated_normals(token, points).to_lanes();
            let (wo, mut rounded) = (wo.to_lanes(), [points.lane(0); MAX_WIDTH]);
            for lane in 0..F::WIDTH {
                let p = points.lane(lane);
                rounded[lane] = p;
                let Some(part) = self.parts.get(p.part as usize) else { continue };
                let (Some(edges), Some(frame)) = (&part.edges, part.frame_at(p.time)) else { continue };
                let is_seen = p.normal.dot(wo[lane]) > 0.0;
                let to_object = frame.inverse();
                let [normal, facet] = [normals[lane], p.normal].map(|n| to_object.normal(n));
                let found = edges.at(p.triangle, to_object.point(p.point), normal, to_object.vector(wo[lane]));
                if let Some((tilted, lift)) = found.filter(|_| is_seen) {
                    let raised = frame.vector(facet) * lift;
                    let error = p.error + raised.abs() * (4.0 * f32::EPSILON);
                    let point = p.point + raised;
                    rounded[lane] = SurfacePoint { point, error, normal: frame.normal(tilted), normals: FLAT, ..p };
                }
            }
            SurfacePoints::from_lanes(token, &rounded)
        })
    }

    /// The interpolated normals of smooth surfaces, and the geometric ones of all others.
    #[inline(always)]
    fn interpolated_normals<F: Lanes>(&self, token: F::Token, points: &SurfacePoints<F>) -> V3<F> {
        if !points.is_smooth.any() {
            return points.normal;
        }
        let corners = self.corner_lanes(
            token,
            points,
            #[inline(always)]
            |_, _| {},
        );
        self.shading_normals(token, points, &corners)
    }

    /// The interpolated unit normals, on the side of the geometric ones. The geometric normal if a mesh has no normals
    /// or if they cancel.
    #[inline(always)]
    pub(crate) fn shading_normals<F: Lanes>(
        &self,
        token: F::Token,
        points: &SurfacePoints<F>,
        &CornerLanes { normals: [n0, n1, n2], is_placed }: &CornerLanes<F>,
    ) -> V3<F> {
        let mut mixed = n0 * (points.b1.one_minus() - points.b2) + n1 * points.b1 + n2 * points.b2;
        if is_placed != 0 {
            self.each_pose(
                token,
                (points.part, points.time),
                is_placed,
                #[inline(always)]
                |lanes, transform| mixed = V3::select(lanes, transform.normals(mixed), mixed),
            );
        }
        let (unit, is_some) = mixed.try_normalize();
        let unit = V3::select(unit.dot(points.normal).lt(points.b1.constant(0.0)), -unit, unit);
        V3::select(is_some & points.is_smooth, unit, points.normal)
    }

    /// Frames of points with heights, from their shading frames: normal to the slopes of its height field, with tangents across
    /// its grooves. The second value is [`ShadingLanes::visible`] for the directions `wo`.
    #[inline(never)]
    fn finished<F: Lanes>(
        &self,
        token: F::Token,
        relief: &Relief,
        (points, wo): (&SurfacePoints<F>, V3<F>),
        frame: Frame<F>,
    ) -> (Frame<F>, F) {
        vectorize!(F, token, {
            let seen = wo.to_lanes();
            let [mut places, mut facets, mut views] = [[Vec3::ZERO; MAX_WIDTH]; 3];
            let mut frames = [Transform::IDENTITY; MAX_WIDTH];
            for lane in 0..F::WIDTH {
                let p = points.lane(lane);
                let frame = self.parts.get(p.part as usize).and_then(|part| part.frame_at(p.time));
                frames[lane] = frame.unwrap_or(Transform::IDENTITY);
                let to_object = frames[lane].inverse();
                (places[lane], facets[lane]) = (to_object.point(p.point), to_object.normal(p.normal));
                // A view in the plane has no direction over its cosine.
                let cos = p.normal.dot(seen[lane]);
                views[lane] = to_object.vector(seen[lane]) / cos.abs().max(LEAST_COSINE).copysign(cos);
            }
            let at = (V3::from_lanes(token, &places), V3::from_lanes(token, &facets));
            let Slopes { slope, across, visible } = match relief {
                Relief::Finish(marks) => marks.slopes::<F>(token, at, V3::from_lanes(token, &views)),
                Relief::Image(image) => {
                    let (mut slopes, mut visible) = ([Vec3::ZERO; MAX_WIDTH], [1.0; MAX_WIDTH]);
                    for lane in 0..F::WIDTH {
                        let by_uv = || self.projection(&points.lane(lane), &image.texture, &frames[lane].inverse());
                        let projections = image.projections(places[lane], facets[lane], by_uv);
                        (slopes[lane], visible[lane]) = image.seen(&self.images, &projections, views[lane]);
                    }
                    Slopes { slope: V3::from_lanes(token, &slopes), across: None, visible: F::load(token, &visible) }
                }
            };
            let turned = |v: V3<F>| {
                let mut v = v.to_lanes();
                (0..F::WIDTH).for_each(|lane| v[lane] = frames[lane].vector(v[lane]));
                V3::from_lanes(token, &v)
            };
            let tangent = across.map_or(frame.tangent, turned);
            (Frame::from_normal_tangent((frame.normal - turned(slope)).normalize(), tangent), visible)
        })
    }

    /// The place of a texture by the coordinates of the mesh. Gradients are in the frame of the object.
    fn projection(&self, p: &SurfacePoint, texture: &Texture, to_object: &Transform) -> Projection {
        let part = &self.parts[p.part as usize];
        let mesh = &self.meshes[part.mesh as usize];
        let uvs = &mesh.uvs[usize::from(texture.uv_set & 1)];
        if uvs.is_empty() {
            return Projection { uv: Vec2::ZERO, gradients: [Vec3::ZERO; 2], weight: 1.0 };
        }
        let vertices = mesh.triangles[p.triangle as usize].map(|i| i as usize);
        let [t0, t1, t2] = vertices.map(|v| texture.transform.apply(uvs[v]));
        let transform = part.transform_at(p.time);
        let [c0, c1, c2] = mesh.corners(p.triangle as usize).map(|c| transform.as_ref().map_or(c, |t| t.point(c)));
        let (e1, e2) = (c1 - c0, c2 - c0);
        let across = e1.cross(e2);
        // The gradients of the second and third barycentric coordinate.
        let [b1, b2] = [e2.cross(across), across.cross(e1)].map(|v| v / across.length_squared());
        let gradients = [b1 * (t1.x - t0.x) + b2 * (t2.x - t0.x), b1 * (t1.y - t0.y) + b2 * (t2.y - t0.y)];
        Projection {
            uv: mix(&p.barycentrics, [t0, t1, t2]),
            gradients: gradients.map(|gradient| to_object.vector(gradient)),
            weight: 1.0,
        }
    }

    /// [`Self::tangent_frame`] of each lane.
    #[inline(always)]
    fn tangent_frames<F: Lanes>(&self, token: F::Token, points: &SurfacePoints<F>, normals: V3<F>) -> Frame<F> {
        let normals = normals.to_lanes();
        let [mut tangent, mut bitangent, mut normal] = [[Vec3::ZERO; MAX_WIDTH]; 3];
        for lane in 0..F::WIDTH {
            let frame = self.tangent_frame(points.lane(lane), normals[lane]);
            (tangent[lane], bitangent[lane], normal[lane]) = (frame.tangent, frame.bitangent, frame.normal);
        }
        Frame {
            tangent: V3::from_lanes(token, &tangent),
            bitangent: V3::from_lanes(token, &bitangent),
            normal: V3::from_lanes(token, &normal),
        }
    }

    /// The frame around the shading normal with the surface's storage tangent, and with the normal map.
    #[inline(never)]
    fn tangent_frame(&self, p: SurfacePoint, normal: Vec3) -> PointFrame {
        let material = &self.materials[p.material as usize];
        let at = &self.texture_point(&p);
        let part = &self.parts[p.part as usize];
        let mesh = &self.meshes[part.mesh as usize];
        let vertices = mesh.triangles[p.triangle as usize].map(|i| i as usize);
        let transform = part.transform_at(p.time);
        let to_render_vector = |v: Vec3| transform.as_ref().map_or(v, |t| t.vector(v));
        let (tangent, handedness) = if mesh.tangents.is_empty() {
            let set = material
                .normal_map
                .texture
                .or(material.anisotropy.strength.texture)
                .map_or(0, |t| usize::from(t.uv_set & 1));
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
        if let Some(texture) = &material.normal_map.texture {
            let [x, y, z, _] = at.eval(texture, &self.images);
            let scale = material.normal_map.scale;
            let map = Vec3::new((2.0 * x - 1.0) * scale, (2.0 * y - 1.0) * scale, 2.0 * z - 1.0);
            let bent = frame.tangent * map.x + frame.bitangent * (handedness * map.y) + frame.normal * map.z;
            if let Some(n) = bent.try_normalize()
                && n.dot(p.normal) > 0.0
            {
                frame = PointFrame::from_normal_tangent(n, frame.tangent);
            }
        }
        if material.anisotropy.strength.factor != 0.0 {
            let [cos, sin] = surface::anisotropy_axis(material, &self.images, at);
            let axis = frame.tangent * cos + frame.bitangent * (handedness * sin);
            frame = PointFrame::from_normal_tangent(frame.normal, axis);
        }
        if let Some(grain) = &material.anisotropy.grain
            && let Some(object) = part.frame_at(p.time)
        {
            let to_object = object.inverse();
            let across = grain.across(to_object.point(p.point), to_object.normal(frame.normal));
            frame = across.map_or(frame, |axis| PointFrame::from_normal_tangent(frame.normal, object.vector(axis)));
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

    /// Radiance [W/(m^2 sr)] of a point on a light whose radiance is not constant.
    #[inline(never)]
    pub(crate) fn radiance_at(&self, part: u32, triangle: u32, point: Vec3, toward: Vec3) -> Rgb {
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
            Some(Light::Area(a)) => a.triangles,
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
        let facet = self.facet(part, t);
        let normal = part.transform.as_ref().map_or(facet.normal(), |t| t.normal(facet.normal()));
        SurfacePoint {
            point,
            error: Vec3::ZERO,
            normal,
            distance: 0.0,
            part: part_index,
            material: part.material,
            triangle: t,
            normals: facet.normals(),
            barycentrics: b,
            // No light moves.
            time: 0.0,
        }
    }
}

/// The least cosine of a view at which the slopes of a finish are masked.
const LEAST_COSINE: f32 = 1e-4;
/// The least cosine between the direction to the viewer and a shading normal, as a share of that to the geometric one.
const MIN_COSINE: f32 = 0.2;

/// The shading normals for viewers, and the lanes in which they are changed. For a viewer that is below it, or nearly, a
/// normal is turned toward the geometric one until its cosine is [`MIN_COSINE`] times that of the geometric one. Both
/// normals are unit vectors on one side.
#[inline(always)]
pub(crate) fn visible_normals<F: Lanes>(normal: V3<F>, geometric: V3<F>, wo: V3<F>) -> (V3<F>, F::Mask) {
    const SQUARE: f32 = MIN_COSINE * MIN_COSINE;
    let side = geometric.dot(wo);
    let (cos, least) = (normal.dot(wo) * side.constant(1.0).copysign(side), side.abs());
    let is_below = cos.lt(least * MIN_COSINE);
    if !is_below.any() {
        return (normal, is_below);
    }
    // The normal `normal * least + geometric * t`. Its condition is quadratic in t.
    let between = normal.dot(geometric).clamp(-1.0, 1.0);
    let off = cos - least * between;
    let root = (off * off + least * least * (between * between).one_minus() * (1.0 - SQUARE)).sqrt() * MIN_COSINE;
    let t = (least * SQUARE * between - cos + root) / (1.0 - SQUARE);
    let turned = (normal * least + geometric * t).normalize_or(geometric);
    (V3::select(is_below, turned, normal), is_below)
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
