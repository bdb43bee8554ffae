//! The frames of a measurement of EMVA 1288: levels from dark to saturation in pairs, stacks in the dark and at half of
//! saturation.

use super::truth::{Edge, Light, Truth, dark_at, truth};
use derive_setters::Setters;
use dunkelfeld::Error;
use dunkelfeld::film::Plane;
use dunkelfeld::radiometry::{Irradiance, Nanometres, Seconds, photon};
use dunkelfeld::sensor::{Device, Efficiency, Exposure, FilterColor, FrameKey, SensorModel};
use dunkelfeld_emva1288::{Frame, FramePair, Level, Measurement, StackAccumulator, StackLevel};
use serde::Serialize;
use std::ops::RangeInclusive;

/// Exposure times \[s\] of a measurement.
pub const EXPOSURES: RangeInclusive<f64> = 1e-6..=1e5;

/// The quantity that varies from level to level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Vary {
    /// The exposure time, under constant light. The analysis then also gives the dark current.
    #[default]
    Exposure,
    /// The light, at one exposure time.
    Irradiance,
}

/// The settings of a measurement.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct DatasetSettings {
    /// Levels of light, 10 to 1000; the last three are saturated.
    pub levels: u32,
    /// Width of the frames in pixels.
    pub width: u32,
    /// Height of the frames in pixels.
    pub height: u32,
    /// Wavelength of the light; `None` means that of the highest quantum efficiency.
    #[setters(into)]
    pub wavelength: Option<Nanometres>,
    /// Frames in each of the two stacks, 3 to 1000.
    pub stack: u32,
    /// Seed of the device and the noise.
    pub seed: u64,
    /// The varied quantity.
    pub vary: Vary,
    /// The exposure time, or the longest exposure time.
    pub exposure: Seconds,
    /// Bits per grey value instead of the sensor's own: gain and black level change with them.
    #[setters(into)]
    pub bit_depth: Option<u32>,
    /// The pixels to measure of a sensor with colour filters.
    #[setters(into)]
    pub color: Option<FilterColor>,
}

impl Default for DatasetSettings {
    fn default() -> Self {
        Self {
            levels: 50,
            width: 640,
            height: 480,
            wavelength: None,
            stack: 16,
            seed: 0,
            vary: Vary::default(),
            exposure: Seconds(0.1),
            bit_depth: None,
            color: None,
        }
    }
}

/// Frames with the same light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Exposure time.
    pub exposure: Exposure,
    /// Photons per pixel on average; zero in the dark.
    pub photons: f64,
    /// Number of the first frame.
    pub first: u32,
    /// Number of frames: two for a level, more for a stack.
    pub frames: u32,
}

/// A planned measurement. Its frames can be simulated in any order.
#[derive(Clone, Debug)]
pub struct DatasetPlan {
    device: Device,
    settings: DatasetSettings,
    light: Light,
    /// Photo-electrons at saturation.
    saturation: f64,
    shots: Vec<Shot>,
}

impl DatasetPlan {
    /// Plans the measurement of a device of the model.
    ///
    /// # Errors
    /// Settings out of range.
    pub fn new(model: &SensorModel, settings: &DatasetSettings) -> Result<Self, Error> {
        let s = settings;
        let within = |what: &str, value: u32, low: u32, high: u32| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            Err(Error::setting(what, format!("{value} is out of range"), format!("choose {low} to {high}")))
        };
        within("levels", s.levels, 10, 1000)?;
        within("frames of a stack", s.stack, 3, 1000)?;
        within("width", s.width, 16, dunkelfeld::limits::MAX_SIDE)?;
        within("height", s.height, 16, dunkelfeld::limits::MAX_SIDE)?;
        if u64::from(s.width) * u64::from(s.height) > dunkelfeld::limits::MAX_PIXELS {
            let problem = format!("{} x {} pixels are more than {}", s.width, s.height, dunkelfeld::limits::MAX_PIXELS);
            return Err(Error::setting("size", problem, "use smaller frames"));
        }
        if !EXPOSURES.contains(&s.exposure.0) {
            let problem = format!("{} s is out of range", s.exposure.0);
            return Err(Error::setting("exposure", problem, "choose a time from 1 us to 100000 s"));
        }
        let model = prepared(model, s)?;
        let (wavelength, efficiency) = light_of(&model, s)?;
        let edge = Edge::of(&model);
        let current = model.dark_electrons(Seconds(1.0)).0;
        // The last two levels are above the first saturated one, so they are saturated too.
        let dark = dark_at(current, s, 1.0);
        if !edge.has_room_for(dark) {
            return Err(Error::setting(
                "exposure",
                format!("in {} s the pixels fill in the dark, with {dark:.0} electrons of dark current", s.exposure.0),
                format!("choose a shorter time: this sensor gathers {current} dark electrons in a second"),
            ));
        }
        let unfit = || Error::setting("sensor", "no light fills all of its pixels", "use a sensor with less PRNU");
        let full = edge.full(|_| dark).ok_or_else(unfit)?;
        let most = full / efficiency * f64::from(s.levels) / f64::from(s.levels - 2);
        let saturation = edge.saturation(|photo| dark_at(current, s, photo / (efficiency * most))).ok_or_else(unfit)?;
        let per_irradiance = photon::photons(model.spec().pixel_pitch, Irradiance(1.0), s.exposure, wavelength);
        let irradiance = Irradiance(most / per_irradiance);
        let light = Light { wavelength, efficiency, irradiance };
        let device = Device::new(model, s.seed, s.width, s.height)?;
        let mut plan = Self { device, settings: s.clone(), light, saturation, shots: Vec::new() };
        plan.lay_out(saturation / (efficiency * most))?;
        Ok(plan)
    }

    fn lay_out(&mut self, saturation: f64) -> Result<(), Error> {
        let s = self.settings.clone();
        let share = |level: u32| f64::from(level) / f64::from(s.levels);
        let middle = ((0.5 * saturation * f64::from(s.levels)).round() as u32).clamp(1, s.levels);
        for level in 1..=s.levels {
            if s.vary == Vary::Exposure || level == 1 {
                self.shoot(share(level), 0.0, 2)?;
            }
            self.shoot(share(level), share(level), 2)?;
        }
        self.shoot(share(middle), 0.0, s.stack)?;
        self.shoot(share(middle), share(middle), s.stack)
    }

    /// Adds frames at a share of the longest time or of the full light.
    fn shoot(&mut self, time: f64, light: f64, frames: u32) -> Result<(), Error> {
        let longest = self.settings.exposure.0;
        // The unit of time in a descriptor is the nanosecond.
        let whole = |seconds: f64| (seconds * 1e9).round().max(1.0) / 1e9;
        let (seconds, irradiance) = match self.settings.vary {
            Vary::Exposure => (whole(longest * time), if light > 0.0 { 1.0 } else { 0.0 }),
            Vary::Irradiance => (whole(longest), light),
        };
        let irradiance = Irradiance(self.light.irradiance.0 * irradiance);
        let pitch = self.device.model().spec().pixel_pitch;
        let photons = photon::photons(pitch, irradiance, Seconds(seconds), self.light.wavelength);
        let first = self.shots.last().map_or(0, |s| s.first + s.frames);
        self.shots.push(Shot { exposure: Exposure::new(Seconds(seconds))?, photons, first, frames });
        Ok(())
    }

    /// The camera.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The settings.
    pub fn settings(&self) -> &DatasetSettings {
        &self.settings
    }

    /// The frames, in the order of the data set.
    pub fn shots(&self) -> &[Shot] {
        &self.shots
    }

    /// Simulates a frame of a shot; `number` is its index from 0.
    ///
    /// # Errors
    /// Those of the sensor.
    pub fn frame(&self, shot: &Shot, number: u32) -> Result<Plane<u16>, Error> {
        let (width, height) = (self.settings.width, self.settings.height);
        let electrons = Plane::new(width, height, (self.light.efficiency * shot.photons) as f32);
        let key = FrameKey { seed: self.settings.seed, frame: shot.first + number };
        Ok(self.device.expose(&electrons, shot.exposure, key)?)
    }

    /// The expected result of an analysis.
    pub fn truth(&self) -> Truth {
        truth(self.device.model(), &self.light, &self.settings, self.saturation)
    }

    /// Simulates the whole measurement without writing a frame.
    ///
    /// # Errors
    /// Those of the sensor.
    pub fn measure(&self) -> Result<Measurement, Error> {
        let mut measurement =
            Measurement { bits: Some(self.device.model().spec().bit_depth), ..Measurement::default() };
        let fits = |e| Error::setting("measurement", format!("{e}"), "report this: frames of one device must fit");
        let (width, height) = (self.settings.width, self.settings.height);
        for shot in &self.shots {
            let (exposure, photons) = (shot.exposure.time().0, shot.photons);
            if shot.frames == 2 {
                let (a, b) = (self.frame(shot, 0)?, self.frame(shot, 1)?);
                let view = |p| Frame::new(width, height, p).map_err(fits);
                let pair = FramePair::from_frames(view(a.data())?, view(b.data())?).map_err(fits)?;
                measurement.levels.push(Level { exposure, photons, pair });
            } else {
                let mut stack = StackAccumulator::new(width, height);
                for number in 0..shot.frames {
                    let frame = self.frame(shot, number)?;
                    stack.add(Frame::new(width, height, frame.data()).map_err(fits)?).map_err(fits)?;
                }
                let stack = stack.finish().map_err(fits)?;
                measurement.stacks.push(StackLevel { exposure, photons, stack });
            }
        }
        Ok(measurement)
    }
}

/// The model with the bit depth of the settings, and with the selected pixels of a mosaic.
fn prepared(model: &SensorModel, s: &DatasetSettings) -> Result<SensorModel, Error> {
    let mut spec = model.spec().clone();
    if let Some(bits) = s.bit_depth {
        if !(8..=16).contains(&bits) {
            return Err(Error::setting("bit depth", format!("{bits} is out of range"), "choose 8 to 16"));
        }
        let factor = f64::from(bits) - f64::from(spec.bit_depth);
        spec.system_gain *= factor.exp2();
        spec.offset.0 *= factor.exp2();
        spec.bit_depth = bits;
    }
    match (spec.quantum_efficiency.filter(), s.color) {
        (Some(filter), Some(color)) => {
            spec.quantum_efficiency = Efficiency::Mono(filter.curves[color as usize].clone());
        }
        (Some(_), None) => {
            let help = "name the pixels: red, green or blue (a data set has the pixels of one colour)";
            return Err(Error::setting("sensor", "it has colour filters", help));
        }
        (None, Some(_)) => {
            return Err(Error::setting("color", "the sensor has no colour filters", "leave the colour out"));
        }
        (None, None) => {}
    }
    Ok(SensorModel::new(spec)?)
}

/// Wavelength of the light, and the efficiency there.
fn light_of(model: &SensorModel, s: &DatasetSettings) -> Result<(Nanometres, f64), Error> {
    let curve = model.spec().quantum_efficiency.of_pixel(0, 0);
    let (wavelength, efficiency) = match s.wavelength {
        Some(w) if (100.0..=20_000.0).contains(&w.0) => (w, curve.at(w)),
        Some(w) => {
            return Err(Error::setting("wavelength", format!("{} nm is out of range", w.0), "choose 100 to 20000 nm"));
        }
        None => curve.peak(),
    };
    if efficiency > 0.0 {
        return Ok((wavelength, efficiency));
    }
    let problem = format!("the sensor has no response to light of {} nm", wavelength.0);
    Err(Error::setting("wavelength", problem, "choose one with a quantum efficiency above zero"))
}
