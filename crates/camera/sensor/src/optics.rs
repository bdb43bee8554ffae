//! The lens and the exposure: from radiance on the film to expected electrons in the pixels.
//!
//! A film has three channels, the sensor counts photons, and photons need wavelengths. By convention, a linear triple
//! is a coarse spectrum of three bands, each with a representative wavelength and a third of the light. A grey triple
//! (L, L, L) is light of radiance L, with a third of it in each band. A single channel carries a third of its value.
//! The response of a pixel is
//!
//! mu_e = A t E' sum over bands of eta(lambda_b) lambda_b / (h c) L_b / 3, where E' = pi tau / (4 N^2 (1 + m)^2)
//!
//! is the irradiance per radiance behind a thin lens, on its axis, and eta is that of the pixel's colour. Lamps of one
//! wavelength, and a filter, change the bands ([`Bands`]). The radiance already includes the fall-off of the lens toward its edge.

use std::f64::consts::PI;

use dunkelfeld_film::Plane;
use dunkelfeld_radiometry::{Electrons, Irradiance, Metres, Radiance, Rgb, Seconds, photon};

use crate::bands::Bands;
use crate::efficiency::{BayerPattern, Efficiency, QuantumEfficiency};
use crate::error::{SensorError, in_range};
use crate::model::SensorModel;
use crate::parallel::for_rows;
use crate::psf::Psf;

/// The share of a grey triple's radiance in each band.
const BAND_SHARE: f64 = 1.0 / 3.0;

/// Share of pixels below the target level of the automatic exposure.
const AUTO_QUANTILE: f64 = 0.995;
/// Level of that quantile as a fraction of saturation.
const AUTO_LEVEL: f64 = 0.9;
/// Longest valid exposure \[s\].
pub(crate) const LONGEST: f64 = 1e6;

/// The lens in front of the sensor. Its values are checked when they are read from their serialised form.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "OpticsValues")]
pub struct Optics {
    f_number: f64,
    transmission: f64,
    magnification: f64,
    bands: Bands,
    psf: Psf,
    glare: f64,
}

/// The values of [`Optics`], unchecked.
#[derive(serde::Deserialize)]
struct OpticsValues {
    f_number: f64,
    transmission: f64,
    magnification: f64,
    #[serde(default)]
    bands: Bands,
    #[serde(default)]
    psf: Psf,
    #[serde(default)]
    glare: f64,
}

impl TryFrom<OpticsValues> for Optics {
    type Error = SensorError;

    fn try_from(v: OpticsValues) -> Result<Self, SensorError> {
        Self::new(v.f_number, v.transmission, v.magnification)?.with_bands(v.bands).with_psf(v.psf).with_glare(v.glare)
    }
}

impl Optics {
    /// A lens of f-number N (0.5 to 1000), transmission tau (above 0, at most 1) and magnification m (0 for an object
    /// at infinity, at most 100).
    pub fn new(f_number: f64, transmission: f64, magnification: f64) -> Result<Self, SensorError> {
        in_range("f_number", f_number, 0.5, 1000.0, "from 0.5 to 1000")?;
        in_range("transmission", transmission, f64::MIN_POSITIVE, 1.0, "above 0 and at most 1")?;
        in_range("magnification", magnification, 0.0, 100.0, "from 0 to 100")?;
        let (bands, psf, glare) = (Bands::default(), Psf::None, 0.0);
        Ok(Self { f_number, transmission, magnification, bands, psf, glare })
    }

    /// The lens with other wavelengths of the channels, with a filter, or behind a beam splitter.
    pub fn with_bands(self, bands: Bands) -> Self {
        Self { bands, ..self }
    }

    /// The wavelengths of the channels, and the transmission of filter and beam splitters at them.
    pub fn bands(&self) -> Bands {
        self.bands
    }

    /// The lens with another point spread function. That of [`Self::new`] has none.
    pub fn with_psf(self, psf: Psf) -> Self {
        Self { psf, ..self }
    }

    /// The lens with a share of its light in the veiling glare, 0 to 0.5: light that reflections in the lens spread over the
    /// image (ISO 1994). Real lenses have 1 to 3 %; the default is 0.
    ///
    /// # Errors
    /// Another share.
    pub fn with_glare(self, glare: f64) -> Result<Self, SensorError> {
        in_range("glare", glare, 0.0, 0.5, "from 0 to 0.5")?;
        Ok(Self { glare, ..self })
    }

    /// The point spread function.
    pub fn psf(&self) -> &Psf {
        &self.psf
    }

    /// The share of the light in the veiling glare.
    pub fn glare(&self) -> f64 {
        self.glare
    }

    /// Does the lens blur the image?
    pub fn blurs(&self) -> bool {
        self.psf != Psf::None || self.glare > 0.0
    }

    /// Must the samples of a pixel be spread over its neighbours, so that the film determines the image behind the lens
    /// (`dunkelfeld_film::MeanImage::SPREAD`)? A lens that keeps 0.82 of the Nyquist frequency needs no spread: its image has an
    /// error below 1 % up to that frequency without it, and up to 6 % with it.
    pub fn needs_spread(&self, pitch: Metres) -> bool {
        const SHARP: f64 = 0.82;
        self.mtfs(0.5 / pitch.0).any(|mtf| mtf < SHARP)
    }

    /// The MTF at a frequency \[1/m\], for each field height and band.
    fn mtfs(&self, frequency: f64) -> impl Iterator<Item = f64> {
        let working_f_number = self.f_number * (1.0 + self.magnification);
        let of_height = move |h| self.bands.wavelengths.map(|nm| self.psf.mtf(frequency, h, working_f_number, nm));
        (0..self.psf.heights().len()).flat_map(of_height)
    }

    /// Is the blur smaller than a film whose smaller side has this number of pixels? Else less than half of a wave over the film
    /// is left.
    pub fn fits(&self, pixels: u32, pitch: Metres) -> bool {
        self.mtfs(1.0 / (f64::from(pixels) * pitch.0)).all(|mtf| mtf >= 0.5)
    }

    /// The f-number N.
    pub fn f_number(&self) -> f64 {
        self.f_number
    }

    /// The transmission tau.
    pub fn transmission(&self) -> f64 {
        self.transmission
    }

    /// The magnification m.
    pub fn magnification(&self) -> f64 {
        self.magnification
    }

    /// Irradiance on the sensor under an object of the given radiance, E = pi L tau / (4 N^2 (1 + m)^2) on the axis.
    pub fn irradiance(&self, radiance: Radiance) -> Irradiance {
        let working_f_number = self.f_number * (1.0 + self.magnification);
        Irradiance(PI * radiance.0 * self.transmission / (4.0 * working_f_number * working_f_number))
    }
}

/// The time for which the shutter is open. Its serialised form is that time \[s\], which is checked when it is read.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "Seconds", into = "Seconds")]
pub struct Exposure {
    time: Seconds,
}

impl TryFrom<Seconds> for Exposure {
    type Error = SensorError;

    fn try_from(time: Seconds) -> Result<Self, SensorError> {
        Self::new(time)
    }
}

impl From<Exposure> for Seconds {
    fn from(exposure: Exposure) -> Self {
        exposure.time
    }
}

impl Exposure {
    /// An exposure with a time above 0 and at most 1e6 s.
    pub fn new(time: Seconds) -> Result<Self, SensorError> {
        in_range("exposure", time.0, f64::MIN_POSITIVE, LONGEST, "above 0 and at most 1e6 s")?;
        Ok(Self { time })
    }

    /// The time.
    pub fn time(&self) -> Seconds {
        self.time
    }
}

/// The response of one pixel: expected electrons per W/(m^2 sr) of red, green and blue. A linear map, since the camera
/// is linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights(pub [f64; 3]);

impl Weights {
    /// Expected electrons of a pixel for a radiance [W/(m^2 sr) per channel].
    #[inline]
    pub fn electrons(&self, radiance: [f32; 3]) -> Electrons {
        let [r, g, b] = radiance.map(f64::from);
        Electrons(self.0[0] * r + self.0[1] * g + self.0[2] * b)
    }

    /// Variance \[e-^2\] of the expected electrons from the variances of red, green and blue, and the covariances of
    /// red and green, red and blue, green and blue. Infinite, which means unknown, if a variance is negative or not
    /// finite.
    ///
    /// A covariance that is not finite is unknown. The channels of a rendered pixel come from the same paths, so full
    /// correlation is then assumed, which gives an upper bound. Other covariances are clamped to the range that the
    /// variances allow.
    #[inline]
    pub fn variance(&self, variance: [f32; 3], covariance: [f32; 3]) -> f64 {
        if !variance.iter().all(|v| v.is_finite() && *v >= 0.0) {
            return f64::INFINITY;
        }
        let ([wr, wg, wb], [r, g, b]) = (self.0, variance.map(|v| f64::from(v).sqrt()));
        let [rg, rb, gb] = [(covariance[0], r * g), (covariance[1], r * b), (covariance[2], g * b)]
            .map(|(c, limit)| if c.is_finite() { f64::from(c).clamp(-limit, limit) } else { limit });
        let own = (wr * r).powi(2) + (wg * g).powi(2) + (wb * b).powi(2);
        (own + 2.0 * (wr * wg * rg + wr * wb * rb + wg * wb * gb)).max(0.0)
    }

    /// The weights of luminance, for images without a sensor: `electrons` is then the luminance of a radiance [W/(m^2
    /// sr)].
    pub fn luminance() -> Self {
        let of = |r, g, b| f64::from(Rgb::new(r, g, b).luminance());
        Self([of(1.0, 0.0, 0.0), of(0.0, 1.0, 0.0), of(0.0, 0.0, 1.0)])
    }

    /// Covariances of channels whose covariance is unknown.
    pub const UNKNOWN_COVARIANCE: [f32; 3] = [f32::INFINITY; 3];
}

/// The response of the pixels of a sensor, by position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Weights of red, green and blue pixels. All equal without a filter array.
    weights: [Weights; 3],
    pattern: Option<BayerPattern>,
}

impl Response {
    /// The response of a sensor behind a lens.
    pub fn new(model: &SensorModel, optics: &Optics, exposure: Exposure) -> Self {
        let spec = model.spec();
        let irradiance = optics.irradiance(Radiance(BAND_SHARE));
        let weights = |curve: &QuantumEfficiency| {
            let electrons = |c: usize| {
                let band = optics.bands.wavelengths[c];
                let photons = photon::photons(spec.pixel_pitch, irradiance, exposure.time, band);
                curve.at(band) * photons * optics.bands.transmission[c]
            };
            Weights([0, 1, 2].map(electrons))
        };
        match &spec.quantum_efficiency {
            Efficiency::Mono(curve) => Self::constant(weights(curve)),
            Efficiency::Mosaic(filter) => {
                Self { weights: [0, 1, 2].map(|c: usize| weights(&filter.curves[c])), pattern: Some(filter.pattern) }
            }
        }
    }

    /// The response of a sensor whose pixels are all equal.
    pub const fn constant(weights: Weights) -> Self {
        Self { weights: [weights; 3], pattern: None }
    }

    /// The response to light whose radiance has been multiplied by a factor.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { weights: self.weights.map(|weights| Weights(weights.0.map(|w| w * factor))), pattern: self.pattern }
    }

    /// The weights of the pixel in column `x` and row `y`.
    #[inline]
    pub fn at(&self, x: u32, y: u32) -> Weights {
        self.weights[self.kind(x, y)]
    }

    /// The weights of each kind of pixel: one, or those of red, green and blue.
    pub fn kinds(&self) -> &[Weights] {
        match self.pattern {
            None => &self.weights[..1],
            Some(_) => &self.weights,
        }
    }

    /// The kind of the pixel in column `x` and row `y`.
    #[inline]
    pub fn kind(&self, x: u32, y: u32) -> usize {
        self.pattern.map_or(0, |pattern| pattern.color_at(x, y) as usize)
    }

    /// The mean over the pixels, as for a blurred mosaic.
    pub fn average(&self) -> Weights {
        match self.pattern {
            None => self.weights[0],
            Some(_) => {
                let [r, g, b] = self.weights.map(|w| w.0);
                Weights([0, 1, 2].map(|c: usize| 0.25 * (r[c] + 2.0 * g[c] + b[c])))
            }
        }
    }
}

/// Expected photo-electrons of every pixel, and the number of repaired pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct MeanElectrons {
    /// Expected photo-electrons, finite and not negative.
    pub plane: Plane<f32>,
    /// Pixels whose radiance was negative or not a number (they count as black) or infinite (they saturate).
    pub invalid: u64,
}

/// Expected photo-electrons of every pixel of a film [W/(m^2 sr) per channel]. Runs on the threads of the pool of the caller,
/// if there is one.
pub fn electrons(radiance: &Plane<[f32; 3]>, response: &Response) -> MeanElectrons {
    let width = radiance.width();
    let mut plane = Plane::new(width, radiance.height(), 0.0f32);
    let invalid = for_rows(plane.data_mut(), width, |y, out| {
        let pixels = radiance.data().get(y * width as usize..).unwrap_or(&[]);
        let pair = [response.at(0, y as u32), response.at(1, y as u32)];
        electrons_of_row(pixels, out, pair)
    });
    MeanElectrons { plane, invalid }
}

/// Expected photo-electrons of a row, for the responses of even and odd columns. Returns the number of repaired pixels.
fn electrons_of_row(pixels: &[[f32; 3]], out: &mut [f32], pair: [Weights; 2]) -> u64 {
    // A sum beyond the range of f32 is set to the largest f32, not to infinity.
    let limited = |electrons: Electrons| (electrons.0 as f32).min(f32::MAX);
    let mut invalid = 0;
    for ((out, &pixel), x) in out.iter_mut().zip(pixels).zip(0usize..) {
        *out = limited(pair[x & 1].electrons(pixel));
        invalid += u64::from(!is_radiance(pixel));
    }
    if invalid > 0 {
        let pixels = out.iter_mut().zip(pixels).zip(0usize..);
        for ((out, &pixel), x) in pixels.filter(|((_, pixel), _)| !is_radiance(**pixel)) {
            *out = limited(pair[x & 1].electrons(pixel.map(|v| if v > 0.0 { v.min(f32::MAX) } else { 0.0 })));
        }
    }
    invalid
}

/// Are all channels finite and not negative? Without branches.
fn is_radiance([r, g, b]: [f32; 3]) -> bool {
    let is_valid = |v: f32| (0.0..=f32::MAX).contains(&v);
    is_valid(r) & is_valid(g) & is_valid(b)
}

/// The exposure time at which the 99.5 % quantile of the image is at 90 % of saturation.
///
/// If fewer than 0.5 % of the pixels receive light, the quantile is that of the lit pixels. The time is within the
/// range of the camera ([`SensorModel::exposure_range`]): light that saturates the pixels in the shortest time still
/// does. Errors: [`SensorError::NoLight`] if every pixel is black.
pub fn auto_exposure(
    radiance: &Plane<[f32; 3]>,
    model: &SensorModel,
    optics: &Optics,
) -> Result<Exposure, SensorError> {
    let per_second = Response::new(model, optics, Exposure { time: Seconds(1.0) });
    let mut rates = electrons(radiance, &per_second).plane.into_vec();
    let mut rate = quantile(&mut rates, AUTO_QUANTILE);
    if rate <= 0.0 {
        rates.retain(|r| *r > 0.0);
        rate = quantile(&mut rates, AUTO_QUANTILE);
    }
    if rate <= 0.0 {
        return Err(SensorError::NoLight);
    }
    // Dark electrons fill a part of the well.
    let dark = model.dark_electrons(Seconds(1.0)).0;
    let time = AUTO_LEVEL * model.saturation().0 / (f64::from(rate) + dark);
    Exposure::new(clamped(time, model))
}

/// The exposure time of the camera that is nearest to a time \[s\].
fn clamped(time: f64, model: &SensorModel) -> Seconds {
    let [least, most] = model.exposure_range();
    Seconds(time.clamp(least.0, most.0))
}

/// Exposure time of an image without light, for which no automatic exposure exists.
pub const DARK_EXPOSURE: Seconds = Seconds(1.0);

/// The exposure of one image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageExposure {
    /// The exposure.
    pub exposure: Exposure,
    /// True if every pixel is black and the exposure is [`DARK_EXPOSURE`], or the nearest of the camera, because no
    /// other was given.
    pub no_light: bool,
}

impl ImageExposure {
    /// The given exposure, or the automatic one of the mean radiance ([`auto_exposure`]), or [`DARK_EXPOSURE`] if every
    /// pixel is black. Radiance in W/(m^2 sr) per channel.
    ///
    /// # Errors
    /// A given exposure that the camera does not have ([`SensorModel::check_exposure`]).
    pub fn new(
        given: Option<Exposure>,
        radiance: &Plane<[f32; 3]>,
        model: &SensorModel,
        optics: &Optics,
    ) -> Result<Self, SensorError> {
        if let Some(given) = given {
            model.check_exposure(given)?;
        }
        let found = given.map_or_else(|| auto_exposure(radiance, model, optics), Ok);
        match found {
            Err(SensorError::NoLight) => {
                Ok(Self { exposure: Exposure { time: clamped(DARK_EXPOSURE.0, model) }, no_light: true })
            }
            found => Ok(Self { exposure: found?, no_light: false }),
        }
    }
}

/// The value below which the given fraction of all values lies. 0 without values.
fn quantile(values: &mut [f32], fraction: f64) -> f32 {
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let index = (fraction * last as f64).round() as usize;
    *values.select_nth_unstable_by(index.min(last), f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SensorSpec;
    use crate::model::tests::example;

    fn model() -> SensorModel {
        SensorModel::new(example()).expect("valid")
    }

    fn lens() -> Optics {
        Optics::new(8.0, 0.9, 0.1).expect("valid")
    }

    #[test]
    fn the_variance_of_electrons_includes_the_covariance_of_the_channels() {
        let response = Response::new(&model(), &lens(), Exposure::new(Seconds(1e-3)).expect("valid"));
        // Grey noise of standard deviation 0.1 changes the electrons by 0.1 times the response to grey.
        let expected = (0.1 * response.at(0, 0).electrons([1.0; 3]).0).powi(2);
        let weights = response.at(0, 0);
        for unknown in [Weights::UNKNOWN_COVARIANCE, [f32::NAN; 3], [f32::NEG_INFINITY; 3], [0.02; 3]] {
            assert!((weights.variance([0.01; 3], unknown) / expected - 1.0).abs() < 1e-6, "{unknown:?}");
        }
        // By hand: 4 * 1 + 9 * 4 + 0, and twice 2 * 3 * (-1) for red and green.
        let weights = Weights([2.0, 3.0, 5.0]);
        assert!((weights.variance([1.0, 4.0, 0.0], [-1.0, 0.0, 7.0]) - 28.0).abs() < 1e-9);
        // Channels with full negative correlation leave no variance, even if a file contains a larger covariance.
        assert_eq!(weights.variance([9.0, 4.0, 0.0], [-7.0, 0.0, 0.0]), 0.0);
        // An invalid variance makes the result unknown, for any covariance.
        for bad in [f32::NAN, -1.0, f32::INFINITY, f32::NEG_INFINITY] {
            for covariance in [[0.0; 3], [f32::NEG_INFINITY; 3], Weights::UNKNOWN_COVARIANCE] {
                assert_eq!(weights.variance([1.0, bad, 0.0], covariance), f64::INFINITY, "{bad} {covariance:?}");
            }
        }
    }

    #[test]
    fn invalid_pixels_are_counted_and_replaced() {
        let response = Response::new(&model(), &lens(), Exposure::new(Seconds(1.0)).expect("valid"));
        let pixels = vec![[1.0; 3], [f32::NAN, 1.0, 1.0], [-1.0; 3], [f32::INFINITY; 3], [f32::MAX; 3]];
        let out = electrons(&Plane::from_vec(5, 1, pixels).expect("5 x 1"), &response);
        assert_eq!(out.invalid, 3);
        let v = out.plane.data();
        assert!(v.iter().all(|e| e.is_finite() && *e >= 0.0), "{v:?}");
        assert_eq!(v[2], 0.0);
        assert!(v[1] < v[0] && v[1] > 0.0, "the valid channels stay: {v:?}");
        assert_eq!(v[3], f32::MAX);
    }

    #[test]
    fn automatic_exposure_puts_the_quantile_at_nine_tenths() {
        // Radiances 1..=1000: the 99.5 % quantile is 995.
        let ramp = Plane::from_fn(100, 10, |x, y| [(1 + x + 100 * y) as f32; 3]);
        let cold = SensorModel::new(SensorSpec {
            dark_current: crate::DarkCurrent { rate: 0.0, ..example().dark_current },
            ..example()
        })
        .expect("valid");
        let exposure = auto_exposure(&ramp, &cold, &lens()).expect("light");
        let e = Response::new(&cold, &lens(), exposure).at(0, 0).electrons([995.0; 3]).0;
        assert!((e - 9000.0).abs() < 9000.0 * 1.1e-3, "{e} electrons");
    }

    #[test]
    fn a_few_lit_pixels_are_enough_and_none_are_an_error() {
        let mut plane = Plane::new(64, 64, [0.0f32; 3]);
        assert_eq!(auto_exposure(&plane, &model(), &lens()), Err(SensorError::NoLight));
        plane.data_mut()[77] = [2.0; 3];
        let exposure = auto_exposure(&plane, &model(), &lens()).expect("light");
        let photo = Response::new(&model(), &lens(), exposure).at(0, 0).electrons([2.0; 3]).0;
        let all = photo + model().dark_electrons(exposure.time()).0;
        assert!((all - 9000.0).abs() < 1e-2, "{all}");
        assert_eq!(auto_exposure(&Plane::new(0, 0, [0.0; 3]), &model(), &lens()), Err(SensorError::NoLight));
    }

    #[test]
    fn exposures_stay_within_the_range_of_the_camera() {
        let spec = SensorSpec { min_exposure: Some(Seconds(3.4e-5)), max_exposure: Some(Seconds(10.0)), ..example() };
        let model = SensorModel::new(spec).expect("valid");
        for (radiance, time) in [(1e9, 3.4e-5), (1e-9, 10.0)] {
            let plane = Plane::new(4, 4, [radiance; 3]);
            assert_eq!(auto_exposure(&plane, &model, &lens()).expect("light").time(), Seconds(time));
            for given in [0.9 * time, time, 1.1 * time] {
                let exposure = Exposure::new(Seconds(given)).expect("valid");
                let is_possible = (3.4e-5..=10.0).contains(&given);
                let found = ImageExposure::new(Some(exposure), &plane, &model, &lens());
                assert_eq!(found.is_ok(), is_possible, "{given}: {found:?}");
            }
        }
    }

    #[test]
    fn faint_and_blinding_light_still_give_a_time() {
        for radiance in [1e-38, 1e-20, 1e20, f32::MAX] {
            let plane = Plane::new(4, 4, [radiance; 3]);
            let big = SensorModel::new(SensorSpec { pixel_pitch: Metres::from_micrometres(1000.0), ..example() });
            for m in [model(), big.expect("valid")] {
                match auto_exposure(&plane, &m, &lens()) {
                    Ok(e) => assert!(e.time().0 > 0.0 && e.time().0 <= LONGEST),
                    Err(e) => assert_eq!(e, SensorError::NoLight, "radiance {radiance}"),
                }
            }
        }
    }
}
