//! The measurement: determines the missing renders, renders them one by one, then writes the report.

use super::analysis::Results;
use super::page;
use super::renders::{DENOISED, MANIFEST, MATCHED, PLAIN, RATIO, Record, Renders, SIGNAL, VERSION};
use super::runs::{Series, Unit, reference, units};
use super::settings::PtcSettings;
use crate::folder::check_folder;
use crate::series::{Kept, Made, StudyOutcome, View, push_plane, render_missing, study_key};
use dunkelfeld::denoising::{Denoiser, find_denoiser};
use dunkelfeld::film::{LensImage, mean_image};
use dunkelfeld::sensor::ExposureNoise;
use dunkelfeld::{
    Budget, Error, Project, RenderSettings, Rendering, SensorChoice, Session, Stage, camera, develop_film, render,
};
use dunkelfeld_io::exr::ExrLayers;
use dunkelfeld_io::layers::Triple;
use std::path::Path;
use std::time::Instant;

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
) -> Result<StudyOutcome, Error> {
    settings.check()?;
    let mut inputs = project.inputs.clone();
    inputs.add_library(settings.oidn.as_deref());
    check_folder(folder, &inputs)?;
    project.settings.run.replay = None;
    let fitted = project.fitted()?;
    project.checked_account(&fitted)?;
    let denoiser = find_denoiser(&settings.denoise())?;
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

    let with_camera = !settings.pictures_only && fitted.has_sensor();
    let all = units(settings, with_camera);
    let work = Work { project: &project, fitted: &fitted, folder: Renders { store, base: fitted.seed }, denoiser };
    let Made { finished, invalid_samples } = work.make(&all, reference(settings), session)?;
    session.begin(Stage::Write, 1.0, 0);
    let denoiser = names.into_iter().next();
    let name = input.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let (files, findings, figures) = match Results::gather(&work.folder, settings, &fitted, name, denoiser, finished)? {
        Some(results) => (page::write(folder, &results)?, results.lines(), page::figures(&results)),
        None => Default::default(),
    };
    Ok(StudyOutcome { files, findings, figures, finished, interrupted: session.is_cancelled(), invalid_samples })
}

struct Work<'a> {
    project: &'a Project,
    fitted: &'a RenderSettings,
    folder: Renders,
    denoiser: Option<Box<dyn Denoiser>>,
}

impl Work<'_> {
    /// Renders the missing frames.
    fn make(&self, all: &[Unit], first: Unit, session: &Session<'_>) -> Result<Made, Error> {
        let finished = |unit: &Unit| Ok(self.folder.record(unit)?.map(|record| record.invalid_samples));
        let mut view = match finished(&first)? {
            Some(_) => Some(View::new(&self.fitted.sensor, &self.folder.radiance(&first)?)?),
            None => None,
        };
        render_missing(
            all,
            ([self.fitted.width, self.fitted.height], |unit| unit.spp),
            finished,
            session,
            |unit, session| self.render(unit, *unit == first, &mut view, session),
        )
    }

    /// Renders one frame and stores it. Returns its invalid samples; `None` if it was interrupted.
    fn render(
        &self,
        unit: &Unit,
        is_reference: bool,
        view: &mut Option<View>,
        session: &Session<'_>,
    ) -> Result<Option<u64>, Error> {
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
                    let done = view.denoised(&rendering.film.sums, &**denoiser, &settings, session)?;
                    let Some((signal, taken)) = done else { return Ok(None) };
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
        Ok(Some(record.invalid_samples))
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
