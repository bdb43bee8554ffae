//! Visible defects that are added to the description of a scene before it is compiled.
//!
//! A defect is geometry with a material. It takes part in light transport like all other objects. No image is painted
//! afterwards.
//!
//! | kind | length | width | depth | made of |
//! |---|---|---|---|---|
//! | scratch | along the curve | across, in its middle | of the groove | opaque body: a strip with two ridges of the height `depth`, or a groove with burrs in its mesh; clear solid: a groove of air |
//! | dent | diameter | not used | in its middle | opaque body: a hollow, or with small slopes a round patch with its shading normals; clear solid: a hollow of air |
//! | pore | diameter | not used | in its middle | opaque body: a pit in its mesh |
//! | chip | along the edge | not used | below the edge | opaque body: a part of its edge is gone |
//! | chatter | diameter | not used | from crest to valley | opaque body: waves in its mesh |
//! | cold_shut | along the curve | across | of the groove | opaque body: a groove in its mesh |
//! | stain | largest extent, to 20 % | not used | not used | a patch with partial coverage |
//! | decal | of a row of the picture | not used | not used | a patch with the picture as texture |
//! | dust | largest extent | not used | not used | an irregular particle on the surface |
//! | fibre | along the curve | thickness | not used | a curved tube on the surface |
//! | bubble | diameter | not used | not used | a sphere of gas in a clear solid |
//! | inclusion | largest extent | not used | not used | an irregular opaque particle in a clear solid |
//! | missing | not used | not used | not used | the object, with a coverage of zero |
//! | faded | not used | not used | not used | the object, with a coverage of `1 - strength` |
//! | shifted | distance | not used | not used | the object, moved along its largest side |
//!
//! Lengths are metres in the world. Angles are radians. A defect on a body that moves has the motion of the body.

mod carve;
mod change;
mod decal;
mod draw;
mod host;
mod material;
mod particle;
mod patch;
mod pieces;
mod place;
mod round;
mod scratch;
mod shapes;
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
pub(crate) use spec::{Defect, DefectSpec, PlacedDefect};

use crate::distribution::Fault;
use dunkelfeld_sampling::Pcg;
use dunkelfeld_scene::SceneBuilder;

/// Adds a defect to a scene. The result depends only on scene, description and stream.
///
/// # Errors
/// If sizes do not fit each other, if no object or no surface fits, or if the defect finds no room.
pub(crate) fn add_defect(scene: &mut SceneBuilder, spec: &DefectSpec, stream: &mut Pcg) -> Result<PlacedDefect, Fault> {
    spec.defect.check()?;
    match &spec.defect {
        Defect::Bubble(_) | Defect::Inclusion(_) => volume::inside(scene, spec, stream),
        Defect::Missing(_) | Defect::Faded(_) | Defect::Shifted(_) => change::change(scene, spec, stream),
        _ => place::on_surface(scene, spec, stream),
    }
}
