//! The lights of emitting surfaces.

use super::placed::PlacedScene;
use crate::light::area::{AreaLight, AreaShape};
use crate::light::mesh_light::MeshLight;
use crate::light::{Light, NO_LIGHT};
use crate::material::Material;
use crate::material::texture::Image;
use crate::query::surface::{CompiledMaterial, mean_emission};
use dunkelfeld_geometry::shape::{Rectangle, RectangleSampler, rectangle_from_triangles};
use dunkelfeld_geometry::{Vec3, geometric_normal, triangle_area};

impl PlacedScene {
    /// One light for each emitting triangle, or for each two in a row that form a rectangle, or for a mesh that is a
    /// single light. Marks the triangles.
    pub(crate) fn area_lights(
        &mut self,
        materials: &[Material],
        compiled: &[CompiledMaterial],
        images: &[Image],
    ) -> (Vec<Light>, Vec<MeshLight>) {
        let (mut lights, mut mesh_lights) = (Vec::new(), Vec::new());
        for (part_index, part) in self.parts.iter_mut().enumerate() {
            let material = &materials[part.material as usize];
            if !material.emits() {
                continue;
            }
            let mesh = &self.meshes[part.mesh as usize];
            let mean_radiance = mean_emission(material, images);
            part.lights = vec![NO_LIGHT; mesh.triangles.len()];
            let to_render = |p: Vec3| part.transform.as_ref().map_or(p, |t| t.point(p));
            let corners = |t: usize| mesh.corners(t).map(to_render);
            let normal = |t: usize| {
                let n = geometric_normal(&mesh.corners(t));
                part.transform.as_ref().map_or(n, |tr| tr.normal(n))
            };
            if self.single_lights[part_index] {
                let all = 0..mesh.triangles.len();
                let light = MeshLight::new(
                    all.clone().map(corners).collect(),
                    all.map(normal).collect(),
                    material.double_sided || material.unlit,
                    part_index as u32,
                    mean_radiance,
                    material.emission_profile,
                    compiled[part.material as usize].has_varying_radiance,
                );
                if let Some(light) = light {
                    part.lights.fill(lights.len() as u32);
                    lights.push(Light::Mesh(mesh_lights.len() as u32));
                    mesh_lights.push(light);
                }
                continue;
            }
            let mut t = 0;
            while t < mesh.triangles.len() {
                let here = corners(t);
                let next = (t + 1 < mesh.triangles.len()).then(|| corners(t + 1));
                let n = normal(t);
                let pair = next
                    .and_then(|next| rectangle_from_triangles(here, next).map(|rectangle| (rectangle, next)))
                    .filter(|_| normal(t + 1).dot(n) > 0.0);
                let second = if pair.is_some() { t as u32 + 1 } else { u32::MAX };
                let (shape, center, area, radius) = placed_shape(here, pair);
                part.lights[t] = lights.len() as u32;
                if second != u32::MAX {
                    part.lights[t + 1] = lights.len() as u32;
                }
                lights.push(Light::Area(AreaLight {
                    shape,
                    normal: n,
                    center,
                    radius,
                    area,
                    two_sided: material.double_sided || material.unlit,
                    part: part_index as u32,
                    triangles: [t as u32, second],
                    mean_radiance,
                    has_varying_radiance: compiled[part.material as usize].has_varying_radiance,
                }));
                t += if second == u32::MAX { 1 } else { 2 };
            }
        }
        (lights, mesh_lights)
    }
}

/// Shape, centre, area and radius of a triangle, or of the rectangle that it forms with the next one.
fn placed_shape(here: [Vec3; 3], pair: Option<(Rectangle, [Vec3; 3])>) -> (AreaShape, Vec3, f32, f32) {
    let reach = |center: Vec3, c: &[Vec3; 3]| c.iter().map(|v| v.distance(center)).fold(0.0, f32::max);
    match pair {
        Some((rectangle, next)) => {
            let center = rectangle.corner + 0.5 * (rectangle.edge_u + rectangle.edge_v);
            let area = triangle_area(&here) + triangle_area(&next);
            let radius = reach(center, &next).max(reach(center, &here));
            (AreaShape::Rectangle(RectangleSampler::new(&rectangle)), center, area, radius)
        }
        None => {
            let center = (here[0] + here[1] + here[2]) / 3.0;
            (AreaShape::Triangle(here), center, triangle_area(&here), reach(center, &here))
        }
    }
}
