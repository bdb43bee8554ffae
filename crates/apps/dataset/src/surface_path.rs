//! The surface that a pixel shows below its defects: what its ray meets if the defects are left out.

use dunkelfeld_film::Plane;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_integrator::{Crossing, Passage};

/// Smallest cosine between the normals of two pixels side by side on one smooth surface: 20 degrees.
const LEAST_COSINE: f32 = 0.94;

/// The surfaces of an image without those of defects.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surfaces<'a> {
    /// The surfaces of each pixel, with the objects that a defect has changed.
    pub(crate) all: &'a Plane<SurfacePath>,
    /// Of a pixel that shows a changed object: its instance, and the surfaces without it. `None` if no object has changed.
    pub(crate) below: Option<&'a Plane<(u16, SurfacePath)>>,
}

impl Surfaces<'_> {
    /// The surfaces of a pixel for an instance. A changed object is no part of its own surroundings, and is a surface like
    /// any other for all else.
    pub(crate) fn at(&self, index: usize, instance: u16) -> SurfacePath {
        match self.below.map(|below| below.data()[index]) {
            Some((changed, below)) if changed == instance => below,
            _ => self.all.data()[index],
        }
    }
}

/// The surfaces of a ray without those of defects.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SurfacePath {
    /// A hash of the objects and materials up to the first one that scatters, in their order. 0 without a surface.
    pub(crate) path: u32,
    /// Object and material of the first of them, hashed. 0 for none.
    pub(crate) first: u32,
    /// Unit normals of the first and the last of them, toward the ray.
    pub(crate) normals: [Vec3; 2],
    /// Is a defect in front that bends the ray? The path then differs from that without the defect.
    pub(crate) is_bent: bool,
    /// Is a defect in front that scatters? Only the first surface behind it is then known.
    pub(crate) is_covered: bool,
    /// Is the path at its end?
    pub(crate) is_decided: bool,
}

impl SurfacePath {
    /// Receives a surface of the ray, and whether it is that of a defect. Those that cover less than `least` of the light do not
    /// count.
    pub(crate) fn visit(&mut self, crossing: &Crossing, is_defect: bool, least: f32) {
        if self.is_decided {
            return;
        }
        if is_defect {
            self.is_bent |= crossing.passage == Passage::Clear && !self.is_covered;
            self.is_covered |= crossing.passage == Passage::Scattering && crossing.coverage >= 0.5;
            return;
        }
        if crossing.coverage < least {
            return;
        }
        let number =
            crossing.ids.object().wrapping_mul(0x9e37_79b1) ^ crossing.ids.material().wrapping_mul(0x85eb_ca77);
        let is_back = crossing.normal.dot(crossing.direction) > 0.0;
        self.normals[1] = if is_back { -crossing.normal } else { crossing.normal };
        if self.first == 0 {
            self.first = number | 1;
            self.normals[0] = self.normals[1];
        }
        // A product and an exclusive or for each surface: the order counts.
        self.path = (self.path ^ number).wrapping_mul(0x0100_0193) | 1;
        // Behind a surface that scatters, all surfaces are named as such.
        self.is_decided = crossing.passage == Passage::Scattering && (self.is_covered || crossing.coverage >= 0.5);
    }

    /// Does the smooth surface of this pixel go on in the pixel beside it?
    pub(crate) fn continues_in(&self, beside: &Self) -> bool {
        self.first == 0 || (0..2).all(|i| self.normals[i].dot(beside.normals[i]) >= LEAST_COSINE)
    }
}
