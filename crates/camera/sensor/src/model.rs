//! The parameters of a sensor, with checks, and the noise that follows from them.

use dunkelfeld_radiometry::{Celsius, DigitalNumber, Electrons, Metres, Seconds};

use crate::efficiency::Efficiency;
use crate::error::{SensorError, in_range};
use crate::expose::Readout;
use crate::maps::PixelMaps;
use crate::optics::{Exposure, LONGEST};
use crate::pattern::{Defects, FixedPattern};

/// Dark current mu_I: thermally generated electrons, whose rate doubles every few degrees (EMVA 1288 release 4.0,
/// Linear).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DarkCurrent {
    /// Electrons per second and pixel at the reference temperature.
    pub rate: f64,
    /// Temperature at which the rate was measured.
    pub reference: Celsius,
    /// Rise of temperature that doubles the rate \[K\].
    pub doubling: f64,
}

/// Published figures of the maker or of a test report, for comparison with those of the model.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Published {
    /// Largest quantum efficiency \[%\].
    pub quantum_efficiency_percent: Option<f64>,
    /// Temporal dark noise sigma_d \[e-\].
    pub dark_noise_e: Option<f64>,
    /// Inverse of the system gain, 1/K \[e-/DN\].
    pub gain_e_per_dn: Option<f64>,
    /// Absolute sensitivity threshold mu_e.min \[e-\].
    pub threshold_e: Option<f64>,
    /// The same in photons, mu_p.min.
    pub threshold_p: Option<f64>,
    /// Saturation capacity mu_e.sat \[e-\].
    pub saturation_e: Option<f64>,
    /// The same in photons, mu_p.sat.
    pub saturation_p: Option<f64>,
    /// Dynamic range \[dB\].
    pub dynamic_range_db: Option<f64>,
    /// Largest signal-to-noise ratio \[dB\].
    pub snr_max_db: Option<f64>,
    /// DSNU1288 \[e-\].
    pub dsnu_e: Option<f64>,
    /// PRNU1288 \[%\].
    pub prnu_percent: Option<f64>,
}

impl Published {
    /// Every figure with the name of its field.
    pub fn figures(&self) -> [(&'static str, Option<f64>); 11] {
        [
            ("quantum_efficiency_percent", self.quantum_efficiency_percent),
            ("dark_noise_e", self.dark_noise_e),
            ("gain_e_per_dn", self.gain_e_per_dn),
            ("threshold_e", self.threshold_e),
            ("threshold_p", self.threshold_p),
            ("saturation_e", self.saturation_e),
            ("saturation_p", self.saturation_p),
            ("dynamic_range_db", self.dynamic_range_db),
            ("snr_max_db", self.snr_max_db),
            ("dsnu_e", self.dsnu_e),
            ("prnu_percent", self.prnu_percent),
        ]
    }
}

/// The description of a sensor, unchecked. [`SensorModel::new`] checks it.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SensorSpec {
    /// Name of the sensor and of the camera it was measured in.
    pub name: String,
    /// Source of the numbers.
    pub source: String,
    /// The numbers that were computed from others and not published.
    pub derived: Vec<String>,
    /// The numbers that are plausible assumptions.
    pub assumed: Vec<String>,
    /// Distance between pixel centres. The area of a pixel is its square.
    pub pixel_pitch: Metres,
    /// Columns and rows of the sensor, if they are published.
    pub resolution: Option<[u32; 2]>,
    /// Quantum efficiency eta of all pixels, or of each colour.
    pub quantum_efficiency: Efficiency,
    /// Electrons of a full pixel (or the saturation capacity mu_e.sat, if only that is published).
    pub full_well: Electrons,
    /// Temporal dark noise without the share of the dark current, sigma_d0 \[e-\]. It includes the noise of rows.
    pub dark_noise: Electrons,
    /// The part of it that the pixels of a row share, with a new value for each row and frame \[e-\].
    pub row_noise: Electrons,
    /// Dark current.
    pub dark_current: DarkCurrent,
    /// Temperature of the sensor during the exposure.
    pub temperature: Celsius,
    /// Shortest exposure time of the camera. `None` for no limit.
    #[serde(default)]
    pub min_exposure: Option<Seconds>,
    /// Longest exposure time of the camera. `None` for no limit.
    #[serde(default)]
    pub max_exposure: Option<Seconds>,
    /// Overall system gain K \[DN/e-\].
    pub system_gain: f64,
    /// Grey value of a pixel without electrons (black level).
    pub offset: DigitalNumber,
    /// Bits per grey value.
    pub bit_depth: u32,
    /// Differences between pixels.
    pub fixed_pattern: FixedPattern,
    /// Defect pixels.
    pub defects: Defects,
    /// Published figures for comparison.
    pub published: Published,
}

/// A sensor whose parameters are valid and consistent. Its serialised form is the [`SensorSpec`], which is checked when it is read.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "SensorSpec")]
pub struct SensorModel(SensorSpec);

impl TryFrom<SensorSpec> for SensorModel {
    type Error = SensorError;

    fn try_from(spec: SensorSpec) -> Result<Self, SensorError> {
        Self::new(spec)
    }
}

impl SensorModel {
    /// Checks a description. The error contains the name of the field that is out of range.
    pub fn new(spec: SensorSpec) -> Result<Self, SensorError> {
        let s = &spec;
        in_range("pixel_pitch", s.pixel_pitch.micrometres(), 0.1, 1000.0, "from 0.1 to 1000 um")?;
        in_range("full_well", s.full_well.0, 1.0, 1e9, "from 1 to 1e9 electrons")?;
        in_range("dark_noise", s.dark_noise.0, 0.0, s.full_well.0, "from 0 electrons to the full well")?;
        in_range(
            "row_noise",
            s.row_noise.0,
            0.0,
            s.dark_noise.0,
            "from 0 electrons to the dark noise, whose part it is",
        )?;
        in_range("dark_current", s.dark_current.rate, 0.0, 1e9, "from 0 to 1e9 electrons per second")?;
        in_range("dark_current_reference", s.dark_current.reference.0, -273.15, 200.0, "from -273.15 to 200 degC")?;
        in_range("dark_current_doubling", s.dark_current.doubling, 1.0, 100.0, "from 1 to 100 K")?;
        in_range("temperature", s.temperature.0, -273.15, 200.0, "from -273.15 to 200 degC")?;
        let [least, most] = [s.min_exposure, s.max_exposure].map(|time| time.map(|t| t.0));
        let shortest = f64::MIN_POSITIVE;
        in_range("min_exposure", least.unwrap_or(shortest), shortest, LONGEST, "above 0 and at most 1e6 s")?;
        let allowed = "from the least exposure to 1e6 s";
        in_range("max_exposure", most.unwrap_or(LONGEST), least.unwrap_or(shortest), LONGEST, allowed)?;
        in_range("system_gain", s.system_gain, 1e-6, 1e4, "from 1e-6 to 1e4 DN per electron")?;
        in_range("bit_depth", f64::from(s.bit_depth), 8.0, 16.0, "from 8 to 16")?;
        let top = f64::from(max_value(s.bit_depth));
        in_range("offset", s.offset.0, 0.0, 0.9 * top, "from 0 to 90 % of the largest grey value")?;
        s.fixed_pattern.check(s.full_well, s.resolution)?;
        s.defects.check()?;
        if s.defects.hot > 0.0 && s.dark_current.rate <= 0.0 {
            let allowed = "0 without a dark current: that is what a hot pixel has more of";
            return Err(SensorError::OutOfRange { field: "hot", value: s.defects.hot, allowed });
        }
        for (field, figure) in s.published.figures() {
            if let Some(value) = figure {
                in_range(field, value, f64::MIN_POSITIVE, 1e12, "above 0 and at most 1e12")?;
            }
        }
        if s.system_gain * s.full_well.0 < 1.0 {
            let allowed = "large enough that a full pixel is at least 1 DN brighter than an empty one";
            return Err(SensorError::OutOfRange { field: "system_gain", value: s.system_gain, allowed });
        }
        Ok(Self(spec))
    }

    /// Read noise of a pixel without the part that its row shares \[e-\]: the square root of sigma_d0^2 less the
    /// squared row noise.
    pub fn pixel_dark_noise(&self) -> Electrons {
        crate::pattern::rest(self.0.dark_noise, &[self.0.row_noise])
    }

    /// The sensor with squares of `factor * factor` pixels that are read as one: their charges are added before the
    /// readout. Pitch and dark current of a pixel grow. Full well, dark noise, gain and non-uniformities of a readout
    /// remain, because the data sheet contains no others.
    ///
    /// # Errors
    /// If the pixels become larger than the model allows, or have maps.
    pub fn binned(&self, factor: u32) -> Result<Self, SensorError> {
        let mut spec = self.0.clone();
        if let Some(name) = spec.fixed_pattern.maps.name().filter(|_| factor > 1) {
            return Err(SensorError::Map { name, problem: "is of single pixels, and these are binned".into() });
        }
        let side = f64::from(factor.max(1));
        spec.pixel_pitch = Metres(spec.pixel_pitch.0 * side);
        spec.dark_current.rate *= side * side;
        spec.resolution = spec.resolution.map(|sides| sides.map(|n| n / factor.max(1)));
        if factor > 1 {
            spec.name = format!("{}, binned {factor} x {factor}", spec.name);
        }
        Self::new(spec)
    }

    /// The sensor without its maps: other devices of its kind, of any size.
    #[must_use]
    pub fn without_maps(&self) -> Self {
        let mut spec = self.0.clone();
        spec.fixed_pattern.maps = PixelMaps::default();
        Self(spec)
    }

    /// Checks that a device of that size can have the maps of the model. All rows of a line scan have the pixels of its
    /// stages.
    ///
    /// # Errors
    /// The maps have another size.
    pub fn check_size(&self, [width, height]: [u32; 2], readout: Readout) -> Result<(), SensorError> {
        let rows = if readout.line_scan_stages > 0 { readout.line_scan_stages } else { height };
        match self.0.fixed_pattern.maps.size() {
            Some([columns, of_map]) if [columns, of_map] != [width, rows] => {
                Err(SensorError::Size(width, rows, columns, of_map))
            }
            _ => Ok(()),
        }
    }

    /// The shortest and the longest exposure time of the camera.
    pub fn exposure_range(&self) -> [Seconds; 2] {
        let Self(spec) = self;
        [spec.min_exposure.unwrap_or(Seconds(f64::MIN_POSITIVE)), spec.max_exposure.unwrap_or(Seconds(LONGEST))]
    }

    /// Checks that the camera has an exposure time.
    ///
    /// # Errors
    /// It is shorter than the shortest, or longer than the longest one.
    pub fn check_exposure(&self, exposure: Exposure) -> Result<(), SensorError> {
        let ([least, most], time) = (self.exposure_range().map(|t| t.0), exposure.time().0);
        let limit = time.clamp(least, most);
        if limit == time {
            return Ok(());
        }
        Err(SensorError::Exposure { camera: self.0.name.clone(), time, limit })
    }

    /// The parameters.
    pub fn spec(&self) -> &SensorSpec {
        &self.0
    }

    /// Largest grey value, 2^bits - 1.
    pub fn max_value(&self) -> u16 {
        max_value(self.0.bit_depth)
    }

    /// Electrons at which the grey value saturates: the full well or the end of the converter, whichever is lower.
    pub fn saturation(&self) -> Electrons {
        let converter = (f64::from(self.max_value()) - self.0.offset.0) / self.0.system_gain;
        Electrons(self.0.full_well.0.min(converter))
    }

    /// Grey value of a saturated pixel.
    pub fn saturation_value(&self) -> DigitalNumber {
        DigitalNumber(self.0.offset.0 + self.0.system_gain * self.saturation().0)
    }

    /// Expected dark electrons of an exposure, mu_I t with mu_I(T) = mu_I.ref 2^((T - T.ref) / T.d).
    pub fn dark_electrons(&self, time: Seconds) -> Electrons {
        let d = &self.0.dark_current;
        Electrons(d.rate * ((self.0.temperature - d.reference).0 / d.doubling).exp2() * time.0)
    }

    /// Variance of the dark signal, sigma_d^2 = sigma_d0^2 + mu_I t \[e-^2\].
    pub fn dark_variance(&self, time: Seconds) -> f64 {
        self.0.dark_noise.0.powi(2) + self.dark_electrons(time).0
    }

    /// Variance of the rounding to whole grey values, sigma_q^2 / K^2 with sigma_q^2 = 1/12 DN^2 \[e-^2\].
    pub fn quantisation_variance(&self) -> f64 {
        1.0 / (12.0 * self.0.system_gain.powi(2))
    }

    /// Temporal variance of a pixel with `mean` expected photo-electrons, mu_e + sigma_d^2 + sigma_q^2 / K^2 \[e-^2\]
    /// (EMVA 1288 release 4.0 Linear, equation 14, divided by K^2).
    pub fn temporal_variance(&self, mean: Electrons, time: Seconds) -> f64 {
        mean.0 + self.dark_variance(time) + self.quantisation_variance()
    }
}

fn max_value(bits: u32) -> u16 {
    u16::MAX >> (16 - bits.clamp(1, 16))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::efficiency::QuantumEfficiency;
    use dunkelfeld_radiometry::Nanometres;

    /// A sensor with all effects.
    pub(crate) fn example() -> SensorSpec {
        SensorSpec {
            name: "example".into(),
            source: "made up".into(),
            derived: vec![],
            assumed: vec![],
            pixel_pitch: Metres::from_micrometres(3.45),
            resolution: None,
            quantum_efficiency: QuantumEfficiency::new(vec![(Nanometres(530.0), 0.65)]).expect("a curve").into(),
            full_well: Electrons(10_000.0),
            dark_noise: Electrons(4.0),
            row_noise: Electrons(0.0),
            dark_current: DarkCurrent { rate: 3.0, reference: Celsius(35.0), doubling: 7.0 },
            temperature: Celsius(42.0),
            min_exposure: None,
            max_exposure: None,
            system_gain: 0.25,
            offset: DigitalNumber(60.0),
            bit_depth: 12,
            fixed_pattern: FixedPattern { dsnu: Electrons(1.5), prnu: 0.005, ..FixedPattern::default() },
            defects: Defects::default(),
            published: Published::default(),
        }
    }

    #[test]
    fn each_number_is_checked_and_named() {
        type Change = fn(&mut SensorSpec);
        let cases: [(&str, Change); 24] = [
            ("pixel_pitch", |s| s.pixel_pitch = Metres(0.0)),
            ("full_well", |s| s.full_well = Electrons(f64::NAN)),
            ("dark_noise", |s| s.dark_noise = Electrons(-1.0)),
            ("dark_current", |s| s.dark_current.rate = f64::INFINITY),
            ("dark_current_doubling", |s| s.dark_current.doubling = 0.0),
            ("temperature", |s| s.temperature = Celsius(-300.0)),
            ("min_exposure", |s| s.min_exposure = Some(Seconds(0.0))),
            ("max_exposure", |s| (s.min_exposure, s.max_exposure) = (Some(Seconds(2.0)), Some(Seconds(1.0)))),
            ("system_gain", |s| s.system_gain = 0.0),
            ("system_gain", |s| s.system_gain = 5e-5),
            ("bit_depth", |s| s.bit_depth = 17),
            ("offset", |s| s.offset = DigitalNumber(4000.0)),
            ("dsnu", |s| s.fixed_pattern.dsnu = Electrons(-0.1)),
            ("prnu", |s| s.fixed_pattern.prnu = 1.5),
            ("row_noise", |s| s.row_noise = Electrons(4.1)),
            ("dsnu_row", |s| s.fixed_pattern.dsnu_row = Electrons(1.6)),
            ("dsnu_column", |s| {
                (s.fixed_pattern.dsnu_row, s.fixed_pattern.dsnu_column) = (Electrons(1.2), Electrons(1.0))
            }),
            ("prnu_row", |s| s.fixed_pattern.prnu_row = -0.001),
            ("prnu_column", |s| s.fixed_pattern.prnu_column = 0.006),
            ("hot", |s| s.defects.hot = 0.2),
            ("hot", |s| (s.defects.hot, s.dark_current.rate) = (1e-5, 0.0)),
            ("hot_factor", |s| s.defects.hot_factor = 0.5),
            ("dead", |s| s.defects.dead = f64::NAN),
            ("snr_max_db", |s| s.published.snr_max_db = Some(f64::INFINITY)),
        ];
        for (name, change) in cases {
            let mut spec = example();
            change(&mut spec);
            match SensorModel::new(spec) {
                Err(SensorError::OutOfRange { field, .. }) => assert_eq!(field, name),
                other => panic!("{name}: {other:?}"),
            }
        }
        assert!(SensorModel::new(example()).is_ok());
    }

    #[test]
    fn saturation_is_the_nearer_of_well_and_converter() {
        let well = SensorModel::new(example()).expect("valid");
        assert_eq!(well.saturation(), Electrons(10_000.0));
        assert_eq!(well.saturation_value(), DigitalNumber(2560.0));
        let converter = SensorModel::new(SensorSpec { system_gain: 1.0, ..example() }).expect("valid");
        assert_eq!(converter.saturation(), Electrons(4035.0));
        assert_eq!(converter.saturation_value(), DigitalNumber(4095.0));
    }

    #[test]
    fn dark_current_doubles_with_temperature() {
        // 42 degC is one doubling above the reference.
        let model = SensorModel::new(example()).expect("valid");
        assert!((model.dark_electrons(Seconds(2.0)).0 - 12.0).abs() < 1e-12);
        let expected = 100.0 + (16.0 + 12.0) + 16.0 / 12.0;
        assert!((model.temporal_variance(Electrons(100.0), Seconds(2.0)) - expected).abs() < 1e-12);
    }
}
