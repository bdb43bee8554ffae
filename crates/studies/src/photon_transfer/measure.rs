//! The measurement: determines the missing renders, renders them one by one, then writes the report.

use super::analysis::Results;
use super::page;
use super::renders::{DENOISED, MANIFEST, MATCHED, PLAIN, RATIO, Record, Renders, SIGNAL, VERSION};
use super::runs::{Series, Unit, reference, units};
use super::settings::PtcSettings;
use crate::folder::{check_folder, free_folder};
use crate::report::table::Figures;
use crate::series::{Kept, Meter, View, push_plane, study_key};
use dunkelfeld::DefaultPath;
use dunkelfeld::Error;
use dunkelfeld::Project;
use dunkelfeld::develop_film;
use dunkelfeld::{Budget, RenderSettings, SensorChoice};
use dunkelfeld::{Progress, ProgressState, Silent, Stage};
use dunkelfeld::{Rendering, Session, camera, render};
use dunkelfeld::{denoise_film, find_denoiser};
use dunkelfeld_denoise::Denoiser;
use dunkelfeld_film::Plane;
use dunkelfeld_io::exr::ExrLayers;
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_io::layers::Triple;
use dunkelfeld_render::lens_image::LensImage;
use dunkelfeld_render::parallel::mean_image;
use dunkelfeld_sensor::ExposureNoise;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The result of a measurement.
#[derive(Clone, Debug)]
pub struct PtcOutcome {
    /// The files of the report, the page first. Empty if there are too few frames for a report.
    pub files: Vec<PathBuf>,
    /// The findings as a few lines of text.
    pub findings: Vec<String>,
    /// The figures of the report: the rows of its tables, by the name of the table. Unknown numbers are null. Empty without
    /// a report.
    pub figures: Figures,
    /// Number of finished renders, and of all.
    pub finished: [usize; 2],
    /// Was it cancelled from outside? Finished renders are kept. The same call continues with the missing ones.
    pub interrupted: bool,
    /// Samples that were not finite, negative or out of range, in all renders.
    pub invalid_samples: u64,
}

/// The default folder of a measurement: the name of the input with `-ptc`, in the current folder. It has an additional
/// number if an input is in that folder.
pub fn ptc_folder(input: &Path, inputs: &InputFiles) -> DefaultPath {
    let mut name = input.file_stem().unwrap_or_else(|| "scene".as_ref()).to_os_string();
    name.push("-ptc");
    free_folder(PathBuf::from(name), inputs)
}

/// Measures the photon transfer of a scene, and writes the report into `folder`.
///
/// `project` is the opened `input` with all settings that are not measured. Its budget, strategy, denoiser and exposure
/// noise are not used. Finished renders in the folder are not repeated; `restart` discards them.
///
/// # Errors
/// Settings outside their range, a denoiser that is not available, a folder that cannot be written to or contains the
/// results of another measurement.
pub fn ptc(
    mut project: Project,
    input: &Path,
    settings: &PtcSettings,
    folder: &Path,
    restart: bool,
    session: &Session<'_>,
) -> Result<PtcOutcome, Error> {
    settings.check()?;
    let mut inputs = project.inputs.clone();
    inputs.add_library(settings.denoise.oidn.as_deref());
    check_folder(folder, &inputs)?;
    project.settings.replay = None;
    let fitted = project.fitted()?;
    project.checked_account(&fitted)?;
    let denoiser = find_denoiser(&settings.denoise)?;
    let store = Kept::open(folder, MANIFEST, restart)?;
    let threads = session.threads();
    let names: Vec<String> = denoiser.iter().map(|d| d.name()).collect();
    let rays = camera(&project.scene, &fitted)?;
    // More frames may be added later, also other series and those of the camera. The exposure of the first render is
    // used for all.
    let mut key = study_key(VERSION, &project.scene, &rays, &fitted, threads, &names);
    key.add("number of samples of the last series", reference(settings).spp);
    store.bind(&key, |key| key)?;
    store.expect_size([fitted.width, fitted.height]);

    let with_camera = settings.camera && fitted.has_sensor();
    let all = units(settings, with_camera);
    let work = Work { project: &project, fitted: &fitted, folder: Renders { store, base: fitted.seed }, denoiser };
    let invalid_samples = work.make(&all, settings, session)?;
    session.begin(Stage::Write, 1.0, 0);
    let mut done = 0;
    for unit in &all {
        done += usize::from(work.folder.record(unit)?.is_some());
    }
    let finished = [done, all.len()];
    let denoiser = names.into_iter().next();
    let name = input.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let (files, findings, figures) = match Results::gather(&work.folder, settings, &fitted, name, denoiser, finished)? {
        Some(results) => (page::write(folder, &results)?, results.lines(), page::figures(&results)),
        None => Default::default(),
    };
    Ok(PtcOutcome { files, findings, figures, finished, interrupted: session.is_cancelled(), invalid_samples })
}

struct Work<'a> {
    project: &'a Project,
    fitted: &'a RenderSettings,
    folder: Renders,
    denoiser: Option<Box<dyn Denoiser>>,
}

impl Work<'_> {
    /// Renders the missing frames. Returns the number of invalid samples of all renders.
    fn make(&self, all: &[Unit], settings: &PtcSettings, session: &Session<'_>) -> Result<u64, Error> {
        let (mut invalid, mut done, mut missing) = (0, 0, Vec::new());
        for unit in all {
            match self.folder.record(unit)? {
                Some(record) => {
                    invalid += record.invalid_samples;
                    done += self.samples(unit);
                }
                None => missing.push(*unit),
            }
        }
        let meter = Meter::new(session.progress(), all.iter().map(|u| self.samples(u)).sum(), done);
        let metered = session.clone().with_progress(&meter);
        let first = reference(settings);
        let mut view = match self.folder.record(&first)? {
            Some(_) => Some(View::new(&self.fitted.sensor, &self.folder.radiance(&first)?)?),
            None => None,
        };
        for unit in missing {
            // A render that ends before the first progress report also appears.
            let begun = ProgressState { stage: Stage::Pilot, fraction: 0.0, elapsed: 0.0, remaining: None, samples: 0 };
            meter.update(&begun);
            if session.is_cancelled() {
                break;
            }
            let Some(record) = self.render(&unit, unit == first, &mut view, &metered)? else { break };
            invalid += record.invalid_samples;
            meter.finish(self.samples(&unit));
        }
        Ok(invalid)
    }

    fn samples(&self, unit: &Unit) -> u64 {
        u64::from(unit.spp) * u64::from(self.fitted.width) * u64::from(self.fitted.height)
    }

    /// Renders one frame and stores it; `None` if it was interrupted.
    fn render(
        &self,
        unit: &Unit,
        is_reference: bool,
        view: &mut Option<View>,
        session: &Session<'_>,
    ) -> Result<Option<Record>, Error> {
        let mut settings = self
            .fitted
            .clone()
            .with_budget(Budget::default().with_spp(f64::from(unit.spp)))
            .with_strategy(unit.strategy())
            .with_seed(unit.seed(self.fitted.seed))
            .with_frame(unit.frame);
        // All frames have the exposure of the first.
        if let (SensorChoice::Emva { exposure, .. }, Some(view)) = (&mut settings.sensor, &*view) {
            *exposure = view.exposure();
        }
        let began = Instant::now();
        let rendering = render(&self.project.scene, &settings, &session.clone().with_start(began))?;
        let seconds = began.elapsed().as_secs_f64();
        if rendering.interrupted {
            return Ok(None);
        }
        let image = session
            .install(|| LensImage::new(mean_image(&rendering.film.sums, rendering.film.is_spread), &settings.sensor));
        if view.is_none() {
            *view = Some(View::new(&self.fitted.sensor, &image.radiance)?);
        }
        let Some(view) = view.as_ref() else { return Ok(None) };
        let mut layers = ExrLayers::new(self.fitted.width, self.fitted.height);
        let mut denoise_seconds = None;
        match unit.series {
            Series::Paper => {
                push_plane(&mut layers, SIGNAL, view.signal(&image.radiance));
                if let Some(denoiser) = &self.denoiser {
                    let Some((signal, taken)) = self.denoised(&rendering, &settings, &**denoiser, view, session)?
                    else {
                        return Ok(None);
                    };
                    push_plane(&mut layers, DENOISED, signal);
                    denoise_seconds = Some(taken);
                }
                if is_reference {
                    layers.push_triples(Triple::Mean, &image.radiance);
                }
            }
            Series::Camera => self.exposures(&rendering, settings.clone(), &mut layers, session)?,
        }
        let record = Record {
            seed: settings.seed,
            frame: unit.frame,
            samples: rendering.film.sums.total_samples(),
            invalid_samples: rendering.film.sums.invalid_samples(),
            seconds,
            denoise_seconds,
        };
        self.folder.store.keep(&unit.name(), &record, layers)?;
        Ok(Some(record))
    }

    /// The denoised signal, and its duration; `None` if it was cancelled.
    fn denoised(
        &self,
        rendering: &Rendering,
        settings: &RenderSettings,
        denoiser: &dyn Denoiser,
        view: &View,
        session: &Session<'_>,
    ) -> Result<Option<(Plane<f32>, f64)>, Error> {
        let run = || denoise_film(&rendering.film.sums, denoiser, &session.clone().with_progress(&Silent));
        match session.install(run) {
            Ok(done) => Ok(Some((session.install(|| view.denoised(done.mean, settings)), done.seconds))),
            Err(_) if session.is_cancelled() => Ok(None),
            Err(e) => {
                let help = "choose another denoiser with --denoise; the renders that are finished are kept";
                Err(Error::setting("denoise", format!("{}: {e}", denoiser.name()), help))
            }
        }
    }

    /// The frames of the sensor for a render.
    fn exposures(
        &self,
        rendering: &Rendering,
        mut settings: RenderSettings,
        layers: &mut ExrLayers,
        session: &Session<'_>,
    ) -> Result<(), Error> {
        for (layer, noise) in [(PLAIN, ExposureNoise::Plain), (MATCHED, ExposureNoise::Matched)] {
            settings.exposure_noise = noise;
            let developed = session.install(|| develop_film(&rendering.film, &settings))?;
            let Some(frame) = developed.sensor else { continue };
            push_plane(layers, layer, frame.values.map(|&v| f32::from(v)));
            if let Some(matched) = &frame.matched {
                push_plane(layers, RATIO, matched.ratios.clone());
            }
        }
        Ok(())
    }
}
