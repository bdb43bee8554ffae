//! Compares the variance that a render certifies with the variance over many renders of the scene, in blocks of 16 x 16
//! pixels.
//!
//! `cargo run --release -p dunkelfeld --example certificate_truth -- [--seeds 32] [--noise 0.7 | --spp N] [--size N] [JOB ...]`
//!
//! Without jobs it renders the shipped ones and six of `tests/references/`. It prints one line per scene:
//!
//! - Share of the blocks whose measured variance is within 0.8 to 1.2 of the certified one: of a single render, and of the
//!   mean over all renders. Share of the blocks for which this holds or the difference is at most three standard errors
//!   (from the scatter over the renders).
//! - The same for whole blocks that are shifted by half a block.
//! - Measured over certified variance of the whole image.
//! - Mean of v / s over the pixels: measured; certified, with s at the mean of all renders; certified, with s at the mean
//!   of each render, as certificates print it.
//! - Share of the pixels that a render claims to be hidden at the levels at which 10, 50, 90 and 99 % are hidden by the
//!   measured variance of each pixel. This needs some hundred seeds.
//! - Samples per pixel, and the forecast of the pilot over the samples taken.
//!
//! Exits with 1 if fewer than 99 % of the blocks of a scene are within, by the mean over all renders.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "an example talks to its reader")]

use dunkelfeld::{Budget, Error, Project, SensorChoice, Session, develop_film, render};
use std::path::PathBuf;
use std::process::ExitCode;

const BLOCK: usize = 16;
const WITHIN: std::ops::RangeInclusive<f64> = 0.8..=1.2;
/// Standard errors of the difference that count as chance.
const ERRORS: f64 = 3.0;
/// Shares of pixels whose noise is below the levels at which claims are evaluated.
const SHARES: [f64; 4] = [0.1, 0.5, 0.9, 0.99];

struct Options {
    seeds: u64,
    budget: Budget,
    size: Option<u32>,
    jobs: Vec<PathBuf>,
}

fn main() -> ExitCode {
    let options = match options(std::env::args().skip(1)) {
        Ok(options) => options,
        Err(usage) => {
            eprintln!("error: {usage}");
            return ExitCode::from(2);
        }
    };
    println!(
        "                                   within a fifth   half a block off                       mean of v / s          claimed hidden at"
    );
    println!(
        "scene                blocks  one render    all  3 s.e.    all  3 s.e.  whole image  measured  certified  printed  10 %  50 %  90 %  99 %  spp     forecast/taken"
    );
    let mut all_true = true;
    for job in &options.jobs {
        match truth(job, &options) {
            Ok(truth) => {
                let name = job.file_stem().unwrap_or_default().to_string_lossy();
                let forecast = truth.forecast.map_or("-".into(), |f| format!("{f:.2}"));
                let hidden = truth.hidden.map(|h| format!("{:>4.0}", 100.0 * h)).join("  ");
                let [measured, certified, printed] = truth.mean_ratio;
                let [own, shifted] = [&truth.own, &truth.shifted];
                let [fifth, three, fifth_off, three_off] =
                    [own.within, own.explained, shifted.within, shifted.explained]
                        .map(|v| if v.is_nan() { "    -".into() } else { format!("{:>5.1}", 100.0 * v) });
                println!(
                    "{name:<20} {:>6}  {:>10.1}  {fifth}  {three:>6}  {fifth_off}  {three_off:>6}  {:>11.3}  {measured:>8.2}  {certified:>9.2}  {printed:>7.2}  {hidden}  {:<7.1} {forecast}",
                    truth.blocks,
                    100.0 * truth.single,
                    truth.whole,
                    truth.spp
                );
                all_true &= truth.own.within >= 0.99;
            }
            Err(e) => {
                eprintln!("error: {}: {e}", job.display());
                return ExitCode::from(2);
            }
        }
    }
    if all_true { ExitCode::SUCCESS } else { ExitCode::from(1) }
}

/// Agreement of the mean certificate of blocks with the measurement; not a number if there are no blocks.
struct Agreement {
    /// Share of the blocks whose measured variance lies [within a fifth](WITHIN) of the certified one.
    within: f64,
    /// Share of the blocks that do, or differ by at most [`ERRORS`] standard errors.
    explained: f64,
}

struct Truth {
    blocks: usize,
    /// Share of blocks within a fifth by certificates of single renders.
    single: f64,
    /// By the mean of all: blocks of the certificate, and whole blocks that are shifted by half a block.
    own: Agreement,
    shifted: Agreement,
    /// Measured over certified variance of the whole image.
    whole: f64,
    /// Mean of v / s: measured, certified, and as certificates print it.
    mean_ratio: [f64; 3],
    /// Share of the pixels that are claimed to be hidden where [`SHARES`] are, mean over the renders.
    hidden: [f64; SHARES.len()],
    spp: f64,
    /// Samples of the forecast over samples taken, mean over the renders that ended when they were hidden.
    forecast: Option<f64>,
}

fn truth(job: &PathBuf, options: &Options) -> Result<Truth, Error> {
    let mut project = Project::open(job)?;
    if !project.settings.has_sensor() {
        project.settings.sensor = SensorChoice::Emva {
            model: Box::new(dunkelfeld::find_sensor(dunkelfeld::limits::DEFAULT_SENSOR)?),
            optics: project.optics.clone(),
            exposure: None,
        };
    }
    if let Some(size) = options.size {
        let longest = f64::from(project.settings.width.max(project.settings.height));
        let scaled = |v: u32| ((f64::from(v) * f64::from(size) / longest).round() as u32).max(1);
        (project.settings.width, project.settings.height) =
            (scaled(project.settings.width), scaled(project.settings.height));
    }
    project.settings.budget = options.budget;
    let mut settings = project.fitted()?;
    let (width, height) = (settings.width as usize, settings.height as usize);

    let mut saturation = f64::INFINITY;
    let (mut seen, mut certified, mut ratios) =
        (Vec::<Vec<f64>>::new(), Vec::<Vec<f64>>::new(), Vec::<Vec<f32>>::new());
    let mut dark = 0.0;
    let (mut samples, mut forecasts) = (0u64, Vec::new());
    for seed in 0..options.seeds {
        settings.seed = seed;
        let rendering = render(&project.scene, &settings, &Session::new(settings.run.threads)?)?;
        let frame = develop_film(&rendering.film, &settings)?;
        samples += rendering.film.sums.total_samples();
        if let Some(foretold) = rendering.forecast.as_ref().and_then(|f| f.target()).and_then(|l| l.samples) {
            forecasts.push(foretold / rendering.film.sums.total_samples() as f64);
        }
        let Some(sensor) = frame.sensor else { continue };
        saturation = sensor.model.saturation().0;
        if let SensorChoice::Emva { exposure, .. } = &mut settings.sensor {
            // The first render finds the exposure, so that the electrons of all can be compared.
            *exposure = Some(sensor.exposure);
        }
        let floor = sensor.model.temporal_variance(dunkelfeld::radiometry::Electrons(0.0), sensor.exposure.time());
        let Some(claim) = sensor.certified else { continue };
        let electrons: Vec<f64> = sensor.electrons.data().iter().map(|&e| f64::from(e)).collect();
        ratios.push(claim.ratios.data().to_vec());
        let claim = claim.ratios.data().iter().zip(&electrons).map(|(&r, e)| f64::from(r) * (e + floor));
        certified.push(claim.collect());
        seen.push(electrons);
        dark = floor;
    }
    let n = options.seeds as f64;
    let over_renders = |planes: &[Vec<f64>]| -> Vec<f64> {
        (0..width * height).map(|pixel| planes.iter().map(|plane| plane[pixel]).sum::<f64>() / n).collect()
    };
    let mean = over_renders(&seen);
    // Pixels that saturate by the mean of all renders. Saturation by a rare sample in one render is noise.
    let full: Vec<bool> = mean.iter().map(|&mean| mean > saturation).collect();
    // Estimate of the variance by each render; their mean is the measured variance.
    let deviations =
        |electrons: Vec<f64>| electrons.iter().zip(&mean).map(|(e, m)| (e - m).powi(2) * n / (n - 1.0)).collect();
    let estimates: Vec<Vec<f64>> = seen.into_iter().map(deviations).collect();
    let measured = over_renders(&estimates);
    // Variance of each pixel over that of the sensor.
    let open = (0..width * height).filter(|&pixel| !full[pixel]);
    let mut noise: Vec<f64> = open.map(|pixel| measured[pixel] / (mean[pixel] + dark)).collect();
    noise.sort_by(f64::total_cmp);
    let hidden = SHARES.map(|share| {
        let level = noise.get((share * noise.len() as f64) as usize).copied().unwrap_or(0.0);
        let claimed = |ratios: &Vec<f32>| {
            ratios.iter().zip(&full).filter(|(r, full)| !**full && f64::from(**r) <= level).count() as f64
        };
        ratios.iter().map(claimed).sum::<f64>() / (n * noise.len() as f64)
    });
    let claimed = over_renders(&certified);
    let mean_ratio = |variances: &[f64]| {
        let open = (0..width * height).filter(|&pixel| !full[pixel]);
        open.map(|pixel| variances[pixel] / (mean[pixel] + dark)).sum::<f64>() / noise.len() as f64
    };
    let printed = ratios
        .iter()
        .map(|ratios| ratios.iter().zip(&full).filter(|(_, full)| !**full).map(|(r, _)| f64::from(*r)).sum::<f64>());
    let mean_ratio = [mean_ratio(&measured), mean_ratio(&claimed), printed.sum::<f64>() / (n * noise.len() as f64)];
    // Sums over blocks: all blocks, or the whole ones that begin `shift` pixels into the image.
    let sums = |values: &[f64], shift: usize| {
        let along = |length: usize| {
            if shift == 0 { length.div_ceil(BLOCK) } else { length.saturating_sub(shift) / BLOCK }
        };
        let (columns, rows) = (along(width), along(height));
        let mut sums = vec![0.0; columns * rows];
        for (pixel, value) in values.iter().enumerate().filter(|(pixel, _)| !full[*pixel]) {
            let block = |at: usize| at.checked_sub(shift).map(|at| at / BLOCK);
            if let (Some(x), Some(y)) = (block(pixel % width), block(pixel / width))
                && x < columns
                && y < rows
            {
                sums[y * columns + x] += value;
            }
        }
        sums
    };
    // A block without noise is certified truly if it is certified without noise.
    let is_true = |measured: f64, claimed: f64| {
        if claimed == 0.0 { measured == 0.0 } else { WITHIN.contains(&(measured / claimed)) }
    };
    let share = |claimed: &[f64]| {
        let (measured, claimed) = (sums(&measured, 0), sums(claimed, 0));
        let within = measured.iter().zip(&claimed).filter(|(m, c)| is_true(**m, **c)).count();
        within as f64 / measured.len() as f64
    };
    let agreement = |shift: usize| {
        let (measured, claimed) = (sums(&measured, shift), sums(&claimed, shift));
        // Measured less certified variance of each render, in each block.
        let missed: Vec<Vec<f64>> = (estimates.iter().zip(&certified))
            .map(|(estimates, claim)| {
                sums(estimates, shift).iter().zip(sums(claim, shift)).map(|(m, c)| m - c).collect()
            })
            .collect();
        let (mut within, mut explained) = (0u32, 0u32);
        for (block, (&measured, &claimed)) in measured.iter().zip(&claimed).enumerate() {
            let mean = measured - claimed;
            let squares = missed.iter().map(|missed| (missed[block] - mean).powi(2)).sum::<f64>();
            let (is_true, error) = (is_true(measured, claimed), (squares / (n * (n - 1.0))).sqrt());
            within += u32::from(is_true);
            explained += u32::from(is_true || mean.abs() <= ERRORS * error);
        }
        let share = |blocks: u32| f64::from(blocks) / measured.len() as f64;
        Agreement { within: share(within), explained: share(explained) }
    };
    let whole = |values: &[f64]| sums(values, 0).iter().sum::<f64>();
    Ok(Truth {
        blocks: sums(&claimed, 0).len(),
        single: certified.iter().map(|c| share(c)).sum::<f64>() / n,
        own: agreement(0),
        shifted: agreement(BLOCK / 2),
        whole: whole(&measured) / whole(&claimed).max(f64::MIN_POSITIVE),
        mean_ratio,
        hidden,
        spp: samples as f64 / n / (width * height) as f64,
        forecast: (!forecasts.is_empty()).then(|| forecasts.iter().sum::<f64>() / forecasts.len() as f64),
    })
}

fn options(mut words: impl Iterator<Item = String>) -> Result<Options, String> {
    let mut options = Options { seeds: 32, budget: Budget::default(), size: None, jobs: Vec::new() };
    while let Some(word) = words.next() {
        let mut number = |least: f64| {
            let value = words.next().and_then(|v| v.parse::<f64>().ok()).filter(|v| v.is_finite() && *v >= least);
            value.ok_or_else(|| format!("{word} needs a number of at least {least}"))
        };
        match word.as_str() {
            "--seeds" => options.seeds = number(2.0)? as u64,
            "--noise" => options.budget.noise = Some(number(1e-3)?),
            "--spp" => options.budget.spp = Some(number(1.0)?),
            "--size" => options.size = Some(number(1.0)? as u32),
            flag if flag.starts_with("--") => return Err(format!("there is no option {flag}")),
            job => options.jobs.push(job.into()),
        }
    }
    if options.budget == Budget::default() {
        options.budget.noise = Some(0.7);
    }
    if options.jobs.is_empty() {
        let shipped =
            ["inspection", "inspection-flat", "inspection-open"].map(|s| format!("scenes/inspection/{s}.toml"));
        let references =
            ["all-kinds-of-light", "glass-ball", "many-lights", "environment-map", "textured", "scattering-box"]
                .map(|s| format!("tests/references/{s}.toml"));
        let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..");
        options.jobs = shipped.into_iter().chain(references).map(|job| root.join(job)).collect();
    }
    Ok(options)
}
