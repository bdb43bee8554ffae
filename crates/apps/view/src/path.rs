//! The path of a sample, projected to the film.

use crate::protocol::{Fault, PathAnswer, PathVertex};
use dunkelfeld::Project;
use dunkelfeld::geometry::DVec3;
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::trace::{PixelSample, TracedVertex};

/// Traces a sample as the render does.
pub(crate) fn trace_path(project: &Project, at: PixelSample) -> Result<PathAnswer, Fault> {
    let camera = dunkelfeld::camera(&project.scene, &project.fitted()?)?;
    let sample = project.trace_sample(at)?;
    let rgb = |[r, g, b]: [f32; 3]| Rgb::new(r, g, b);
    let vertices = sample.vertices.into_iter().map(|vertex| {
        let light = vertex.connections.iter().map(|connection| rgb(connection.contribution));
        let light = light.fold(rgb(vertex.emitted) + rgb(vertex.direct), |sum, light| sum + light);
        // A ray that leaves the scene has a direction instead of a place.
        let place = vertex.position.and_then(|position| camera.project(DVec3::from_array(position)));
        let [x, y] = [0, 1].map(|axis| place.map(|place| place[axis]));
        let event = event_of(&vertex);
        PathVertex { before: vertex.before, luminance: light.luminance().into(), x, y, object: vertex.material, event }
    });
    let vertices = vertices.collect();
    Ok(PathAnswer { index: at.index, luminance: rgb(sample.radiance).luminance().into(), vertices })
}

fn event_of(vertex: &TracedVertex) -> String {
    match (&vertex.material, &vertex.scattered) {
        (None, _) => "leaves the scene".to_owned(),
        (_, None) => "ends".to_owned(),
        (_, Some(scattered)) => scattered.lobe.clone(),
    }
}
