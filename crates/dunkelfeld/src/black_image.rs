//! The likely cause of a black image, and its cure.

use crate::project::ProjectResult;
use dunkelfeld_film::Plane;
use dunkelfeld_radiometry::Number;
use dunkelfeld_render::{RenderedFilm, camera};
use dunkelfeld_scene::Scene;

/// An image with this share of black pixels is black.
const NEARLY_ALL: f64 = 0.999;
/// A pixel with fewer expected photo-electrons is black.
const ONE_ELECTRON: f32 = 1.0;

/// The share of the pixels with less than one expected photo-electron, if it is nearly all of them.
pub(crate) fn black_share(electrons: &Plane<f32>) -> Option<f64> {
    let black = electrons.data().iter().filter(|&&e| e < ONE_ELECTRON).count() as f64;
    Some(black / electrons.data().len() as f64).filter(|share| *share >= NEARLY_ALL)
}

/// The likely cause of an image without light, and its cure; `None` for an image with light.
///
/// An image is black if 99.9 % of the pixels with samples have no light. It is also black if its sensor has a fixed exposure
/// and receives less than one photo-electron in 99.9 % of the pixels.
pub fn black_image(scene: &Scene, result: &ProjectResult) -> Option<String> {
    let stats = &result.stats;
    let [width, height] = stats.run.size.map(f64::from);
    let sampled = width * height - stats.sampling.pixels_without_samples as f64;
    if sampled <= 0.0 {
        return None;
    }
    let share = stats.sampling.black_pixels as f64 / sampled;
    if share >= NEARLY_ALL {
        // A share just below one is not printed as all.
        let percent = Number((1000.0 * share).floor() / 10.0);
        return Some(format!("the image is black: {percent} % of its pixels have no light: {}", cause(scene, result)));
    }
    let sensor = result.frame.sensor.as_ref()?;
    let share = black_share(&sensor.electrons).filter(|_| !result.frame.no_light)?;
    let percent = Number((1000.0 * share).floor() / 10.0);
    let time = Number(sensor.exposure.time().0);
    Some(format!(
        "the image is black: {percent} % of its pixels receive less than one photo-electron in {time} s; expose longer (`exposure` in [sensor], or --exposure auto), or raise the light (`power` in [[light]])"
    ))
}

fn cause(scene: &Scene, result: &ProjectResult) -> String {
    let camera = camera(scene, result.settings()).ok();
    if let Some(body) = camera.and_then(|camera| scene.body_around(&camera, false)) {
        return format!(
            "the camera is inside the object \"{body}\"; move it out (`position` or `working_distance` in [camera]), or remove the object by `[[object]]` with `visible = false`"
        );
    }
    likely_cause(scene, &result.rendering.film).into()
}

fn likely_cause(scene: &Scene, film: &RenderedFilm) -> &'static str {
    if scene.light_inventory().iter().all(|light| light.power.is_black()) {
        return "the scene has no light; add [[light]] with a `kind` such as \"ring\", or [environment] with `radiance = 1`, to a job";
    }
    if film.ids.data().iter().all(Option::is_none) {
        return "no object is in the image; turn the camera (`look_at` in [camera]), select another one (--camera), or check the unit of length ([import] `unit`)";
    }
    "no light reaches the objects in the image; lamps may face away, be covered or inside a body, or have no power: `dunkelfeld inspect` lists their places, their power and hazards; turn them (`aim` or `target` in [[light]]), or add a light"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Project;

    /// A black and a white square, and the back of a lamp, from above.
    const OBJ: &str = "mtllib a.mtl\no part\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nusemtl paper\nf 1 2 3 4\no lamp\nv -1 -1 1\nv 1 -1 1\nv 1 -1 -1\nv -1 -1 -1\nusemtl glow\nf 8 7 6 5\n";
    const MTL: &str = "newmtl paper\nKd 0.5 0.5 0.5\nnewmtl glow\nKd 0 0 0\nKe 4 5 6\n";

    fn explained(job: &str) -> Option<String> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let camera = if job.contains("[camera]") { "" } else { "[camera]\nposition = [0, 2, 0]\nlook_at = \"part\"\n" };
        let text =
            format!("scene = \"a.obj\"\nfilm = {{ width = 8, height = 8 }}\nbudget = {{ spp = 8 }}\n{job}{camera}");
        for (name, text) in [("a.obj", OBJ), ("a.mtl", MTL), ("job.toml", &text)] {
            std::fs::write(folder.path().join(name), text).expect("writable");
        }
        let project = Project::open(folder.path().join("job.toml")).unwrap_or_else(|e| panic!("{e}"));
        let result = project.render().expect("an image");
        black_image(&project.scene, &result)
    }

    #[test]
    fn black_images_have_a_cause_and_a_cure() {
        const NONE: &str = "sensor = { model = \"none\" }\n";
        let light = "[[light]]\nkind = \"point\"\nposition = [0, 1.5, 0]\npower = \"10W\"\n";
        let off = "[[light]]\nname = \"lamp\"\nenabled = false\n";
        let short = "sensor = { exposure = \"19us\" }\n";
        let faint = light.replace("10W", "0.001uW");
        let inside = "[camera]\nposition = [0, 0.1, 0]\nlook_at = [0, 0, 0]\n[[object]]\nname = \"crate\"\nkind = \"box\"\nsize = [0.5, 0.5, 0.5]\ntranslate = [0, -0.1, 0]\n";
        let away = "[camera]\nposition = [0, 2, 0]\nlook_at = [0, 9, 0]\n";
        for (job, part) in [
            (format!("{NONE}{off}"), Some("the scene has no light; add [[light]]")),
            (format!("sensor = {{ exposure = \"1ms\" }}\n{off}"), Some("100 % of its pixels have no light")),
            (format!("{NONE}{light}{away}"), Some("no object is in the image")),
            (NONE.to_string(), Some("no light reaches the objects in the image")),
            (String::new(), Some("no light reaches the objects in the image")),
            (format!("{short}{faint}"), Some("less than one photo-electron in 0.000019 s; expose longer")),
            (format!("{NONE}{light}{inside}"), Some("the camera is inside the object \"crate\"; move it out")),
            (format!("{NONE}{light}"), None),
            (light.to_string(), None),
        ] {
            let found = explained(&job);
            match part {
                Some(part) => assert!(found.as_deref().is_some_and(|f| f.contains(part)), "{job}: {found:?}"),
                None => assert_eq!(found, None, "{job}"),
            }
        }
    }
}
