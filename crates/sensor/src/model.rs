//! What is known of a sensor, checked once, and the noise that follows from it.

use dunkelfeld_radiometry::{Celsius, DigitalNumber, Electrons, Metres, Nanometres, Seconds};

/// Why a sensor, a lens or an exposure cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SensorError {
    /// A number is not finite or lies outside its range.
    #[error("{field} is {value}, it must be {allowed}")]
    OutOfRange {
        /// Which quantity, by the name of its field.
        field: &'static str,
        /// What it was.
        value: f64,
        /// What it may be, in words.
        allowed: &'static str,
    },
    /// The quantum efficiency is not a curve.
    #[error("quantum_efficiency: {0}")]
    Curve(&'static str),
    /// A plane does not have the size of the device.
    #[error("the device has {0} x {1} pixels, the plane {2} x {3}")]
    Size(u32, u32, u32, u32),
    /// The rows asked for do not fit the plane, or the buffer does not fit the rows.
    #[error("rows {start}..{end} of {height} do not fit a buffer of {buffer} pixels")]
    Rows {
        /// First row.
        start: u32,
        /// One past the last row.
        end: u32,
        /// Rows of the plane.
        height: u32,
        /// Length of the buffer.
        buffer: usize,
    },
    /// No pixel receives light: no exposure time makes a picture of it.
    #[error("no pixel receives any light, so there is no exposure time to choose")]
    NoLight,
}

/// Quantum efficiency eta over the wavelength: straight lines between points, constant beyond the ends.
///
/// A single point makes it the same everywhere.
#[derive(Clone, Debug, PartialEq)]
pub struct QuantumEfficiency(Vec<(Nanometres, f64)>);

impl QuantumEfficiency {
    /// A curve through points of ascending wavelength; efficiencies are fractions in (0, 1].
    pub fn new(points: Vec<(Nanometres, f64)>) -> Result<Self, SensorError> {
        if points.is_empty() {
            return Err(SensorError::Curve("needs at least one point [wavelength in nm, efficiency]"));
        }
        for &(wavelength, efficiency) in &points {
            in_range("quantum_efficiency", wavelength.0, 100.0, 20_000.0, "at wavelengths from 100 to 20 000 nm")?;
            if !(efficiency > 0.0 && efficiency <= 1.0) {
                let allowed = "a fraction above 0 and at most 1";
                return Err(SensorError::OutOfRange { field: "quantum_efficiency", value: efficiency, allowed });
            }
        }
        if points.windows(2).any(|w| w[0].0 >= w[1].0) {
            return Err(SensorError::Curve("wavelengths must ascend"));
        }
        Ok(Self(points))
    }

    /// The efficiency at a wavelength.
    pub fn at(&self, wavelength: Nanometres) -> f64 {
        let after = self.0.partition_point(|p| p.0 <= wavelength);
        match (after.checked_sub(1).and_then(|i| self.0.get(i)), self.0.get(after)) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * ((wavelength - a.0) / (b.0 - a.0)),
            (Some(only), None) | (None, Some(only)) => only.1,
            (None, None) => 0.0,
        }
    }

    /// The points, by ascending wavelength.
    pub fn points(&self) -> &[(Nanometres, f64)] {
        &self.0
    }
}

/// Dark current mu_I: electrons that heat sets free, doubling every few degrees (EMVA 1288 release 4.0, Linear).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DarkCurrent {
    /// Electrons per second and pixel at the reference temperature.
    pub rate: f64,
    /// Where the rate was measured.
    pub reference: Celsius,
    /// Rise of temperature that doubles the rate \[K\].
    pub doubling: f64,
}

/// What distinguishes the pixels of one device from each other in every frame: one standard deviation each.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FixedPattern {
    /// Dark signal non-uniformity, DSNU1288 \[e-\].
    pub dsnu: Electrons,
    /// Photo response non-uniformity, PRNU1288, as a fraction of the signal.
    pub prnu: f64,
}

/// What the maker or a test report says the sensor achieves, for comparison with what the model implies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Published {
    /// Dynamic range \[dB\].
    pub dynamic_range_db: Option<f64>,
    /// Largest signal-to-noise ratio \[dB\].
    pub snr_max_db: Option<f64>,
}

/// The description of a sensor, unchecked. [`SensorModel::new`] checks it.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorSpec {
    /// Name of the sensor and of the camera it was measured in.
    pub name: String,
    /// Where the numbers come from.
    pub source: String,
    /// Which of the numbers were computed from others, not published.
    pub derived: Vec<String>,
    /// Which of the numbers are plausible assumptions.
    pub assumed: Vec<String>,
    /// Distance between pixel centres; the pixel's area is its square.
    pub pixel_pitch: Metres,
    /// Quantum efficiency eta.
    pub quantum_efficiency: QuantumEfficiency,
    /// Electrons at which a pixel is full (the saturation capacity mu_e.sat, where only that is published).
    pub full_well: Electrons,
    /// Temporal dark noise without the dark current's share, sigma_d0 \[e-\].
    pub dark_noise: Electrons,
    /// Dark current.
    pub dark_current: DarkCurrent,
    /// Temperature of the sensor during the exposure.
    pub temperature: Celsius,
    /// Overall system gain K \[DN/e-\].
    pub system_gain: f64,
    /// Grey value of a pixel without electrons (black level).
    pub offset: DigitalNumber,
    /// Bits per grey value.
    pub bit_depth: u32,
    /// Differences between pixels.
    pub fixed_pattern: FixedPattern,
    /// Published figures to compare with.
    pub published: Published,
}

/// A sensor whose numbers make sense together.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorModel(SensorSpec);

impl SensorModel {
    /// Checks a description. The error names the field that is out of range.
    pub fn new(spec: SensorSpec) -> Result<Self, SensorError> {
        let s = &spec;
        in_range("pixel_pitch", s.pixel_pitch.micrometres(), 0.1, 1000.0, "from 0.1 to 1000 um")?;
        in_range("full_well", s.full_well.0, 1.0, 1e9, "from 1 to 1e9 electrons")?;
        in_range("dark_noise", s.dark_noise.0, 0.0, s.full_well.0, "from 0 electrons to the full well")?;
        in_range("dark_current", s.dark_current.rate, 0.0, 1e9, "from 0 to 1e9 electrons per second")?;
        in_range("dark_current_reference", s.dark_current.reference.0, -273.15, 200.0, "from -273.15 to 200 degC")?;
        in_range("dark_current_doubling", s.dark_current.doubling, 1.0, 100.0, "from 1 to 100 K")?;
        in_range("temperature", s.temperature.0, -273.15, 200.0, "from -273.15 to 200 degC")?;
        in_range("system_gain", s.system_gain, 1e-6, 1e4, "from 1e-6 to 1e4 DN per electron")?;
        in_range("bit_depth", f64::from(s.bit_depth), 8.0, 16.0, "from 8 to 16")?;
        let top = f64::from(max_value(s.bit_depth));
        in_range("offset", s.offset.0, 0.0, 0.9 * top, "from 0 to 90 % of the largest grey value")?;
        in_range("dsnu", s.fixed_pattern.dsnu.0, 0.0, s.full_well.0, "from 0 electrons to the full well")?;
        in_range("prnu", s.fixed_pattern.prnu, 0.0, 1.0, "from 0 to 100 %")?;
        if s.system_gain * s.full_well.0 < 1.0 {
            let allowed = "large enough that a full pixel is at least 1 DN brighter than an empty one";
            return Err(SensorError::OutOfRange { field: "system_gain", value: s.system_gain, allowed });
        }
        Ok(Self(spec))
    }

    /// The numbers.
    pub fn spec(&self) -> &SensorSpec {
        &self.0
    }

    /// Largest grey value, 2^bits - 1.
    pub fn max_value(&self) -> u16 {
        max_value(self.0.bit_depth)
    }

    /// Electrons at which the grey value stops growing: the full well or the end of the converter, whichever is first.
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

    /// Temporal variance of a pixel that expects `mean` photo-electrons, mu_e + sigma_d^2 + sigma_q^2 / K^2 \[e-^2\]
    /// (EMVA 1288 release 4.0 Linear, equation 14, divided by K^2).
    pub fn temporal_variance(&self, mean: Electrons, time: Seconds) -> f64 {
        mean.0 + self.dark_variance(time) + self.quantisation_variance()
    }
}

fn max_value(bits: u32) -> u16 {
    u16::MAX >> (16 - bits.clamp(1, 16))
}

pub(crate) fn in_range(
    field: &'static str,
    value: f64,
    low: f64,
    high: f64,
    allowed: &'static str,
) -> Result<(), SensorError> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(SensorError::OutOfRange { field, value, allowed }) }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A sensor with every effect in it.
    pub(crate) fn example() -> SensorSpec {
        SensorSpec {
            name: "example".into(),
            source: "made up".into(),
            derived: vec![],
            assumed: vec![],
            pixel_pitch: Metres::from_micrometres(3.45),
            quantum_efficiency: QuantumEfficiency::new(vec![(Nanometres(530.0), 0.65)]).expect("a curve"),
            full_well: Electrons(10_000.0),
            dark_noise: Electrons(4.0),
            dark_current: DarkCurrent { rate: 3.0, reference: Celsius(35.0), doubling: 7.0 },
            temperature: Celsius(42.0),
            system_gain: 0.25,
            offset: DigitalNumber(60.0),
            bit_depth: 12,
            fixed_pattern: FixedPattern { dsnu: Electrons(1.5), prnu: 0.005 },
            published: Published::default(),
        }
    }

    #[test]
    fn each_number_is_checked_and_named() {
        type Change = fn(&mut SensorSpec);
        let cases: [(&str, Change); 12] = [
            ("pixel_pitch", |s| s.pixel_pitch = Metres(0.0)),
            ("full_well", |s| s.full_well = Electrons(f64::NAN)),
            ("dark_noise", |s| s.dark_noise = Electrons(-1.0)),
            ("dark_current", |s| s.dark_current.rate = f64::INFINITY),
            ("dark_current_doubling", |s| s.dark_current.doubling = 0.0),
            ("temperature", |s| s.temperature = Celsius(-300.0)),
            ("system_gain", |s| s.system_gain = 0.0),
            ("system_gain", |s| s.system_gain = 5e-5),
            ("bit_depth", |s| s.bit_depth = 17),
            ("offset", |s| s.offset = DigitalNumber(4000.0)),
            ("dsnu", |s| s.fixed_pattern.dsnu = Electrons(-0.1)),
            ("prnu", |s| s.fixed_pattern.prnu = 1.5),
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
    fn the_efficiency_is_interpolated_and_held_beyond_the_ends() {
        let nm = Nanometres;
        let curve = QuantumEfficiency::new(vec![(nm(400.0), 0.2), (nm(500.0), 0.6), (nm(700.0), 0.4)]).expect("curve");
        for (at, expected) in
            [(300.0, 0.2), (400.0, 0.2), (450.0, 0.4), (500.0, 0.6), (600.0, 0.5), (700.0, 0.4), (900.0, 0.4)]
        {
            assert!((curve.at(nm(at)) - expected).abs() < 1e-12, "at {at} nm: {}", curve.at(nm(at)));
        }
        for bad in [vec![], vec![(nm(500.0), 0.0)], vec![(nm(500.0), 0.5), (nm(500.0), 0.6)], vec![(nm(f64::NAN), 0.5)]]
        {
            assert!(QuantumEfficiency::new(bad).is_err());
        }
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
