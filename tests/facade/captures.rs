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
    // An image that cannot be written does not lose the others.
    let mut seen = Vec::new();
    let failed = project.render_captures(&Silent, &Cancel::new(), &mut |name, _| {
        seen.extend(name.map(str::to_owned));
        Err(Error::setting("disk", format!("no space for {seen:?}"), "free some"))
    });
    assert_eq!(seen, ["all", "sides", "east", "west"]);
    assert!(failed.expect_err("the first error").to_string().contains("[\"all\"]"));
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

/// Lamps that flash in turn: each row of a capture is that of a render with its lamp alone, to the last bit, and has the height
/// of its own lines. The plan has what each row needs in its own light.
#[test]
fn lines_in_turn_are_those_of_renders_with_one_lamp() {
    let scan = SPHERE
        .replace("sensor = { model = \"none\" }", "sensor = { model = \"imx250\", exposure = \"50us\" }")
        .replace("diameter = \"50mm\"", "diameter = \"50mm\"\nvelocity = [0, 0, -10]")
        .replace("height = 64", "height = 66");
    let lines = "[line_scan]\nline_rate = \"20kHz\"\nalternate = true\n";
    let names = ["east", "north", "west"];
    let captured = names.map(|name| format!("[[capture]]\nname = \"{name}\"\nlights = [\"{name}\"]\n")).concat();
    let of = |text: String| Project::from_text("scan.toml", &text).and_then(|project| captures(&project));
    let all = of(format!("{scan}{lines}{}{captured}", lamps())).expect("rendered");
    for (k, name) in (0..).zip(names) {
        let result = &all[k as usize].1;
        let alone = format!("[[capture]]\nname = \"alone\"\nlights = [\"{name}\"]\n");
        let alone = of(format!("{scan}{}{}{alone}", lines.replace("true", "false"), lamps())).expect("rendered");
        let (found, wanted) = (&result.rendering.film, &alone[0].1.rendering.film);
        let frame = result.frame.sensor.as_ref().expect("a sensor");
        assert_eq!(
            [found.sums.height(), result.settings().height, frame.values.height(), result.stats.run.size[1]],
            [22; 4]
        );
        let certificate = result.stats.certificate.as_ref().expect("a sensor");
        assert_eq!(certificate.pixels + certificate.saturated, 22 * 64);
        let mut lit = 0;
        for (x, y) in (0..22).flat_map(|y| (0..64).map(move |x| (x, y))) {
            let (a, b) = (found.sums.pixel(x, y), wanted.sums.pixel(x, 3 * y + k));
            assert!(a == b && found.ids.at(x, y) == wanted.ids.at(x, 3 * y + k), "{name}: {x}, {y}");
            lit += u32::from(a.mean()[1] > 0.0);
        }
        assert!(lit > 200, "{name}: {lit} lit pixels");
    }
    // The plan is that of each row in its own light: the rows of two lights get other samples.
    let budget =
        scan.replace("spp = 64", "noise = 0.03, spp = 4000").replace("allocate = { strategy = \"uniform\" }\n", "");
    let two = "[[capture]]\nname = \"bright\"\nlights = [\"east\"]\n\
        [[capture]]\nname = \"dim\"\nlights = { west = 0.05 }\n";
    let two = of(format!("{budget}{lines}{}{two}", lamps())).expect("rendered");
    assert!(two.iter().all(|(_, result)| result.stats.certificate.as_ref().is_some_and(|c| c.is_hidden)));
    let samples: Vec<u64> = two.iter().map(|(_, result)| result.stats.sampling.samples).collect();
    assert!(samples[1] > samples[0] + samples[0] / 20, "{samples:?}");
    for (keys, wanted) in
        [("alternate = true\n", "no multiple of the 4 captures"), ("alternate = true\ntdi_stages = 2\n", "stages")]
    {
        let captured = format!("{captured}[[capture]]\nname = \"all\"\n");
        let text = format!("{scan}[line_scan]\nline_rate = \"20kHz\"\n{keys}{}{captured}", lamps());
        let error = of(text).expect_err(wanted).to_string();
        assert!(error.contains(wanted), "{error}");
    }
}

/// A capture of one camera is in the render of this camera alone, and `--exposure` is that of all captures.
#[test]
fn a_capture_can_have_its_own_camera() {
    let pose = "camera = { position = [0, \"300mm\", 0], look_at = [0, 0, 0], up = [0, 0, -1], lens = { projection = \
                \"telecentric\", magnification = 1, focus_distance = \"300mm\" } }";
    let camera = |name: &str, x: i32| {
        let pose =
            pose.trim_start_matches("camera = {").trim_end_matches('}').replace("[0, \"3", &format!("[\"{x}mm\", \"3"));
        format!("{{ name = \"{name}\", {pose} }}")
    };
    let cameras = format!("camera = [{}, {}]", camera("left", -30), camera("right", 30));
    let text = SPHERE
        .replace(pose, &cameras)
        .replace("sensor = { model = \"none\" }", "sensor = { model = \"imx250\", exposure = \"1ms\" }")
        .replace("spp = 64", "spp = 4");
    let job =
        |captured: &str| Project::from_text("two.toml", &format!("{text}{}{captured}", lamps())).expect("a valid job");
    let each = "[[capture]]\nname = \"all\"\n[[capture]]\nname = \"west\"\nlights = [\"west\"]\ncamera = \"right\"\nexposure = \"3ms\"\n";
    let names = |all: &[(Option<String>, ProjectResult)]| -> Vec<String> {
        all.iter()
            .map(|(name, result)| format!("{} {:?}", name.clone().unwrap_or_default(), result.stats.run.camera))
            .collect()
    };
    let all = captures(&job(each)).expect("rendered");
    let (left, right) = ("Some(\"left\")", "Some(\"right\")");
    assert_eq!(names(&all), [format!("left-all {left}"), format!("right-all {right}"), format!("right-west {right}")]);
    let mut alone = job(each);
    alone.settings.camera = Some("right".into());
    let alone = captures(&alone).expect("rendered");
    assert_eq!(names(&alone), [format!("all {right}"), format!("west {right}")]);
    assert!(
        alone[1].1.rendering.film == all[2].1.rendering.film && alone[0].1.rendering.film == all[1].1.rendering.film
    );
    let of_right = "[[capture]]\nname = \"one\"\ncamera = \"right\"\n";
    assert_eq!(names(&captures(&job(of_right)).expect("rendered")), [format!("one {right}")]);
    let mut other = job(of_right);
    other.settings.camera = Some("left".into());
    let unknown = of_right.replace("right", "midle");
    let errors = [captures(&other), captures(&job(&unknown))].map(|failed| failed.expect_err("refused").to_string());
    assert!(
        errors[0].contains("no capture is of the camera \"left\"") && errors[1].contains("left, right"),
        "{errors:?}"
    );
    assert!(job(&unknown).inspect().hazards.iter().any(|hazard| hazard.contains("midle")));
    // The films of the groups of lights are in the account.
    let peak = |captured: &str| job(captured).inspect().memory.expect("an account").peak_bytes;
    assert!(peak(each) > peak(""));
    let mut exposed = job(each);
    exposed.set_overrides("sensor.exposure = \"2ms\"").expect("valid");
    let times = captures(&exposed)
        .expect("rendered")
        .into_iter()
        .map(|(_, result)| result.stats.sensor.expect("one").exposure_seconds);
    assert_eq!(times.collect::<Vec<_>>(), [2e-3; 3]);
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
