//! Tests of new lamps in a job.

use super::*;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_scene::AlphaMode;
use dunkelfeld_scene::shapes::cuboid;

/// An environment.
const SKY: &str = "[[light]]\nkind = \"environment\"\n";
const HEAD: &str = "scene = \"part.glb\"\n";

fn job(text: &str) -> Result<Job, InputError> {
    Job::from_text("job.toml", format!("{HEAD}{text}"))
}

/// A part of 20 x 4 x 20 mm around the origin, and a camera above it.
fn scene() -> SceneBuilder {
    let mut b = SceneBuilder::default();
    let m = b.add_material(Material::default());
    b.add_object("part", cuboid(Vec3::new(-0.01, -0.002, -0.01), Vec3::new(0.01, 0.002, 0.01)), m);
    b.add_camera("above", DVec3::new(0.0, 0.5, 0.0), DVec3::ZERO, 0.3);
    b
}

fn lit(text: &str) -> SceneBuilder {
    let job = job(text).unwrap_or_else(|e| panic!("{text}: {e}"));
    let mut scene = scene();
    job.apply_overrides(&mut scene).unwrap_or_else(|e| panic!("{text}: {e}"));
    scene
}

/// Position, and the direction in which the lamp of an object shines.
fn pose(scene: &SceneBuilder, name: &str) -> (DVec3, DVec3) {
    let lamp = scene.instances.iter().find(|n| n.name == name).unwrap_or_else(|| panic!("no lamp {name}"));
    (lamp.to_world.translation, -lamp.to_world.matrix3.z_axis)
}

/// The irradiance [W/m^2] of all lamps at a point that faces up, by the facets of their meshes, in one channel.
fn irradiance(scene: &SceneBuilder, at: DVec3, channel: usize) -> f64 {
    let mut sum = 0.0;
    for lamp in &scene.instances {
        for part in lamp.meshes.iter().map(|m| &scene.meshes[*m]) {
            let material = &scene.materials[part.material];
            let radiance = f64::from(material.emission.factor.to_array()[channel]);
            if radiance > 0.0 {
                // The frame of the lamp is that of `irradiance_on_axis` if the point lies on its axis.
                let local = lamp.to_world.inverse().transform_point3(at);
                assert!(local.x.hypot(local.y) < 1e-9, "{} is not over the point", lamp.name);
                sum += radiance * irradiance_on_axis(&part.mesh, &material.emission_profile, -local.z);
            }
        }
    }
    sum
}

#[test]
fn a_ring_lies_on_the_axis_of_the_camera_and_faces_the_part() {
    let text = "[[light]]\nkind = \"ring\"\ndiameter = \"100mm\"\ndistance = \"200mm\"\nirradiance = 50\n";
    let scene = lit(text);
    let (position, aim) = pose(&scene, "ring");
    assert!(position.distance(DVec3::new(0.0, 0.2, 0.0)) < 1e-9 && aim.distance(DVec3::NEG_Y) < 1e-9);
    for channel in 0..3 {
        assert!((irradiance(&scene, DVec3::ZERO, channel) / 50.0 - 1.0).abs() < 1e-6);
    }
    assert!(scene.meshes[1].is_single_light);
}

#[test]
fn the_power_of_a_lamp_is_what_its_surface_emits() {
    for shape in [
        "kind = \"ring\"\ndiameter = \"100mm\"\ntilt = \"30deg\"",
        "kind = \"ring\"\ndiameter = \"100mm\"\nleds = 24\nlens_angle = \"30deg\"",
        "kind = \"bar\"\nwidth = \"100mm\"\nleds = [20, 2]",
        "kind = \"panel\"\nwidth = \"100mm\"\nspread = \"40deg\"",
        "kind = \"dome\"\ndiameter = \"200mm\"",
        "kind = \"point\"\ndiameter = \"10mm\"",
        "kind = \"spot\"\ndiameter = \"10mm\"\ncone_angle = \"60deg\"",
    ] {
        let scene = lit(&format!("[[light]]\n{shape}\ndistance = \"200mm\"\npower = \"3W\"\nname = \"lamp\"\n"));
        let part = scene.meshes.iter().find(|m| m.name == "lamp").expect("a lamp");
        let material = &scene.materials[part.material];
        let power =
            f64::from(material.emission.factor.mean()) * PI * area(&part.mesh) * material.emission_profile.exitance();
        assert!((power / 3.0 - 1.0).abs() < 1e-5, "{shape}: {power} W");
    }
}

/// The intensity of small lamps on their axis is that of lights without extent.
#[test]
fn small_points_and_spots_have_the_intensity_of_punctual_ones() {
    for shape in ["kind = \"point\"", "kind = \"spot\"\ncone_angle = \"50deg\"\nblend = 0.3"] {
        for strength in ["power = \"3W\"", "intensity = 2"] {
            let head = format!("[[light]]\n{shape}\n{strength}\ndistance = \"200mm\"\nname = \"lamp\"\n");
            let punctual = match lit(&head).lights[0].kind {
                PunctualKind::Point { intensity } | PunctualKind::Spot { intensity, .. } => intensity.g,
                other => panic!("{other:?}"),
            };
            let scene = lit(&format!("{head}diameter = \"1mm\"\n"));
            let part = scene.meshes.iter().find(|m| m.name == "lamp").expect("a lamp");
            let seen = area(&part.mesh) * if shape.contains("spot") { 1.0 } else { 0.25 };
            let intensity = f64::from(scene.materials[part.material].emission.factor.g) * seen;
            assert!((intensity / f64::from(punctual) - 1.0).abs() < 1e-4, "{head}: {intensity} and {punctual}");
        }
    }
}

#[test]
fn poses_follow_directions_angles_and_copies() {
    let head = "[[light]]\nkind = \"bar\"\nwidth = \"100mm\"\ndistance = \"200mm\"\n";
    let (position, aim) = pose(&lit(&format!("{head}direction = [1, 0, 0]\n")), "bar");
    assert!(position.distance(DVec3::new(0.2, 0.0, 0.0)) < 1e-9 && aim.distance(DVec3::NEG_X) < 1e-9);
    // 30 degrees above the table, in the direction of the camera's right.
    let scene = lit(&format!("{head}elevation = \"30deg\"\ncount = 4\n"));
    let mut sum = DVec3::ZERO;
    for k in 1..=4 {
        let (position, aim) = pose(&scene, &format!("bar {k}"));
        assert!((position.y - 0.1).abs() < 1e-8 && (position.length() - 0.2).abs() < 1e-8, "{position}");
        assert!(aim.distance(-position / 0.2) < 1e-8);
        // The long side is horizontal.
        let long =
            scene.instances.iter().find(|n| n.name == format!("bar {k}")).expect("a bar").to_world.matrix3.x_axis;
        assert!(long.y.abs() < 1e-8, "{long}");
        sum += position;
    }
    assert!(sum.distance(DVec3::new(0.0, 0.4, 0.0)) < 1e-7, "evenly around the axis: {sum}");
    let scene = lit("[[light]]\nkind = \"back\"\nwidth = \"100mm\"\ndistance = \"50mm\"\ntarget = \"part\"\n");
    let (position, aim) = pose(&scene, "back");
    assert!(position.distance(DVec3::new(0.0, -0.05, 0.0)) < 1e-9 && aim.distance(DVec3::Y) < 1e-9);
    let text = "[[light]]\nkind = \"panel\"\nwidth = 0.1\nposition = [0, 1, 0]\naim = [0, 0, -1]\nup = [0, 1, 0]\n";
    let scene = lit(text);
    assert!(pose(&scene, "panel").1.distance(DVec3::NEG_Z) < 1e-9);
    assert!(scene.instances[1].to_world.matrix3.y_axis.distance(DVec3::Y) < 1e-9);
}

#[test]
fn wavelengths_set_channels_and_bands() {
    let text = "[[light]]\nkind = \"ring\"\ndiameter = \"100mm\"\ndistance = \"200mm\"\nirradiance = 9\n";
    let red = format!("{text}wavelength = \"625nm\"\n");
    let scene = lit(&red);
    // A third of the light of a grey triple is in each channel.
    assert!((irradiance(&scene, DVec3::ZERO, 0) / 27.0 - 1.0).abs() < 1e-6);
    assert_eq!(irradiance(&scene, DVec3::ZERO, 1), 0.0);
    assert_eq!(job(&red).expect("a job").bands().expect("bands").wavelengths[0], Nanometres(625.0));
    let both = format!("{red}[[light]]\nkind = \"dome\"\ndiameter = \"200mm\"\nwavelength = \"infrared\"\n");
    let error = job(&both).expect("a job").bands().expect_err("two wavelengths in one channel");
    assert!(error.problem.contains("850") && error.problem.contains("625"), "{error}");
    let filtered = format!("{red}[lens]\nfilter = {{ center = \"625nm\", width = \"20nm\" }}\n");
    let bands = job(&filtered).expect("a job").bands().expect("bands");
    assert!((bands.transmission[0] - 0.9).abs() < 1e-12 && bands.transmission[1] < 1e-3, "{bands:?}");
}

#[test]
fn a_coaxial_lamp_is_invisible_from_behind_and_halves_the_light_of_the_camera() {
    let text = "[[light]]\nkind = \"coaxial\"\nwidth = \"60mm\"\ndistance = \"100mm\"\nradiance = 10\n";
    let scene = lit(text);
    let lamp = &scene.materials[scene.meshes[1].material];
    assert!(lamp.alpha_mode == AlphaMode::FrontOnly && (lamp.emission.factor.g - 5.0).abs() < 1e-6);
    let job = job(text).expect("a job");
    assert!((job.splitter_transmission("above", Some("above")) - 0.5).abs() < 1e-12);
    assert_eq!(job.splitter_transmission("side", Some("above")), 1.0);
    assert!((job.splitter_transmission("", None) - 0.5).abs() < 1e-12, "a scene without cameras");
}

#[test]
fn strobes_shorten_the_exposure_and_off_lamps_are_absent() {
    let lamp = "[[light]]\nkind = \"panel\"\nwidth = 0.1\ndistance = 0.2\nradiance = 10\n";
    let scene = lit(&format!("[sensor]\nexposure = \"1ms\"\n{lamp}strobe = \"100us\"\n"));
    assert!((scene.materials[1].emission.factor.g - 1.0).abs() < 1e-6);
    let scene = lit(&format!("{lamp}enabled = false\n"));
    assert_eq!((scene.instances.len(), scene.materials.len()), (1, 1));
}

/// `tests/refusals.txt` has the lamps that are refused.
#[test]
fn lamps_at_the_limits_are_accepted() {
    let ring = "[[light]]\nkind = \"ring\"\ndiameter = \"100mm\"\ndistance = \"200mm\"\n";
    let all = format!("{ring}leds = 9000\ncount = 2\n{ring}leds = [200, 10]\n");
    assert!(job(&all).is_ok(), "20000 LEDs");
    assert!(job(&format!("{all}{ring}leds = 9000\ndiffuser = true\n")).is_ok(), "LEDs behind a diffuser do not count");
    assert!(job(&format!("{SKY}enabled = false\n{SKY}")).is_ok(), "a lamp that is off is no environment");
}

/// A lamp belongs to the first camera, or to that of its key.
#[test]
fn lamps_lie_on_the_axis_of_their_camera() {
    let cameras = "[[camera]]\nname = \"top\"\nlook_at = \"*\"\nworking_distance = 0.4\n[[camera]]\nname = \"side\"\n\
                   look_at = [0, 0, \"5mm\"]\nposition = [0.3, 0, 0.005]\n";
    let ring = "[[light]]\nkind = \"ring\"\ndiameter = \"100mm\"\ndistance = \"200mm\"\n";
    // The target of the last one is the part, without the lamps before it.
    let scene = lit(&format!("{cameras}{ring}{ring}camera = \"side\"\nname = \"b\"\n{ring}name = \"c\"\n"));
    for (name, position, aim) in [
        ("ring", DVec3::new(0.0, 0.2, 0.0), DVec3::NEG_Y),
        ("b", DVec3::new(0.2, 0.0, 0.005), DVec3::NEG_X),
        ("c", DVec3::new(0.0, 0.2, 0.0), DVec3::NEG_Y),
    ] {
        let found = pose(&scene, name);
        assert!(found.0.distance(position) < 1e-8 && found.1.distance(aim) < 1e-8, "{name}: {found:?}");
    }
}

#[test]
fn the_irradiance_of_a_lamp_at_a_position_is_that_at_its_target() {
    let scene = lit("[[light]]\nkind = \"panel\"\nwidth = 0.1\nposition = [0, 0.3, 0]\nirradiance = 7\n");
    assert!((irradiance(&scene, DVec3::ZERO, 1) / 7.0 - 1.0).abs() < 1e-6);
}

/// Points and spots: E = I / d^2. With a diameter: a sphere of radius R gives E = pi L R^2 / d^2 at the distance d from its
/// centre, the same as that of its projected area in the far field.
#[test]
fn the_irradiance_of_points_and_spots_is_that_at_their_target() {
    for kind in ["point", "spot"] {
        let head = format!("[[light]]\nkind = \"{kind}\"\nname = \"lamp\"\nirradiance = 5\n");
        for (keys, distance) in [
            ("distance = \"300mm\"\n", 0.3),
            ("position = [0.3, 0.4, 0]\n", 0.5),
            ("distance = \"300mm\"\nworking_distance = \"200mm\"\n", 0.2),
        ] {
            let intensity = match lit(&format!("{head}{keys}")).lights[0].kind {
                PunctualKind::Point { intensity } | PunctualKind::Spot { intensity, .. } => intensity.g,
                other => panic!("{other:?}"),
            };
            assert!((f64::from(intensity) / (5.0 * distance * distance) - 1.0).abs() < 1e-6, "{kind}: {keys}");
        }
        let round = lit(&format!("{head}distance = \"300mm\"\ndiameter = \"20mm\"\n"));
        let part = round.meshes.iter().find(|m| m.name == "lamp").expect("a lamp");
        let radiance = f64::from(round.materials[part.material].emission.factor.g);
        let per_radiance = PI * 0.01f64.powi(2) / if kind == "spot" { 0.09 + 0.01f64.powi(2) } else { 0.09 };
        assert!((radiance * per_radiance / 5.0 - 1.0).abs() < 2e-3, "{kind}: {}", radiance * per_radiance);
        let error = job(&format!("{head}distance = 0\n")).expect("a job").apply_overrides(&mut scene());
        let error = error.expect_err("at its target");
        assert!(error.place.contains("irradiance") && error.problem.contains("0 m"), "{error}");
    }
}

/// An angle of 120 degrees is Lambertian, so that it needs no profile.
#[test]
fn the_widest_lens_angle_is_lambertian() {
    let panel = "[[light]]\nkind = \"panel\"\nwidth = 0.1\ndistance = 0.3\n";
    let profile = |text: &str| lit(&format!("{panel}{text}")).materials[1].emission_profile;
    assert_eq!(profile("lens_angle = \"120deg\"\n"), EmissionProfile::Lambertian);
    assert!(matches!(profile("lens_angle = \"100deg\"\n"), EmissionProfile::CosinePower { .. }));
}
