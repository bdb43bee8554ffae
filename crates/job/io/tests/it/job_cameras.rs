//! Cameras of a job: their poses and projections, and their refusals with line and caret.

use dunkelfeld_geometry::{DAffine3, DVec3};
use dunkelfeld_io::InputError;
use dunkelfeld_io::job::{Job, LensSettings, Place};
use dunkelfeld_scene::{Camera, Projection, SceneBuilder, shapes};

/// A plate of 2 m x 2 m around (3, 0, 0), and a camera of the scene.
fn scene() -> SceneBuilder {
    let mut scene = SceneBuilder::default();
    let material = scene.add_material(Default::default());
    let plate = shapes::rectangle([2.0, 0.0, 1.0].into(), [2.0, 0.0, 0.0].into(), [0.0, 0.0, -2.0].into());
    scene.add_object("plate", plate, material);
    scene.add_camera("above", DVec3::new(0.0, 5.0, 0.0), DVec3::ZERO, 0.5);
    scene
}

fn try_cameras(text: &str) -> Result<Vec<Camera>, InputError> {
    let mut scene = scene();
    let job = Job::from_text("a.toml", format!("scene = \"a.glb\"\n{text}"))?;
    job.apply_overrides(&mut scene)?;
    job.apply_intrinsics(&mut scene, [640, 480]);
    Ok(scene.cameras)
}

fn cameras(text: &str) -> Vec<Camera> {
    try_cameras(text).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()))
}

#[track_caller]
fn assert_pose(camera: &Camera, position: [f64; 3], forward: [f64; 3], up: [f64; 3]) {
    let DAffine3 { matrix3: axes, translation } = camera.to_world;
    for (what, found, expected) in
        [("position", translation, position), ("forward", -axes.z_axis, forward), ("up", axes.y_axis, up)]
    {
        assert!(found.distance(DVec3::from_array(expected)) < 1e-9, "{what}: {found} instead of {expected:?}");
    }
}

#[test]
fn a_camera_looks_at_a_point_or_an_object() {
    let list = cameras("[camera]\nposition = [3, 0, \"400cm\"]\nlook_at = \"pl*\"");
    assert_eq!(
        list.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(),
        ["camera", "above"],
        "in front of the scene's"
    );
    assert_pose(&list[0], [3.0, 0.0, 4.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]);
    let turned = cameras("[camera]\nposition = [0, 0, 4]\nlook_at = [0, 0, 0]\nup = [5, 0, 1]");
    assert_pose(&turned[0], [0.0, 0.0, 4.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]);
    // A view along y has -z up in the image.
    let below = cameras("[camera]\nposition = [0, -1, 0]\nlook_at = [0, 0, 0]");
    assert_pose(&below[0], [0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]);
}

#[test]
fn one_camera_at_least_is_enabled() {
    let two = |first: &str, second: &str| {
        let text = format!("scene = \"a.glb\"\n[[camera]]\nname = \"a\"\n{first}[[camera]]\nname = \"b\"\n{second}");
        Job::from_text("a.toml", text)
    };
    let off = "enabled = false\n";
    assert_eq!(two("", off).expect("one is enabled").first_enabled(), None, "the first one of the scene");
    assert_eq!(two(off, "enabled = true\n").expect("one is enabled").first_enabled(), Some("b"));
}

#[test]
fn a_working_distance_places_the_camera() {
    let above = cameras("[camera]\nlook_at = \"plate\"\nworking_distance = \"200mm\"");
    assert_pose(&above[0], [3.0, 0.2, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]);
    let beside = cameras("[camera]\nlook_at = [1, 0, 0]\nworking_distance = 2\ndirection = [7, 0, 0]");
    assert_pose(&beside[0], [3.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    // Focal length or magnification: the field of the thin lens that is focused at the working distance.
    let job = |lens: &str| {
        let text = format!("scene = \"a\"\n[camera]\nlook_at = [0, 0, 0]\nworking_distance = 0.3\nlens = {{ {lens} }}");
        let job = Job::from_text("a.toml", text).unwrap_or_else(|e| panic!("{e}"));
        job.camera.defined[0].lens_or(&LensSettings::default())
    };
    let by_focal_length = job("focal_length = \"50mm\"");
    assert!((by_focal_length.magnification.expect("one") - 0.2).abs() < 1e-12);
    let by_magnification = job("magnification = 0.2");
    assert!((by_magnification.focal_length.expect("one") - 0.05).abs() < 1e-12);
    assert_eq!(job("focal_length = \"50mm\", focus_distance = \"310mm\"").magnification, None);
    assert_eq!(job("vertical_fov = \"20deg\", magnification = 0.2").focal_length, None);
}

/// OpenCV: a point X of the world is at R X + t, with x right, y down and z forward.
#[test]
fn rotation_and_translation_are_those_of_opencv() {
    // The camera stands at (1, 2, 3), looks along +x of the world, and its right is +z.
    let rows = [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]];
    let text = format!("[camera]\nR = {rows:?}\nt = [-3, 2, -1]");
    let camera = &cameras(&text)[0];
    assert_pose(camera, [1.0, 2.0, 3.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    let point = DVec3::new(4.0, 2.5, 7.0);
    let local = camera.to_world.inverse().transform_point3(point);
    for (k, t) in [-3.0, 2.0, -1.0].into_iter().enumerate() {
        let opencv = DVec3::from_array(rows[k]).dot(point) + t;
        let ours = [local.x, -local.y, -local.z][k];
        assert!((opencv - ours).abs() < 1e-12, "{opencv} against {ours}");
    }
}

#[test]
fn a_camera_matrix_sets_field_principal_point_and_aspect() {
    let camera = &cameras(
        "[camera]\nlook_at = [0, 0, 0]\nposition = [0, 1, 0]\nK = [[900, 0, 310], [0, 720.0, 250.5], [0, 0, 1]]",
    )[0];
    let Projection::Perspective { vertical_fov } = camera.projection else { panic!("{camera:?}") };
    assert!((f64::from(vertical_fov) - 2.0 * (240.0f64 / 720.0).atan()).abs() < 1e-7);
    assert_eq!(camera.lens.principal_point, [310.0 - 319.5, 250.5 - 239.5]);
    assert_eq!(camera.lens.pixel_aspect, 0.8);
}

#[test]
fn a_camera_without_a_pose_is_that_of_the_scene() {
    let list = cameras(
        "[[camera]]\nname = \"above\"\nvertical_fov = \"10deg\"\n[[camera]]\nposition = [1, 1, 1]\nlook_at = [0, 0, 0]",
    );
    assert_eq!(list.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["above", "camera-2"]);
    assert_eq!(list[0].to_world, scene().cameras[0].to_world);
    assert_eq!(list[0].projection, Projection::Perspective { vertical_fov: 10f32.to_radians() });
    let job =
        Job::from_text("a.toml", "scene = \"a\"\n[camera]\nlook_at = \"x\"\nposition = [0, 0, 0]").expect("a job");
    assert_eq!(job.camera.defined[0].look_at, Some(Place::Object("x".into())));
}

#[test]
fn parts_of_the_film_are_read_with_the_film() {
    let job = |film: &str| Job::from_text("a.toml", format!("scene = \"a\"\n[film]\n{film}"));
    let film = job("roi = [8, 6, 64, 48]\nbinning = 2").expect("a job").film;
    assert_eq!((film.roi, film.binning, film.full), (Some([8, 6, 64, 48]), Some(2), false));
}
