//! The measurement: determines the missing renders, renders them one by one, and writes the report.

use super::denoised::{Filter, filters};
use super::page;
use super::results::{About, Results};
use super::runs::{Purpose, Unit, units};
use super::settings::{BenchSettings, can_be_left_out};
use super::store::{Manifest, Record, Store, VERSION, layers};
use super::tables::tables;
use crate::folder::check_folder;
use crate::report::table::figures;
use crate::series::{Made, StudyOutcome, View, render_missing, study_key};
use dunkelfeld::adaptive::Strategy;
use dunkelfeld::film::{LensImage, Plane, mean_image};
use dunkelfeld::scene::{Effect, Scene};
use dunkelfeld::sensor::ExposureNoise;
use dunkelfeld::{
    Budget, Error, Project, ProjectOptions, RenderSettings, Rendering, SensorChoice, Session, Stage, camera,
    develop_film, render, save_picture,
};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// Approximate duration of the renders of a quick bench \[s\]. Reading, writing and the report are additional.
const QUICK_SECONDS: f64 = 30.0;
/// Longest and shortest long side of a quick bench's film \[pixels\].
const QUICK_SIDES: [u32; 2] = [32, 256];
/// Long side of the film, and samples per pixel, of the render that measures the speed for a quick bench.
const TRIAL: (u32, u32) = (64, 8);

/// Measures the cost of accuracy in time, and writes the report into `folder`.
///
/// `project` is the opened `input` with all settings that are not measured. Its budget, strategy and exposure noise are
/// not used. Finished renders in the folder are not repeated. `own_size` means that the caller has set the size of the
/// film, so that a quick bench does not change it. `restart` discards the content of the folder.
///
/// # Errors
/// Settings outside their range, a folder that cannot be written to or contains an input or the results of another
/// bench.
pub fn bench(
    mut project: Project,
    input: &Path,
    settings: &BenchSettings,
    folder: &Path,
    own_size: bool,
    restart: bool,
    session: &Session<'_>,
) -> Result<StudyOutcome, Error> {
    settings.check()?;
    check_folder(folder, &project.inputs)?;
    // The bench measures the noise of the renders. No processing of the picture may hide it.
    project.settings.exposure_noise = ExposureNoise::Plain;
    let settings = &for_sensor(settings, project.settings.has_sensor())?;
    let filters = filters(settings)?;
    let store = Store::open(folder, restart)?;
    let effects = effects(&project, settings);
    if settings.quick && !own_size {
        // A continued bench keeps its film.
        let size = match store.manifest()?.filter(|m| m.settings.quick) {
            Some(there) => there.size,
            None => quick_size(&project, settings, effects.len(), session)?,
        };
        project.resize_keeping_view(size[0], size[1]);
    }
    let fitted = project.fitted()?;
    project.checked_account(&fitted)?;
    let threads = session.threads();
    let names: Vec<String> = filters.iter().map(Filter::name).collect();
    let camera = camera(&project.scene, &fitted)?;
    let key = study_key(VERSION, &project.scene, &camera, &fitted, threads, &names);
    let binding = Manifest::new(key, [fitted.width, fitted.height], settings.summary());
    store.bind(&binding)?;

    let all = units(settings, &effects, fitted.pilot_spp);
    let reference = Unit { purpose: Purpose::Reference, spp: settings.reference_spp(), index: 0 };
    let bench = Bench {
        project: &project,
        input,
        fitted: &fitted,
        store: &store,
        filters: &filters,
        reference,
        top: settings.top(),
    };
    let Made { finished, invalid_samples } = bench.make(&all, session)?;
    session.begin(Stage::Write, 1.0, 0);
    let about = About {
        name: input.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        threads,
        finished,
        effects: &effects,
        denoisers: filters.iter().map(|f| f.key).zip(names).collect(),
        reference,
    };
    // Without the reference there is no result.
    let (files, findings, figures) = match Results::gather(&store, settings, &fitted, &about)? {
        Some(results) => (page::write(folder, &results)?, results.findings(), figures(&tables(&results))),
        None => Default::default(),
    };
    Ok(StudyOutcome { files, findings, figures, finished, interrupted: session.is_cancelled(), invalid_samples })
}

/// Without a sensor there is no data for the strategy `sensor`. The list of all strategies leaves it out. If it is
/// named, it is refused.
fn for_sensor(settings: &BenchSettings, has_sensor: bool) -> Result<BenchSettings, Error> {
    let mut settings = settings.clone();
    if !has_sensor && settings.strategies() == Strategy::ALL {
        settings.strategies = Strategy::ALL.into_iter().filter(|s| *s != Strategy::Sensor).collect();
    }
    if !has_sensor && settings.strategies.contains(&Strategy::Sensor) {
        let problem = "the strategy `sensor` needs a sensor, and there is none";
        return Err(Error::setting("strategies", problem, "choose a sensor, or leave out the strategy `sensor`"));
    }
    Ok(settings)
}

/// The effects to leave out: those of the settings, or all effects of the scene. Both lists contain only effects that
/// can be left out.
fn effects(project: &Project, settings: &BenchSettings) -> Vec<Effect> {
    let called: Vec<String> = project.inspect().effects.into_iter().filter(|e| e.on).map(|e| e.name).collect();
    let is_called = |e: &Effect| called.iter().any(|name| name == e.name());
    let wanted = |e: &Effect| settings.effects.as_ref().is_none_or(|list| list.contains(e));
    Effect::ALL.into_iter().filter(|e| can_be_left_out(*e) && is_called(e) && wanted(e)).collect()
}

/// The film of a quick bench: the largest that this machine can render in the time.
fn quick_size(
    project: &Project,
    settings: &BenchSettings,
    effects: usize,
    session: &Session<'_>,
) -> Result<[u32; 2], Error> {
    let (width, height) = (project.settings.width, project.settings.height);
    let long = width.max(height);
    let sized = |side: u32| {
        let scale = f64::from(side.min(long)) / f64::from(long);
        [width, height].map(|v| ((f64::from(v) * scale).round() as u32).max(1))
    };
    let mut trial = project.fitted()?;
    let [w, h] = sized(TRIAL.0);
    (trial.width, trial.height) = (w, h);
    trial.budget = Budget::default().with_spp(f64::from(TRIAL.1));
    let began = Instant::now();
    let rendering =
        render(&project.scene, &trial, &session.clone().with_start(began).with_progress(&dunkelfeld::Silent))?;
    let rate = rendering.film.sums.total_samples() as f64 / began.elapsed().as_secs_f64().max(1e-6);
    let ladder: f64 = settings.ladder().iter().map(|&n| f64::from(n)).sum::<f64>() * settings.strategies().len() as f64;
    let ablation = if effects > 0 { (effects + 1) as f64 * f64::from(settings.effect_spp()) } else { 0.0 };
    let per_pixel = (ladder + ablation) * f64::from(settings.seeds()) + f64::from(settings.reference_spp());
    let pixels = QUICK_SECONDS * rate / per_pixel;
    let side = (pixels * f64::from(long).powi(2) / (f64::from(width) * f64::from(height))).sqrt();
    Ok(sized((side as u32).clamp(QUICK_SIDES[0], QUICK_SIDES[1])))
}

/// A bench in progress.
struct Bench<'a> {
    project: &'a Project,
    input: &'a Path,
    fitted: &'a RenderSettings,
    store: &'a Store,
    filters: &'a [Filter],
    reference: Unit,
    /// Samples per pixel of the top rung, whose exposure and output are timed.
    top: u32,
}

impl Bench<'_> {
    /// Renders the missing units.
    fn make(&self, all: &[Unit], session: &Session<'_>) -> Result<Made, Error> {
        let finished =
            |unit: &Unit| Ok(self.store.record(unit, self.fitted.seed)?.map(|record| record.invalid_samples));
        let mut view = None;
        let mut other: Option<(Effect, Scene, RenderSettings)> = None;
        render_missing(
            all,
            ([self.fitted.width, self.fitted.height], |unit| unit.spp),
            finished,
            session,
            |unit, session| {
                let (scene, settings) = match unit.without() {
                    None => (&self.project.scene, self.fitted),
                    Some(effect) => {
                        if other.as_ref().is_none_or(|(e, ..)| *e != effect) {
                            let (scene, settings) = self.without(effect)?;
                            other = Some((effect, scene, settings));
                        }
                        other
                            .as_ref()
                            .map_or((&self.project.scene, self.fitted), |(_, scene, settings)| (scene, settings))
                    }
                };
                self.render(unit, scene, settings, &mut view, session)
            },
        )
    }

    /// The scene without an effect, and its settings.
    fn without(&self, effect: Effect) -> Result<(Scene, RenderSettings), Error> {
        let mut other = Project::open_with(
            self.input,
            ProjectOptions::default()
                .with_without(vec![effect])
                .with_can_change(false)
                .with_threads(self.project.settings.run.threads),
        )?;
        other.take_settings_of(self.project);
        other.settings.run.without = vec![effect];
        let settings = other.fitted()?;
        Ok((other.scene, settings))
    }

    /// Renders one unit and stores it. Returns its invalid samples; `None` if it was interrupted.
    fn render(
        &self,
        unit: &Unit,
        scene: &Scene,
        settings: &RenderSettings,
        view: &mut Option<(View, Vec<bool>)>,
        session: &Session<'_>,
    ) -> Result<Option<u64>, Error> {
        let settings = settings
            .clone()
            .with_budget(Budget::default().with_spp(f64::from(unit.spp)))
            .with_strategy(unit.strategy())
            .with_seed(unit.seed(self.fitted.seed))
            .running(|run| run.with_replay(None));
        let began = Instant::now();
        let rendering = render(scene, &settings, &session.clone().with_start(began))?;
        if rendering.interrupted {
            return Ok(None);
        }
        let image = session
            .install(|| LensImage::new(mean_image(&rendering.film.sums, rendering.film.is_spread), &settings.sensor));
        let total_seconds = began.elapsed().as_secs_f64();
        let mut seconds = BTreeMap::new();
        for (stage, s) in &rendering.stages {
            *seconds.entry(stage.name().to_string()).or_insert(0.0) += s;
        }
        if view.is_none() {
            *view = Some(self.view(unit, &image.radiance)?);
        }
        let Some((view, counts)) = view.as_ref() else { return Ok(None) };
        if matches!(unit.purpose, Purpose::Point(_)) && unit.spp == self.top && unit.index == 0 {
            self.close(unit, &rendering, &settings, view, &mut seconds, session)?;
        }
        let stated = session.install(|| view.signal_variance(&rendering.film, &image))?;
        let is_reference = unit.purpose == Purpose::Reference;
        let is_point = matches!(unit.purpose, Purpose::Point(_));
        let mut denoised = Vec::new();
        for filter in self.filters.iter().filter(|_| is_point) {
            let done = filter.apply(&rendering.film.sums, &settings, view, session)?;
            let Some(done) = done else { return Ok(None) };
            denoised.push(done);
        }
        let record = Record {
            name: unit.name(),
            seed: settings.seed,
            allocation: unit.strategy().name().into(),
            without: unit.without().map(|e| e.name().into()),
            spp: unit.spp,
            samples: rendering.film.sums.total_samples(),
            invalid_samples: rendering.film.sums.invalid_samples(),
            seconds,
            total_seconds,
            lanes: rendering.lane_use.shares().map(|(stage, share)| (stage.into(), share)).collect(),
            denoise_seconds: denoised.iter().map(|d| (d.key.to_string(), d.seconds)).collect(),
            stated_variance: Some(super::statistics::masked_mean(&stated, counts)).filter(|v| v.is_finite()),
        };
        let keeps_counts = is_point && unit.index == 0;
        let (signal, counts) = (view.signal(&image.radiance), keeps_counts.then(|| rendering.plan()));
        self.store.keep(&record, layers(signal, denoised, counts, is_reference.then_some(&image.radiance)))?;
        Ok(Some(record.invalid_samples))
    }

    /// The camera view of all units, and the unsaturated pixels. Both follow from the reference, which is the first
    /// unit.
    fn view(&self, unit: &Unit, radiance: &Plane<[f32; 3]>) -> Result<(View, Vec<bool>), Error> {
        let kept;
        let reference = match unit.purpose {
            Purpose::Reference => radiance,
            _ => {
                kept = self.store.radiance(&self.reference)?;
                &kept
            }
        };
        let view = View::new(&self.fitted.sensor, reference)?;
        let counts = view.unsaturated(&view.signal(reference));
        Ok((view, counts))
    }

    /// Exposes and writes a picture as `render` does, to measure the time.
    fn close(
        &self,
        unit: &Unit,
        rendering: &Rendering,
        settings: &RenderSettings,
        view: &View,
        seconds: &mut BTreeMap<String, f64>,
        session: &Session<'_>,
    ) -> Result<(), Error> {
        let mut settings = settings.clone();
        if let SensorChoice::Emva { exposure, .. } = &mut settings.sensor {
            *exposure = view.exposure();
        }
        let began = Instant::now();
        let frame = session.install(|| develop_film(&rendering.film, &settings))?;
        seconds.insert(Stage::Expose.name().into(), began.elapsed().as_secs_f64());
        let began = Instant::now();
        save_picture(&frame, &self.store.picture(unit))?;
        seconds.insert(Stage::Write.name().into(), began.elapsed().as_secs_f64());
        Ok(())
    }
}
