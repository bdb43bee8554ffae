//! Lens: the aperture and its shape, focus, vignetting, and the formulas of the thin lens.

use crate::camera::distortion::Distortion;
use dunkelfeld_lanes::{Double, Lanes, Real};
use dunkelfeld_sampling::warp::lanes::{sample_disk, sample_polygon};
use std::f64::consts::{PI, TAU};

/// A lens. The default is a pinhole: sharp everywhere, without distortion, equally bright over the film.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Lens {
    /// The aperture; `None` is infinitely small, and the image is sharp at all depths.
    pub aperture: Option<Aperture>,
    /// Distortion of the image; only for a perspective.
    pub distortion: Distortion,
    /// Where the optical axis meets the film, as an offset from its middle \[pixels\], to the right and down. For a
    /// film of W x H pixels it is OpenCV's (cx, cy) - (W - 1, H - 1) / 2.
    pub principal_point: [f64; 2],
    /// Darkening of the image toward its edge.
    pub vignetting: Vignetting,
    /// Width of a pixel over its height: OpenCV's fy / fx. 1 for square pixels.
    pub pixel_aspect: f64,
    /// A lens that blurs: a film keeps the places of samples, so that any blur can be applied to it, and they are spread by a box of
    /// this width \[pixels\] beyond their pixel (`dunkelfeld_film::MeanImage`).
    pub spread: Option<f32>,
}

impl Default for Lens {
    fn default() -> Self {
        Self {
            aperture: None,
            distortion: Distortion::NONE,
            principal_point: [0.0; 2],
            vignetting: Vignetting::None,
            pixel_aspect: 1.0,
            spread: None,
        }
    }
}

/// A finite aperture.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Aperture {
    /// Size of the aperture.
    pub opening: Opening,
    /// Distance along the optical axis from the camera's position to the plane in focus \[m\]. May be infinite for a
    /// perspective.
    pub focus_distance: f64,
    /// Straight blades that bound the aperture; `None` for a circle. A polygon has the area of the circle that it
    /// replaces, so that an f-number gives the same irradiance.
    pub blades: Option<Blades>,
}

/// Size of an aperture.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Opening {
    /// Radius \[m\] of the pupil of a perspective camera, f / (2 N).
    Radius(f64),
    /// Numerical aperture sin(theta) on the object's side (in air) of a telecentric lens: a camera with parallel chief
    /// rays.
    NumericalAperture(f64),
}

/// A regular polygon of straight aperture blades.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Blades {
    /// Number of blades, 3 or more.
    pub count: u32,
    /// Angle \[rad\] of the first corner from the camera's right, toward up.
    pub rotation: f64,
}

/// Darkening of the image of an evenly bright scene away from the optical axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize)]
pub enum Vignetting {
    /// No darkening.
    #[default]
    None,
    /// With the fourth power of the cosine of the angle between chief ray and axis (the natural vignetting of a thin
    /// lens; Kolb, Mitchell & Hanrahan 1995). The axis keeps its brightness; a telecentric lens has none.
    CosineFourth,
}

impl Vignetting {
    /// The name on the command line and in job files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::CosineFourth => "cos4",
        }
    }
}

impl Aperture {
    /// A point of the aperture for two uniform numbers, uniform by area: in metres on the pupil of a perspective, in
    /// direction sines for a telecentric lens, to the right and up.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> [f64; 2] {
        self.sample_lanes(u)
    }

    /// [`Self::sample`] for two numbers per lane.
    #[inline(always)]
    pub(crate) fn sample_lanes<F: Lanes>(&self, u: [F; 2]) -> [F::Double; 2] {
        let (Opening::Radius(size) | Opening::NumericalAperture(size)) = self.opening;
        let (size, [x, y]) = match self.blades {
            None => (size, sample_disk(u)),
            Some(blades) => (size * blades.corner(), sample_polygon(u, blades.count, blades.rotation as f32)),
        };
        [F::Double::widen(x) * size, F::Double::widen(y) * size]
    }
}

impl Blades {
    /// Distance of the corners from the middle, where a circle of the same area has radius one.
    #[inline]
    pub fn corner(&self) -> f64 {
        let n = f64::from(self.count);
        let (_, sin) = f64::cos_sin(TAU / n);
        (TAU / (n * sin)).sqrt()
    }

    /// Share of the circle through the corners that the polygon fills.
    pub fn fill(&self) -> f64 {
        let n = f64::from(self.count);
        n * (TAU / n).sin() / (2.0 * PI)
    }
}

/// A thin lens focused on a plane: 1/f = 1/u + 1/v with focal length f, object distance u and image distance v.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinLens {
    /// Focal length f \[m\], above 0.
    pub focal_length: f64,
    /// f-number N: the pupil's diameter is f / N.
    pub f_number: f64,
    /// Distance u from the lens to the plane in focus \[m\], above f; may be infinite.
    pub focus_distance: f64,
}

impl ThinLens {
    /// The lens that is focused at `focus_distance` if its film is at `image_distance` \[m\].
    pub fn from_image_distance(image_distance: f64, f_number: f64, focus_distance: f64) -> Self {
        // Written with the quotient, so that an infinite focus distance gives f = v.
        Self { focal_length: image_distance / (1.0 + image_distance / focus_distance), f_number, focus_distance }
    }

    /// Magnification m = f / (u - f), image size over object size in the plane in focus.
    pub fn magnification(&self) -> f64 {
        self.focal_length / (self.focus_distance - self.focal_length)
    }

    /// Distance from the lens to its film \[m\], v = f (1 + m).
    pub fn image_distance(&self) -> f64 {
        self.focal_length * (1.0 + self.magnification())
    }

    /// Radius of the pupil \[m\], f / (2 N).
    pub fn aperture_radius(&self) -> f64 {
        0.5 * self.focal_length / self.f_number
    }

    /// Full field angle \[rad\] of a film of the given height \[m\] around the axis.
    pub fn field_of_view(&self, film_height: f64) -> f64 {
        2.0 * (0.5 * film_height / self.image_distance()).atan()
    }
}

/// f-number of the telecentric lens of the given numerical aperture on the object's side, in the sense in which
/// E = pi L tau / (4 N^2 (1 + m)^2): the image's side has the numerical aperture NA / m = 1 / (2 N (1 + m)).
pub fn telecentric_f_number(numerical_aperture: f64, magnification: f64) -> f64 {
    magnification / (2.0 * numerical_aperture * (1.0 + magnification))
}

/// Numerical aperture on the object's side of a telecentric lens; the inverse of [`telecentric_f_number`].
pub fn telecentric_aperture(f_number: f64, magnification: f64) -> f64 {
    magnification / (2.0 * f_number * (1.0 + magnification))
}
