//! Denoising as a library user has it: what the layers that guide it show, what it may touch, and how it ends early.
//!
//! Replay: `cargo test -p dunkelfeld --test it denoising::NAME`.

use crate::support::{Add, build, clear, emitter, film, settings, spot_camera, square};
use dunkelfeld::film::Film;
use dunkelfeld::geometry::{DVec3, Vec3};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::scene::{Material, Scene, SceneBuilder, Specular, shapes};
use dunkelfeld::{Cancel, DenoiseMethod, Progress, ProgressState, Project, Stage};

/// A red floor with its normal along +z, behind a cover or in a mirror. The lamp is outside of the view.
fn scene(camera: (DVec3, DVec3), add: impl FnOnce(&mut SceneBuilder)) -> Scene {
    let mut b = SceneBuilder::default();
    let floor = Material {
        base_color: Rgb::new(0.8, 0.2, 0.1).into(),
        specular: Specular::NONE,
        roughness: 1.0.into(),
        ..Material::default()
    };
    b.add("floor", square(0.0, 4.0, false), floor);
    b.add("lamp", shapes::rectangle(Vec3::new(1.9, 1.0, 1.0), Vec3::Y * -2.0, Vec3::Z), emitter(5.0));
    add(&mut b);
    spot_camera(&mut b, camera.0, camera.1, 0.05);
    build(b)
}

/// Mean albedo, normal and depth of a film, and the largest variance of an albedo's mean.
fn layers(film: &Film) -> ([f32; 3], [f32; 3], f32, f32) {
    let n = film.pixels() as f32;
    let (mut albedo, mut normal, mut depth, mut variance) = ([0.0; 3], [0.0; 3], 0.0, 0f32);
    for p in film.sums().data() {
        for c in 0..3 {
            albedo[c] += p.mean_albedo()[c] / n;
            normal[c] += p.mean_normal()[c] / n;
        }
        depth += p.mean_depth() / n;
        variance = variance.max(p.variance_of_albedo()[0]);
    }
    (albedo, normal, depth, variance)
}

/// The layers are means over the first surface of each path that is not clear.
#[test]
fn layers_show_what_lies_behind_clear_covers_and_in_mirrors() {
    let down = (DVec3::new(0.0, 0.0, 1.0), DVec3::ZERO);
    let of = |scene: &Scene| layers(&film(scene, &settings(8, 8, 64.0, 3)));
    let bare = of(&scene(down, |_| ()));
    assert!((bare.2 - 1.0).abs() < 1e-3 && bare.1[2] > 0.999 && bare.3 < 1e-6, "{bare:?}");

    // Through two faces of smooth PMMA 8 % of the paths are reflected away and meet the cover or nothing instead.
    let cover = |roughness| {
        move |b: &mut SceneBuilder| {
            b.add(
                "cover",
                shapes::cuboid(Vec3::new(-0.9, -0.9, 0.4), Vec3::new(0.9, 0.9, 0.5)),
                Material { roughness, ..clear(1.49) },
            );
        }
    };
    let (albedo, normal, depth, variance) = of(&scene(down, cover(0.0.into())));
    let ratio = |c: usize| albedo[c] / bare.0[c];
    assert!((0.85..1.6).contains(&ratio(0)), "red stays red: {albedo:?}");
    assert!(albedo[0] - albedo[1] > 0.85 * (bare.0[0] - bare.0[1]), "{albedo:?} of {:?}", bare.0);
    assert!(normal[2] > 0.9 && (0.9..1.05).contains(&depth), "{normal:?}, {depth}");
    // The mixture of both is noisy, and the variance of the film shows it: about 8 % of other colour over 64 samples.
    assert!(variance > 1e-5 && variance < 1e-2, "{variance}");
    // A rough cover is the first surface itself.
    let rough = of(&scene(down, cover(0.4.into())));
    assert!((rough.2 - 0.5).abs() < 1e-3 && (rough.0[0] - rough.0[1]).abs() < 1e-3, "{rough:?}");

    // A mirror upright at x = 1 shows the floor: 1 m to the mirror, and as far again.
    let aslant = (DVec3::new(0.0, 0.0, 1.0), DVec3::new(1.0, 0.0, 0.5));
    let mirror = |roughness: f32| {
        move |b: &mut SceneBuilder| {
            let metal = b.add_material(Material {
                metallic: 1.0.into(),
                base_color: Rgb::WHITE.into(),
                roughness: roughness.into(),
                ..Material::default()
            });
            b.add_object("mirror", shapes::rectangle(Vec3::new(1.0, 0.9, 0.1), Vec3::Y * -1.8, Vec3::Z * 0.8), metal);
        }
    };
    let (albedo, normal, depth, _) = of(&scene(aslant, mirror(0.0)));
    // At an oblique angle the floor has another albedo and the same hue.
    assert!((albedo[1] / albedo[0] - 0.25).abs() < 0.01 && normal[2] > 0.999, "{albedo:?}, {normal:?}");
    assert!((depth - 2.0 * 1.25f32.sqrt()).abs() < 0.02, "{depth}");
    // Brushed metal is the first surface itself.
    let (albedo, normal, depth, _) = of(&scene(aslant, mirror(0.3)));
    assert!(albedo[1] > 0.9 && normal[0] < -0.99 && (depth - 1.25f32.sqrt()).abs() < 0.02, "{albedo:?}, {normal:?}");
}

/// Cancels once denoising has begun.
struct Impatient<'a>(&'a Cancel);

impl Progress for Impatient<'_> {
    fn update(&self, state: &ProgressState) {
        if state.stage == Stage::Denoise {
            self.0.cancel();
        }
    }
}

#[test]
fn a_switch_thrown_while_denoising_ends_it_and_the_render_is_kept() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.obj");
    std::fs::write(&path, "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n").expect("writable");
    let mut project = Project::open(&path).expect("a scene");
    let s = &mut project.settings;
    (s.width, s.height, s.budget.spp) = (40, 30, Some(2.0));
    s.denoise.method = DenoiseMethod::Builtin;
    let cancel = Cancel::new();
    let result = project.render_with(&Impatient(&cancel), &cancel).expect("rendered");
    assert!(result.rendering.interrupted && result.frame.denoised.is_none());
    assert_eq!((result.stats.run.stop.as_str(), result.stats.sampling.samples), ("interrupted", 2 * 40 * 30));
    assert!(!result.stats.is_flagged(), "an interrupted render is not flagged");
    let error = result.stats.denoise.as_ref().and_then(|d| d.error.clone());
    assert_eq!(error.as_deref(), Some("denoising was cancelled"));

    let calm = project.render().expect("rendered");
    assert!(calm.frame.denoised.is_some() && calm.stats.time.seconds["denoise"] >= 0.0);
}
