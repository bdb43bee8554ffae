//! Statistics of the samples of every pixel. They are planes, computed from a film before any decision.
//!
//! Values are in any one linear unit: photo-electrons with a sensor, luminance without one.

use dunkelfeld_film::{Plane, Scatter};

/// Pixels lie on different surfaces if the cosine between their normals is below this (26 degrees).
pub(crate) const SIMILAR: f32 = 0.9;

/// The surface properties of a pixel that affect its noise: pixels with similar features have similar noise.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelFeatures {
    /// Id of the object at the centre of the pixel. Any id of its own if there is no object.
    pub object: u32,
    /// Unit normal of the surface. Zero if there is none.
    pub normal: [f32; 3],
    /// One of the eight adjacent pixels shows another object, or a surface with another normal. Such a pixel contains
    /// an edge, and edges have other noise than surfaces.
    pub border: bool,
}

impl PixelFeatures {
    /// Returns whether two pixels may share their variance estimates. They need the same object. Border pixels match
    /// border pixels. Other pixels need a similar normal too (in a border pixel the normal is a mixture without
    /// meaning).
    #[inline]
    pub fn is_like(&self, other: &Self) -> bool {
        self.object == other.object
            && self.border == other.border
            && (self.border || similar(&self.normal, &other.normal))
    }
}

/// The range of the sensor variance of a pixel. Its bounds follow from the render noise of the pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorVarianceRange {
    /// Least variance [unit^2].
    pub least: f32,
    /// Largest variance [unit^2].
    pub most: f32,
}

impl SensorVarianceRange {
    /// The range of a pixel of unknown brightness.
    pub const ANY: Self = Self { least: 0.0, most: f32::INFINITY };

    /// Returns whether two pixels may share their variance estimates. They may not if their sensor variances differ by
    /// more than a factor of two, for all values within the bounds. The noise of a dark pixel beside a highlight is not
    /// that of the highlight.
    #[inline]
    pub fn is_like(&self, other: &Self) -> bool {
        self.least <= 2.0 * other.most && other.least <= 2.0 * self.most
    }
}

#[inline]
fn similar(a: &[f32; 3], b: &[f32; 3]) -> bool {
    let dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    // Two surfaces without a normal are similar too.
    dot >= SIMILAR || (*a == [0.0; 3] && *b == [0.0; 3])
}

/// The features of the pixels of an image, from its objects and mean normals (of any length; a length below 1e-3 counts
/// as no normal).
///
/// # Panics
/// If the planes differ in size.
pub fn pixel_features(objects: &Plane<u32>, normals: &Plane<[f32; 3]>) -> Plane<PixelFeatures> {
    let (width, height) = (objects.width(), objects.height());
    assert_eq!((width, height), (normals.width(), normals.height()), "objects and normals differ in size");
    let unit = normals.map(|&[x, y, z]| {
        let length = (x * x + y * y + z * z).sqrt();
        if length > 1e-3 && length.is_finite() { [x / length, y / length, z / length] } else { [0.0; 3] }
    });
    Plane::from_fn(width, height, |x, y| {
        let (object, normal) = (*objects.at(x, y), *unit.at(x, y));
        let border = around(x, y, 1, width, height)
            .any(|(nx, ny)| *objects.at(nx, ny) != object || !similar(unit.at(nx, ny), &normal));
        PixelFeatures { object, normal, border }
    })
}

/// The pixels of the square of `2 reach + 1` pixels around (x, y) that lie in the image, including (x, y).
pub(crate) fn around(x: u32, y: u32, reach: u32, width: u32, height: u32) -> impl Iterator<Item = (u32, u32)> {
    let columns = x.saturating_sub(reach)..(x.saturating_add(reach).saturating_add(1)).min(width);
    let rows = y.saturating_sub(reach)..(y.saturating_add(reach).saturating_add(1)).min(height);
    rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
}

/// Statistics of all pixels. All planes have the same size.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseInputs {
    /// Samples per pixel.
    pub counts: Plane<u32>,
    /// Mean of the samples.
    pub mean: Plane<f32>,
    /// Estimated variance of that mean, from the spread of the film's batches. Infinite if it is unknown.
    pub variance: Plane<f32>,
    /// Scatter of the samples of the pixel [unit^2], as of independent samples. `None` if it is unknown.
    pub scatter: Plane<Option<Scatter>>,
    /// The largest sample.
    pub largest: Plane<f32>,
    /// Surface features of the pixel.
    pub surface: Plane<PixelFeatures>,
    /// Range of the sensor variance of the pixel.
    pub level: Plane<SensorVarianceRange>,
}

impl NoiseInputs {
    /// Width of the image.
    pub fn width(&self) -> u32 {
        self.counts.width()
    }

    /// Height of the image.
    pub fn height(&self) -> u32 {
        self.counts.height()
    }

    /// Returns whether all planes have one size.
    pub fn is_consistent(&self) -> bool {
        let size = (self.width(), self.height());
        [
            (self.mean.width(), self.mean.height()),
            (self.variance.width(), self.variance.height()),
            (self.scatter.width(), self.scatter.height()),
            (self.largest.width(), self.largest.height()),
            (self.surface.width(), self.surface.height()),
            (self.level.width(), self.level.height()),
        ]
        .into_iter()
        .all(|other| other == size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_are_where_objects_or_normals_change() {
        let objects = Plane::from_fn(9, 5, |x, _| u32::from(x >= 3));
        // Object 1 has a kink at x = 6.
        let normals = Plane::from_fn(9, 5, |x, _| if x >= 6 { [0.0, 2.0, 0.0] } else { [0.0, 0.0, 0.5] });
        let surface = pixel_features(&objects, &normals);
        let borders: Vec<bool> = (0..9).map(|x| surface.at(x, 2).border).collect();
        assert_eq!(borders, [false, false, true, true, false, true, true, false, false]);
        assert_eq!(surface.at(8, 0).normal, [0.0, 1.0, 0.0]);
        assert!(surface.at(4, 0).is_like(surface.at(4, 4)));
        assert!(!surface.at(4, 0).is_like(surface.at(8, 0)), "turned another way");
        assert!(!surface.at(4, 0).is_like(surface.at(3, 0)), "a border");
        assert!(surface.at(3, 0).is_like(surface.at(6, 0)), "borders of one object");
        assert!(!surface.at(2, 0).is_like(surface.at(3, 0)), "borders of two");
    }

    #[test]
    fn levels_are_similar_up_to_a_factor_of_two() {
        let level = |least, most| SensorVarianceRange { least, most };
        let dark = level(10.0, 12.0);
        assert!(dark.is_like(&dark) && dark.is_like(&level(24.0, 30.0)) && level(24.0, 30.0).is_like(&dark));
        assert!(!dark.is_like(&level(24.5, 30.0)) && !level(24.5, 30.0).is_like(&dark));
        assert!(dark.is_like(&level(5.0, 1e6)), "it may be as dark");
        // Saturated pixels match saturated pixels only.
        let full = level(f32::INFINITY, f32::INFINITY);
        assert!(full.is_like(&full) && !full.is_like(&dark) && !dark.is_like(&full));
        assert!(
            SensorVarianceRange::ANY.is_like(&dark)
                && SensorVarianceRange::ANY.is_like(&full)
                && full.is_like(&SensorVarianceRange::ANY)
        );
    }
}
