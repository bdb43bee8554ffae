//! Coverage of the confidence bounds of the certificate: the share of renders and pixels in which the variance measured over all
//! renders lies below the bound.
//!
//! `cargo run --release -p dunkelfeld --example bound_coverage -- [SEEDS [SPP [SIZE]]]`

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "an example prints its result")]

use dunkelfeld::adaptive::variance::pooled::upper_factor;
use dunkelfeld::{Budget, Error, Project, SensorChoice, Session, render};
use std::path::PathBuf;

/// Standard normal quantile of 95 %.
const Z: f64 = 1.645;

fn main() -> Result<(), Error> {
    let mut numbers = std::env::args().skip(1).filter_map(|a| a.parse::<u32>().ok());
    let (seeds, spp, size) =
        (numbers.next().unwrap_or(128), numbers.next().unwrap_or(64), numbers.next().unwrap_or(64));
    println!(
        "scene, renders, bound of the mean holds, mean ratio +- s.e., bound of a pixel holds, pixels surely hidden at the k of 50 %, 90 %: claimed, of these hidden"
    );
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..");
    for job in [
        "scenes/inspection/inspection-open",
        "scenes/inspection/inspection",
        "tests/references/glass-ball",
        "tests/references/many-lights",
        "tests/references/all-kinds-of-light",
    ] {
        coverage(&root.join(format!("{job}.toml")), seeds, spp, size)?;
    }
    Ok(())
}

fn coverage(job: &PathBuf, seeds: u32, spp: u32, size: u32) -> Result<(), Error> {
    let mut project = Project::open(job)?;
    if !project.settings.has_sensor() {
        let model = Box::new(dunkelfeld::find_sensor(dunkelfeld::DEFAULT_SENSOR)?);
        project.settings.sensor = SensorChoice::Emva { model, optics: project.optics, exposure: None };
    }
    (project.settings.width, project.settings.height) = (size, size);
    project.settings.budget = Budget { spp: Some(f64::from(spp)), ..Budget::default() };
    let mut settings = project.fitted()?;
    let (mut signals, mut ratios, mut uppers, mut bounds) = (vec![], vec![], vec![], vec![]);
    let (mut floor, mut saturation) = (0.0, 0.0);
    for seed in 0..u64::from(seeds) {
        settings.seed = seed;
        let rendering = render(&project.scene, &settings, &Session::new(settings.threads)?)?;
        let frame = dunkelfeld::develop(&rendering.film.sums.mean(), &settings)?;
        let Some(sensor) = frame.sensor else { continue };
        if let SensorChoice::Emva { exposure, .. } = &mut settings.sensor {
            *exposure = Some(sensor.exposure);
        }
        floor = sensor.model.temporal_variance(dunkelfeld::radiometry::Electrons(0.0), sensor.exposure.time());
        saturation = sensor.model.saturation().0;
        let measured = dunkelfeld::engine::film_noise::FilmNoise::exposed(
            sensor.response,
            &sensor.model,
            sensor.exposure,
            &rendering.film,
        );
        let noise = measured.owned();
        let Some(certified) = measured.certify_by(&noise, 1.0) else { continue };
        signals.push(sensor.electrons.data().iter().map(|&e| f64::from(e)).collect::<Vec<_>>());
        let upper = noise.data().iter().map(|n| upper_factor(f64::from(n.freedom), Z));
        let ratio = certified.ratios.data();
        uppers.push(
            ratio.iter().zip(upper).map(|(&r, u)| if r == 0.0 { 0.0 } else { f64::from(r) * u }).collect::<Vec<_>>(),
        );
        ratios.push(ratio.iter().map(|&r| f64::from(r)).collect::<Vec<_>>());
        bounds.push((certified.certificate.mean_at_most, certified.certificate.saturated));
    }
    let n = signals.len() as f64;
    let pixels = (size * size) as usize;
    let mean: Vec<f64> = (0..pixels).map(|p| signals.iter().map(|s| s[p]).sum::<f64>() / n).collect();
    let open: Vec<usize> = (0..pixels).filter(|&p| mean[p] <= saturation).collect();
    let truth: Vec<f64> = (0..pixels)
        .map(|p| signals.iter().map(|s| (s[p] - mean[p]).powi(2)).sum::<f64>() / (n - 1.0) / (mean[p] + floor))
        .collect();
    let of = |values: &dyn Fn(usize) -> f64| open.iter().map(|&p| values(p)).sum::<f64>() / open.len() as f64;
    let true_mean = of(&|p| truth[p]);
    let each: Vec<f64> =
        signals.iter().map(|s| of(&|p| (s[p] - mean[p]).powi(2) * n / (n - 1.0) / (mean[p] + floor))).collect();
    let error = (each.iter().map(|e| (e - true_mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt();
    let held = bounds.iter().filter(|b| b.0 >= true_mean).count() as f64 / n;
    let low = bounds.iter().filter(|b| b.0 >= true_mean - 2.0 * error).count() as f64 / n;
    let high = bounds.iter().filter(|b| b.0 >= true_mean + 2.0 * error).count() as f64 / n;
    let pixel = uppers.iter().map(|u| of(&|p| f64::from(u8::from(u[p] >= truth[p])))).sum::<f64>() / n;
    let mut sorted: Vec<f64> = open.iter().map(|&p| truth[p]).collect();
    sorted.sort_by(f64::total_cmp);
    let claims = [0.5, 0.9].map(|share| {
        let level = sorted[(share * sorted.len() as f64) as usize];
        let (mut claimed, mut right) = (0u64, 0u64);
        for u in &uppers {
            for &p in open.iter().filter(|&&p| u[p] <= level) {
                claimed += 1;
                right += u64::from(truth[p] <= level);
            }
        }
        (claimed as f64 / (n * open.len() as f64), right as f64 / claimed.max(1) as f64)
    });
    let certified_mean = ratios.iter().map(|r| of(&|p| r[p])).sum::<f64>() / n;
    println!(
        "{} {n} | mean bound holds {held:.3} (truth -+ 2 s.e.: {low:.3} to {high:.3}) | truth {true_mean:.4} +- {error:.4}, certified {certified_mean:.4} | pixel bound holds {pixel:.3} | {:.3} {:.3}, {:.3} {:.3} | saturated {}",
        job.file_stem().unwrap_or_default().to_string_lossy(),
        claims[0].0,
        claims[0].1,
        claims[1].0,
        claims[1].1,
        pixels - open.len()
    );
    Ok(())
}
