//! `render --debug-sample`: one sample, vertex by vertex.

use crate::outcome::{Outcome, print};
use dunkelfeld::radiometry::Rgb;
use dunkelfeld::trace::Lobe;
use dunkelfeld::trace::{Estimator, PixelSample, TraceConnection};
use dunkelfeld::{Error, Project, Session};
use std::fmt::Write;

pub(super) fn run(project: &Project, at: PixelSample) -> Result<Outcome, Error> {
    let s = &project.fitted()?;
    if at.x >= s.width || at.y >= s.height {
        let problem = format!("pixel {},{} is outside {} x {}", at.x, at.y, s.width, s.height);
        return Err(Error::setting("--debug-sample", problem, "name a pixel of the image; the first is 0,0"));
    }
    let camera = dunkelfeld::camera(&project.scene, s)?;
    let roulette = Session::new(s.threads)?.install(|| dunkelfeld::trace::train(&project.scene, &camera, s));
    let estimator = Estimator {
        scene: &project.scene,
        camera: &camera,
        width: s.width,
        seed: s.seed,
        frame: s.frame,
        roulette: roulette.as_ref(),
    };
    let (sample, trace) = estimator.trace(at);
    let origin = project.scene.world_origin();
    let mut text = String::new();
    for (i, v) in trace.vertices.iter().enumerate() {
        match v.material {
            Some(m) => {
                let [x, y, z] = [0, 1, 2].map(|k| f64::from(v.position[k]) + origin[k]);
                let name = project.scene.materials().get(m as usize).map_or("?", |m| m.name.as_str());
                let place = if v.in_medium { "inside " } else { "" };
                let _ = writeln!(text, "{i}: {place}\"{name}\" at {x:.6} {y:.6} {z:.6} m");
            }
            None => {
                let [x, y, z] = v.position;
                let _ = writeln!(text, "{i}: left the scene toward {x:.6} {y:.6} {z:.6}");
            }
        }
        let _ = writeln!(text, "   throughput {}", rgb(v.throughput));
        if !v.emitted.is_black() {
            let _ = writeln!(text, "   emitted    {}", rgb(v.emitted));
        }
        if !v.direct.is_black() {
            let _ = writeln!(text, "   direct     {}", rgb(v.direct));
        }
        for c in &v.connections {
            let _ = writeln!(text, "   connected  {}", connection(c));
        }
        if let Some(s) = v.scattered {
            let ([x, y, z], pdf, weight) = (s.direction, s.pdf, rgb(s.weight));
            let lobe = lobe(s.lobe);
            let _ =
                writeln!(text, "   scattered  toward {x:.6} {y:.6} {z:.6}, lobe {lobe}, pdf {pdf:e}, weight {weight}");
        }
    }
    let _ = writeln!(text, "radiance {} W/(m^2 sr)", rgb(sample.radiance));
    if !sample.is_valid() {
        text += "this sample is invalid: not finite, negative or out of range\n";
    }
    print(&text);
    Ok(if sample.is_valid() { Outcome::Done } else { Outcome::Flagged })
}

fn rgb(c: Rgb) -> String {
    format!("{:e} {:e} {:e}", c.r, c.g, c.b)
}

/// A connection through a cover: its chain of interfaces, the number of shots, and its contribution.
fn connection(c: &TraceConnection) -> String {
    let (chain, cover, p) = (c.chain, c.cover, c.probability);
    let shots = if c.rays == 1 { "1 shot".into() } else { format!("{} shots", c.rays) };
    let found = match (c.has_converged, c.mis_weight > 0.0) {
        (false, _) => "not found".into(),
        (true, false) => "no light comes through".into(),
        (true, true) => format!("share {}, adds {}", c.mis_weight, rgb(c.contribution)),
    };
    format!("{chain:?} through cover {cover}, sampled with probability {p}, {shots}, {found}")
}

/// The name of the lobe that a direction was drawn from.
fn lobe(lobe: Lobe) -> String {
    let words = [
        (Lobe::CLEARCOAT, "clearcoat"),
        (Lobe::DIFFUSE, "diffuse"),
        (Lobe::GLOSSY, "glossy"),
        (Lobe::DELTA, "delta"),
        (Lobe::REFLECTION, "reflection"),
        (Lobe::TRANSMISSION, "transmission"),
    ];
    let words: Vec<&str> = words.iter().filter(|(l, _)| lobe.contains(*l)).map(|(_, word)| *word).collect();
    if words.is_empty() { "phase function".into() } else { words.join(" ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lobes_are_named_by_what_they_are() {
        assert_eq!(lobe(Lobe::DELTA | Lobe::TRANSMISSION), "delta transmission");
        assert_eq!(lobe(Lobe::REFLECTION | Lobe::CLEARCOAT | Lobe::GLOSSY), "clearcoat glossy reflection");
        assert_eq!(lobe(Lobe::default()), "phase function");
    }
}
