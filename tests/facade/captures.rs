//! Captures: several lightings of one part from one render. Replay: `cargo test -p dunkelfeld --test it captures::NAME`.

use dunkelfeld::{Cancel, Error, Project, ProjectResult, Silent};

/// A white matt sphere of 50 mm in the light of four distant lamps from the sides, seen from above by parallel rays.
const SPHERE: &str = r#"
scene = "none"
film = { width = 64, height = 64, pixel_pitch = "1mm" }
budget = { spp = 64 }
allocate = { strategy = "uniform" }
sensor = { model = "none" }
camera = { position = [0, "300mm", 0], look_at = [0, 0, 0], up = [0, 0, -1], lens = { projection = "telecentric", magnification = 1, focus_distance = "300mm" } }

[[object]]
name = "ball"
kind = "sphere"
diameter = "50mm"
material = "matt"

[[material]]
name = "matt"
new = true
base_color = 0.8
specular = 0
roughness = 1
"#;

/// Directions to the lamps.
const LAMPS: [(&str, [f64; 3]); 4] =
    [("east", [1.0, 1.5, 0.0]), ("north", [0.0, 1.5, -1.0]), ("west", [-1.0, 1.5, 0.0]), ("south", [0.0, 1.5, 1.0])];

fn lamps() -> String {
    let lamp = |(name, [x, y, z]): (&str, [f64; 3])| {
        format!("[[light]]\nname = \"{name}\"\nkind = \"sun\"\nirradiance = 3\ndirection = [{x}, {y}, {z}]\n")
    };
    LAMPS.into_iter().map(lamp).collect()
}

fn captures(project: &Project) -> Result<Vec<(Option<String>, ProjectResult)>, Error> {
    let mut all = Vec::new();
    project.render_captures(&Silent, &Cancel::new(), &mut |name, result| {
        all.push((name.map(str::to_owned), result));
        Ok(())
    })?;
    Ok(all)
}

/// Photometric stereo (Woodham 1980) of four captures gives the normals of a Lambertian sphere within a degree.
#[test]
fn photometric_stereo_finds_the_normals_of_a_sphere() {
    let captured = LAMPS.map(|(name, _)| format!("[[capture]]\nname = \"{name}\"\nlights = [\"{name}\"]\n")).concat();
    let project = Project::from_text("sphere.toml", &format!("{SPHERE}{}{captured}", lamps())).expect("a valid job");
    let all = captures(&project).expect("rendered");
    assert_eq!(all.iter().filter_map(|(name, _)| name.as_deref()).collect::<Vec<_>>(), LAMPS.map(|(name, _)| name));
    let mut worst: f64 = 0.0;
    let mut seen = 0;
    for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
        let [u, v] = [x, y].map(|place| (f64::from(place) + 0.5 - 32.0) / 25.0);
        // All four lamps light the middle of the sphere.
        if u * u + v * v > 0.3 {
            continue;
        }
        let light = all.iter().map(|(_, result)| result.rendering.film.sums.pixel(x, y).mean()[1]);
        let [e, n, w, s]: [f64; 4] = light.collect::<Vec<_>>().try_into().expect("four captures");
        // I = c (n . l): opposite lamps differ in one horizontal component, and all together give the vertical one.
        let [nx, nz, ny] = [(e - w) / 2.0, (s - n) / 2.0, (e + n + w + s) / 6.0];
        let length = (nx * nx + ny * ny + nz * nz).sqrt();
        let wanted = [u, (1.0 - u * u - v * v).sqrt(), v];
        let cos = (nx * wanted[0] + ny * wanted[1] + nz * wanted[2]) / length;
        worst = worst.max(cos.min(1.0).acos().to_degrees());
        seen += 1;
    }
    assert!(seen > 500 && worst < 1.0, "{seen} pixels, {worst} degrees");
}

/// A capture of all lights with factors of 1 has the film of the render without captures, to the last bit. Factors scale the
/// light of a lamp, and lights of no capture are dark.
#[test]
fn captures_are_the_light_of_their_lamps() {
    let text = format!(
        "{SPHERE}{}[[capture]]\nname = \"all\"\nlights = [\"*\"]\n[[capture]]\nname = \"sides\"\nlights = {{ east = 0.5, \
         west = 2 }}\n[[capture]]\nname = \"east\"\nlights = [\"east\"]\n[[capture]]\nname = \"west\"\nlights = [\"w*\"]\n",
        lamps()
    );
    let project = Project::from_text("sphere.toml", &text).expect("a valid job");
    let all = captures(&project).expect("rendered");
    let whole = project.render().expect("rendered");
    assert!(all[0].1.rendering.film == whole.rendering.film);
    let at = |capture: usize, x, y| all[capture].1.rendering.film.sums.pixel(x, y).mean()[1];
    for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
        let wanted = 0.5 * at(2, x, y) + 2.0 * at(3, x, y);
        assert!((at(1, x, y) - wanted).abs() <= 1e-6 * wanted, "{x}, {y}");
    }
}

/// The noise limit holds in each capture, the dim one included; each has its own exposure.
#[test]
fn the_plan_serves_the_worst_capture() {
    let text = SPHERE
        .replace("sensor = { model = \"none\" }", "sensor = { model = \"imx250\", exposure = \"1ms\" }")
        .replace("budget = { spp = 64 }", "budget = { noise = 1, spp = 20000 }")
        .replace("allocate = { strategy = \"uniform\" }\n", "")
        .replace(", pixel_pitch = \"1mm\"", "");
    let panels = "[environment]\nradiance = 0.05\n\
        [[light]]\nname = \"left\"\nkind = \"panel\"\nwidth = \"100mm\"\nheight = \"100mm\"\n\
        position = [\"-200mm\", \"200mm\", 0]\ntarget = [0, 0, 0]\npower = 0.4\n\
        [[light]]\nname = \"right\"\nkind = \"panel\"\nwidth = \"30mm\"\nheight = \"30mm\"\n\
        position = [\"150mm\", \"60mm\", 0]\ntarget = [0, 0, 0]\npower = 0.02\n";
    let captured = "[[capture]]\nname = \"bright\"\nlights = [\"left\"]\nexposure = \"auto\"\n\
        [[capture]]\nname = \"dim\"\nlights = { right = 1, environment = 0.5 }\nexposure = \"20ms\"\n";
    let project = Project::from_text("sphere.toml", &format!("{text}{panels}{captured}")).expect("a valid job");
    let all = captures(&project).expect("rendered");
    let exposures = all.iter().map(|(_, result)| result.frame.sensor.as_ref().expect("a sensor").exposure.time().0);
    let exposures: Vec<f64> = exposures.collect();
    assert!(exposures[1] == 0.02 && exposures[0] != 0.02, "{exposures:?}");
    for (name, result) in &all {
        let certificate = result.stats.certificate.as_ref().expect("a sensor");
        assert!(certificate.is_hidden, "{name:?}: {certificate:?}");
        assert_eq!(result.stats.run.capture, *name);
    }
    // Each capture has its own noise.
    let lone = project_of_two(&text, panels);
    let values = |number: usize| &lone[number].1.frame.sensor.as_ref().expect("a sensor").values;
    let differ = values(0).data().iter().zip(values(1).data()).filter(|(a, b)| a != b).count();
    assert!(lone[0].1.rendering.film == lone[1].1.rendering.film && differ > 1000, "{differ} pixels differ");
    let samples: Vec<u64> = all.iter().map(|(_, result)| result.stats.sampling.samples).collect();
    assert_eq!(samples[0], samples[1]);
}

/// Two captures of one lamp.
fn project_of_two(text: &str, panels: &str) -> Vec<(Option<String>, ProjectResult)> {
    let text = text.replace("budget = { noise = 1, spp = 20000 }", "budget = { spp = 4 }");
    let captured = ["one", "two"].map(|name| format!("[[capture]]\nname = \"{name}\"\nlights = [\"left\"]\n")).concat();
    let project = Project::from_text("sphere.toml", &format!("{text}{panels}{captured}")).expect("a valid job");
    captures(&project).expect("rendered")
}

#[test]
fn captures_name_lights_of_the_scene() {
    for (capture, wanted) in [
        ("name = \"a\"\nlights = [\"est\"]", "no light named \"est\""),
        ("name = \"a\"\nlights = { east = 0 }", "no light is on"),
        ("name = \"a/b\"\nlights = [\"east\"]", "not a suffix"),
        ("name = \"a\"\nlights = [\"east\"]\n[[capture]]\nname = \"A\"\nlights = [\"west\"]", "two captures"),
    ] {
        let text = format!("{SPHERE}{}[[capture]]\n{capture}\n", lamps());
        let error = Project::from_text("sphere.toml", &text).and_then(|project| captures(&project)).expect_err(wanted);
        assert!(error.to_string().contains(wanted), "{error}");
    }
}
