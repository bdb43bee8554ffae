//! Compares the sample plan of the program with a baseline of two half-buffers, each planned by the other.
//!
//! `cargo run --release -p dunkelfeld --example half_buffers -- [--spp 64] [--seeds 1] [--size 96] [--training 20480]
//! [--truth 16] JOB ...`
//!
//! A half-buffer is a render with half of the samples and with a seed of its own. Both begin with an eighth of the budget
//! in each pixel. Twice the number of samples is doubled: each pixel of one half then gets samples in proportion to the
//! square root of v / s (Neyman 1934), from the squares of the samples of the *other* half, averaged over 5 x 5 pixels. v is
//! the variance of a sample [e-^2] and s the variance of the sensor [e-^2]. The image is the mean of the two halves with
//! equal weights. Its effective number of samples is `4 / (1 / n_a + 1 / n_b)`. Weights by the numbers of samples would
//! need fewer samples, but are biased: they depend on the samples.
//!
//! The true v of a pixel is 64 times the variance of its mean over `--truth` uniform renders of 64 samples per pixel. A
//! job without a sensor gets the default one. Per job the program prints, for `uniform`, for the plan and for the
//! half-buffers: mean, 90 % quantile and 99 % quantile of v / (n s) over the unsaturated pixels, the mean of the squared
//! error of the image over s, its relative squared error, and the relative error of the mean of the image. The last
//! lines are geometric means over all jobs, of the ratios to the plan.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "an example talks to its reader")]

use dunkelfeld::adaptive::Strategy;
use dunkelfeld::film::{Film, Plane};
use dunkelfeld::{Budget, Error, Project, RenderSettings, Rendering, SensorChoice, Session, render, scene::Scene};
use dunkelfeld_adaptive::{SensorNoise, Shares, plan};
use dunkelfeld_render::film_noise::{per_luminance, sensor_noise, signal_scatter};
use dunkelfeld_sensor::{ImageExposure, Response, Weights};
use std::path::PathBuf;
use std::process::ExitCode;

/// Samples per pixel of the renders from which v is measured.
const TRUTH_SPP: f64 = 64.0;
/// First seed of these renders, and of the half-buffers.
const SEEDS: (u64, u64) = (10_000, 1_000);
/// Number of times that the samples of the half-buffers are doubled.
const DOUBLINGS: u32 = 2;
/// Radius of the average of v / s \[pixels\].
const REACH: u32 = 2;
/// Least v / s of a pixel, over the mean of the image.
const FLOOR: f32 = 0.01;

const NAMES: [&str; 3] = ["uniform", "plan", "half-buffers"];
const FIGURES: [&str; 6] = ["mean", "90 %", "99 %", "error / s", "relative", "mean of image"];

struct Options {
    spp: f64,
    seeds: u64,
    size: u32,
    training: u32,
    truth: u64,
    jobs: Vec<PathBuf>,
}

/// A scene with its true noise.
struct Setup {
    scene: Scene,
    settings: RenderSettings,
    session: Session<'static>,
    /// Electrons per radiance.
    weights: Weights,
    sensor: SensorNoise,
    /// Mean electrons of each pixel.
    mean: Vec<f64>,
    /// v / s of each pixel.
    ratio: Vec<f64>,
}

impl Setup {
    fn new(job: &PathBuf, options: &Options) -> Result<Self, Error> {
        let mut project = Project::open(job)?;
        if !project.settings.has_sensor() {
            let model = Box::new(dunkelfeld::find_sensor(dunkelfeld::DEFAULT_SENSOR)?);
            project.settings.sensor = SensorChoice::Emva { model, optics: project.optics, exposure: None };
        }
        (project.settings.width, project.settings.height) = (options.size, options.size);
        project.settings.training_paths = Some(options.training);
        project.settings.budget = Budget::default();
        let (mut settings, session) = (project.fitted()?, Session::new(project.settings.threads)?);
        settings.strategy = Some(Strategy::Uniform);
        settings.budget.spp = Some(TRUTH_SPP);
        let mut films = Vec::new();
        for i in 0..options.truth {
            settings.seed = SEEDS.0 + i;
            films.push(render(&project.scene, &settings, &session)?.film.sums.mean());
        }
        let of_pixel =
            |i: usize| [0, 1, 2].map(|c| films.iter().map(|f| f.data()[i][c]).sum::<f32>() / films.len() as f32);
        let mean = Plane::from_fn(options.size, options.size, |x, y| of_pixel((y * options.size + x) as usize));
        let SensorChoice::Emva { model, optics, exposure } = &settings.sensor else {
            unreachable!("the job has a sensor");
        };
        let exposure = ImageExposure::new(*exposure, &mean, model, optics)?.exposure;
        let (weights, sensor) = (Response::new(model, optics, exposure).average(), sensor_noise(model, exposure));
        settings.sensor = SensorChoice::Emva { model: model.clone(), optics: *optics, exposure: Some(exposure) };
        let mean = electrons(&mean, weights);
        let mut ratio = vec![0.0; mean.len()];
        for film in &films {
            for ((ratio, e), &mean) in ratio.iter_mut().zip(electrons(film, weights)).zip(&mean) {
                *ratio += TRUTH_SPP * (e - mean).powi(2) / (options.truth - 1) as f64 / sensor.variance(mean);
            }
        }
        Ok(Self { scene: project.scene, settings, session, weights, sensor, mean, ratio })
    }

    fn render(&self, seed: u64, change: impl FnOnce(&mut RenderSettings)) -> Result<Rendering, Error> {
        let mut settings = self.settings.clone();
        settings.seed = seed;
        change(&mut settings);
        render(&self.scene, &settings, &self.session)
    }

    /// The figures of a render with the given effective samples per pixel and the given image \[electrons\].
    fn figures(&self, samples: &[f64], image: &[f64]) -> [f64; 6] {
        let open: Vec<usize> = (0..self.mean.len()).filter(|&i| self.mean[i] <= self.sensor.saturation).collect();
        let mut noise: Vec<f64> = open.iter().map(|&i| self.ratio[i] / samples[i]).collect();
        noise.sort_by(f64::total_cmp);
        let quantile = |share: f64| noise[((share * noise.len() as f64).ceil() as usize).saturating_sub(1)];
        let average = |f: &dyn Fn(usize) -> f64| open.iter().map(|&i| f(i)).sum::<f64>() / open.len() as f64;
        let grand = average(&|i| self.mean[i]);
        let error = |i: usize| image[i] - self.mean[i];
        [
            noise.iter().sum::<f64>() / noise.len() as f64,
            quantile(0.9),
            quantile(0.99),
            average(&|i| error(i).powi(2) / self.sensor.variance(self.mean[i])),
            average(&|i| error(i).powi(2) / (self.mean[i].powi(2) + 1e-4 * grand * grand)),
            average(&error) / grand,
        ]
    }

    /// v / s of the pixels of a film, from the squares of the samples, averaged over a box.
    fn noise(&self, film: &Film) -> Plane<f32> {
        let own = film.map(|p| {
            let (electrons, of_batches) = p.weighted_mean_and_variance(self.weights.0);
            let (factor, _) = per_luminance(self.weights, p.mean());
            let variance = p.scatter().map_or(of_batches, |s| signal_scatter(s, factor).all);
            let is_used = variance.is_finite() && !self.sensor.is_saturated(electrons, variance);
            let ratio = variance * f64::from(p.count()) / self.sensor.variance(electrons);
            if is_used { ratio as f32 } else { 0.0 }
        });
        Plane::from_fn(own.width(), own.height(), |x, y| {
            let rows = y.saturating_sub(REACH)..(y + REACH + 1).min(own.height());
            let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(own.width());
            let sum: f32 =
                rows.clone().flat_map(|y| columns.clone().map(move |x| (x, y))).map(|(x, y)| own.at(x, y)).sum();
            sum / (rows.len() * columns.len()) as f32
        })
    }

    /// Effective samples per pixel, and the image \[electrons\], of two half-buffers.
    fn half_buffers(&self, spp: f64, seed: u64) -> Result<(Vec<f64>, Vec<f64>), Error> {
        let (width, height) = (self.settings.width, self.settings.height);
        let film = |half: u64, counts: &Plane<u32>| -> Result<Film, Error> {
            let plan = counts.clone();
            Ok(self.render(SEEDS.1 + 2 * seed + half, |s| s.replay = Some(plan))?.film.sums)
        };
        let weights = |film: &Film| {
            let noise = self.noise(film);
            let least = FLOOR * noise.data().iter().sum::<f32>() / noise.data().len() as f32;
            Shares::from_weights(noise.map(|v| v.max(least).sqrt()))
        };
        let first = plan::total_for_mean(0.5 * spp / f64::from(1 << DOUBLINGS), self.mean.len() as u64);
        let even = Shares::from_weights(Plane::new(width, height, 1.0));
        let mut counts = [0, 1].map(|_| plan::next_round(&plan::empty(width, height), &even, first));
        let mut films = [film(0, &counts[0])?, film(1, &counts[1])?];
        for doubling in 1..=DOUBLINGS {
            let next = |own: usize| plan::next_round(&counts[own], &weights(&films[1 - own]), first << doubling);
            counts = [next(0), next(1)];
            films = [film(0, &counts[0])?, film(1, &counts[1])?];
        }
        let pairs = counts[0].data().iter().zip(counts[1].data());
        let samples = pairs.map(|(&a, &b)| 4.0 / (f64::from(a).recip() + f64::from(b).recip())).collect();
        let [a, b] = films.map(|film| electrons(&film.mean(), self.weights));
        Ok((samples, a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect()))
    }

    /// The figures of the three renders of a seed.
    fn compare(&self, spp: f64, seed: u64) -> Result<[[f64; 6]; 3], Error> {
        let by = |strategy: Strategy| -> Result<[f64; 6], Error> {
            let rendering = self.render(seed, |s| {
                (s.strategy, s.budget.spp) = (Some(strategy), Some(spp));
            })?;
            let samples: Vec<f64> = rendering.plan().data().iter().map(|&n| f64::from(n)).collect();
            Ok(self.figures(&samples, &electrons(&rendering.film.sums.mean(), self.weights)))
        };
        let (samples, image) = self.half_buffers(spp, seed)?;
        Ok([by(Strategy::Uniform)?, by(Strategy::Sensor)?, self.figures(&samples, &image)])
    }
}

fn electrons(radiance: &Plane<[f32; 3]>, weights: Weights) -> Vec<f64> {
    radiance.data().iter().map(|&pixel| weights.electrons(pixel).0).collect()
}

fn options(mut words: impl Iterator<Item = String>) -> Option<Options> {
    let mut options = Options { spp: 64.0, seeds: 1, size: 96, training: 20_480, truth: 16, jobs: Vec::new() };
    while let Some(word) = words.next() {
        let mut number = |least: u32| words.next()?.parse::<u32>().ok().filter(|v| *v >= least);
        match word.as_str() {
            "--spp" => options.spp = number(32)?.into(),
            "--seeds" => options.seeds = number(1)?.into(),
            "--size" => options.size = number(1)?,
            "--training" => options.training = number(0)?,
            "--truth" => options.truth = number(2)?.into(),
            flag if flag.starts_with("--") => return None,
            job => options.jobs.push(job.into()),
        }
    }
    (!options.jobs.is_empty()).then_some(options)
}

fn run(options: &Options) -> Result<(), Error> {
    println!("| job | samples | {} |\n|---|---|{}", FIGURES.join(" | "), "---:|".repeat(FIGURES.len()));
    let line = |job: &str, name: &str, figures: &[f64]| {
        let figures: Vec<String> = figures.iter().map(|f| format!("{f:.4}")).collect();
        println!("| {job} | {name} | {} |", figures.join(" | "));
    };
    let (mut logarithms, mut count) = ([[0.0; 5]; 3], 0.0);
    for job in &options.jobs {
        let (setup, name) = (Setup::new(job, options)?, job.file_stem().unwrap_or_default().to_string_lossy());
        for seed in 0..options.seeds {
            let all = setup.compare(options.spp, seed)?;
            all.iter().zip(NAMES).for_each(|(figures, kind)| line(&name, kind, figures));
            for (sums, figures) in logarithms.iter_mut().zip(&all) {
                sums.iter_mut().zip(figures).zip(&all[1]).for_each(|((sum, v), plan)| *sum += (v / plan).ln());
            }
            count += 1.0;
        }
    }
    for (sums, name) in logarithms.iter().zip(NAMES) {
        line("ratios to the plan", name, &sums.map(|sum| (sum / count).exp()));
    }
    Ok(())
}

fn main() -> ExitCode {
    let Some(options) = options(std::env::args().skip(1)) else {
        eprintln!("usage: half_buffers [--spp N] [--seeds N] [--size N] [--training N] [--truth N] JOB ...");
        return ExitCode::from(2);
    };
    match run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(2)
        }
    }
}
