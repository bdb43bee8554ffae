//! Visible defects that are added to the description of a scene before it is compiled.
//!
//! A defect is geometry with a material. It takes part in light transport like all other objects. No image is painted
//! afterwards.
//!
//! | kind | length | width | depth | made of |
//! |---|---|---|---|---|
//! | scratch | along the curve | across, in its middle | of the groove | opaque body: a strip with two ridges of the height `depth`; clear solid: a groove of air |
//! | dent | diameter | not used | in its middle | opaque body: a hollow, or with small slopes a round patch with its shading normals; clear solid: a hollow of air |
//! | stain | largest extent, to 20 % | not used | not used | a patch with partial coverage |
//! | dust | largest extent | not used | not used | an irregular particle on the surface |
//! | fibre | along the curve | thickness | not used | a curved tube on the surface |
//! | bubble | diameter | not used | not used | a sphere of gas in a clear solid |
//! | inclusion | largest extent | not used | not used | an irregular opaque particle in a clear solid |
//! | missing | not used | not used | not used | the object, with a coverage of zero |
//! | faded | not used | not used | not used | the object, with a coverage of `1 - strength` |
//! | shifted | distance | not used | not used | the object, moved along its largest side |
//!
//! Lengths are metres in the world. Angles are radians. A defect on a body that moves has the motion of the body.

mod change;
mod cut;
mod draw;
mod host;
mod material;
mod particle;
mod patch;
mod place;
mod round;
mod scratch;
mod shell;
mod site;
mod spec;
mod surface;
#[cfg(test)]
mod tests;
mod tree;
mod volume;
mod walk;

pub(crate) use host::has_surface;
pub(crate) use spec::{DefectKind, DefectProblem, DefectSpec, PlacedDefect};

use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Pcg;
use dunkelfeld_scene::SceneBuilder;

/// Adds a defect to a scene. The result depends only on scene, description and stream.
///
/// # Errors
/// If a number is out of its range, if no object or no surface fits, or if the defect finds no room.
pub(crate) fn add_defect(
    scene: &mut SceneBuilder,
    spec: &DefectSpec,
    stream: &mut Pcg,
) -> Result<PlacedDefect, DefectProblem> {
    check_numbers(spec)?;
    let help = "name at least one object of the scene";
    fits("on", !spec.on.is_empty(), "the defect has no candidates", help)?;
    fits("on", spec.on.iter().all(|i| *i < scene.instances.len()), "a candidate is no object of the scene", help)?;
    match spec.kind {
        DefectKind::Scratch | DefectKind::Dent | DefectKind::Stain | DefectKind::Dust | DefectKind::Fibre => {
            place::on_surface(scene, spec, stream)
        }
        DefectKind::Bubble | DefectKind::Inclusion => volume::inside(scene, spec, stream),
        DefectKind::Missing | DefectKind::Faded | DefectKind::Shifted => change::change(scene, spec, stream),
    }
}

/// Smallest size \[m\]. Smaller bodies lose their shape in f32.
pub(crate) const SMALLEST: f64 = 1e-9;

/// Checks the numbers that the kind uses.
///
/// # Errors
/// A number out of its range, at its key.
pub(crate) fn check_numbers(spec: &DefectSpec) -> Result<(), DefectProblem> {
    use DefectKind::{Dent, Faded, Fibre, Missing, Scratch, Stain};
    let kind = spec.kind;
    let size = |name: &'static str, value: f64| {
        let problem = format!("the {name} of the defect is {value} m");
        let is_size = value >= SMALLEST && value.is_finite();
        if is_size { Ok(()) } else { Err(DefectProblem::new(problem, "give a size above 0, at least 1 nm").at(name)) }
    };
    if !matches!(kind, Missing | Faded) {
        size("length", spec.length)?;
    }
    if matches!(kind, Scratch | Fibre) {
        size("width", spec.width)?;
        fits("width", spec.width <= spec.length, "the defect is wider than long", "exchange `length` and `width`")?;
        fits("curvature", spec.curvature.is_finite(), "the curvature is not finite", "give an angle")?;
    }
    if matches!(kind, Scratch | Dent) {
        size("depth", spec.depth)?;
    }
    if kind == Scratch {
        let help = "give at most half of the width, which is a slope of 69 degrees";
        fits("depth", spec.depth <= 0.5 * spec.width, "the scratch is too deep for its width", help)?;
    }
    if kind == Dent {
        let help = "give at most a quarter of the diameter, which is a slope of 38 degrees";
        fits("depth", spec.depth <= 0.25 * spec.length, "the dent is too deep for its diameter", help)?;
    }
    if matches!(kind, Stain | Faded) {
        fits(
            "strength",
            (0.0..=1.0).contains(&spec.strength),
            "the strength is out of its range",
            "give a number from 0 to 1",
        )?;
    }
    let share = |v: Option<f64>| v.is_none_or(|v| (0.0..=1.0).contains(&v));
    fits("angle", spec.angle.is_none_or(f64::is_finite), "the angle is not finite", "give an angle, or leave it out")?;
    fits("roughness", share(spec.roughness), "the roughness is out of its range", "give a number from 0 to 1")?;
    fits("metallic", share(spec.metallic), "the metallic value is out of its range", "give a number from 0 to 1")?;
    let is_color = |c: Rgb| c.to_array().iter().all(|v| (0.0..=1.0).contains(v));
    fits("color", spec.color.is_none_or(is_color), "the colour is out of its range", "give numbers from 0 to 1")?;
    let has_direction = spec.facing.is_none_or(|f| f.is_finite() && f.try_normalize().is_some());
    fits(
        "facing",
        has_direction,
        "the direction that the surface must face has no length",
        "give a vector other than 0",
    )
}

fn fits(key: &'static str, condition: bool, problem: &str, help: &'static str) -> Result<(), DefectProblem> {
    if condition { Ok(()) } else { Err(DefectProblem::new(problem, help).at(key)) }
}
