//! The measurement: determines the missing renders, renders them one by one, and writes the report.

use super::denoised::{Filter, filters};
use super::page;
use super::results::{About, Results};
use super::runs::{Purpose, Unit, units};
use super::settings::{BenchSettings, can_be_left_out};
use super::store::{Manifest, Record, Store, VERSION, layers};
use super::tables::tables;
use crate::folder::{check_folder, free_folder};
use crate::report::table::{Figures, figures};
use crate::series::{Meter, View, study_key};
use dunkelfeld::DefaultPath;
use dunkelfeld::Error;
use dunkelfeld::develop_film;
use dunkelfeld::save_picture;
use dunkelfeld::{Budget, RenderSettings, SensorChoice};
use dunkelfeld::{Progress, ProgressState, Stage};
use dunkelfeld::{Project, ProjectOptions};
use dunkelfeld::{Rendering, Session, camera, render};
use dunkelfeld_adaptive::weights::Strategy;
use dunkelfeld_film::Plane;
use dunkelfeld_io::input::InputFiles;
use dunkelfeld_render::lens_image::LensImage;
use dunkelfeld_render::parallel::mean_image;
use dunkelfeld_scene::{Effect, Scene};
use dunkelfeld_sensor::ExposureNoise;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Approximate duration of the renders of a quick bench \[s\]. Reading, writing and the report are additional.
const QUICK_SECONDS: f64 = 30.0;
/// Longest and shortest long side of a quick bench's film \[pixels\].
const QUICK_SIDES: [u32; 2] = [32, 256];
/// Long side of the film, and samples per pixel, of the render that measures the speed for a quick bench.
const TRIAL: (u32, u32) = (64, 8);

/// The result of a bench.
#[derive(Clone, Debug)]
pub struct BenchOutcome {
    /// The files of the report, the page first.
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

/// The default folder of a bench: the name of the input with `-bench`, in the current folder. It has an additional
/// number if an input is in that folder.
pub fn default_folder(input: &Path, inputs: &InputFiles) -> DefaultPath {
    let mut name = input.file_stem().unwrap_or_else(|| "scene".as_ref()).to_os_string();
    name.push("-bench");
    free_folder(PathBuf::from(name), inputs)
}

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
) -> Result<BenchOutcome, Error> {
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
    let reference = Unit { purpose: Purpose::Reference, spp: settings.reference_spp, index: 0 };
    let bench = Bench {
        project: &project,
        input,
        fitted: &fitted,
        store: &store,
        filters: &filters,
        reference,
        top: top(settings),
    };
    let invalid_samples = bench.make(&all, session)?;
    session.begin(Stage::Write, 1.0, 0);
    let finished = [count_finished(&store, &all, fitted.seed)?, all.len()];
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
    Ok(BenchOutcome { files, findings, figures, finished, interrupted: session.is_cancelled(), invalid_samples })
}

/// Without a sensor there is no data for the strategy `sensor`. The list of all strategies leaves it out. If it is
/// named, it is refused.
fn for_sensor(settings: &BenchSettings, has_sensor: bool) -> Result<BenchSettings, Error> {
    let mut settings = settings.clone();
    if !has_sensor && settings.strategies == Strategy::ALL {
        settings.strategies.retain(|s| *s != Strategy::Sensor);
    }
    if !has_sensor && settings.strategies.contains(&Strategy::Sensor) {
        let problem = "the strategy `sensor` needs a sensor, and there is none";
        return Err(Error::setting("strategies", problem, "choose a sensor, or leave out the strategy `sensor`"));
    }
    Ok(settings)
}

fn count_finished(store: &Store, all: &[Unit], base_seed: u64) -> Result<usize, Error> {
    let mut n = 0;
    for unit in all {
        n += usize::from(store.record(unit, base_seed)?.is_some());
    }
    Ok(n)
}

fn top(settings: &BenchSettings) -> u32 {
    settings.ladder.last().copied().unwrap_or(1)
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
    let ladder: f64 = settings.ladder.iter().map(|&n| f64::from(n)).sum::<f64>() * settings.strategies.len() as f64;
    let ablation = if effects > 0 { (effects + 1) as f64 * f64::from(settings.effect_spp) } else { 0.0 };
    let per_pixel = (ladder + ablation) * f64::from(settings.seeds) + f64::from(settings.reference_spp);
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
    /// Renders the missing units. Returns the number of invalid samples of all renders.
    fn make(&self, all: &[Unit], session: &Session<'_>) -> Result<u64, Error> {
        let base = self.fitted.seed;
        let mut invalid = 0;
        let mut missing = Vec::new();
        let mut done = 0;
        for unit in all {
            match self.store.record(unit, base)? {
                Some(record) => {
                    invalid += record.invalid_samples;
                    done += self.samples(unit);
                }
                None => missing.push(*unit),
            }
        }
        let total: u64 = all.iter().map(|u| self.samples(u)).sum();
        let meter = Meter::new(session.progress(), total, done);
        let metered = session.clone().with_progress(&meter);
        let mut view = None;
        let mut other: Option<(Effect, Scene, RenderSettings)> = None;
        for unit in missing {
            // A unit that ends before the first progress report also appears.
            let begun = ProgressState { stage: Stage::Pilot, fraction: 0.0, elapsed: 0.0, remaining: None, samples: 0 };
            meter.update(&begun);
            if session.is_cancelled() {
                break;
            }
            let (scene, settings) = match unit.without() {
                None => (&self.project.scene, self.fitted),
                Some(effect) => {
                    if other.as_ref().is_none_or(|(e, ..)| *e != effect) {
                        let (scene, settings) = self.without(effect)?;
                        other = Some((effect, scene, settings));
                    }
                    other.as_ref().map_or((&self.project.scene, self.fitted), |(_, scene, settings)| (scene, settings))
                }
            };
            let Some(record) = self.render(&unit, scene, settings, &mut view, &metered)? else { break };
            invalid += record.invalid_samples;
            meter.finish(self.samples(&unit));
        }
        Ok(invalid)
    }

    fn samples(&self, unit: &Unit) -> u64 {
        u64::from(unit.spp) * u64::from(self.fitted.width) * u64::from(self.fitted.height)
    }

    /// The scene without an effect, and its settings.
    fn without(&self, effect: Effect) -> Result<(Scene, RenderSettings), Error> {
        let mut other = Project::open_with(
            self.input,
            ProjectOptions::default()
                .with_without(vec![effect])
                .with_can_change(false)
                .with_threads(self.project.settings.threads),
        )?;
        other.take_settings_of(self.project);
        other.settings.without = vec![effect];
        let settings = other.fitted()?;
        Ok((other.scene, settings))
    }

    /// Renders one unit and stores it. `None` if it was interrupted.
    fn render(
        &self,
        unit: &Unit,
        scene: &Scene,
        settings: &RenderSettings,
        view: &mut Option<(View, Vec<bool>)>,
        session: &Session<'_>,
    ) -> Result<Option<Record>, Error> {
        let settings = settings
            .clone()
            .with_budget(Budget::default().with_spp(f64::from(unit.spp)))
            .with_strategy(unit.strategy())
            .with_seed(unit.seed(self.fitted.seed))
            .with_replay(None);
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
            let done = session.install(|| filter.apply(&rendering.film.sums, &settings, view, session))?;
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
        Ok(Some(record))
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
