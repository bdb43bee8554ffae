//! Surfaces, solids and lights in whole renders, against closed forms, quadrature and random walks: textures and vertex
//! colours, masks and veils, normal maps, absorbing and rough solids, many lights, environment maps, labels and layers.
//!
//! Where a scene shows the same radiance in every pixel, the pixel means are independent samples of one number. The
//! false-alarm rate of each check is at most `support::RATE`. Replay: `cargo test -p dunkelfeld --test it surfaces::NAME`.

use crate::support::{
    Add, RATE, black, build, clear, emitter, f_cos, film, integrate, lit_by_panel, pixel_moments, plastic,
    plastic_bsdf, rendered, settings, sky, spot_camera, square, sun, view,
};
use dunkelfeld::geometry::{DAffine3, DQuat, DVec3, LocalDir, Mesh, Vec3, Vec4};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::shapes::{cuboid, sphere};
use dunkelfeld::scene::{
    AlphaMode, ColorEncoding, Environment, EnvironmentSource, Filter, Image, ImageId, Material, Parameter, Scene,
    SceneBuilder, Texels, Texture,
};
use dunkelfeld_bsdf::{Bsdf, Dielectric, Lobe, Principled, PrincipledParams};
use dunkelfeld_sampling::Sampler;
use dunkelfeld_testkit::{SampleMoments, welch_test, z_test};
use std::f64::consts::PI;
use std::sync::Arc;

/// Renders a 16 x 16 image and compares its mean with the expectation.
fn check(scene: &Scene, spp: f64, expected: f64, what: &str) {
    crate::support::must_be(scene, spp, 7, 1, expected, what);
}

/// A floor of a material, seen around the origin from an angle.
fn floor_scene(material: Material) -> SceneBuilder {
    let mut b = SceneBuilder::default();
    b.add("floor", square(0.0, 1.0, false), material);
    spot_camera(&mut b, view() * 4.0, DVec3::ZERO, 1e-4);
    b
}

fn image(width: u32, height: u32, texels: Vec<[u8; 4]>) -> Image {
    Image { name: "image".into(), width, height, texels: Texels::Rgba8(texels).into() }
}

fn nearest() -> Texture {
    Texture { filter: Filter::Nearest, ..Texture::new(ImageId(0), ColorEncoding::Linear) }
}

#[test]
fn a_textured_light_over_a_floor() {
    // The half of the panel at x < 0 has radiance 5, the other 5 * 51 / 255 = 1. L = integral of f cos L cos_l / d^2.
    let mut b = floor_scene(plastic());
    b.images.push(image(2, 1, vec![[255; 4], [51; 4]]));
    b.add(
        "light",
        square(0.4, 0.4, true),
        Material { emission: Parameter { factor: Rgb::splat(5.0), texture: Some(nearest()) }, ..emitter(5.0) },
    );
    let half = |x: f64, l: f64| lit_by_panel(view(), DVec3::new(x, -0.2, 0.4), DVec3::X * 0.2, DVec3::Y * 0.4, l, 300);
    let expected = half(-0.2, 5.0) + half(0.0, 1.0);
    check(&build(b), 256.0, expected, "textured light");
}

#[test]
fn a_light_that_covers_partly_shines_partly() {
    // Coverage 0.3: NEE, scattering and the camera all find 0.3 of the radiance; the light from behind counts 0.7.
    let veil = |l: f32| Material { alpha: 0.3.into(), alpha_mode: AlphaMode::Blend, ..emitter(l) };
    let mut b = floor_scene(plastic());
    let front = b.add_material(veil(5.0));
    let back = b.add_material(emitter(2.0));
    b.add_object("front", square(0.4, 0.4, true), front);
    b.add_object("back", square(0.4001, 0.4, true), back);
    // The back panel, 0.1 mm behind, is all but the same rectangle: 5e-4 of its share, 3e-4 of the whole.
    let (corner, radiance) = (DVec3::new(-0.2, -0.2, 0.4), 0.3 * 5.0 + 0.7 * 2.0);
    let expected = lit_by_panel(view(), corner, DVec3::X * 0.4, DVec3::Y * 0.4, radiance, 400);
    let m = pixel_moments(&film(&build(b), &settings(16, 16, 256.0, 7)));
    let error = m.standard_error().hypot(3e-4 * expected);
    z_test(m.mean(), error, expected).assert(RATE, "partly covering light");
    let mut b = SceneBuilder::default();
    let front = b.add_material(veil(5.0));
    let back = b.add_material(emitter(2.0));
    b.add_object("front", square(0.1, 1.0, false), front);
    b.add_object("back", square(0.0, 1.0, false), back);
    spot_camera(&mut b, DVec3::Z, DVec3::ZERO, 0.1);
    check(&build(b), 256.0, 0.3 * 5.0 + 0.7 * 2.0, "seen by the camera");
}

#[test]
fn a_single_bright_texel_of_a_sky_is_a_small_sun() {
    // Texel (i, j) of a 64 x 32 map, turned by 0.8 rad about +y, over the floor: L = integral over the texel's solid angle.
    // The map's own direction at azimuth phi = 2 pi (u - 1/2): (sin t sin phi, cos t, -sin t cos phi), t = pi v.
    let (w, h, i, j, rotation) = (64u32, 32u32, 6u32, 11u32, 0.8f32);
    let mut texels = vec![[0.0f32; 3]; (w * h) as usize];
    texels[(j * w + i) as usize] = [40.0; 3];
    let mut b = floor_scene(plastic());
    b.images.push(Image { name: "sky".into(), width: w, height: h, texels: Texels::RgbF32(texels).into() });
    let source = EnvironmentSource::Image { image: ImageId(0), scale: Rgb::splat(2.5) };
    b.environment = Some(Environment { source, rotation });
    let turn = DQuat::from_rotation_y(f64::from(rotation));
    let bsdf = plastic_bsdf();
    let mut lowest = 1.0f64;
    let direction = |u: f64, v: f64| {
        let theta = PI * (f64::from(j) + v) / f64::from(h);
        let phi = 2.0 * PI * ((f64::from(i) + u) / f64::from(w) - 0.5);
        (turn * DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos()), theta.sin())
    };
    [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
        .iter()
        .for_each(|&(u, v)| lowest = lowest.min(direction(u, v).0.z));
    assert!(lowest > 0.2, "the texel stands above the floor: {lowest}");
    let cell = 2.0 * PI * PI / f64::from(w * h);
    let expected = integrate(200, |u, v| {
        let (wi, sin) = direction(u, v);
        cell * sin * 100.0 * f_cos(&bsdf, DVec3::Z, view(), wi)
    });
    check(&build(b), 256.0, expected, "one bright texel");
}

#[test]
fn vertex_colours_multiply_the_base_colour() {
    // Colours 0.2, 0.6, 1 at the corners (-.5, -.5), (.5, -.5), (.5, .5): at the origin, the middle of the diagonal from
    // the first to the third, 0.6 times the base of 0.6.
    let mut b = floor_scene(plastic());
    Arc::make_mut(&mut b.meshes[0].mesh).colors = [0.2f32, 0.6, 1.0, 0.6].map(|c| Vec4::new(c, c, c, 1.0)).to_vec();
    let from = DVec3::new(-0.3, 0.5, 0.9).normalize();
    sun(&mut b, from);
    let params = PrincipledParams { base_color: Rgb::splat(0.36), roughness: 0.4, eta: 1.5, ..Default::default() };
    let expected = f_cos(&Bsdf::Principled(Principled::new(&params)), DVec3::Z, view(), from);
    let mean = pixel_moments(&film(&build(b), &settings(4, 4, 4.0, 3))).mean();
    assert!((mean / expected - 1.0).abs() < 1e-3, "{mean}, expected {expected}");
}

#[test]
fn an_alpha_mask_applies_to_camera_and_shadow_rays() {
    // The mask hides x < 0. Seen from above through it: the emitter shows in the right half only. Under it, with parallel
    // light from straight above: the floor is lit in the right half only.
    let cut = |b: &mut SceneBuilder, height: f32| {
        b.images.push(image(2, 1, vec![[255, 255, 255, 255], [255, 255, 255, 100]]));
        let alpha = Texture { channel: 3, ..nearest() };
        let alpha_mode = AlphaMode::Mask { cutoff: 0.5 };
        b.add(
            "mask",
            square(height, 1.0, false),
            Material { alpha: Parameter { factor: 1.0, texture: Some(alpha) }, alpha_mode, ..black() },
        );
    };
    let mut b = SceneBuilder::default();
    b.add("light", square(0.0, 1.0, false), emitter(2.0));
    cut(&mut b, 0.3);
    b.add_camera("above", DVec3::Z * 2.0, DVec3::ZERO, 0.2);
    let image = film(&build(b), &settings(16, 8, 16.0, 3)).mean();
    // World +y is up in the picture, +x to the right.
    for (k, p) in image.data().iter().enumerate() {
        let expected = if k % 16 < 8 { 0.0 } else { 2.0 };
        assert_eq!(p[1], expected, "pixel {}, {}", k % 16, k / 16);
    }
    for x in [-0.2, 0.2] {
        let mut b = SceneBuilder::default();
        b.add("floor", square(0.0, 1.0, false), plastic());
        cut(&mut b, 0.5);
        sun(&mut b, DVec3::Z);
        // Below the mask, so that it is not in the way.
        let target = DVec3::new(x, 0.0, 0.0);
        spot_camera(&mut b, target + view() * 0.3, target, 1e-3);
        let expected = if x < 0.0 { 0.0 } else { f_cos(&plastic_bsdf(), DVec3::Z, view(), DVec3::Z) };
        let mean = pixel_moments(&film(&build(b), &settings(4, 4, 4.0, 3))).mean();
        assert!((mean - expected).abs() <= 1e-3 * expected, "at x {x}: {mean}, expected {expected}");
    }
}

#[test]
fn a_partly_transmitting_sheet_is_two_things_at_random() {
    // Of the light of an emitter behind it a sheet of transmission 0.6 and tint 0.5 passes 0.6 * 0.5 (1 - R'), with
    // R' = 2R / (1+R) for both faces, R = 0.04. In front all is black.
    let mut b = SceneBuilder::default();
    let sheet = b.add_material(Material {
        base_color: Rgb::splat(0.5).into(),
        roughness: 0.0.into(),
        transmission: 0.6.into(),
        ..Material::default()
    });
    b.add_object("sheet", square(0.1, 0.5, false), sheet);
    b.add("light", square(0.0, 0.5, false), emitter(2.0));
    spot_camera(&mut b, DVec3::Z, DVec3::ZERO, 0.01);
    check(&build(b), 1024.0, 2.0 * 0.6 * 0.5 * (1.0 - 0.08 / 1.04), "partly transmitting sheet");
}

#[test]
fn a_rough_slab_is_a_random_walk_between_its_faces() {
    // A plate wide enough to have no rim, in a sky of one: its radiance is the weight of a walk that scatters at the two
    // faces until it leaves, made here with nothing but the boundary's own samples. Not more than one.
    let walk = |pixel: u32| {
        let face = Bsdf::Dielectric(Dielectric::new(1.5, 0.16, Rgb::WHITE, Rgb::WHITE));
        // In the frame of the top face; the bottom face is its mirror image. Straight down on it at first.
        let (mut wo, mut on_top, mut weight) = (LocalDir::new(0.0, 0.0, 1.0), true, 1.0f64);
        for vertex in 0..10_000 {
            let [u, x, y, _] = Sampler::new(5, 0, pixel, 0).get_4d(vertex);
            let mirrored = |d: LocalDir| if on_top { d } else { LocalDir::new(d.0.x, d.0.y, -d.0.z) };
            let Some(s) = face.sample(mirrored(wo), u, [x, y]) else { return 0.0 };
            weight *= f64::from(s.weight.g);
            let wi = mirrored(s.wi);
            if s.wi.0.z > 0.0 {
                return weight;
            }
            assert!(!s.lobe.contains(Lobe::DELTA));
            on_top = wi.0.z > 0.0;
            wo = -wi;
        }
        0.0
    };
    let expected: SampleMoments = (0..200_000).map(walk).collect();
    let mut b = SceneBuilder::default();
    b.add(
        "plate",
        cuboid(Vec3::new(-10.0, -10.0, 0.0), Vec3::new(10.0, 10.0, 1e-3)),
        Material { roughness: 0.4.into(), ..clear(1.5) },
    );
    b.environment = sky(1.0);
    spot_camera(&mut b, DVec3::Z, DVec3::ZERO, 0.01);
    let rendered = pixel_moments(&film(&build(b), &settings(16, 16, 512.0, 7)));
    assert!(rendered.mean() < 1.0 + 5.0 * rendered.standard_error() && rendered.mean() > 0.85, "{}", rendered.mean());
    welch_test(&rendered, &expected).assert(RATE, "rough slab");
}

#[test]
fn glass_whose_metal_is_painted_away_is_glass() {
    // A metallic factor of 1 with a black texture, as glTF files have it, is metallic 0: the ball is invisible in a
    // uniform sky. What is lost is given up at the silhouette, where normals disagree with facets.
    let mut b = SceneBuilder::default();
    b.images.push(image(1, 1, vec![[0, 0, 0, 255]]));
    let metallic = Parameter { factor: 1.0, texture: Some(Texture { channel: 2, ..nearest() }) };
    b.add("ball", sphere(Vec3::ZERO, 0.5, 24, true), Material { metallic, ..clear(1.5) });
    b.environment = sky(1.0);
    spot_camera(&mut b, DVec3::new(0.0, 0.3, 3.0), DVec3::ZERO, 0.5);
    let mean = pixel_moments(&film(&build(b), &settings(16, 16, 64.0, 5))).mean();
    assert!((mean - 1.0).abs() < 4e-3, "{mean}");
}

#[test]
fn unlit_surfaces_show_their_colour_and_nothing_else() {
    // From both sides, under any light.
    let mut b = SceneBuilder::default();
    b.images.push(image(1, 1, vec![[51; 4]]));
    let mut sign = Material { unlit: true, ..plastic() };
    sign.base_color.texture = Some(nearest());
    b.add("sign", square(0.0, 1.0, false), sign);
    b.environment = sky(3.0);
    sun(&mut b, DVec3::Z);
    for side in [1.0, -1.0] {
        let mut b = b.clone();
        spot_camera(&mut b, DVec3::Z * side, DVec3::ZERO, 0.1);
        check(&build(b), 4.0, 0.6 * 0.2, &format!("side {side}"));
    }
}

#[test]
fn layers_and_pixel_ids_describe_the_visible_surface() {
    // A white emitter (object 1) over a plastic floor (object 0), seen from 2 m above; and past both, nothing.
    let scene = |orthographic: bool| {
        let mut b = SceneBuilder::default();
        let [plastic, light] = [b.add_material(plastic()), b.add_material(emitter(1.0))];
        b.add_object("floor", square(0.0, 2.0, false), plastic);
        let mut panel = square(0.5, 0.46, false);
        panel.positions.iter_mut().for_each(|p| p.x += 0.5);
        b.add_object("panel", panel, light);
        if orthographic {
            spot_camera(&mut b, DVec3::Z * 2.0, DVec3::ZERO, 1.5);
            b.cameras[0].to_world = dunkelfeld::scene::look_at(DVec3::Z * 2.0, DVec3::ZERO, DVec3::Y);
        } else {
            b.add_camera("c", DVec3::Z * 2.0, DVec3::ZERO, 2.0 * 0.75f32.atan());
        }
        build(b)
    };
    for orthographic in [true, false] {
        let scene = scene(orthographic);
        let s = settings(30, 30, 16.0, 9);
        let r = rendered(&scene, &s);
        // Pixels are 0.1 m wide at a distance of 2 m.
        for (k, (label, sums)) in r.film.ids.data().iter().zip(r.film.sums.sums().data()).enumerate() {
            let (x, y) = (f64::from(k as u32 % 30) * 0.1 - 1.45, 1.45 - f64::from(k as u32 / 30) * 0.1);
            // At the height z a pixel shows the point (x, y) times 1 - z/2 in perspective.
            let shrink = |z: f64| if orthographic { 1.0 } else { 1.0 - z / 2.0 };
            let inside = |z: f64, cx: f64, half: f64, margin: f64| {
                let (px, py) = (x * shrink(z), y * shrink(z));
                let reach = half + margin * 0.06;
                (px - cx).abs() < reach && py.abs() < reach
            };
            let panel = [1.0, 0.0, -1.0].map(|m| inside(0.5, 0.5, 0.23, m));
            let floor = [1.0, 0.0, -1.0].map(|m| inside(0.0, 0.0, 1.0, m));
            // Centres decide labels; layers are means over the pixel, so those that an edge crosses are left out.
            let expected = if panel[1] { Some((1, 1)) } else { floor[1].then_some((0, 0)) };
            assert_eq!(label.map(|l| (l.object(), l.material())), expected, "pixel {k}, orthographic {orthographic}");
            if panel[0] != panel[2] || floor[0] != floor[2] {
                continue;
            }
            let (albedo, normal, depth) = (sums.mean_albedo(), sums.mean_normal(), f64::from(sums.mean_depth()));
            let way = if panel[1] { 1.5 } else { 2.0 };
            let slant = if orthographic { 1.0 } else { (1.0 + (x * x + y * y) / 4.0).sqrt() };
            match expected {
                None => assert!(albedo == [0.0; 3] && normal == [0.0; 3] && depth == 0.0),
                Some((object, _)) => {
                    assert!(
                        (depth / (way * slant) - 1.0).abs() < 2e-3,
                        "pixel {k}: depth {depth}, not {}",
                        way * slant
                    );
                    assert!((normal[2] - 1.0).abs() < 1e-6 && normal[0].abs() < 1e-6, "pixel {k}: {normal:?}");
                    let wo = LocalDir::new((1.0 - 1.0 / (slant * slant)).sqrt() as f32, 0.0, 1.0 / slant as f32);
                    let of_floor = plastic_bsdf().albedo(wo).g;
                    let expected = if object == 1 { 0.0 } else { of_floor };
                    assert!((albedo[1] - expected).abs() < 2e-3, "pixel {k}: albedo {albedo:?}, not {expected}");
                }
            }
        }
    }
}

#[test]
fn an_instanced_light_far_from_its_own_origin_does_not_hide_itself() {
    // The light's mesh lies a kilometre from its object's origin, and the instance brings it back. Its points are then known
    // to 30 um only; shadow rays must not end behind the surface they aim at. Irradiance as for the plain light, within
    // what that rounding moves the corners: 3e-5 of 0.4 m.
    let mut b = floor_scene(plastic());
    let m = b.add_material(emitter(5.0));
    let tilt = DQuat::from_rotation_x(0.4) * DQuat::from_rotation_y(0.3);
    let far = DVec3::new(900.0, -700.0, 1100.0);
    let mut mesh = Mesh::default();
    let n = 100u32;
    for i in 0..=n {
        for j in 0..=n {
            let p = DVec3::new(f64::from(i) / f64::from(n) - 0.5, f64::from(j) / f64::from(n) - 0.5, 0.0) * 0.4;
            mesh.positions.push((tilt * p + far).as_vec3());
        }
    }
    for i in 0..n {
        for j in 0..n {
            let at = |a: u32, b: u32| (i + a) * (n + 1) + j + b;
            mesh.triangles.extend([[at(0, 0), at(1, 1), at(1, 0)], [at(0, 0), at(0, 1), at(1, 1)]]);
        }
    }
    b.add_object("light", mesh, m);
    b.instances[1].to_world = DAffine3::from_translation(DVec3::Z * 0.4 - far);
    let mut twin = b.instances[1].clone();
    twin.to_world = DAffine3::from_translation(DVec3::Z * -50.0 - far);
    b.instances.push(twin);
    let corner = tilt * DVec3::new(-0.2, -0.2, 0.0) + DVec3::Z * 0.4;
    let expected = lit_by_panel(view(), corner, tilt * DVec3::X * 0.4, tilt * DVec3::Y * 0.4, 5.0, 400);
    let scene = build(b);
    assert_eq!(scene.summary().instanced_parts, 2);
    let m = pixel_moments(&film(&scene, &settings(16, 16, 256.0, 7)));
    let error = m.standard_error().hypot(1e-3 * expected);
    z_test(m.mean(), error, expected).assert(RATE, &format!("{} expected {expected}", m.mean()));
}
