//! Invalid input of a builder is refused or repaired, and never causes a panic.

use dunkelfeld_geometry::{DAffine3, DVec3, Ray, Vec2, Vec3, Vec4};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_scene::shapes::{cuboid, rectangle, sphere};
use dunkelfeld_scene::{
    BuildCache, BuildError, Camera, ColorEncoding, Environment, EnvironmentSource, Finding, Image, ImageId, Instance,
    Material, Parameter, Projection, PunctualKind, PunctualLight, Scene, SceneBuilder, Severity, Surface, SurfacePoint,
    Texels, Texture, Volume,
};
use std::sync::Arc;

/// A change that makes a valid scene invalid.
type Corrupt = Box<dyn Fn(&mut SceneBuilder)>;

/// One white square of a metre in the xy plane, facing +z.
fn square() -> SceneBuilder {
    let mut b = SceneBuilder::default();
    let m = b.add_material(Material::default());
    b.add_object("square", rectangle(Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y), m);
    b
}

fn camera(projection: Projection) -> Camera {
    Camera { name: "c".into(), to_world: DAffine3::IDENTITY, projection, ..Camera::default() }
}

#[test]
fn singular_or_non_finite_transforms_remove_their_object() {
    let bad = [
        DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0)),
        DAffine3::from_scale(DVec3::splat(f64::NAN)),
        DAffine3::from_translation(DVec3::new(f64::INFINITY, 0.0, 0.0)),
        DAffine3::from_scale(DVec3::splat(1e300)),
    ];
    let mut b = square();
    for to_world in bad {
        b.instances.push(Instance { name: "bad".into(), meshes: vec![0], to_world, motion: Default::default() });
    }
    let (scene, report) = b.build().expect("the good one is left");
    assert_eq!(report.findings.iter().filter(|f| f.place == "object \"bad\"").count(), bad.len(), "{report:?}");
    assert_eq!(scene.summary().placed_triangles, 2);
    assert_eq!(scene.bounds().map(|b| b[1]), Some(DVec3::new(0.5, 0.5, 0.0)));
}

#[test]
fn indices_out_of_range_are_named() {
    let texture = Texture::new(ImageId(3), ColorEncoding::Linear);
    let cases: [(&str, Corrupt); 4] = [
        ("material 9", Box::new(|b| b.meshes[0].material = 9)),
        ("mesh 7", Box::new(|b| b.instances[0].meshes.push(7))),
        ("image 3", Box::new(move |b| b.materials[0].normal_map.texture = Some(texture))),
        (
            "image 5",
            Box::new(|b| {
                let source = EnvironmentSource::Image { image: ImageId(5), scale: Rgb::WHITE };
                b.environment = Some(Environment { source, rotation: 0.0 });
            }),
        ),
    ];
    for (what, spoil) in cases {
        let mut b = square();
        spoil(&mut b);
        let error = b.build().expect_err(what);
        assert!(matches!(error, BuildError::BadIndex { .. }) && error.to_string().contains(what), "{error}");
    }
}

#[test]
fn invalid_values_are_refused_by_name() {
    let nan = f32::NAN;
    let light = |kind| PunctualLight { name: "l".into(), to_world: DAffine3::IDENTITY, kind };
    let environment =
        |r: f32, rotation| Some(Environment { source: EnvironmentSource::Constant(Rgb::splat(r)), rotation });
    let cases: Vec<(&str, Corrupt)> = vec![
        ("emission", Box::new(|b| b.materials[0].emission = Rgb::new(0.0, -1.0, 0.0).into())),
        ("colours", Box::new(|b| b.materials[0].sheen.color.factor = Rgb::splat(f32::INFINITY))),
        ("refraction", Box::new(|b| b.materials[0].ior = 0.0)),
        ("factors", Box::new(move |b| b.materials[0].alpha = nan.into())),
        (
            "unlit",
            Box::new(|b| {
                b.materials[0].unlit = true;
                b.materials[0].base_color.factor = Rgb::splat(-0.1);
            }),
        ),
        (
            "strength",
            Box::new(move |b| {
                b.lights.push(light(PunctualKind::Directional { irradiance: Rgb::splat(-1.0) }));
            }),
        ),
        (
            "cone",
            Box::new(move |b| {
                b.lights.push(light(PunctualKind::Spot { intensity: Rgb::WHITE, inner: nan, outer: 0.3 }));
            }),
        ),
        ("field of view", Box::new(|b| b.cameras.push(camera(Projection::Perspective { vertical_fov: 3.2 })))),
        (
            "size",
            Box::new(|b| {
                b.cameras.push(camera(Projection::Orthographic { half_width: 1.0, half_height: 0.0 }));
            }),
        ),
        (
            "transform",
            Box::new(|b| {
                b.cameras.push(Camera {
                    to_world: DAffine3::from_translation(DVec3::NAN),
                    ..camera(Projection::Perspective { vertical_fov: 1.0 })
                });
            }),
        ),
        ("radiance", Box::new(move |b| b.environment = environment(-1.0, 0.0))),
        ("rotation", Box::new(move |b| b.environment = environment(1.0, nan))),
        (
            "do not fill",
            Box::new(|b| {
                let texels = Texels::Rgba8(vec![[0; 4]; 3]);
                b.images.push(Image { name: "i".into(), width: 2, height: 2, texels: texels.into() });
            }),
        ),
    ];
    for (what, spoil) in cases {
        let mut b = square();
        spoil(&mut b);
        let error = b.build().expect_err(what);
        assert!(matches!(error, BuildError::BadValue { .. }) && error.to_string().contains(what), "{what}: {error}");
    }
}

#[test]
fn attributes_that_do_not_fit_are_ignored_with_a_note() {
    let mut b = square();
    let mesh = Arc::make_mut(&mut b.meshes[0].mesh);
    mesh.normals = vec![Vec3::X; 3];
    mesh.tangents = vec![Vec4::X];
    mesh.uvs[1] = vec![Vec2::ZERO; 9];
    mesh.colors = vec![Vec4::new(f32::NAN, 1.0, 1.0, 1.0); 4];
    mesh.triangles.push([0, 1, 77]);
    let (scene, report) = b.build().expect("repaired");
    for what in
        ["3 normals", "1 tangents", "9 texture coordinates", "colours that are not finite", "beyond the vertices"]
    {
        assert!(report.findings.iter().any(|f| f.message.contains(what)), "{what}: {report:?}");
    }
    // A triangle that is lost leaves a hole, so it is a hazard.
    let is_expected = |f: &Finding| {
        let is_lost = f.message.contains("beyond the vertices");
        f.severity == if is_lost { Severity::Hazard } else { Severity::Note }
    };
    assert!(report.findings.iter().filter(|f| f.place != "scene").all(is_expected), "{report:?}");
    let hit = scene.intersect(&Ray::new(Vec3::Z, Vec3::NEG_Z)).expect("the square is there");
    let shading = scene.shade_lanes::<f32>(hit.material(), &(&hit).into(), Vec3::Z.into());
    assert_eq!(shading.frames.frame.normal, Vec3::Z.into());
    assert_eq!(scene.coverage(&hit, Vec3::NEG_Z), 1.0);
}

#[test]
fn invalid_radiance_texels_are_replaced_by_black() {
    let texels = Texels::RgbF32(vec![[f32::NAN, 1.0, -1.0], [1.0, f32::INFINITY, 1.0]]);
    let mut b = square();
    b.images.push(Image { name: "broken".into(), width: 2, height: 1, texels: texels.into() });
    let texture = Texture::new(ImageId(0), ColorEncoding::Linear);
    b.materials[0] =
        Material { emission: Parameter { factor: Rgb::WHITE, texture: Some(texture) }, ..Material::default() };
    let (scene, report) = b.build().expect("repaired");
    assert!(report.findings.iter().any(|f| f.message.contains("2 texels")), "{report:?}");
    for x in [-0.25, 0.0, 0.25] {
        let hit = scene.intersect(&Ray::new(Vec3::new(x, 0.1, 1.0), Vec3::NEG_Z)).expect("the square is there");
        let emitted = scene.emitted(&hit, Vec3::Z);
        assert!(emitted.is_finite() && emitted.b >= 0.0 && emitted.g <= 1.0, "{emitted:?} at {x}");
    }
}

#[test]
fn solids_that_are_open_or_inside_out_are_hazards() {
    let volume = Volume::default();
    let clear = |b: &mut SceneBuilder| {
        b.add_material(Material {
            name: "clear".into(),
            transmission: 1.0.into(),
            surface: Surface::Solid(volume),
            ..Material::default()
        })
    };
    let whole = cuboid(Vec3::ZERO, Vec3::ONE);
    let mut open = whole.clone();
    open.triangles.pop();
    let mut turned = whole.clone();
    turned.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    for (mesh, complaint) in [(whole, None), (open, Some("not closed")), (turned, Some("inside out"))] {
        let mut b = SceneBuilder::default();
        let m = clear(&mut b);
        b.add_object("body", mesh, m);
        let (_, report) = b.build().expect("valid");
        let found: Vec<&str> =
            report.hazards().filter(|f| f.place == "mesh \"body\"").map(|f| f.message.as_str()).collect();
        match complaint {
            None => assert!(found.is_empty(), "{found:?}"),
            Some(what) => assert!(found.len() == 1 && found[0].contains(what), "{found:?}"),
        }
    }
}

#[test]
fn light_that_cannot_be_found_is_a_hazard() {
    use dunkelfeld_scene::{PunctualKind, PunctualLight};
    let hazards = |material: Material, lamp: bool| {
        let mut b = SceneBuilder::default();
        let m = b.add_material(material);
        b.add_object("pane", rectangle(Vec3::ZERO, Vec3::X, Vec3::Y), m);
        if lamp {
            let kind = PunctualKind::Point { intensity: Rgb::WHITE };
            b.lights.push(PunctualLight { name: "lamp".into(), to_world: DAffine3::IDENTITY, kind });
        }
        let (_, report) = b.build().expect("valid");
        report.hazards().map(|f| format!("{}: {}", f.place, f.message)).collect::<Vec<_>>().join("\n")
    };
    let clear =
        Material { name: "clear".into(), transmission: 1.0.into(), roughness: 0.0.into(), ..Material::default() };
    assert!(hazards(clear.clone(), true).contains("light \"lamp\": has no extent, and material \"clear\""));
    assert!(!hazards(clear.clone(), false).contains("no extent"), "without such a light there is nothing to miss");
    let frosted = Material { roughness: 0.3.into(), ..clear.clone() };
    assert!(hazards(frosted, true).is_empty(), "what scatters can be connected");
    let metal = Material { metallic: 1.0.into(), ..clear };
    assert!(hazards(metal, true).contains("its transmission has no effect; set metallic to 0"));
}

/// Tori with as many triangles as `meshes` says, in places of their own, on a floor of glass.
fn tori(meshes: &[u32]) -> SceneBuilder {
    let mut b = SceneBuilder::default();
    let grey = b.add_material(Material::default());
    let glass = b.add_material(Material {
        transmission: 1.0.into(),
        surface: Surface::Solid(Volume::default()),
        ..Material::default()
    });
    b.add_object("floor", cuboid(Vec3::new(-9.0, -9.0, -2.0), Vec3::new(99.0, 9.0, -1.0)), glass);
    for (i, rings) in meshes.iter().enumerate() {
        let ball = b.add_object(&format!("ball {i}"), sphere(Vec3::ZERO, 0.9, *rings, true), grey);
        b.instances[ball].to_world = DAffine3::from_translation(DVec3::new(2.0 * i as f64, 0.1, 0.3));
    }
    // Twice the same triangle.
    let mesh = &mut Arc::make_mut(&mut b.meshes[1].mesh).triangles;
    mesh.push(mesh[7]);
    b
}

/// The hits of a grid of rays, bit by bit.
fn hits(scene: &Scene) -> Vec<Option<[u32; 3]>> {
    let down = Vec3::new(0.1, -0.05, -1.0).normalize();
    let ray = |i: u32| {
        let [x, y] = [(i % 128) as f32 * 0.08 - 1.0, (i / 128) as f32 * 0.02 - 0.9];
        Ray::new((DVec3::new(x.into(), y.into(), 3.0) - scene.world_origin()).as_vec3(), down)
    };
    let bits = |p: SurfacePoint| [p.distance.to_bits(), p.point.x.to_bits(), p.point.z.to_bits()];
    (0..128 * 96).map(|i| scene.intersect(&ray(i)).map(bits)).collect()
}

/// One mesh that all threads build, many that have one thread each with trees of their own, and many in one tree.
#[test]
fn any_number_of_threads_gives_the_same_scene() {
    let many: Vec<u32> = (0..40).map(|i| 30 + i).collect();
    for meshes in [&[400][..], &many, &[24; 30]] {
        let builder = |threads: usize| SceneBuilder { threads, ..tori(meshes) };
        let (plain, report) = builder(1).build().expect("valid");
        let findings: Vec<String> = report.findings.iter().map(|f| format!("{} {}", f.place, f.message)).collect();
        assert!(findings.iter().any(|f| f.contains("repeat another")), "{findings:?}");
        let seen = hits(&plain);
        assert!(seen.iter().flatten().count() > 5000, "the test does not test");
        for (threads, with_cache) in [(2, false), (3, true), (8, false)] {
            let built = if with_cache {
                builder(threads).build_with(&mut BuildCache::default())
            } else {
                builder(threads).build()
            };
            let (scene, report) = built.expect("valid");
            assert_eq!(scene.fingerprint(), plain.fingerprint(), "{threads} threads");
            assert!(hits(&scene) == seen, "{threads} threads: other hits");
            let of_build: Vec<String> = report.findings.iter().map(|f| format!("{} {}", f.place, f.message)).collect();
            assert!(findings.starts_with(&of_build), "{threads} threads: {of_build:?}");
        }
    }
}
