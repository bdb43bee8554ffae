//! A film behind a camera: frames, maps and certificates.

use crate::prepared::{Found, Means, Prepared};
use crate::protocol::{Camera, Fault, FrameHeader, MapHeader, MapKind, Noise, Ranges, Readiness, Tone};
use crate::snapshot::{Content, Heaviest, Snapshot};
use dunkelfeld::denoising::{Denoiser, OIDN_VARIABLE, denoise_film, find_denoiser};
use dunkelfeld::film::Certified;
use dunkelfeld::film::{MeanImage, PixelSums, Plane};
use dunkelfeld::io::sensor_file::find_sensor;
use dunkelfeld::light_layers::sum_of_means;
use dunkelfeld::radiometry::{Celsius, DigitalNumber, Electrons, Number, Rgb, Seconds};
use dunkelfeld::sensor::{
    Exposure, ExposureNoise, ImageNoise, Optics, PRESETS, Psf, SensorModel, TimedExposure, display, through_lens,
};
use dunkelfeld::{
    DenoiseMethod, DenoiseSettings, ExposeSettings, Exposer, Picture, RenderSettings, RenderedFilm, SensorChoice,
    Session,
};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

/// The name of the sensor of the job in the list of sensors.
pub(crate) const OWN_SENSOR: &str = "as in the job";

/// The sensors that the view knows: that of the job, and the presets. No other file is read for a name.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sensors {
    /// Names with models, the sensor of the job first.
    all: Arc<Vec<(String, SensorModel)>>,
}

impl Sensors {
    pub(crate) fn new(choice: &SensorChoice) -> Self {
        let own = if let SensorChoice::Emva { model, .. } = choice { Some((**model).clone()) } else { None };
        let own = own.map(|model| (OWN_SENSOR.to_owned(), model));
        let presets = PRESETS.iter().filter_map(|(name, _)| Some(((*name).to_owned(), find_sensor(name).ok()?)));
        Self { all: Arc::new(own.into_iter().chain(presets).collect()) }
    }

    /// Names with models, the sensor of the job first.
    pub(crate) fn all(&self) -> &[(String, SensorModel)] {
        &self.all
    }

    /// The model of a camera. `None` without a sensor.
    pub(crate) fn model(&self, camera: &Camera, binning: u32) -> Result<Option<SensorModel>, Fault> {
        let Some(name) = &camera.sensor else { return Ok(None) };
        let unknown = || Fault::new(format!("{name:?} is no sensor of the list"), "choose a sensor of the list");
        let (_, model) = self.all.iter().find(|(listed, _)| listed == name).ok_or_else(unknown)?;
        let model = if name == OWN_SENSOR {
            model.clone()
        } else {
            model.clone().binned(binning).map_err(|e| Fault::from(dunkelfeld::Error::from(e)))?
        };
        within("gain", camera.gain, Ranges::KNOBS.gain)?;
        camera
            .temperature
            .map_or(Ok(()), |temperature| within("temperature", temperature, Ranges::KNOBS.temperature))?;
        camera.exposure.map_or(Ok(()), |time| within("exposure time", time, Ranges::KNOBS.exposure))?;
        let mut spec = model.spec().clone();
        spec.system_gain *= camera.gain;
        spec.temperature = camera.temperature.map_or(spec.temperature, Celsius);
        spec.offset = camera.black_level.map_or(spec.offset, DigitalNumber);
        SensorModel::new(spec).map(Some).map_err(|e| Fault::from(dunkelfeld::Error::from(e)))
    }
}

/// Checks that samples of moving objects and timed lamps are exposed for their time.
pub(crate) fn check_timed(snapshot: &Snapshot, camera: &Camera) -> Result<(), Fault> {
    match snapshot.scene.timed {
        Some(TimedExposure { time, reason }) if camera.sensor.is_some() && camera.exposure != Some(time.0) => {
            let problem = format!("{reason} for an exposure of {} s", Number(time.0));
            Err(Fault::new(problem, "change `exposure` in [sensor] of the job"))
        }
        _ => Ok(()),
    }
}

/// The reason why the f-number is no knob of a film with these settings.
pub(crate) fn fixed_f_number(settings: &RenderSettings) -> Option<&'static str> {
    if settings.run.view.as_ref().is_some_and(|view| view.lens.aperture.is_some()) {
        return Some("the samples show the depth of field of this aperture");
    }
    match &settings.sensor {
        SensorChoice::Emva { optics, .. } if *optics.psf() != Psf::None => None,
        _ => Some("the samples are those of a sharp image, without the diffraction of an aperture"),
    }
}

/// The lens `of_film` with the knobs of a camera.
pub(crate) fn with_knobs(of_film: Optics, camera: &Camera, settings: &RenderSettings) -> Result<Optics, Fault> {
    if let Some(f_number) = camera.f_number {
        within("f-number", f_number, Ranges::KNOBS.f_number)?;
        if let Some(reason) = fixed_f_number(settings) {
            let help = "set `f_number` in `[lens]` of the job";
            return Err(Fault::new(format!("the f-number is fixed, because {reason}"), help));
        }
    }
    camera.glare.map_or(Ok(()), |glare| within("glare", glare, Ranges::KNOBS.glare))?;
    let f_number = camera.f_number.unwrap_or(of_film.f_number());
    let lens = Optics::new(f_number, of_film.transmission(), of_film.magnification())
        .and_then(|lens| lens.with_glare(camera.glare.unwrap_or(of_film.glare())))
        .map_err(dunkelfeld::Error::from)?;
    Ok(lens.with_bands(of_film.bands()).with_psf(of_film.psf().clone()))
}

/// Checks a knob.
fn within(knob: &str, value: f64, [low, high]: [f64; 2]) -> Result<(), Fault> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Fault::new(format!("the {knob} {value} is out of range"), format!("use {low} to {high}")))
}

/// A film behind a camera.
#[derive(Debug)]
pub(crate) struct Developed {
    pub(crate) snapshot: Arc<Snapshot>,
    camera: Camera,
    /// `None` without a sensor.
    pub(crate) exposer: Option<Exposer>,
    /// The factors of the lights ([`Snapshot::factors`]), and the film with these.
    factors: Vec<f64>,
    weighted: OnceLock<Result<Option<RenderedFilm>, Fault>>,
    /// The transmission of the lens, if it is another one than that of the film.
    transmission: Option<Arc<Plane<f32>>>,
    /// The unbiased mean with factors of the lights, or behind another lens.
    sum: Option<MeanImage>,
    /// The mean that is shown, if it is denoised.
    denoised: Option<MeanImage>,
    certified: OnceLock<Option<Certified>>,
    readiness: Readiness,
    /// [`Prepared::count`] before it was computed.
    prepared: u64,
}

/// May an answer use the noise or the denoised mean of an earlier film or another camera, or do without them?
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Accept {
    Exact,
    Provisional,
}

impl Developed {
    /// Runs on the threads of the session.
    ///
    /// # Errors
    /// Knobs out of range, an unknown sensor, an EXR that is to be denoised, and the reason why an analysis failed.
    pub(crate) fn new(
        snapshot: Arc<Snapshot>,
        camera: &Camera,
        (prepared, accept): (&Prepared, Accept),
        session: &Session<'_>,
    ) -> Result<Self, Fault> {
        let count = prepared.count();
        let transmission = match camera.vignetting == snapshot.is_vignetted {
            true => None,
            false => Some(snapshot.other_transmission()?),
        };
        let factors = snapshot.factors(camera.lights.as_ref())?;
        let (means, mut readiness) = match camera.denoise {
            DenoiseMethod::Off => (None, Readiness::Exact),
            _ if matches!(snapshot.content, Content::Exr(_)) => {
                return Err(Fault::new("an EXR is shown as it is", "denoise it by `dunkelfeld denoise`"));
            }
            method => {
                let found = prepared.denoised(&snapshot, method);
                if found.is_none() {
                    // A denoiser that is not installed is a fault at once.
                    denoiser(&snapshot, method)?;
                }
                usable(found, accept, || denoised_means(&snapshot, method, prepared, session))?
            }
        };
        let denoised = means.map(|means| sum(&means, &factors)).transpose()?;
        let sum = if factors.is_empty() { None } else { Some(snapshot.weighted_mean(&factors)?) };
        let (sum, denoised) = match &transmission {
            None => (sum, denoised),
            Some(transmission) => {
                let mean = sum.as_ref().unwrap_or_else(|| snapshot.mean());
                let behind = |mean: &MeanImage| mean.map(|plane| through_lens(plane, transmission));
                (Some(behind(mean)), denoised.as_ref().map(behind))
            }
        };
        let model = snapshot.scene.sensors.model(camera, snapshot.settings.readout.binning)?;
        let mut developed = Self {
            snapshot,
            camera: camera.clone(),
            exposer: None,
            factors,
            weighted: OnceLock::new(),
            transmission,
            sum,
            denoised,
            certified: OnceLock::new(),
            readiness,
            prepared: count,
        };
        if let Some(model) = model {
            let exposer = developed.expose(model.clone())?;
            // The remaining noise of a denoised image is unknown.
            let mut noise = None;
            if camera.noise == Noise::Matched && camera.denoise == DenoiseMethod::Off {
                let found = prepared.noise(&developed.snapshot, camera);
                (noise, readiness) = usable(found, accept, || developed.noise(model, &exposer, prepared))?;
            }
            developed.readiness = readiness;
            developed.exposer = Some(match noise {
                None => exposer,
                Some(noise) => {
                    let counts = developed.snapshot.film().map(|_| &developed.snapshot.counts);
                    exposer.with_noise(&noise, counts)?
                }
            });
        }
        // Without an exact result, the reason may be known.
        let failure = (readiness != Readiness::Exact).then(|| prepared.failure(&developed.snapshot, camera)).flatten();
        failure.map_or(Ok(developed), Err)
    }

    /// Analyses the noise of the film behind this camera.
    fn noise(&self, model: SensorModel, exposer: &Exposer, prepared: &Prepared) -> Result<Arc<ImageNoise>, Fault> {
        let noise = match &self.snapshot.content {
            Content::Exr(image) => {
                // The model of the exposer has the binning of the file already.
                let mut settings = self.settings(model)?;
                settings.exposure = Some(exposer.exposure());
                image.image_noise(&settings).map_err(without_options)?
            }
            Content::Film(_) => exposer.image_noise(self.film()?),
        };
        let noise = Arc::new(noise);
        prepared.add_noise(&self.snapshot, &self.camera, noise.clone());
        Ok(noise)
    }

    /// Computes the film with the factors of the lights, once. Not for threads of the session: while such a thread waits for
    /// others it takes up other work, which could wait for this result.
    pub(crate) fn find_film(&self, session: &Session<'_>) {
        self.weighted.get_or_init(|| session.install(|| self.snapshot.weighted(&self.factors)));
    }

    /// The film with the factors of the lights, after [`Self::find_film`], or on the thread that makes this picture.
    ///
    /// # Errors
    /// An EXR, and too little memory.
    fn film(&self) -> Result<&RenderedFilm, Fault> {
        let weighted = self.weighted.get_or_init(|| self.snapshot.weighted(&self.factors));
        let film = weighted.as_ref().map_err(Clone::clone)?.as_ref().or(self.snapshot.film());
        film.ok_or_else(|| Fault::new("an EXR has no samples", "open the saved film of the render"))
    }

    /// The sample with the largest share of the light of a pixel. `None` for a black pixel and for an EXR. After
    /// [`Self::find_film`].
    pub(crate) fn heaviest(&self, x: u32, y: u32) -> Option<Heaviest> {
        let sums = self.film().ok()?.sums.pixel(x, y);
        let [r, g, b] = sums.mean().map(|v| v as f32);
        let total = f64::from(Rgb::new(r, g, b).luminance()) * f64::from(sums.count());
        let (index, luminance) = sums.heaviest().filter(|_| total > 0.0)?;
        Some(Heaviest { index, share: (f64::from(luminance) / total).min(1.0) })
    }

    /// The settings of this camera, for plain exposure.
    fn settings(&self, model: SensorModel) -> Result<ExposeSettings, Fault> {
        let Self { snapshot, camera, .. } = self;
        check_timed(snapshot, camera)?;
        let mut settings = match ExposeSettings::of_render(&snapshot.settings)? {
            Some(settings) => settings.with_model(model),
            None => ExposeSettings::new(model)?,
        };
        settings.optics = with_knobs(settings.optics, camera, &snapshot.settings)?;
        settings.exposure = match camera.exposure {
            None => None,
            Some(time) => Some(Exposure::new(Seconds(time)).map_err(dunkelfeld::Error::from)?),
        };
        settings.seed = camera.device;
        settings.exposure_noise = ExposureNoise::Plain;
        Ok(settings)
    }

    /// Plain exposure.
    fn expose(&self, model: SensorModel) -> Result<Exposer, Fault> {
        let mut settings = self.settings(model)?;
        if let Content::Exr(image) = &self.snapshot.content {
            return Ok(image.expose(&settings)?);
        }
        if self.denoised.is_some() && settings.exposure.is_none() {
            // The exposure is that of the unbiased mean.
            settings.exposure = Some(self.exposer_of(self.unbiased(), &settings)?.exposure());
        }
        self.exposer_of(self.mean(), &settings)
    }

    fn exposer_of(&self, mean: &MeanImage, settings: &ExposeSettings) -> Result<Exposer, Fault> {
        let film = self.snapshot.film().ok_or_else(|| Fault::new("an EXR has no film", "expose its image"))?;
        // Plain exposure needs the mean alone.
        Ok(Exposer::of_film_and_mean(film, mean, self.transmission.clone(), settings)?)
    }

    /// [`Prepared::count`] before it was computed.
    pub(crate) fn prepared(&self) -> u64 {
        self.prepared
    }

    /// How far noise and denoised mean are there.
    pub(crate) fn readiness(&self) -> Readiness {
        self.readiness
    }

    /// Are noise and denoised mean those of this film and camera?
    pub(crate) fn is_exact(&self) -> bool {
        self.readiness() == Readiness::Exact
    }

    /// The camera.
    pub(crate) fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The unbiased mean radiance in front of the lens [W/(m² sr)].
    pub(crate) fn radiance(&self) -> &Plane<[f32; 3]> {
        &self.unbiased().radiance
    }

    fn unbiased(&self) -> &MeanImage {
        self.sum.as_ref().unwrap_or_else(|| self.snapshot.mean())
    }

    fn mean(&self) -> &MeanImage {
        self.denoised.as_ref().unwrap_or_else(|| self.unbiased())
    }

    /// Computes [`Self::certified`], once. Not for threads of the session: while such a thread waits for others it takes up
    /// other work, which could wait for this result.
    pub(crate) fn certify(&self, session: &Session<'_>) {
        let certify = || match (self.exposer.as_ref()?, &self.snapshot.content) {
            (exposer, Content::Film(_)) => exposer.certify(self.film().ok()?, 1.0),
            (exposer, Content::Exr(image)) => image.certify(exposer, 1.0),
        };
        self.find_film(session);
        self.certified.get_or_init(|| session.install(certify));
    }

    /// The ratios of the noise of the render to that of the camera. `None` without a sensor, and before [`Self::certify`].
    pub(crate) fn certified(&self) -> Option<&Certified> {
        self.certified.get()?.as_ref()
    }

    /// Expected grey value \[DN\] of a pixel with so many photo-electrons, up to saturation.
    pub(crate) fn expected(exposer: &Exposer, electrons: f32) -> f64 {
        let model = exposer.model();
        let dark = model.dark_electrons(exposer.exposure().time()).0;
        let charge = (f64::from(electrons) + dark).min(model.spec().full_well.0);
        (model.spec().system_gain * charge + model.spec().offset.0).clamp(0.0, f64::from(model.max_value()))
    }

    /// Temporal standard deviation of the camera \[DN\] of a pixel with so many photo-electrons.
    pub(crate) fn camera_sigma(exposer: &Exposer, electrons: f32) -> f64 {
        let model = exposer.model();
        let variance = model.temporal_variance(Electrons(electrons.max(0.0).into()), exposer.exposure().time());
        model.spec().system_gain * variance.sqrt()
    }

    /// Grey values \[DN\] of a frame. `None` without a sensor.
    pub(crate) fn values(&self, frame: u32) -> Result<Option<Plane<u16>>, Fault> {
        let Some(exposer) = &self.exposer else { return Ok(None) };
        Ok(Some(match self.camera.noise {
            Noise::None => exposer.electrons().map(|&e| (Self::expected(exposer, e) + 0.5) as u16),
            Noise::Plain | Noise::Matched => exposer.frame(frame)?,
        }))
    }

    /// A frame with its description: grey values of a monochrome sensor, or a picture in colours, computed on the threads of the
    /// session.
    pub(crate) fn frame(&self, frame: u32, tone: Tone, session: &Session<'_>) -> Result<(FrameHeader, Vec<u8>), Fault> {
        let began = Instant::now();
        let [width, height] = self.snapshot.size();
        let mut header = FrameHeader {
            width,
            height,
            format: "rgb8",
            white: 1.0,
            black: 0.0,
            film: self.snapshot.id,
            exposure: None,
            no_light: false,
            is_black: false,
            saturated: 0.0,
            matched: None,
            analysis: self.readiness(),
            mean_value: 0.0,
            mean_electrons: 0.0,
            compute: 0.0,
        };
        let describe = |exposer: &Exposer| {
            header.white = exposer.model().saturation_value().0;
            header.black = exposer.model().spec().offset.0;
            header.exposure = Some(exposer.exposure().time().0);
            header.no_light = exposer.no_light();
            header.is_black = exposer.is_black();
            header.saturated = exposer.saturated();
            header.matched = exposer.matched();
            header.mean_electrons = mean(exposer.electrons().data().iter().map(|&e| f64::from(e)));
        };
        let (values, ()) = session.join(|| self.values(frame), || self.exposer.as_ref().map_or((), describe));
        let payload = match (&self.exposer, values?) {
            (Some(exposer), Some(values)) => {
                let model = exposer.model();
                let mean_value = || mean(values.data().iter().map(|&v| f64::from(v)));
                let payload = || match model.spec().quantum_efficiency.filter() {
                    None => ("gray16", little_endian(values.data(), |v| v.to_le_bytes())),
                    Some(_) => match Picture::from_values(&values, model) {
                        Picture::Rgb(picture) => ("rgb8", toned(picture.data(), tone)),
                        Picture::Gray(_) => ("rgb8", Vec::new()),
                    },
                };
                let (mean_value, (format, payload)) = session.join(mean_value, payload);
                (header.mean_value, header.format) = (mean_value, format);
                payload
            }
            _ => toned(display::linear_to_8bit(&self.mean().radiance).data(), tone),
        };
        header.compute = began.elapsed().as_secs_f64();
        Ok((header, payload))
    }

    /// The share of first light in the luminance of each pixel \[%\]. NaN for a black pixel.
    fn first_light(&self) -> Result<Vec<f32>, Fault> {
        let luminance = |[r, g, b]: [f32; 3]| Rgb::new(r, g, b).luminance();
        let share = |p: &PixelSums| 100.0 * luminance(p.mean_first_light()) / luminance(p.mean().map(|v| v as f32));
        Ok(self.film()?.sums.map(share).into_vec())
    }

    /// A map of the film. Unknown values are NaN.
    pub(crate) fn map(&self, kind: MapKind) -> Result<(MapHeader, Vec<u8>), Fault> {
        let began = Instant::now();
        let [width, height] = self.snapshot.size();
        let is_exr = matches!(self.snapshot.content, Content::Exr(_));
        let without = || match &self.exposer {
            Some(_) if is_exr => {
                Fault::new("the EXR does not contain samples and noise", "open the saved film of the render")
            }
            _ => Fault::new("there is no sensor, so there is no noise to compare with", "choose a sensor"),
        };
        if is_exr && self.snapshot.samples == 0 && matches!(kind, MapKind::Samples | MapKind::Recent) {
            return Err(Fault::new("the EXR contains no numbers of samples", "open the saved film of the render"));
        }
        let of_camera = || self.exposer.as_ref().ok_or_else(without);
        let ratio = |v: f32| if v.is_finite() { v.sqrt() } else { f32::NAN };
        let counts = |plane: &Plane<u32>| plane.data().iter().map(|&n| n as f32).collect::<Vec<f32>>();
        let (unit, values) = match kind {
            MapKind::Samples => ("samples", counts(&self.snapshot.counts)),
            MapKind::Recent => ("samples", self.snapshot.recent.as_ref().map(counts).unwrap_or_default()),
            MapKind::FirstLight if is_exr => {
                let help = "open the saved film of the render";
                return Err(Fault::new("the EXR is shown without the parts of its light", help));
            }
            MapKind::FirstLight => ("%", self.first_light()?),
            MapKind::Ratio => {
                let certified = self.certified().ok_or_else(without)?;
                let pixels = certified.ratios.data().iter().zip(certified.saturated.data());
                // Pixels that the certificate leaves out are distinct from those of unknown noise, which it counts.
                ("", pixels.map(|(&v, &is_left_out)| if is_left_out { f32::NAN } else { v.sqrt() }).collect())
            }
            MapKind::CameraSigma => {
                let exposer = of_camera()?;
                let sigma = |&e: &f32| Self::camera_sigma(exposer, e) as f32;
                ("DN", exposer.electrons().data().iter().map(sigma).collect())
            }
            MapKind::RenderSigma => {
                let (exposer, certified) = (of_camera()?, self.certified().ok_or_else(without)?);
                let pixels = exposer.electrons().data().iter().zip(certified.ratios.data());
                ("DN", pixels.map(|(&e, &v)| ratio(v) * Self::camera_sigma(exposer, e) as f32).collect())
            }
        };
        if values.is_empty() {
            return Err(Fault::new("there is one picture only", "wait for the next one"));
        }
        let mut known: Vec<f32> = values.iter().copied().filter(|v| v.is_finite()).collect();
        let mut quantile = |share: f64| {
            let last = known.len().checked_sub(1)?;
            let (_, value, _) = known.select_nth_unstable_by((share * last as f64) as usize, f32::total_cmp);
            Some(f64::from(*value))
        };
        let (low, high) = (quantile(0.01).unwrap_or(0.0), quantile(0.99).unwrap_or(0.0));
        let payload = little_endian(&values, |v| v.to_le_bytes());
        let (film, compute) = (self.snapshot.id, began.elapsed().as_secs_f64());
        Ok((MapHeader { width, height, format: "f32", unit, film, compute, low, high }, payload))
    }
}

/// A fault of an EXR without noise, with the help for a page.
fn without_options(error: dunkelfeld::Error) -> Fault {
    let fault = Fault::from(error);
    match &fault.help {
        Some(help) if help.contains("--exposure-noise") => {
            let help = "choose plain noise, or open an EXR with the layer `variance`";
            Fault { help: Some(help.to_owned()), ..fault }
        }
        _ => fault,
    }
}

/// The bytes of numbers, N for each.
fn little_endian<T: Copy, const N: usize>(values: &[T], bytes_of: impl Fn(T) -> [u8; N]) -> Vec<u8> {
    let mut bytes = vec![0; N * values.len()];
    for (to, &value) in bytes.chunks_exact_mut(N).zip(values) {
        to.copy_from_slice(&bytes_of(value));
    }
    bytes
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len().max(1) as f64;
    values.sum::<f64>() / n
}

/// A picture of gamma 2.2 with another tone curve.
fn toned(picture: &[[u8; 3]], tone: Tone) -> Vec<u8> {
    let table: [u8; 256] = std::array::from_fn(|code| {
        let linear = (code as f64 / 255.0).powf(display::GAMMA);
        let value = match tone {
            Tone::Gamma => return code as u8,
            Tone::Linear => linear,
            Tone::Log => (1.0 + 1000.0 * linear).ln() / 1001f64.ln(),
        };
        (255.0 * value + 0.5) as u8
    });
    picture.iter().flatten().map(|&code| table[usize::from(code)]).collect()
}

/// A result that was found, if it may be used, or else one that is computed now. An answer that may do without it does not
/// wait for it.
fn usable<T>(
    found: Option<Found<T>>,
    accept: Accept,
    compute: impl FnOnce() -> Result<Arc<T>, Fault>,
) -> Result<(Option<Arc<T>>, Readiness), Fault> {
    let readiness = Readiness::of(found.as_ref());
    if readiness == Readiness::Exact || accept == Accept::Provisional {
        return Ok((found.map(|found| found.result), readiness));
    }
    Ok((Some(compute()?), Readiness::Exact))
}

/// The denoiser of a choice, and the choice that names it. An automatic choice takes one of the others.
fn denoiser(snapshot: &Snapshot, method: DenoiseMethod) -> Result<(Box<dyn Denoiser>, DenoiseMethod), Fault> {
    let with = |mut settings: DenoiseSettings, method: DenoiseMethod| {
        settings.method = method;
        settings
    };
    let (of_job, builtin) = (&snapshot.settings.denoise, with(DenoiseSettings::default(), DenoiseMethod::Builtin));
    let settings = match method {
        DenoiseMethod::Auto => with(of_job.clone(), DenoiseMethod::Auto),
        DenoiseMethod::Oidn => with(of_job.clone(), DenoiseMethod::Oidn),
        DenoiseMethod::Builtin | DenoiseMethod::Off => builtin.clone(),
    };
    let found = find_denoiser(&settings).map_err(|error| {
        let help = format!(
            "install Open Image DenoiseMethod 1.4 or 2 (`pip install oidn` has it), name its library by `oidn` in `[denoise]` of the job or by {OIDN_VARIABLE}, or choose the built-in filter"
        );
        Fault { help: Some(help), ..Fault::from(error) }
    });
    let denoiser = found?.ok_or_else(|| Fault::new("there is no denoiser", "choose `builtin`"))?;
    let is_builtin = find_denoiser(&builtin)?.is_some_and(|builtin| builtin.name() == denoiser.name());
    Ok((denoiser, if is_builtin { DenoiseMethod::Builtin } else { DenoiseMethod::Oidn }))
}

/// The denoised mean of a picture with factors of its lights: from its own, or from those of the lights.
fn sum(means: &[MeanImage], factors: &[f64]) -> Result<MeanImage, Fault> {
    let factor = |light: usize| factors.get(light).copied().unwrap_or(1.0);
    Ok(sum_of_means(&means.iter().enumerate().map(|(light, mean)| (mean, factor(light))).collect::<Vec<_>>())?)
}

/// Denoises a picture, or each of its lights that have films of their own.
fn denoised_means(
    snapshot: &Snapshot,
    method: DenoiseMethod,
    prepared: &Prepared,
    session: &Session<'_>,
) -> Result<Arc<Means>, Fault> {
    let (denoiser, chosen) = denoiser(snapshot, method)?;
    let denoised = |film: &RenderedFilm| {
        let denoised = denoise_film(&film.sums, &*denoiser, session);
        let mean = denoised.map_err(|e| Fault::new(e.to_string(), "choose the denoiser `builtin`"))?.mean;
        Ok::<_, Fault>(MeanImage::without_moments(mean, film.sums.has_moments()))
    };
    let means = match snapshot.film() {
        None => Means::new(),
        Some(film) if film.groups.is_empty() => vec![denoised(film)?],
        Some(film) => {
            let lights = 0..film.groups.len();
            // Each has the auxiliary layers of the picture.
            let only = |light| lights.clone().map(|other| f64::from(u8::from(other == light))).collect::<Vec<f64>>();
            lights.clone().map(|light| denoised(&film.weighted(&only(light))?)).collect::<Result<_, Fault>>()?
        }
    };
    let means = Arc::new(means);
    prepared.add_denoised(snapshot, vec![method, chosen], means.clone());
    Ok(means)
}
