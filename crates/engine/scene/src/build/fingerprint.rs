//! Fingerprint of a scene for checkpoints, which must not be continued with another scene.

use crate::material::texture::{Channel, Image, rgba, with_texels};
use crate::scene::{Part, Scene};
use dunkelfeld_geometry::Mesh;
use serde::Serialize;
use std::io::Write;
use twox_hash::XxHash3_128;

/// Size of the buffer in front of the hash \[bytes\].
const CHUNK: usize = 1 << 16;

/// The XXH3 hash of the serialised value (format postcard, version 1): all its numbers to the last bit, in the order of
/// its fields, without the names of types and fields.
pub fn digest(value: &impl Serialize) -> u128 {
    let mut hash = Hash::default();
    hash.value(value);
    hash.finish()
}

impl Scene {
    /// A hash of all data of the scene that can change a sample. It does not depend on the files that the data came
    /// from. Meshes are hashed by their memory, images by their values, and all other data by their serialised values.
    pub fn fingerprint(&self) -> u128 {
        // No `..`, so that the compiler demands a decision for each new field.
        let Self {
            world_origin,
            bounds,
            // Both are computed from the meshes.
            bvh: _,
            facets: _,
            placements,
            parts,
            meshes,
            object_names,
            punctual_names,
            materials,
            compiled,
            images,
            lights,
            cameras,
            radius,
            has_coverage,
            has_open_faces,
            solids,
            solid_bounds,
            has_nesting,
            covers,
            shutter,
            has_solids,
            has_media,
            effects,
        } = self;
        let mut hash = Hash::default();
        hash.value(&(world_origin, bounds, placements, parts, object_names, punctual_names));
        hash.value(&(materials, compiled, lights, cameras, radius, has_coverage, has_open_faces));
        hash.value(&(solids, solid_bounds, has_nesting, covers, has_solids, has_media, effects));
        // Scenes at rest keep the fingerprint that they had before motion existed.
        if let Some(shutter) = shutter {
            hash.value(shutter);
        }
        let radius = |(number, part): (usize, &Part)| Some((number, part.edges.as_ref()?.radius()));
        parts.iter().enumerate().filter_map(radius).for_each(|radius| hash.value(&radius));
        meshes.iter().for_each(|mesh| hash.mesh(mesh));
        images.iter().for_each(|image| hash.image(image));
        hash.finish()
    }
}

struct Hash {
    state: XxHash3_128,
    buffer: Vec<u8>,
}

impl Default for Hash {
    fn default() -> Self {
        Self { state: XxHash3_128::new(), buffer: Vec::with_capacity(2 * CHUNK) }
    }
}

impl Hash {
    fn bytes(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
        if self.buffer.len() >= CHUNK {
            self.empty_buffer();
        }
    }

    fn empty_buffer(&mut self) {
        self.state.write(&self.buffer);
        self.buffer.clear();
    }

    fn value(&mut self, value: &impl Serialize) {
        // Writing into the hash does not fail, and the length of each list is known.
        let written = postcard::to_io(value, &mut *self).map(|_| ());
        debug_assert_eq!(written, Ok(()));
    }

    /// Hashes the number of elements that follow, so that lists of different lengths have different hashes.
    fn count(&mut self, n: usize) {
        self.bytes(&(n as u64).to_le_bytes());
    }

    fn floats<const N: usize>(&mut self, values: impl ExactSizeIterator<Item = [f32; N]>) {
        self.count(values.len());
        values.flatten().for_each(|v| self.bytes(&v.to_bits().to_le_bytes()));
    }

    fn mesh(&mut self, mesh: &Mesh) {
        let Mesh { positions, triangles, normals, tangents, uvs, colors } = mesh;
        self.floats(positions.iter().map(|v| v.to_array()));
        self.count(triangles.len());
        triangles.iter().flatten().for_each(|i| self.bytes(&i.to_le_bytes()));
        self.floats(normals.iter().map(|v| v.to_array()));
        self.floats(tangents.iter().map(|v| v.to_array()));
        uvs.iter().for_each(|set| self.floats(set.iter().map(|v| v.to_array())));
        self.floats(colors.iter().map(|v| v.to_array()));
    }

    fn image(&mut self, image: &Image) {
        // The name is used only in messages.
        let Image { name: _, width, height, texels } = image;
        self.value(&(width, height));
        if texels.is_float() {
            self.count(texels.len());
        }
        let channels = if texels.is_float() { 3 } else { 4 };
        // By value: a channel that is not stored is hashed as its default.
        with_texels!(&**texels, t => t.iter().for_each(|t| {
            rgba(*t).iter().take(channels).for_each(|v| self.bytes(v.le_bytes().as_ref()));
        }));
    }

    fn finish(mut self) -> u128 {
        self.empty_buffer();
        self.state.finish_128()
    }
}

impl Write for Hash {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.bytes(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::shapes::{cuboid, sphere};
    use crate::{Material, SceneBuilder};
    use dunkelfeld_geometry::{DVec3, Vec3};
    use dunkelfeld_radiometry::Rgb;
    use std::sync::Arc;

    fn builder() -> SceneBuilder {
        let mut b = SceneBuilder::default();
        let grey = b.add_material(Material { base_color: Rgb::splat(0.5).into(), ..Material::default() });
        b.add_object("box", cuboid(Vec3::ZERO, Vec3::ONE), grey);
        b.add_object("ball", sphere(Vec3::new(3.0, 0.0, 0.0), 1.0, 8, true), grey);
        b.add_camera("camera", DVec3::new(0.0, -5.0, 0.0), DVec3::ZERO, 0.7);
        b
    }

    fn fingerprint(change: impl FnOnce(&mut SceneBuilder)) -> u128 {
        let mut b = builder();
        change(&mut b);
        b.build().expect("a scene").0.fingerprint()
    }

    #[test]
    fn a_fingerprint_depends_on_the_last_bit_and_is_repeatable() {
        let same = fingerprint(|_| {});
        assert_eq!(fingerprint(|_| {}), same);
        type Change = fn(&mut SceneBuilder);
        let changes: [Change; 4] = [
            |b| {
                let mesh = Arc::make_mut(&mut b.meshes[1].mesh);
                mesh.positions[3].x = mesh.positions[3].x.next_up();
            },
            |b| b.materials[0].roughness.factor = b.materials[0].roughness.factor.next_down(),
            |b| b.cameras[0].name.push('s'),
            |b| {
                b.add_object("other", cuboid(Vec3::splat(7.0), Vec3::splat(8.0)), 0);
            },
        ];
        for (i, change) in changes.into_iter().enumerate() {
            assert_ne!(fingerprint(change), same, "change {i}");
        }
    }
}
