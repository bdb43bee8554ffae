//! Conversion of expected electrons to grey values: frames of one device of a model.

use std::ops::Range;

use dunkelfeld_film::Plane;
use dunkelfeld_sampling::{Pcg, hash_u64};
use rand_distr::{Distribution, StandardNormal};

use crate::error::{SensorError, in_range};
use crate::matched::{LeftOut, left_out};
use crate::model::SensorModel;
use crate::optics::Exposure;
use crate::pattern::{Pattern, PixelPattern};
use crate::poisson::poisson;
use crate::random::stream;

/// Purposes of random numbers. Streams of different purposes are independent.
const TEMPORAL: u64 = 0x7465_6d70;
const ROWS: u64 = 0x0072_6f77;
const RESTORED: u64 = 0x7265_7374;

/// The key of a frame. All random numbers that change from frame to frame follow from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameKey {
    /// Seed of the run.
    pub seed: u64,
    /// Number of the frame in the run.
    pub frame: u32,
}

/// How the pixels of a sensor form those of an image.
///
/// It is checked when it is read from a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "ReadoutValues")]
pub struct Readout {
    /// Side of the squares of pixels that are read as one, at most 1024; 0 and 1 are single pixels. The model of the
    /// device describes such a square ([`SensorModel::binned`]).
    pub binning: u32,
    /// Number of stages of a line-scan sensor, whose rows are exposures of the same pixels, at most 1024; 0 for an area
    /// sensor.
    pub line_scan_stages: u32,
}

/// A [`Readout`] that is not checked yet.
#[derive(serde::Deserialize)]
struct ReadoutValues {
    binning: u32,
    line_scan_stages: u32,
}

impl TryFrom<ReadoutValues> for Readout {
    type Error = SensorError;

    fn try_from(values: ReadoutValues) -> Result<Self, SensorError> {
        let ReadoutValues { binning, line_scan_stages } = values;
        in_range("binning", f64::from(binning), 0.0, 1024.0, "at most 1024")?;
        in_range("line_scan_stages", f64::from(line_scan_stages), 0.0, 1024.0, "at most 1024")?;
        Ok(Self { binning, line_scan_stages })
    }
}

/// One device of a sensor model, with the fixed pattern of its pixels.
///
/// The pattern follows from the device seed and is the same in every frame. Noise follows from the frame key.
#[derive(Clone, Debug)]
pub struct Device {
    model: SensorModel,
    seed: u64,
    width: u32,
    height: u32,
    /// Number of rows of the image with a pattern of their own: all, or one for a line-scan sensor.
    pattern_rows: u32,
    pattern: Pattern,
}

impl Device {
    /// The device of an area sensor for a seed, with `width * height` pixels.
    ///
    /// # Errors
    /// The model has maps of another size.
    pub fn new(model: SensorModel, seed: u64, width: u32, height: u32) -> Result<Self, SensorError> {
        Self::with_readout(model, seed, [width, height], Readout::default())
    }

    /// The device of a model for a seed, whose images have `size` (width, height) pixels.
    ///
    /// All rows of a line scan have the same pixels. So its fixed pattern consists of columns: the mean over the stages,
    /// whose charges are added. A column is hot if a pixel of its stages is. Runs on the threads of the pool of the caller, if
    /// there is one.
    ///
    /// # Errors
    /// The model has maps of another size.
    pub fn with_readout(
        model: SensorModel,
        seed: u64,
        [width, height]: [u32; 2],
        readout: Readout,
    ) -> Result<Self, SensorError> {
        model.check_size([width, height], readout)?;
        let is_line_scan = readout.line_scan_stages > 0;
        let pattern_rows = if is_line_scan { height.min(1) } else { height };
        let drawn_rows = if is_line_scan { readout.line_scan_stages } else { height };
        let pattern = Pattern::draw(&model.spec().fixed_pattern, &model.spec().defects, seed, width, drawn_rows);
        let pattern = if is_line_scan { pattern.mean_of_rows(width) } else { pattern };
        Ok(Self { model, seed, width, height, pattern_rows, pattern })
    }

    /// Indices in the pattern of the pixels of a row.
    fn pattern_of_row(&self, y: u32) -> Range<usize> {
        let first = y.min(self.pattern_rows.saturating_sub(1)) as usize * self.width as usize;
        first..first + self.width as usize
    }

    /// The difference of the pixel in column `x` and row `y` from the model. `None` outside the device.
    pub fn pixel(&self, x: u32, y: u32) -> Option<PixelPattern> {
        let index = self.pattern_of_row(y).start + x as usize;
        let is_inside = x < self.width && y < self.height;
        is_inside.then(|| self.pattern.pixels(index..index + 1).first().copied().unwrap_or(PixelPattern::NONE))
    }

    /// Columns and rows of the hot pixels, row by row.
    pub fn hot_pixels(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        (0..self.height).flat_map(move |y| {
            let row = self.pattern_of_row(y);
            let first = row.start as u64;
            self.pattern.hot(row).iter().map(move |p| ((p - first) as u32, y))
        })
    }

    /// The model.
    pub fn model(&self) -> &SensorModel {
        &self.model
    }

    /// A standard normal number for each pixel of a frame, by its index: for [`LensBlur::restored`](crate::LensBlur::restored).
    pub fn normals(&self, key: FrameKey) -> impl Fn(usize) -> f64 + Sync + use<> {
        let key = hash_u64([self.seed, key.seed, u64::from(key.frame), RESTORED]);
        move |pixel| StandardNormal.sample(&mut stream(key, pixel as u64))
    }

    /// A frame: grey values \[DN\] of all pixels from their expected photo-electrons.
    pub fn expose(&self, electrons: &Plane<f32>, exposure: Exposure, key: FrameKey) -> Result<Plane<u16>, SensorError> {
        let mut frame = Plane::new(self.width, self.height, 0);
        self.expose_rows(electrons, exposure, key, 0..self.height, frame.data_mut())?;
        Ok(frame)
    }

    /// The rows `rows` of a frame, written to `out` (row by row, `width * rows.len()` values). The values are those of
    /// [`Device::expose`], so that threads can expose rows in parallel.
    pub fn expose_rows(
        &self,
        electrons: &Plane<f32>,
        exposure: Exposure,
        key: FrameKey,
        rows: Range<u32>,
        out: &mut [u16],
    ) -> Result<(), SensorError> {
        self.expose_known(electrons, &[], exposure, key, rows, out)
    }

    /// [`Device::expose_rows`] for rendered electrons with known variance \[e-^2\]. The camera's noise is drawn less
    /// the noise of the render: see [`ExposureNoise::Matched`](crate::ExposureNoise). A pixel whose variance is zero or
    /// unknown gets the value of [`Device::expose_rows`].
    pub fn expose_rows_matched(
        &self,
        electrons: &Plane<f32>,
        render_variance: &Plane<f32>,
        exposure: Exposure,
        key: FrameKey,
        rows: Range<u32>,
        out: &mut [u16],
    ) -> Result<(), SensorError> {
        let (width, height) = (render_variance.width(), render_variance.height());
        if (width, height) != (self.width, self.height) {
            return Err(SensorError::Size(self.width, self.height, width, height));
        }
        self.expose_known(electrons, render_variance.data(), exposure, key, rows, out)
    }

    /// `variances` has the values of all pixels, or is empty.
    fn expose_known(
        &self,
        electrons: &Plane<f32>,
        variances: &[f32],
        exposure: Exposure,
        key: FrameKey,
        rows: Range<u32>,
        out: &mut [u16],
    ) -> Result<(), SensorError> {
        if (electrons.width(), electrons.height()) != (self.width, self.height) {
            return Err(SensorError::Size(self.width, self.height, electrons.width(), electrons.height()));
        }
        let width = self.width as usize;
        let pixels = rows.start as usize * width..rows.end as usize * width;
        let (Some(means), true) = (electrons.data().get(pixels.clone()), out.len() == pixels.len()) else {
            let (start, end, height, buffer) = (rows.start, rows.end, self.height, out.len());
            return Err(SensorError::Rows { start, end, height, buffer });
        };
        let readout = Converter::new(&self.model, exposure);
        let key = hash_u64([self.seed, key.seed, u64::from(key.frame), TEMPORAL]);
        let variances = variances.get(pixels).unwrap_or(&[]);
        let lines = out.chunks_mut(width.max(1)).zip(means.chunks(width.max(1))).zip(rows.start..);
        for ((line, means), y) in lines {
            let from = (y - rows.start) as usize * width;
            let variances = variances.get(from..from + width).unwrap_or(&[]);
            self.expose_line(&readout, key, y, line, means, variances);
        }
        Ok(())
    }

    /// Exposes one row of a frame. `variances` has the values of its pixels, or is empty.
    fn expose_line(&self, readout: &Converter, key: u64, y: u32, line: &mut [u16], means: &[f32], variances: &[f32]) {
        let shared = readout.row_noise(key, y);
        let first = y as usize * self.width as usize;
        let pixels = first..first + line.len();
        let in_pattern = self.pattern_of_row(y);
        let pattern = self.pattern.pixels(in_pattern.clone());
        let matched = |readout: &Converter, pixel: usize, mean: f32, variance: f32, own: PixelPattern| {
            let (mean, response) = (f64::from(mean), f64::from(own.response));
            // The response of the pixel scales the noise of the render in the same way as its mean.
            let variance = f64::from(variance) * response * response;
            readout.matched_pixel(
                mean,
                variance,
                f64::from(own.dark) + shared,
                response,
                &mut stream(key, pixel as u64),
            )
        };
        let patterns = pattern.iter().copied().chain(std::iter::repeat(PixelPattern::NONE));
        let inputs = line.iter_mut().zip(means).zip(pixels.clone()).zip(patterns);
        if variances.is_empty() {
            for (((out, &mean), pixel), own) in inputs {
                let (dark_offset, response) = (f64::from(own.dark) + shared, f64::from(own.response));
                let mut rng = stream(key, pixel as u64);
                *out = readout.pixel(f64::from(mean), dark_offset, response, &mut rng);
            }
        } else {
            for ((((out, &mean), pixel), own), &variance) in inputs.zip(variances) {
                *out = matched(readout, pixel, mean, variance, own);
            }
        }
        // A grey value depends on its own pixel only, so those of the few hot pixels can be computed again. With
        // unknown render noise, the whole noise is drawn.
        let factor = self.model.spec().defects.hot_factor;
        let hot = Converter { dark_electrons: readout.dark_electrons * factor, ..*readout };
        for &pixel in self.pattern.hot(in_pattern.clone()) {
            let i = pixel as usize - in_pattern.start;
            let own = pattern.get(i).copied().unwrap_or(PixelPattern::NONE);
            line[i] = matched(&hot, first + i, means[i], variances.get(i).copied().unwrap_or(0.0), own);
        }
    }
}

/// The parameters that all pixels of an exposure share.
#[derive(Clone, Copy)]
struct Converter {
    dark_electrons: f64,
    /// Noise of single pixels.
    dark_noise: f64,
    row_noise: f64,
    full_well: f64,
    system_gain: f64,
    offset: f64,
    max_value: f64,
}

impl Converter {
    fn new(model: &SensorModel, exposure: Exposure) -> Self {
        let spec = model.spec();
        Self {
            dark_electrons: model.dark_electrons(exposure.time()).0,
            dark_noise: model.pixel_dark_noise().0,
            row_noise: spec.row_noise.0,
            full_well: spec.full_well.0,
            system_gain: spec.system_gain,
            offset: spec.offset.0,
            max_value: f64::from(model.max_value()),
        }
    }

    /// Row noise of this frame, an offset of all pixels of a row \[e-\]. `key` contains all coordinates but the row.
    fn row_noise(&self, key: u64, row: u32) -> f64 {
        if self.row_noise <= 0.0 {
            return 0.0;
        }
        let shared: f64 = StandardNormal.sample(&mut stream(hash_u64([key, ROWS]), u64::from(row)));
        self.row_noise * shared
    }

    /// The grey value of one pixel, in the order of the steps of EMVA 1288.
    #[inline]
    fn pixel(&self, photo_electrons: f64, dark_offset: f64, response: f64, rng: &mut Pcg) -> u16 {
        // Photo-electrons and dark electrons are both Poisson numbers. The sum of two is a Poisson number of the summed
        // mean.
        let shot = poisson(photo_electrons * response + self.dark_electrons, rng);
        let read: f64 = StandardNormal.sample(rng);
        self.convert(shot + dark_offset + self.dark_noise * read)
    }

    /// The same for electrons that were rendered with the given variance.
    #[inline]
    fn matched_pixel(
        &self,
        photo_electrons: f64,
        render_variance: f64,
        dark_offset: f64,
        response: f64,
        rng: &mut Pcg,
    ) -> u16 {
        let mean = photo_electrons * response + self.dark_electrons;
        let LeftOut { shot: still, read: unread } = left_out(render_variance, mean, self.dark_noise * self.dark_noise);
        let shot = still + poisson(mean - still, rng);
        let read: f64 = StandardNormal.sample(rng);
        // The square root of a square may differ from the original number by rounding. If no part is left out, values
        // must stay the same.
        let dark_noise =
            if unread > 0.0 { (self.dark_noise * self.dark_noise - unread).sqrt() } else { self.dark_noise };
        self.convert(shot + dark_offset + dark_noise * read)
    }

    /// Applies full well, gain and converter.
    #[inline]
    fn convert(&self, electrons: f64) -> u16 {
        let charge = electrons.min(self.full_well);
        let value = (self.system_gain * charge + self.offset).clamp(0.0, self.max_value);
        // The only rounding. The cast truncates, and the value is not negative, so adding one half rounds to nearest.
        (value + 0.5) as u16
    }
}
