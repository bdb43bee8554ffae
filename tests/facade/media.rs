//! Media, nested solids and cameras inside of them, in whole renders against closed forms.
//!
//! Each scene shows the same radiance in every pixel, so the pixel means are independent samples of one number. The
//! false-alarm rate of each check is at most `support::RATE`. Replay: `cargo test -p dunkelfeld --test it media::NAME`.

use crate::support::{Add, RATE, black, build, emitter, film, settings, sky, spot_camera, square};
use dunkelfeld::film::Film;
use dunkelfeld::geometry::{DAffine3, DQuat, DVec3, Mesh, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::shapes::{cuboid, sphere};
use dunkelfeld::scene::{
    DiffuseTransmission, Material, PunctualKind, PunctualLight, Scene, SceneBuilder, Specular, Surface, Volume,
};
use dunkelfeld_testkit::{Claim, SampleMoments, z_test};
use std::f64::consts::PI;

/// A smooth clear body of a volume.
fn body(ior: f32, volume: Volume) -> Material {
    Material {
        ior,
        roughness: 0.0.into(),
        transmission: 1.0.into(),
        surface: Surface::Solid(volume),
        ..Material::default()
    }
}

fn scattering(absorption: Rgb, scattering: Rgb, g: f32) -> Volume {
    Volume { absorption, scattering, scattering_anisotropy: g, ..Volume::default() }
}

fn absorbing(absorption: f32) -> Volume {
    Volume { absorption: Rgb::splat(absorption), ..Volume::default() }
}

fn cube(half: f32) -> Mesh {
    cuboid(Vec3::splat(-half), Vec3::splat(half))
}

/// Means of the pixels in one channel, with no invalid sample among them.
fn channel_moments(scene: &Scene, spp: f64, seed: u64, channel: usize) -> SampleMoments {
    let film = film(scene, &settings(16, 16, spp, seed));
    assert_eq!(film.invalid_samples(), 0, "samples that are not finite or negative");
    film.sums().data().iter().map(|p| p.mean()[channel]).collect()
}

/// Holds one channel to `expected`: the first look is `film`, the later ones are rendered.
fn judge(scene: &Scene, film: &Film, spp: f64, channel: usize, [expected, sure]: [f64; 2], what: &str) {
    let claim = Claim { expected, tolerance: 5e-6 * expected, sure: sure * expected };
    claim.assert(what, |look| match look {
        0 => film.sums().data().iter().map(|p| p.mean()[channel]).collect::<SampleMoments>().into(),
        _ => channel_moments(scene, spp * f64::from(1 << (2 * look)), 11 + u64::from(look), channel).into(),
    });
}

fn check(builder: SceneBuilder, spp: f64, expected: f64, what: &str) {
    crate::support::must_be(&build(builder), spp, 11, 1, expected, what);
}

#[test]
fn a_matched_slab_transmits_by_beer_and_lambert() {
    // No surface to reflect: exp(-sigma d) per channel, for any roughness of the face without a change of index.
    let sigma = [3.0, 40.0, 0.0];
    let volume = Volume { absorption: Rgb::from_array(sigma), ..Volume::default() };
    for roughness in [0.0, 0.4] {
        let mut b = SceneBuilder::default();
        b.add(
            "slab",
            cuboid(Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.05)),
            Material { roughness: roughness.into(), ..body(1.0, volume) },
        );
        b.environment = sky(2.0);
        spot_camera(&mut b, DVec3::Z, DVec3::ZERO, 0.1);
        let scene = build(b);
        for (channel, s) in sigma.into_iter().enumerate() {
            let expected = 2.0 * (-f64::from(s) * 0.05).exp();
            crate::support::must_be(
                &scene,
                4.0,
                11,
                channel,
                expected,
                &format!("channel {channel}, roughness {roughness}"),
            );
        }
    }
}

#[test]
fn light_connects_straight_through_matched_solids() {
    // A point light above a floor, with a matched absorbing cube between, tinted at each face by the root of 0.64. Nothing is
    // random but the place in a tiny pixel.
    let floor = Material {
        base_color: Rgb::splat(0.6).into(),
        specular: Specular::NONE,
        roughness: 1.0.into(),
        ..Material::default()
    };
    let render = |with_cube: bool| {
        let mut b = SceneBuilder::default();
        b.add("floor", square(0.0, 4.0, false), floor.clone());
        if with_cube {
            b.add(
                "cube",
                cuboid(Vec3::new(-0.1, -0.1, 0.2), Vec3::new(0.1, 0.1, 0.3)),
                Material { base_color: Rgb::splat(0.64).into(), ..body(1.0, absorbing(7.0)) },
            );
        }
        let kind = PunctualKind::Point { intensity: Rgb::splat(2.0) };
        b.lights.push(PunctualLight { name: "lamp".into(), to_world: DAffine3::from_translation(DVec3::Z), kind });
        spot_camera(&mut b, DVec3::new(1.0, 0.0, 1.0), DVec3::ZERO, 1e-4);
        channel_moments(&build(b), 4.0, 11, 1).mean()
    };
    let ratio = render(true) / render(false);
    let expected = 0.64 * (-0.7f64).exp();
    assert!((ratio / expected - 1.0).abs() < 1e-4, "{ratio}, expected {expected}");
}

#[test]
fn white_media_in_a_uniform_sky_are_invisible() {
    // Nothing is absorbed, and radiance is the same from everywhere: scattering changes nothing, at any density, in any
    // channel, for any phase function. Inside a body of another index the radiance is n^2 times as large, which is undone
    // on the way out. Expected: 1.
    let coloured = Rgb::new(4.0, 10.0, 25.0);
    for (k, (ior, density, g, spp)) in [
        (1.0, Rgb::splat(40.0), 0.0, 32.0),
        (1.0, coloured, 0.7, 1536.0),
        (1.0, coloured, -0.6, 32.0),
        (1.49, Rgb::splat(20.0), 0.0, 32.0),
        (1.49, coloured, 0.8, 1024.0),
        (1.0, Rgb::splat(0.0), 0.5, 4.0),
    ]
    .into_iter()
    .enumerate()
    {
        let mut b = SceneBuilder::default();
        b.add("cube", cube(0.02), body(ior, scattering(Rgb::BLACK, density, g)));
        b.environment = sky(1.0);
        spot_camera(&mut b, DVec3::new(0.3, 0.2, 1.0), DVec3::ZERO, 0.01);
        let scene = build(b);
        let film = film(&scene, &settings(16, 16, spp, 11));
        assert_eq!(film.invalid_samples(), 0, "case {k}: samples that are not finite or negative");
        for channel in 0..3 {
            let sure = if spp > 1000.0 { 1e-3 } else { 1e-2 };
            judge(&scene, &film, spp, channel, [1.0, sure], &format!("case {k}, channel {channel}"));
        }
    }
}

#[test]
fn a_white_medium_in_a_cavity_that_shines_shows_its_walls() {
    // The same with lights that have a surface: a box of radiance 1 on its inside, with the medium and the camera in it.
    let mut walls = cube(0.3);
    walls.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    walls.normals.iter_mut().for_each(|n| *n = -*n);
    let mut b = SceneBuilder::default();
    b.add("cube", cube(0.05), body(1.0, scattering(Rgb::BLACK, Rgb::splat(25.0), 0.3)));
    b.add("walls", walls, emitter(1.0));
    spot_camera(&mut b, DVec3::new(0.05, 0.02, 0.25), DVec3::ZERO, 0.03);
    check(b, 64.0, 1.0, "cavity");
}

#[test]
fn thin_scattering_is_single_scattering() {
    // A slab of depth d seen along its normal, with parallel light at cosine m: of what depth z scatters, exp(-t z (1 + 1/m))
    // is left, so L = s p E (1 - exp(-t d (1 + 1/m))) / (t (1 + 1/m)). The albedo is 1e-3: what is scattered twice is less
    // than a thousandth of it, which counts as an error of its own.
    let (s, t, d, m) = (0.02f64, 20.0f64, 0.05f64, 0.8f64);
    for g in [0.0, 0.6, -0.6] {
        let mut b = SceneBuilder::default();
        let volume = scattering(Rgb::splat((t - s) as f32), Rgb::splat(s as f32), g as f32);
        b.add("slab", cuboid(Vec3::new(-3.0, -3.0, -d as f32), Vec3::new(3.0, 3.0, 0.0)), body(1.0, volume));
        let from = DVec3::new((1.0 - m * m).sqrt(), 0.0, m);
        b.lights.push(PunctualLight {
            name: "sun".into(),
            to_world: DAffine3::from_quat(DQuat::from_rotation_arc(DVec3::NEG_Z, -from)),
            kind: PunctualKind::Directional { irradiance: Rgb::splat(3.0) },
        });
        spot_camera(&mut b, DVec3::Z, DVec3::ZERO, 0.1);
        // Light that travels along -from is deflected to +z: the cosine of the deflection is -m.
        let phase = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g + 2.0 * g * m).powf(1.5));
        let rate = t * (1.0 + 1.0 / m);
        let expected = s * phase * 3.0 * (1.0 - (-rate * d).exp()) / rate;
        let moments = channel_moments(&build(b), 256.0, 11, 1);
        let error = moments.standard_error().hypot(1e-3 * expected);
        z_test(moments.mean(), error, expected).assert(RATE, &format!("g {g}: {} of {expected}", moments.mean()));
        assert!(moments.standard_error() < 5e-3 * expected, "g {g}: {}", moments.standard_error());
    }
}

#[test]
#[ignore = "long: .ci/run runs it"]
fn a_white_sphere_of_three_thousand_free_paths_is_invisible() {
    let mut b = SceneBuilder::default();
    b.add("sphere", sphere(Vec3::ZERO, 0.5, 32, true), body(1.0, scattering(Rgb::BLACK, Rgb::splat(3000.0), 0.0)));
    b.environment = sky(1.0);
    spot_camera(&mut b, DVec3::new(0.3, 0.2, 3.0), DVec3::ZERO, 0.25);
    let scene = build(b);
    let film = film(&scene, &settings(16, 16, 32.0, 11));
    // 8192 paths: a standard error of 0.007. Roulette after a number of scatterings was 0.02 too dark, with an error that
    // was too small.
    judge(&scene, &film, 32.0, 1, [1.0, 1e-2], "a dense sphere");
}

#[test]
fn media_beyond_the_limit_are_refused() {
    // The mean chord of a cube of 1 m is 2/3 m: 3000 and 2e6 scatterings are the limits.
    for (absorption, density, is_built) in [
        (0.0, 4400.0, true),
        (0.0, 4600.0, false),
        (1.0, 4600.0, true),
        (1.0, 1e9, false),
        (1e5, 2.9e6, true),
        (1e5, 3.1e6, false),
    ] {
        let mut b = SceneBuilder::default();
        b.add("cube", cube(0.5), body(1.0, scattering(Rgb::splat(absorption), Rgb::splat(density), 0.0)));
        b.environment = sky(1.0);
        let built = b.build().map(|_| ()).map_err(|e| e.to_string());
        match &built {
            Ok(()) => assert!(is_built, "{absorption}, {density}"),
            Err(e) => assert!(!is_built && e.contains("object \"cube\"") && e.contains("opaque white"), "{e}"),
        }
    }
}

#[test]
fn the_densest_medium_stays_finite() {
    // A million scatterings per metre. White, and a millimetre thick: 1 again. Grey, and a metre: a number below 1.
    for (half, absorption, spp) in [(5e-4, 0.0, 4.0), (0.5, 1e5, 16.0)] {
        let mut b = SceneBuilder::default();
        b.add("cube", cube(half), body(1.0, scattering(Rgb::splat(absorption), Rgb::splat(1e6 - absorption), 0.0)));
        b.environment = sky(1.0);
        spot_camera(&mut b, DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, 0.5 * half);
        let scene = build(b);
        if absorption == 0.0 {
            crate::support::must_be(&scene, spp, 11, 1, 1.0, "white and dense");
        } else {
            let m = channel_moments(&scene, spp, 11, 1);
            assert!(m.mean() > 0.3 && m.mean() < 0.9, "{}", m.mean());
        }
    }
}

/// Reflectance of a smooth boundary for unpolarised light, from the cosines on both sides.
fn fresnel(n1: f64, c1: f64, n2: f64, c2: f64) -> f64 {
    let (s, p) = ((n1 * c1 - n2 * c2) / (n1 * c1 + n2 * c2), (n2 * c1 - n1 * c2) / (n2 * c1 + n1 * c2));
    0.5 * (s * s + p * p)
}

/// Transmission of a stack of clear layers, all reflections between its faces included, for light that arrives from air at
/// an angle. Each face i adds R_i / (1 - R_i) to 1/T - 1: the shares of a random walk without absorption.
fn through_stack(indices: &[f64], sin: f64) -> f64 {
    let cos = |n: f64| (1.0 - (sin / n).powi(2)).sqrt();
    let all: Vec<f64> = [&[1.0], indices, &[1.0]].concat();
    let sum: f64 = all
        .windows(2)
        .map(|w| {
            let r = fresnel(w[0], cos(w[0]), w[1], cos(w[1]));
            r / (1.0 - r)
        })
        .sum();
    1.0 / (1.0 + sum)
}

/// An emitter of radiance 1 behind solids, seen at an angle through them.
fn behind(solids: &[(Mesh, f32, i32)], sin: f64) -> SceneBuilder {
    let mut b = SceneBuilder::default();
    for (k, (mesh, ior, priority)) in solids.iter().enumerate() {
        b.add(&format!("solid {k}"), mesh.clone(), body(*ior, Volume { priority: *priority, ..Volume::default() }));
    }
    b.add("light", square(-0.2, 6.0, false), emitter(1.0));
    spot_camera(&mut b, DVec3::new(sin, 0.0, (1.0 - sin * sin).sqrt()) * 1.5, DVec3::ZERO, 0.01);
    b
}

fn layer(low: f32, high: f32) -> Mesh {
    cuboid(Vec3::new(-1.0, -1.0, low), Vec3::new(1.0, 1.0, high))
}

#[test]
fn glass_on_water_reflects_as_glass_on_water() {
    // Faces that coincide, both orders in the file; water that reaches into the glass, either with priority; and a film of
    // air of 10 um, which is one.
    let (glass, water) = (1.52f32, 1.33f32);
    let indices = [f64::from(glass), f64::from(water)];
    for sin in [0.0, 0.7] {
        let expected = through_stack(&indices, sin);
        for (what, solids) in [
            ("glass first", vec![(layer(0.0, 0.02), glass, 1), (layer(-0.03, 0.0), water, 0)]),
            ("water first", vec![(layer(-0.03, 0.0), water, 0), (layer(0.0, 0.02), glass, 1)]),
            ("water has priority", vec![(layer(-0.03, 0.0), water, 5), (layer(0.0, 0.02), glass, 1)]),
            ("no priority", vec![(layer(-0.03, 0.0), water, 0), (layer(0.0, 0.02), glass, 0)]),
            ("water in the glass", vec![(layer(-0.03, 0.01), water, 0), (layer(0.0, 0.02), glass, 1)]),
            ("glass in the water", vec![(layer(0.0, 0.02), glass, -1), (layer(-0.03, 0.01), water, 0)]),
        ] {
            check(behind(&solids, sin), 256.0, expected, &format!("{what}, sine {sin}"));
        }
        let air = through_stack(&[f64::from(glass), 1.0, f64::from(water)], sin);
        let gap = [(layer(0.0, 0.02), glass, 1), (layer(-0.03, -1e-5), water, 0)];
        check(behind(&gap, sin), 256.0, air, &format!("10 um of air, sine {sin}"));
    }
    // At normal incidence the interface itself reflects 0.45 %, air and glass 4.3 %: the two differ by far more than the error.
    assert!(through_stack(&indices, 0.0) > 1.05 * through_stack(&[f64::from(glass), 1.0, f64::from(water)], 0.0));
}

#[test]
fn bodies_in_a_solid_use_its_index() {
    // Water around glass around water, and a plate of glass in a glass of the same index: it must be invisible.
    let (glass, water) = (1.52f32, 1.33f32);
    for sin in [0.0, 0.6] {
        let nested = [(layer(-0.03, 0.03), water, 0), (layer(-0.01, 0.01), glass, 0)];
        let (n, w) = (f64::from(glass), f64::from(water));
        check(behind(&nested, sin), 256.0, through_stack(&[w, n, w], sin), "glass in water");
        let turned: Vec<_> = nested.iter().rev().cloned().collect();
        check(behind(&turned, sin), 256.0, through_stack(&[w, n, w], sin), "glass in water, other order");
        let same = [(layer(-0.03, 0.03), glass, 0), (layer(-0.01, 0.01), glass, 0)];
        check(behind(&same, sin), 256.0, through_stack(&[n], sin), "glass in glass");
    }
}

#[test]
fn a_camera_inside_a_solid_renders_through_its_medium() {
    // A matched body: exp(-sigma d) to its face at distance d. A body of index n, along the normal of its faces: of the sky
    // n^2 (1 - R) enters, and is reflected R between the faces, 2 h apart: n^2 (1-R) a / (1 - R A) with a = exp(-sigma h)
    // from the middle and A = exp(-2 sigma h). Two bodies: the inner one's way, then the outer one's.
    let (h, sigma) = (0.2f64, 3.0f64);
    let inside = |bodies: &[(f32, f32, f64)], expected: f64, what: &str| {
        let mut b = SceneBuilder::default();
        for &(ior, absorption, half) in bodies {
            b.add("cube", cube(half as f32), body(ior, absorbing(absorption)));
        }
        b.environment = sky(1.0);
        spot_camera(&mut b, DVec3::ZERO, DVec3::new(0.0, 0.0, -1.0), 0.01);
        check(b, 256.0, expected, what);
    };
    inside(&[(1.0, sigma as f32, h)], (-sigma * h).exp(), "matched");
    let n = 1.49f64;
    let r = ((n - 1.0) / (n + 1.0)).powi(2);
    let expected = n * n * (1.0 - r) * (-sigma * h).exp() / (1.0 - r * (-2.0 * sigma * h).exp());
    inside(&[(n as f32, sigma as f32, h)], expected, "PMMA");
    let two = (-(5.0 * 0.1 + sigma * 0.1)).exp();
    inside(&[(1.0, sigma as f32, h), (1.0, 5.0, 0.1)], two, "two matched bodies");
    inside(&[(1.0, 5.0, 0.1), (1.0, sigma as f32, h)], two, "two matched bodies, other order");
}

#[test]
fn a_lens_half_inside_a_solid_samples_both_sides_of_its_face() {
    // Parallel rays that start on a film across the face of a matched absorbing body, which they leave 0.1 m further on:
    // half of the pixels are attenuated, half are not.
    let mut b = SceneBuilder::default();
    b.add("body", cuboid(Vec3::new(0.0, -1.0, -0.1), Vec3::new(1.0, 1.0, 1.0)), body(1.0, absorbing(10.0)));
    b.environment = sky(1.0);
    b.cameras.push(dunkelfeld::scene::Camera {
        name: "across".into(),
        projection: dunkelfeld::scene::Projection::Orthographic { half_width: 0.1, half_height: 0.1 },
        ..camera_at_origin()
    });
    let film = film(&build(b), &settings(16, 16, 4.0, 3));
    for (i, p) in film.sums().data().iter().enumerate() {
        let expected = if i % 16 < 8 { 1.0 } else { (-1f64).exp() };
        assert!((p.mean()[1] - expected).abs() < 1e-5, "pixel {i}: {}", p.mean()[1]);
    }
}

/// A camera at the world's origin that looks along -z with +y up.
fn camera_at_origin() -> dunkelfeld::scene::Camera {
    let mut b = SceneBuilder::default();
    b.add_camera("camera", DVec3::ZERO, DVec3::NEG_Z, 0.5);
    b.cameras.remove(0)
}

#[test]
fn a_translucent_sheet_passes_its_share() {
    // Black in reflection: of the light on its back it passes share times colour, after Lambert. A point lamp behind the sheet,
    // at distance d under what is seen: E = I / d^2, L = share colour E / pi. In a uniform sky of 1: share times colour.
    let paper = Material {
        diffuse_transmission: DiffuseTransmission { share: 0.6.into(), color: Rgb::splat(0.5).into() },
        ..black()
    };
    let mut b = SceneBuilder::default();
    b.add("sheet", square(0.0, 1.0, false), paper.clone());
    let kind = PunctualKind::Point { intensity: Rgb::splat(2.0) };
    let below = DAffine3::from_translation(DVec3::new(0.0, 0.0, -0.5));
    b.lights.push(PunctualLight { name: "lamp".into(), to_world: below, kind });
    spot_camera(&mut b, DVec3::new(0.5, 0.2, 1.0), DVec3::ZERO, 1e-4);
    let lit = channel_moments(&build(b), 4.0, 11, 1).mean();
    assert!((lit / (0.3 * 2.0 / 0.25 / PI) - 1.0).abs() < 1e-4, "{lit}");
    let mut b = SceneBuilder::default();
    b.add("sheet", square(0.0, 1.0, false), paper);
    b.environment = sky(1.0);
    spot_camera(&mut b, DVec3::new(0.5, 0.2, 1.0), DVec3::ZERO, 0.1);
    check(b, 64.0, 0.3, "uniform sky");
}
