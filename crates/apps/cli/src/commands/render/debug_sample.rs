//! `render --debug-sample`: one sample, vertex by vertex.

use crate::outcome::{Outcome, print};
use dunkelfeld::trace::{PixelSample, TracedConnection, TracedSample};
use dunkelfeld::{Error, Project};
use std::fmt::Write;

pub(super) fn run(project: &Project, at: PixelSample) -> Result<Outcome, Error> {
    let sample = project.trace_sample(at).map_err(|e| match e {
        Error::Setting { problem, help, .. } => Error::setting("--debug-sample", problem, help),
        other => other,
    })?;
    print(&text_of(&sample));
    Ok(if sample.is_valid { Outcome::Done } else { Outcome::Flagged })
}

fn text_of(sample: &TracedSample) -> String {
    let mut text = String::new();
    for (i, v) in sample.vertices.iter().enumerate() {
        let place = if v.in_medium { "inside " } else { "" };
        // The vertex before it is the last one, unless the path was split.
        let from = v.before.filter(|before| before + 1 < i).map_or(String::new(), |before| format!("from {before}, "));
        if let (Some(name), Some([x, y, z])) = (&v.material, v.position) {
            let _ = writeln!(text, "{i}: {from}{place}\"{name}\" at {x:.6} {y:.6} {z:.6} m");
        }
        if let Some([x, y, z]) = v.left_toward {
            let _ = writeln!(text, "{i}: {from}left the scene toward {x:.6} {y:.6} {z:.6}");
        }
        let _ = writeln!(text, "   throughput {}", rgb(v.throughput));
        if v.emitted != [0.0; 3] {
            let _ = writeln!(text, "   emitted    {}", rgb(v.emitted));
        }
        if v.direct != [0.0; 3] {
            let _ = writeln!(text, "   direct     {}", rgb(v.direct));
        }
        for c in &v.connections {
            let _ = writeln!(text, "   connected  {}", connection(c));
        }
        if let Some(s) = &v.scattered {
            let ([x, y, z], lobe, pdf, weight) = (s.direction, &s.lobe, s.pdf, rgb(s.weight));
            let _ =
                writeln!(text, "   scattered  toward {x:.6} {y:.6} {z:.6}, lobe {lobe}, pdf {pdf:e}, weight {weight}");
        }
    }
    let _ = writeln!(text, "radiance {} W/(m^2 sr)", rgb(sample.radiance));
    if !sample.is_valid {
        text += "this sample is invalid: not finite, negative or out of range\n";
    }
    text
}

fn rgb([r, g, b]: [f32; 3]) -> String {
    format!("{r:e} {g:e} {b:e}")
}

/// A connection through a cover: its chain of interfaces, the number of shots, and its contribution.
fn connection(c: &TracedConnection) -> String {
    let (chain, cover, p) = (&c.chain, c.cover, c.probability);
    let shots = if c.rays == 1 { "1 shot".into() } else { format!("{} shots", c.rays) };
    let found = match (c.has_converged, c.mis_weight > 0.0) {
        (false, _) => "not found".into(),
        (true, false) => "no light comes through".into(),
        (true, true) => format!("share {}, adds {}", c.mis_weight, rgb(c.contribution)),
    };
    format!("{chain} through cover {cover}, sampled with probability {p}, {shots}, {found}")
}
