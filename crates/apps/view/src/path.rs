//! The path of a sample, projected to the film.

use crate::protocol::{Fault, PathAnswer, PathVertex};
use dunkelfeld::geometry::DVec3;
use dunkelfeld::trace::{Estimator, Lobe, PixelSample, train};
use dunkelfeld::{Project, Session};

/// Traces a sample as the render does.
pub(crate) fn trace_path(project: &Project, at: PixelSample) -> Result<PathAnswer, Fault> {
    let settings = project.fitted()?;
    let camera = dunkelfeld::camera(&project.scene, &settings)?;
    let roulette = Session::new(settings.run.threads)?.install(|| train(&project.scene, &camera, &settings));
    let estimator = Estimator {
        scene: &project.scene,
        camera: &camera,
        width: settings.width,
        seed: settings.seed,
        frame: settings.frame,
        roulette: roulette.as_ref(),
    };
    let (sample, trace) = estimator.trace(at);
    let origin = project.scene.world_origin();
    let on_film = |position: [f32; 3]| camera.project(DVec3::from_array(position.map(f64::from)) + origin);
    let vertices = trace.vertices.iter().map(|vertex| {
        // A ray that leaves the scene has a direction instead of a place.
        let place = vertex.material.and_then(|_| on_film(vertex.position));
        let name = vertex.material.and_then(|m| project.scene.materials().get(m as usize)).map(|m| m.name.clone());
        let event = match (&vertex.material, &vertex.scattered) {
            (None, _) => "leaves the scene".to_owned(),
            (_, None) => "ends".to_owned(),
            (_, Some(scattered)) => lobe(scattered.lobe),
        };
        PathVertex {
            before: vertex.before,
            luminance: vertex.contribution().luminance().into(),
            x: place.map(|p| p[0]),
            y: place.map(|p| p[1]),
            object: name,
            event,
        }
    });
    Ok(PathAnswer { index: at.index, luminance: sample.radiance.luminance().into(), vertices: vertices.collect() })
}

/// The kind of scattering.
fn lobe(lobe: Lobe) -> String {
    let names = [
        (Lobe::CLEARCOAT, "clearcoat"),
        (Lobe::DIFFUSE, "diffuse"),
        (Lobe::GLOSSY, "glossy"),
        (Lobe::DELTA, "specular"),
        (Lobe::REFLECTION, "reflection"),
        (Lobe::TRANSMISSION, "transmission"),
    ];
    let names: Vec<&str> = names.iter().filter(|(l, _)| lobe.contains(*l)).map(|(_, name)| *name).collect();
    if names.is_empty() { "volume".into() } else { names.join(" ") }
}
