//! Instructions for effects that the plain scene does not use.
//!
//! The sums prove that the stages of these effects get no paths, and that the tests for them are cheap. They do not contain
//! numbers that shared code computes for effects without a test (such as the factor of refraction in roulette), nor
//! library code that is inlined into these lines, because it has lines of its own.

use super::callgrind::Lines;

/// Code for effects only: files, folders, and functions in shared files (none: all).
pub(crate) const EFFECTS: [(&str, &[&str]); 36] = [
    ("bsdf/src/bsdf.rs", &[]),
    ("bsdf/src/clearcoat.rs", &[]),
    ("bsdf/src/compensation.rs", &[]),
    ("bsdf/src/dielectric.rs", &[]),
    ("bsdf/src/phase.rs", &[]),
    ("bsdf/src/principled.rs", &["gains"]),
    ("bsdf/src/sheen.rs", &[]),
    ("bsdf/src/thin.rs", &[]),
    ("bsdf/src/translucent.rs", &[]),
    ("bsdf/src/transmission.rs", &[]),
    ("integrator/src/learned_roulette", &[]),
    ("integrator/src/mnee", &[]),
    ("integrator/src/path.rs", &["weight_behind_covers", "sample_presence", "pass"]),
    ("integrator/src/ray_state.rs", &[]),
    ("integrator/src/wavefront/attempts.rs", &[]),
    ("integrator/src/wavefront/connect.rs", &[]),
    ("integrator/src/wavefront/escape.rs", &[]),
    ("integrator/src/wavefront/group.rs", &["points", "enclosing_beyond", "lit_lanes"]),
    ("integrator/src/wavefront/media.rs", &[]),
    ("integrator/src/wavefront/mod.rs", &["arrive"]),
    ("integrator/src/wavefront/scatter.rs", &["enter_solids", "evaluate_each"]),
    ("scene/src/camera/distortion.rs", &[]),
    ("scene/src/camera/lens.rs", &[]),
    ("scene/src/camera/mod.rs", &["through_lens"]),
    ("scene/src/camera/shutter.rs", &[]),
    ("scene/src/covers", &[]),
    ("scene/src/light/delta.rs", &[]),
    ("scene/src/light/emission_profile.rs", &[]),
    ("scene/src/light/environment.rs", &[]),
    ("scene/src/light/luminaire.rs", &[]),
    ("scene/src/light/sun.rs", &[]),
    ("scene/src/light/tree.rs", &[]),
    ("scene/src/material", &[]),
    ("scene/src/media", &[]),
    ("scene/src/query/shading.rs", &["shading_normals", "tangent_frame", "bsdf_at", "each_bsdf", "radiance_at"]),
    ("scene/src/query/surface_points.rs", &["each_pose", "pose", "from_lanes"]),
];

/// A line of other code with one of these words tests for an effect. All of its instructions are counted.
const TESTS: &str = "covers() darkens has_aperture has_chance has_coverage has_environment has_solids in_medium is_bent \
    is_delta is_own is_placed is_plain is_rich is_see_through is_smooth is_solid moves needs_tangent shutter undistorter \
    varying";

/// The part of a line of code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Shared,
    Effect,
    Test,
}

/// True if a line, or some line of a text, begins a function.
pub(crate) fn begins(line: &str, name: &str) -> bool {
    ["(", "<"].iter().any(|open| line.contains(&format!("fn {name}{open}")))
}

/// The parts of the lines of a file.
pub(crate) fn parts(file: &str, text: &str) -> Vec<Part> {
    let listed = || EFFECTS.iter().filter(|(path, _)| file.contains(path));
    let mut end = None;
    let part = |line: &str| {
        if end.is_none() && listed().any(|(_, functions)| functions.iter().any(|name| begins(line, name))) {
            end = Some(format!("{}}}", &line[..line.len() - line.trim_start().len()]));
        }
        let is_effect = end.is_some() || listed().any(|(_, functions)| functions.is_empty());
        end.take_if(|end| end == line);
        match is_effect {
            true => Part::Effect,
            false if TESTS.split_whitespace().any(|word| line.contains(word)) => Part::Test,
            false => Part::Shared,
        }
    };
    text.lines().map(part).collect()
}

/// The instructions in lines of each [`Part`], and those whose line is not one of the program. `source` is the text of a
/// file.
pub(crate) fn sums(lines: &Lines<f64>, source: impl Fn(&str) -> Option<String>) -> [f64; 4] {
    let (mut sums, mut open) = ([0.0; 4], (String::new(), Vec::new()));
    for ((file, line), cost) in lines {
        if open.0 != *file {
            open = (file.clone(), source(file).map_or_else(Vec::new, |text| parts(file, &text)));
        }
        // Line 0 is an unknown line of the file. The first line is a comment, of code for effects if all of the file is.
        let part = open.1.get((*line as usize).max(1) - 1);
        sums[part.map_or(3, |part| *part as usize)] += cost;
    }
    sums
}
