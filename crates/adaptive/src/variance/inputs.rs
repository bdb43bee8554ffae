//! What the samples taken so far tell of every pixel: planes that a film is turned into before anything is decided.
//!
//! Values are in any one linear unit: photo-electrons behind a sensor, luminance without one.

use dunkelfeld_film::{Plane, Scatter};

/// Neighbours whose normals differ by more than this cosine (26 degrees) lie on different surfaces.
const SIMILAR: f32 = 0.9;

/// What a pixel shows, as far as noise is concerned: pixels of one kind have similar noise.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelFeatures {
    /// Number of the object in the pixel's centre; any number of its own where there is none.
    pub object: u32,
    /// Normal of the surface, of length one; zero where there is none.
    pub normal: [f32; 3],
    /// Does one of the eight pixels around show another object, or a surface turned another way? Such pixels hold an edge,
    /// and an edge has noise of its own.
    pub border: bool,
}

impl PixelFeatures {
    /// May the noise of one pixel speak for the other? The same object, borders with borders, and elsewhere a similar normal
    /// (in a border pixel it is a mixture, which says nothing).
    #[inline]
    pub fn is_like(&self, other: &Self) -> bool {
        self.object == other.object
            && self.border == other.border
            && (self.border || similar(&self.normal, &other.normal))
    }

    /// The same object with a similar normal, at a border or not.
    #[inline]
    pub fn is_turned_like(&self, other: &Self) -> bool {
        self.object == other.object && similar(&self.normal, &other.normal)
    }
}

/// How bright a pixel is, as far as noise is concerned: the variance that a sensor has of its own there, between bounds that
/// the pixel's own noise leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorVarianceRange {
    /// Least variance [unit^2].
    pub least: f32,
    /// Largest variance [unit^2].
    pub most: f32,
}

impl SensorVarianceRange {
    /// A pixel that may be as bright as any.
    pub const ANY: Self = Self { least: 0.0, most: f32::INFINITY };

    /// May the noise of one pixel speak for the other? Not if the sensor's variances differ by more than a factor of two, whatever
    /// lies between the bounds: beside a highlight the noise of a dark pixel is not the highlight's.
    #[inline]
    pub fn is_like(&self, other: &Self) -> bool {
        self.least <= 2.0 * other.most && other.least <= 2.0 * self.most
    }
}

#[inline]
fn similar(a: &[f32; 3], b: &[f32; 3]) -> bool {
    let dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    // Two surfaces without a normal are alike too.
    dot >= SIMILAR || (*a == [0.0; 3] && *b == [0.0; 3])
}

/// The surfaces of an image, from its objects and mean normals (of any length; what is shorter than 1e-3 counts as none).
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

/// The pixels of the square of `2 reach + 1` pixels around (x, y) that lie in the image, itself included.
pub(crate) fn around(x: u32, y: u32, reach: u32, width: u32, height: u32) -> impl Iterator<Item = (u32, u32)> {
    let columns = x.saturating_sub(reach)..(x.saturating_add(reach).saturating_add(1)).min(width);
    let rows = y.saturating_sub(reach)..(y.saturating_add(reach).saturating_add(1)).min(height);
    rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
}

/// Everything that is known of the pixels. All planes have the same size.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseInputs {
    /// Samples per pixel.
    pub counts: Plane<u32>,
    /// Mean of the samples.
    pub mean: Plane<f32>,
    /// Estimated variance of that mean, from the spread of the film's batches; infinite where nothing is known.
    pub variance: Plane<f32>,
    /// How the pixel's samples scatter [unit^2], as of independent samples; `None` where that is not known.
    pub scatter: Plane<Option<Scatter>>,
    /// The largest sample.
    pub largest: Plane<f32>,
    /// What the pixel shows.
    pub surface: Plane<PixelFeatures>,
    /// How bright it is.
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

    /// Do all planes have one size?
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
    fn nothing_is_like_nothing_and_odd_normals_are_none() {
        let normals = Plane::from_vec(3, 1, vec![[0.0; 3], [f32::NAN, 0.0, 0.0], [1e-9, 0.0, 0.0]]).expect("three");
        let surface = pixel_features(&Plane::new(3, 1, 7), &normals);
        assert!(surface.data().iter().all(|s| *s == PixelFeatures { object: 7, ..PixelFeatures::default() }));
        assert!(surface.at(0, 0).is_like(surface.at(2, 0)));
        assert!(pixel_features(&Plane::new(0, 0, 0), &Plane::new(0, 0, [0.0; 3])).data().is_empty());
    }

    #[test]
    fn levels_are_alike_up_to_a_factor_of_two_between_their_bounds() {
        let level = |least, most| SensorVarianceRange { least, most };
        let dark = level(10.0, 12.0);
        assert!(dark.is_like(&dark) && dark.is_like(&level(24.0, 30.0)) && level(24.0, 30.0).is_like(&dark));
        assert!(!dark.is_like(&level(24.5, 30.0)) && !level(24.5, 30.0).is_like(&dark));
        assert!(dark.is_like(&level(5.0, 1e6)), "it may be as dark");
        // Saturated pixels speak for each other alone.
        let full = level(f32::INFINITY, f32::INFINITY);
        assert!(full.is_like(&full) && !full.is_like(&dark) && !dark.is_like(&full));
        assert!(
            SensorVarianceRange::ANY.is_like(&dark)
                && SensorVarianceRange::ANY.is_like(&full)
                && full.is_like(&SensorVarianceRange::ANY)
        );
    }

    #[test]
    fn neighbourhoods_end_at_the_image() {
        assert_eq!(around(0, 0, 1, 3, 3).count(), 4);
        assert_eq!(around(1, 1, 1, 3, 3).count(), 9);
        assert_eq!(around(2, 0, 7, 3, 1).count(), 3);
    }
}
