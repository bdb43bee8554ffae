//! Points on surfaces and shading in lanes have the bits of single points, for each kind of mesh, pose and material.

use dunkelfeld_bsdf::Bsdf;
use dunkelfeld_bvh::Hit;
use dunkelfeld_geometry::{DAffine3, DQuat, DVec3, Mesh, Ray, RigidMotion, Vec2, Vec3, Vec4};
use dunkelfeld_lanes::{InstructionSet, Lanes, MAX_WIDTH, Mask, V3, dispatch};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::mix64;
use dunkelfeld_scene::shapes::{cuboid, sphere};
use dunkelfeld_scene::{
    AlphaMode, ChannelTexture, ColorEncoding, HitLanes, Image, ImageId, Material, Scene, SceneBuilder, ShadingLanes,
    Shutter, Surface, SurfacePoint, Texels, Texture, Volume,
};

const EXPOSURE: f64 = 0.5;

struct Random(u64);

impl Random {
    /// Evenly distributed in [-1, 1).
    fn next(&mut self) -> f32 {
        self.0 += 1;
        (mix64(self.0) >> 40) as f32 / 8_388_608.0 - 1.0
    }
    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }
    fn direction(&mut self) -> Vec3 {
        self.vector().try_normalize().unwrap_or(Vec3::Z)
    }
}

/// Material number `k` of as many kinds as there are, with the image 0.
fn material(k: usize) -> Material {
    let texture = Texture::new(ImageId(0), ColorEncoding::Linear);
    let solid = Surface::Solid(Volume::default());
    let plain = Material { base_color: Rgb::new(0.7, 0.5, 0.3), ..Material::default() };
    match k {
        0 => plain,
        1 => Material { transmission: 1.0, roughness: 0.0, surface: solid, ..plain },
        2 => Material { transmission: 0.4, ..plain },
        3 => Material { base_color_texture: Some(texture), ..plain },
        4 => Material { normal_texture: Some(texture), normal_scale: 1.3, ..plain },
        5 => Material { anisotropy: 0.8, anisotropy_rotation: 0.7, metallic: 1.0, ..plain },
        6 => Material { anisotropy: 0.5, anisotropy_texture: Some(texture), normal_texture: Some(texture), ..plain },
        7 => {
            Material { transmission: 0.6, transmission_texture: Some(ChannelTexture { texture, channel: 1 }), ..plain }
        }
        8 => Material { diffuse_transmission: 0.3, surface: solid, ..plain },
        _ => Material { emission: Rgb::WHITE, alpha: 0.5, alpha_mode: AlphaMode::Blend, ..plain },
    }
}
const MATERIALS: usize = 10;

/// A ball, a ball with normals that lean to all sides, or a box, with or without tangents and texture coordinates.
fn mesh(k: usize, place: Place, random: &mut Random) -> Mesh {
    let rings = if place == Place::Joined { 80 } else { 9 };
    let mut mesh = match k % 3 {
        0 => cuboid(Vec3::splat(-0.4), Vec3::splat(0.3)),
        _ => sphere(Vec3::new(0.1, 0.0, -0.1), 0.5, rings, true),
    };
    if k % 3 == 2 {
        mesh.normals.iter_mut().for_each(|n| *n = (*n + 0.9 * random.vector()).try_normalize().unwrap_or(*n));
        mesh.normals[7] = -mesh.normals[8];
    }
    if place == Place::Instanced {
        // Only meshes of many triangles become instances. These are far away.
        for i in 0..9000 {
            let (first, at) = (mesh.positions.len() as u32, Vec3::new(90.0, 0.0, 1e-3 * i as f32));
            mesh.positions.extend([at, at + 1e-3 * Vec3::X, at + 1e-3 * Vec3::Y]);
            mesh.triangles.push([first, first + 1, first + 2]);
        }
    }
    let count = mesh.positions.len();
    if !mesh.normals.is_empty() {
        mesh.normals.resize(count, Vec3::Z);
    }
    if k.is_multiple_of(2) {
        mesh.uvs[0] = (0..count).map(|_| Vec2::new(random.next(), random.next())).collect();
    }
    if k % 4 == 1 {
        mesh.tangents = (0..count).map(|i| random.direction().extend([1.0, -1.0][i % 2])).collect();
    }
    if k % 5 == 4 {
        mesh.colors = (0..count).map(|_| Vec4::splat(0.5) + 0.5 * random.vector().extend(0.0)).collect();
    }
    mesh
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    /// All meshes in one tree.
    Shared,
    /// Trees that are joined.
    Joined,
    /// Under transforms.
    Instanced,
    /// Under transforms that change with time.
    Moving,
}

fn scene(place: Place) -> Scene {
    let mut random = Random(5);
    let pixel = |_| [0; 4].map(|_: i32| (32768.0 + 32767.0 * random.next()) as u16);
    let texels: Vec<[u16; 4]> = (0..64).map(pixel).collect();
    let image = Image { name: "noise".into(), width: 8, height: 8, texels: Texels::Rgba16(texels).into() };
    let mut b = SceneBuilder { images: vec![image], ..SceneBuilder::default() };
    let materials: Vec<usize> = (0..MATERIALS).map(|k| b.add_material(material(k))).collect();
    for k in 0..30 {
        let m = mesh(k, place, &mut random);
        b.add_object(&format!("object {k}"), m, materials[(k * 7 + k / 10) % MATERIALS]);
        let scale = match place {
            Place::Instanced => DVec3::new(0.8, 1.2, [1.0, -0.7][k % 2]),
            _ => DVec3::ONE,
        };
        let turn = DQuat::from_axis_angle(random.direction().as_dvec3(), 3.0);
        let at = 3.0 * random.vector().as_dvec3();
        let instance = &mut b.instances[k];
        instance.to_world = DAffine3::from_scale_rotation_translation(scale, turn, at);
        if place == Place::Moving && k % 3 != 0 {
            let spin = RigidMotion::rotation(random.direction().as_dvec3(), at, 0.5).expect("an axis");
            let motion = if k % 2 == 0 { spin } else { RigidMotion::default() };
            instance.motion = RigidMotion { velocity: random.vector().as_dvec3(), ..motion };
        }
    }
    if place == Place::Moving {
        b.shutter = Some(Shutter::Frame { exposure: EXPOSURE });
        // A light must not move.
        for (instance, mesh) in b.instances.iter_mut().zip(&b.meshes) {
            if mesh.material == materials[MATERIALS - 1] {
                instance.motion = RigidMotion::default();
            }
        }
    }
    if place == Place::Instanced {
        for k in 0..30 {
            let mut twin = b.instances[k].clone();
            twin.to_world.translation += DVec3::new(0.7, 0.3, -0.5);
            b.instances.push(twin);
        }
    }
    b.build().expect("the scene is valid").0
}

/// Random hits with the directions to their viewers, which lie on all sides of the surfaces, and their times \[s\].
fn hits(scene: &Scene, count: usize) -> Vec<(Hit, Vec3, f32)> {
    let mut random = Random(99);
    let mut found = Vec::new();
    while found.len() < count {
        let time = if scene.shutter().is_some() { 0.5 * EXPOSURE as f32 * random.next() } else { 0.0 };
        let ray = Ray::new(4.0 * random.vector(), random.direction()).at_time(time);
        let Some(hit) = scene.bvh().closest_hit(&ray) else { continue };
        // Each third view is grazing or from another side.
        let wo = if found.len() % 3 == 0 {
            let n = scene.surface_point(&hit, time).normal;
            (n.any_orthonormal_vector() + 0.02 * random.vector()).normalize()
        } else {
            -ray.direction
        };
        found.push((hit, wo, time));
    }
    found
}

type HitOf = (Hit, Vec3, f32);

fn kind(hit: &Hit) -> f32 {
    (hit.triangle % 7) as f32 / 7.0
}

/// The data of a point. Their text has all digits of each number.
#[derive(Debug)]
#[expect(dead_code, reason = "the texts are compared")]
struct Found {
    point: SurfacePoint,
    frame: [Vec3; 3],
    receiver: [Vec3; 2],
    origin: Vec3,
    both_sides: bool,
    is_bent: bool,
    is_consistent: bool,
    emits: bool,
    bsdf: Bsdf,
}

fn found_singly(scene: &Scene, (hit, wo, time): &HitOf) -> Found {
    let point = scene.surface_point(hit, *time);
    let mut storage = None;
    let bsdf = *scene.bsdf(&point, kind(hit), None, &mut storage);
    let ShadingLanes { frames, receivers } = scene.shade_lanes::<f32>(point.material(), &(&point).into(), (*wo).into());
    let frame = frames.frame;
    Found {
        point,
        frame: [frame.tangent.into(), frame.bitangent.into(), frame.normal.into()],
        receiver: [receivers.point.into(), receivers.normal.into()],
        origin: point.ray_origin(*wo),
        both_sides: receivers.both_sides,
        is_bent: frames.is_bent,
        is_consistent: frames.consistent((*wo).into(), frame.to_local((*wo).into())),
        emits: scene.emits(point.material()),
        bsdf,
    }
}

/// The points of hits on one material, as many as there are lanes.
#[inline(always)]
fn found_in_lanes<F: Lanes>(token: F::Token, scene: &Scene, hits: &[HitOf], found: &mut Vec<Found>) {
    let [mut t, mut b1, mut b2, mut time, mut u] = [[0.0; MAX_WIDTH]; 5];
    let [mut instance, mut part, mut triangle] = [[0; MAX_WIDTH]; 3];
    let mut wo = [Vec3::ZERO; MAX_WIDTH];
    for lane in 0..F::WIDTH {
        let (hit, its_wo, its_time) = &hits[lane.min(hits.len() - 1)];
        (t[lane], b1[lane], b2[lane], time[lane]) = (hit.t, hit.b1, hit.b2, *its_time);
        (instance[lane], part[lane], triangle[lane]) = (hit.instance, hit.part, hit.triangle);
        (wo[lane], u[lane]) = (*its_wo, kind(hit));
    }
    let lanes = HitLanes::<F> {
        t: F::load(token, &t),
        b1: F::load(token, &b1),
        b2: F::load(token, &b2),
        instance: F::load_word(token, &instance),
        part: F::load_word(token, &part),
        triangle: F::load_word(token, &triangle),
    };
    let wo = V3::from_lanes(token, &wo);
    let points = scene.surface_points(token, &lanes, F::load(token, &time));
    let material = scene.material_of(instance[0], part[0], triangle[0]);
    let shading = scene.shade_lanes(material, &points, wo);
    let mut storage = [None; MAX_WIDTH];
    let bsdfs = scene.bsdfs(material, &points, (&u, &[]), &mut storage);
    let frame = shading.frames.frame;
    let consistent = shading.frames.consistent(wo, frame.to_local(wo)).bits();
    let bit = |bits: u32, lane: usize| bits >> lane & 1 == 1;
    let origins = points.ray_origins(wo).to_lanes();
    for (lane, origin) in origins.into_iter().enumerate().take(F::WIDTH.min(hits.len())) {
        let vector = |v: V3<F>| v.to_lanes()[lane];
        found.push(Found {
            point: points.lane(lane),
            frame: [vector(frame.tangent), vector(frame.bitangent), vector(frame.normal)],
            receiver: [vector(shading.receivers.point), vector(shading.receivers.normal)],
            origin,
            both_sides: bit(shading.receivers.both_sides.bits(), lane),
            is_bent: bit(shading.frames.is_bent.bits(), lane),
            is_consistent: bit(consistent, lane),
            emits: scene.emits(points.lane(lane).material()),
            bsdf: *bsdfs.lane(lane),
        });
    }
}

#[test]
fn all_widths_have_the_bits_of_single_points() {
    for place in [Place::Shared, Place::Joined, Place::Instanced, Place::Moving] {
        let scene = scene(place);
        let instanced = scene.summary().instanced_parts;
        assert_eq!(instanced > 0, matches!(place, Place::Instanced | Place::Moving), "{place:?}: {instanced}");
        let mut hits = hits(&scene, 6000);
        let material = |(hit, _, _): &HitOf| scene.material_of(hit.instance, hit.part, hit.triangle);
        hits.sort_by_key(material);
        let expected: Vec<Found> = hits.iter().map(|hit| found_singly(&scene, hit)).collect();
        assert!(expected.iter().zip(&hits).all(|(found, hit)| found.point.material() == material(hit)));
        // All branches are tested.
        let bent = expected.iter().filter(|f| f.is_bent).count();
        assert!(bent > 2000 && bent < 5500, "{place:?}: {bent}");
        assert!(expected.iter().filter(|f| !f.is_consistent).count() < 10);
        for set in InstructionSet::all() {
            let mut found = Vec::new();
            for group in hits.chunk_by(|a, b| material(a) == material(b)).flat_map(|g| g.chunks(set.lanes())) {
                dispatch!(set, F, token => found_in_lanes::<F>(token, &scene, group, &mut found));
            }
            assert_eq!(found.len(), expected.len());
            for (found, expected) in found.iter().zip(&expected) {
                assert_eq!(format!("{found:?}"), format!("{expected:?}"), "{place:?}, {set:?}");
            }
        }
    }
}
