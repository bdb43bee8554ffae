//! The part of the sensor that a job reads: whole, region of interest, binning.

use dunkelfeld_io::InputError;
use dunkelfeld_io::job::FilmSettings;
use dunkelfeld_render::{RenderSettings, SensorChoice};
use dunkelfeld_scene::FilmWindow;

/// The whole film of a job, and the part of it that is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FilmPart {
    /// Width and height of the whole film \[pixels\].
    pub(crate) whole: [u32; 2],
    /// Left, top, width and height of the rendered part, in pixels of the whole film.
    region: [u32; 4],
    /// Side of the squares of pixels that are read as one.
    pub(crate) binning: u32,
}

impl FilmPart {
    /// The part that a job describes, for the sensor of the settings.
    ///
    /// # Errors
    /// A sensor without a resolution, a region outside the film, pixels that do not fit a colour sensor.
    pub(crate) fn new(film: &FilmSettings, sensor: &SensorChoice) -> Result<Self, InputError> {
        let spec = match sensor {
            SensorChoice::Emva { model, .. } => Some(model.spec()),
            SensorChoice::None => None,
        };
        let whole = match (film.full, spec) {
            (true, Some(spec)) => spec.resolution.ok_or_else(|| {
                let problem = format!("the resolution of the sensor \"{}\" is unknown", spec.name);
                let help = "write `width` and `height` instead, or `resolution = [columns, rows]` in a sensor file";
                InputError::of_key("full", problem, help)
            })?,
            _ => {
                let usual = RenderSettings::without_sensor();
                [film.width.unwrap_or(usual.width), film.height.unwrap_or(usual.height)]
            }
        };
        let region @ [left, top, width, height] = film.roi.unwrap_or([0, 0, whole[0], whole[1]]);
        if left.saturating_add(width) > whole[0] || top.saturating_add(height) > whole[1] {
            let problem = format!("the region ends at {}, {}", left.saturating_add(width), top.saturating_add(height));
            let help = format!("the film has {} x {} pixels; write [left, top, width, height]", whole[0], whole[1]);
            return Err(InputError::of_key("roi", problem, help));
        }
        let binning = film.binning.unwrap_or(1);
        if width < binning || height < binning {
            let problem = format!("the film of {width} x {height} pixels is smaller than a square of binned pixels");
            return Err(InputError::of_key("binning", problem, "write a smaller number, or a larger region"));
        }
        if spec.is_some_and(|s| s.quantum_efficiency.filter().is_some()) {
            if binning > 1 {
                let problem = "the pixels of a colour sensor have different colours, and binning adds their charges";
                return Err(InputError::of_key("binning", problem, "remove it, or choose a monochrome sensor"));
            }
            if left % 2 == 1 || top % 2 == 1 {
                let problem = "the region begins inside a square of the colour filter";
                return Err(InputError::of_key("roi", problem, "write even numbers for its left and top edge"));
            }
        }
        Ok(Self { whole, region, binning })
    }

    /// Width and height of the rendered film \[pixels\]. Rows and columns that fill no square of binned pixels are left
    /// out at the bottom and on the right.
    pub(crate) fn size(&self) -> [u32; 2] {
        let [_, _, width, height] = self.region;
        [width / self.binning, height / self.binning]
    }

    /// The window of the whole film for a rendered film of `width * height` pixels; `None` if that is the whole film.
    ///
    /// A film of another size than [`Self::size`] has the same vertical field, around the same middle.
    pub(crate) fn window(&self, width: u32, height: u32) -> Option<FilmWindow> {
        let [usual_width, usual_height] = self.size().map(f64::from);
        let corner = [f64::from(self.region[0]), f64::from(self.region[1])];
        let side = f64::from(self.binning);
        let window = if [width, height] == self.size() {
            FilmWindow { full: self.whole, origin: corner, step: side }
        } else {
            let step = side * usual_height / f64::from(height);
            let left = corner[0] + 0.5 * (side * usual_width - step * f64::from(width));
            FilmWindow { full: self.whole, origin: [left, corner[1]], step }
        };
        let is_whole = window.origin == [0.0; 2] && window.step == 1.0 && [width, height] == self.whole;
        (!is_whole).then_some(window)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(film: FilmSettings) -> Result<FilmPart, InputError> {
        FilmPart::new(&film, &SensorChoice::None)
    }

    fn film() -> FilmSettings {
        FilmSettings { width: Some(641), height: Some(480), ..FilmSettings::default() }
    }

    #[test]
    fn regions_and_binned_pixels_are_windows_of_the_whole_film() {
        let whole = part(film()).expect("a film");
        assert_eq!((whole.size(), whole.window(641, 480)), ([641, 480], None));
        let binned = part(FilmSettings { binning: Some(2), ..film() }).expect("a film");
        let window = FilmWindow { full: [641, 480], origin: [0.0; 2], step: 2.0 };
        assert_eq!((binned.size(), binned.window(320, 240)), ([320, 240], Some(window)), "the last column is left out");
        let region = part(FilmSettings { roi: Some([100, 50, 64, 32]), ..film() }).expect("a film");
        let window = FilmWindow { full: [641, 480], origin: [100.0, 50.0], step: 1.0 };
        assert_eq!((region.size(), region.window(64, 32)), ([64, 32], Some(window)));
        // A preview with a quarter of the pixels, and one with another aspect: the same rows of the whole film.
        assert_eq!(region.window(32, 16), Some(FilmWindow { step: 2.0, ..window }));
        assert_eq!(region.window(48, 16), Some(FilmWindow { step: 2.0, origin: [84.0, 50.0], ..window }));
    }

    #[test]
    fn parts_that_the_film_does_not_have_are_refused() {
        for (key, change) in [
            ("roi", FilmSettings { roi: Some([600, 0, 42, 1]), ..film() }),
            ("roi", FilmSettings { roi: Some([0, 480, 1, 1]), ..film() }),
            ("binning", FilmSettings { roi: Some([0, 0, 1, 9]), binning: Some(2), ..film() }),
        ] {
            assert_eq!(part(change.clone()).expect_err("no such part").place, key, "{change:?}");
        }
    }
}
