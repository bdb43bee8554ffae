//! Analysis of the finished renders, read back from the folder: all data of the report, as plain data.

use super::findings::{Finding, findings};
use super::renders::Renders;
use super::runs::{Series, Unit, reference};
use super::settings::PtcSettings;
use crate::series::statistics::{correlation, quantile, rank_correlation};
use crate::series::{View, exposure_words};
use dunkelfeld::film::Plane;
use dunkelfeld::sensor::{Device, Exposure, FrameKey, SensorModel};
use dunkelfeld::{Error, RenderSettings};
use dunkelfeld_emva1288::{
    AnalysisError, Frame, FramePair, LineFit, PhotonTransfer, Quantity, TemporalAccumulator, TemporalStatistics,
    TransferPoint,
};
use dunkelfeld_report::words::rounded;

/// Levels of uniform light, and the side of the frames, for the photon transfer curve of the camera.
const LEVELS: u32 = 50;
const LEVEL_SIDE: u32 = 128;
/// Number of intervals of the linear curves over the sensor's range.
pub(super) const LINEAR_BINS: f64 = 128.0;
/// Dark and saturated grey values of the paper's pictures \[DN\].
const PICTURE: [f64; 2] = [0.0, 255.0];
/// Largest ratio of the render's standard deviation to the camera's, for pixels of the curves of the sensor's frames.
/// With it, matched exposure can compensate the noise of the render also in single frames.
const QUIET: f64 = 0.7;
/// Minimum number of frames with a spread, of which one can be left out.
const MIN_FRAMES: usize = 3;

/// A photon transfer curve with the straight line through 0-70 % of its range.
#[derive(Clone, Debug)]
pub(super) struct Curve {
    pub(super) points: Vec<TransferPoint>,
    /// `None` with too few points for a line.
    pub(super) fit: Option<LineFit>,
    /// Dark and saturated grey values \[DN\].
    pub(super) range: [f64; 2],
}

/// The pictures of the paper: 8 bit, gamma 2.2, of one number of samples, denoised or not.
#[derive(Clone, Debug)]
pub(super) struct PictureSeries {
    pub(super) spp: u32,
    pub(super) is_denoised: bool,
    pub(super) frames: u64,
    /// Seconds of one frame.
    pub(super) seconds: f64,
    /// The image of the first frame, and its gradient [DN/pixel].
    pub(super) picture: Plane<u8>,
    pub(super) sobel: Plane<f32>,
    /// Temporal variance \[DN^2\].
    pub(super) variance: Plane<f64>,
    pub(super) curve: Curve,
    /// The curve without the steepest pixels.
    pub(super) filtered: Curve,
    /// Correlation of the Sobel magnitude of the first frame with the variance of the *other* frames: Pearson,
    /// Spearman.
    pub(super) correlations: [f64; 2],
    /// Mean variance: of all pixels, of the steepest, of the rest \[DN^2\].
    pub(super) mean_variance: [f64; 3],
    /// Linear grey values instead of gamma; with a sensor.
    pub(super) linear: Option<Curve>,
}

/// The frames of the sensor, for one number of samples.
#[derive(Clone, Debug)]
pub(super) struct CameraSeries {
    pub(super) spp: u32,
    pub(super) frames: u64,
    /// Share of the pixels in the curves. The render of these pixels has little noise compared to the camera, on
    /// average over the frames where its noise is known.
    pub(super) quiet: f64,
    pub(super) plain: Option<Curve>,
    pub(super) matched: Option<Curve>,
}

/// The sensor's own curve, from uniform light: points and gain.
#[derive(Clone, Debug)]
pub(super) struct SensorCurve {
    pub(super) name: String,
    pub(super) curve: Curve,
    pub(super) gain: Option<Quantity>,
    /// K of the sensor's description [DN/e-].
    pub(super) truth: f64,
}

/// All data of the report.
pub(super) struct Results {
    pub(super) name: String,
    pub(super) size: [u32; 2],
    pub(super) seed: u64,
    pub(super) settings: PtcSettings,
    pub(super) camera: String,
    pub(super) denoiser: Option<String>,
    pub(super) finished: [usize; 2],
    pub(super) pictures: Vec<PictureSeries>,
    pub(super) cameras: Vec<CameraSeries>,
    pub(super) sensor: Option<SensorCurve>,
}

impl Results {
    /// Reads the finished renders; `None` if no series has three frames.
    pub(super) fn gather(
        renders: &Renders,
        settings: &PtcSettings,
        render: &RenderSettings,
        name: String,
        denoiser: Option<String>,
        finished: [usize; 2],
    ) -> Result<Option<Self>, Error> {
        let first = reference(settings);
        if renders.record(&first)?.is_none() {
            return Ok(None);
        }
        let view = View::new(&render.sensor, &renders.radiance(&first)?)?;
        let reader = Reader { renders, settings, view: &view };
        let (mut pictures, mut cameras) = (Vec::new(), Vec::new());
        for &spp in settings.spp() {
            for is_denoised in [false, true] {
                if !is_denoised || denoiser.is_some() {
                    pictures.extend(reader.pictures(spp, is_denoised)?);
                }
            }
            if let (Some(model), Some(exposure)) = (view.model(), view.exposure()) {
                cameras.extend(reader.cameras(spp, model, exposure)?);
            }
        }
        if pictures.is_empty() {
            return Ok(None);
        }
        let sensor = match (view.model(), view.exposure()) {
            (Some(model), Some(exposure)) => Some(sensor_curve(model, exposure, render.seed)?),
            _ => None,
        };
        Ok(Some(Self {
            name,
            size: [render.width, render.height],
            seed: render.seed,
            settings: settings.clone(),
            camera: exposure_words(&view, &renders.signal(&first, false)?),
            denoiser,
            finished,
            pictures,
            cameras,
            sensor,
        }))
    }

    pub(super) fn findings(&self) -> Vec<Finding> {
        findings(&self.pictures)
    }

    /// The findings as a few lines of text.
    pub(super) fn lines(&self) -> Vec<String> {
        let mut lines: Vec<String> =
            self.findings().iter().map(|f| format!("{}: {} ({})", f.claim, f.verdict.words(), f.here)).collect();
        if let Some((sensor, gain)) = self.sensor.as_ref().and_then(|s| Some((s, s.gain.as_ref()?))) {
            lines.push(format!(
                "{}: K = {:.5} +- {:.5} DN/e- from even light, {:.5} by its data",
                sensor.name, gain.value, gain.standard_error, sensor.truth
            ));
        }
        for series in &self.cameras {
            for (name, curve) in [("plain", &series.plain), ("matched", &series.matched)] {
                if let (Some(fit), Some(sensor)) = (curve.as_ref().and_then(|c| c.fit.as_ref()), &self.sensor) {
                    lines.push(format!(
                        "{} samples per pixel, {name} exposure: K = {:.5} +- {:.5} DN/e- ({:+.2} %), R^2 = {:.5}, on {} % of the pixels",
                        series.spp,
                        fit.slope.value,
                        fit.slope.standard_error,
                        100.0 * (fit.slope.value / sensor.truth - 1.0),
                        fit.r_squared,
                        rounded(100.0 * series.quiet)
                    ));
                }
            }
        }
        lines
    }
}

/// The gradient of the first frame, and the pixels without strong edges.
pub(super) struct Gradient {
    pub(super) sobel: Plane<f32>,
    magnitudes: Vec<f64>,
    /// The pixels below the steepest ones.
    pub(super) flat: Vec<bool>,
}

impl Gradient {
    /// `edges` is the share of the pixels that count as strong edges.
    pub(super) fn new(first: &Plane<u8>, edges: f64) -> Self {
        let sobel = dunkelfeld::adaptive::sobel::magnitude(first);
        let magnitudes: Vec<f64> = sobel.data().iter().map(|&v| f64::from(v)).collect();
        let limit = quantile(magnitudes.clone(), 1.0 - edges);
        let flat = magnitudes.iter().map(|s| *s <= limit).collect();
        Self { sobel, magnitudes, flat }
    }

    /// Its correlation with the variance of the other frames: Pearson's, Spearman's.
    pub(super) fn correlations(&self, variance: &[f64]) -> [f64; 2] {
        [correlation(&self.magnitudes, variance), rank_correlation(&self.magnitudes, variance)]
    }

    /// Mean variance of all pixels, of those at strong edges, of the others.
    pub(super) fn mean_variance(&self, variance: &[f64]) -> [f64; 3] {
        let mean = |wanted: &dyn Fn(bool) -> bool| {
            let chosen = variance.iter().zip(&self.flat).filter(|(_, flat)| wanted(**flat)).map(|(v, _)| *v);
            let (sum, n) = chosen.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
            sum / n
        };
        [mean(&|_| true), mean(&|flat| !flat), mean(&|flat| flat)]
    }
}

/// An error of the analyser for simulated frames is a fault of the frames, not of the user.
pub(super) fn fault(e: AnalysisError) -> Error {
    Error::setting("frames", e.to_string(), e.help())
}

fn stack_of<'a>(
    frames: impl Iterator<Item = Result<Plane<u16>, Error>> + 'a,
    size: (u32, u32),
) -> Result<TemporalStatistics, Error> {
    let mut stack = TemporalAccumulator::new(size.0, size.1);
    for frame in frames {
        let frame = frame?;
        stack.add(Frame::new(frame.width(), frame.height(), frame.data()).map_err(fault)?).map_err(fault)?;
    }
    stack.finish().map_err(fault)
}

/// A curve of 8-bit pictures, in unit-wide intervals.
pub(super) fn picture_curve(
    stack: &TemporalStatistics,
    range: [f64; 2],
    keep: Option<&[bool]>,
) -> Result<Curve, Error> {
    let transfer = PhotonTransfer::by_unit_bins(stack, range[0], keep).map_err(fault)?;
    Ok(curve(&transfer, range))
}

/// A curve of linear grey values from dark to saturation. The dark value is in the middle of an interval.
pub(super) fn linear_curve(stack: &TemporalStatistics, range: [f64; 2], keep: Option<&[bool]>) -> Result<Curve, Error> {
    linear_transfer(stack, range, keep).map(|transfer| curve(&transfer, range))
}

fn linear_transfer(
    stack: &TemporalStatistics,
    range: [f64; 2],
    keep: Option<&[bool]>,
) -> Result<PhotonTransfer, Error> {
    let width = linear_bin(range);
    PhotonTransfer::by_bins(stack, range[0] - 0.5 * width, width, range[0], keep).map_err(fault)
}

/// The points, and the line through them over 0-70 % of the range.
fn curve(transfer: &PhotonTransfer, range: [f64; 2]) -> Curve {
    Curve { points: transfer.points().to_vec(), fit: transfer.line(range[1]).ok(), range }
}

struct Reader<'a> {
    renders: &'a Renders,
    settings: &'a PtcSettings,
    view: &'a View,
}

impl Reader<'_> {
    fn finished(&self, series: Series, spp: u32) -> Result<Vec<Unit>, Error> {
        let mut found = Vec::new();
        for frame in 0..self.settings.frames() {
            let unit = Unit { series, spp, frame };
            if self.renders.record(&unit)?.is_some() {
                found.push(unit);
            }
        }
        Ok(found)
    }

    fn pictures(&self, spp: u32, is_denoised: bool) -> Result<Option<PictureSeries>, Error> {
        let units = self.finished(Series::Paper, spp)?;
        let (Some((first, others)), true) = (units.split_first(), units.len() >= MIN_FRAMES) else { return Ok(None) };
        let signal = |unit: &Unit| self.renders.signal(unit, is_denoised);
        let picture = self.view.picture(&signal(first)?);
        let size = (picture.width(), picture.height());
        let as_frame = |unit: &Unit| Ok(self.view.picture(&signal(unit)?).map(|&v| u16::from(v)));
        let stack = stack_of(units.iter().map(as_frame), size)?;
        let rest = stack_of(others.iter().map(as_frame), size)?;
        let gradient = Gradient::new(&picture, self.settings.edges());
        let mut seconds = 0.0;
        for unit in &units {
            let record = self.renders.record(unit)?;
            let of = |r: &super::renders::Record| r.seconds + r.denoise_seconds.filter(|_| is_denoised).unwrap_or(0.0);
            seconds += record.as_ref().map_or(0.0, of) / units.len() as f64;
        }
        let variance = Plane::from_vec(size.0, size.1, stack.variance.clone());
        let Some(variance) = variance else { return Ok(None) };
        Ok(Some(PictureSeries {
            spp,
            is_denoised,
            frames: stack.frames,
            seconds,
            variance,
            curve: picture_curve(&stack, PICTURE, None)?,
            filtered: picture_curve(&stack, PICTURE, Some(&gradient.flat))?,
            correlations: gradient.correlations(&rest.variance),
            mean_variance: gradient.mean_variance(&stack.variance),
            linear: self.linear(&units, is_denoised, size)?,
            sobel: gradient.sobel,
            picture,
        }))
    }

    /// The curve of the expected grey values, rounded as by the sensor, without noise of the sensor.
    fn linear(&self, units: &[Unit], is_denoised: bool, size: (u32, u32)) -> Result<Option<Curve>, Error> {
        let Some(model) = self.view.model() else { return Ok(None) };
        let (gain, offset, most) = (model.spec().system_gain, model.spec().offset.0, f64::from(model.max_value()));
        let full = model.saturation().0;
        let grey = |e: f32| (offset + gain * f64::from(e).min(full)).clamp(0.0, most).round() as u16;
        let frames = units.iter().map(|unit| Ok(self.renders.signal(unit, is_denoised)?.map(|&e| grey(e))));
        let stack = stack_of(frames, size)?;
        let range = [offset, model.saturation_value().0];
        linear_curve(&stack, range, None).map(Some)
    }

    fn cameras(&self, spp: u32, model: &SensorModel, exposure: Exposure) -> Result<Option<CameraSeries>, Error> {
        let units = self.finished(Series::Camera, spp)?;
        if units.len() < MIN_FRAMES {
            return Ok(None);
        }
        // Number of frames in which the noise of a pixel is known, and its mean share of the camera's variance in them.
        let mut known: Vec<(u32, f64)> = Vec::new();
        let mut size = (0, 0);
        for unit in &units {
            let ratios = self.renders.ratios(unit)?;
            size = (ratios.width(), ratios.height());
            known.resize(ratios.data().len(), (0, 0.0));
            for ((frames, mean), ratio) in known.iter_mut().zip(ratios.data()).filter(|(_, r)| r.is_finite()) {
                *frames += 1;
                *mean += (f64::from(*ratio) - *mean) / f64::from(*frames);
            }
        }
        let is_quiet = |&(frames, mean): &(u32, f64)| 2 * frames as usize > units.len() && mean <= QUIET * QUIET;
        let keep: Vec<bool> = known.iter().map(is_quiet).collect();
        let dark = model.spec().offset.0 + model.spec().system_gain * model.dark_electrons(exposure.time()).0;
        let range = [dark, model.saturation_value().0];
        let black = self.in_the_dark(&units, size, model, exposure)?;
        let of = |matched: bool| {
            let mut stack = TemporalAccumulator::new(size.0, size.1);
            for unit in &units {
                let (values, ratios) = (self.renders.values(unit, matched)?, self.renders.ratios(unit)?);
                let frame = Frame::new(size.0, size.1, values.data()).map_err(fault)?;
                stack.add_where(frame, ratios.map(|r| r.is_finite()).data()).map_err(fault)?;
            }
            let lit = stack.finish().map_err(fault)?;
            linear_transfer(&lit, range, Some(&keep)).map(|t| Some(curve(&t.with_dark_frames(&black), range)))
        };
        let quiet = keep.iter().filter(|k| **k).count() as f64 / keep.len().max(1) as f64;
        Ok(Some(CameraSeries { spp, frames: units.len() as u64, quiet, plain: of(false)?, matched: of(true)? }))
    }

    /// The same number of frames of the same device without light: the lower end of the photon transfer curve.
    fn in_the_dark(
        &self,
        units: &[Unit],
        (width, height): (u32, u32),
        model: &SensorModel,
        exposure: Exposure,
    ) -> Result<TemporalStatistics, Error> {
        let nothing = Plane::new(width, height, 0.0);
        let frames = units.iter().map(|unit| {
            let seed = self.renders.seed(unit);
            let device = Device::new(model.clone(), seed, width, height)?;
            // Their frame numbers differ from those of all frames with light.
            Ok(device.expose(&nothing, exposure, FrameKey { seed, frame: !unit.frame })?)
        });
        stack_of(frames, (width, height))
    }
}

/// Width of the bins of a linear curve \[DN\]: at least one.
fn linear_bin(range: [f64; 2]) -> f64 {
    ((range[1] - range[0]) / LINEAR_BINS).round().max(1.0)
}

/// The curve of the sensor alone, as measured on a test bench: two frames of uniform light at each level.
fn sensor_curve(model: &SensorModel, exposure: Exposure, seed: u64) -> Result<SensorCurve, Error> {
    let device = Device::new(model.without_maps(), seed, LEVEL_SIDE, LEVEL_SIDE)?;
    let pair = |level: u32| -> Result<FramePair, Error> {
        let electrons = model.saturation().0 * f64::from(level) / f64::from(LEVELS);
        let light = Plane::new(LEVEL_SIDE, LEVEL_SIDE, electrons as f32);
        let take = |frame| device.expose(&light, exposure, FrameKey { seed, frame });
        let (a, b) = (take(2 * level)?, take(2 * level + 1)?);
        let frame = |p| Frame::new(LEVEL_SIDE, LEVEL_SIDE, p).map_err(fault);
        FramePair::from_frames(frame(a.data())?, frame(b.data())?).map_err(fault)
    };
    let dark = pair(0)?;
    let levels = (1..=LEVELS).map(pair).collect::<Result<Vec<_>, _>>()?;
    let transfer = PhotonTransfer::by_levels(&dark, &levels);
    let range = [transfer.dark().mean, model.saturation_value().0];
    Ok(SensorCurve {
        name: model.spec().name.clone(),
        gain: transfer.gain(range[1]).ok(),
        curve: curve(&transfer, range),
        truth: model.spec().system_gain,
    })
}
