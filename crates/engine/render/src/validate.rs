//! Checks the ranges of settings before a render begins.

use crate::error::Error;
use crate::settings::{Budget, MAX_PIXELS, MAX_SIDE, MAX_TRAINING_PATHS, RenderSettings, SensorChoice};
use dunkelfeld_adaptive::weights::Strategy;
use dunkelfeld_adaptive::{budget, plan};
use dunkelfeld_sensor::ExposureNoise;

/// Refuses settings that cannot be rendered, with help.
pub fn validate(s: &RenderSettings) -> Result<(), Error> {
    check_size(s)?;
    check_budget(s)?;
    if let Some(paths) = s.run.training_paths.filter(|&paths| paths > MAX_TRAINING_PATHS) {
        let problem = format!("{paths} are more than {MAX_TRAINING_PATHS}");
        return Err(Error::setting("training paths", problem, "render the plan again"));
    }
    if let SensorChoice::Emva { model, exposure, .. } = &s.sensor {
        exposure.map_or(Ok(()), |exposure| model.check_exposure(exposure))?;
        model.check_size([s.width, s.height], s.readout)?;
    }
    if s.strategy == Some(Strategy::Sensor) && !s.has_sensor() {
        let problem = "the allocation `sensor` needs the noise of a sensor, and there is no sensor";
        return Err(Error::setting("allocation", problem, "choose a sensor, or the allocation `uniform`"));
    }
    if s.exposure_noise == ExposureNoise::Matched && !s.has_sensor() {
        let problem = "matched exposure noise needs the noise of a sensor, and there is no sensor";
        return Err(Error::setting("exposure noise", problem, "choose a sensor, or the exposure noise `plain`"));
    }
    check_samples(s)?;
    check_replay(s)
}

fn check_size(s: &RenderSettings) -> Result<(), Error> {
    let range = format!("1 to {MAX_SIDE}");
    for (name, v) in [("width", s.width), ("height", s.height)] {
        if !(1..=MAX_SIDE).contains(&v) {
            return Err(Error::setting(name, format!("{v} is out of range"), format!("use {range}")));
        }
    }
    let pixels = u64::from(s.width) * u64::from(s.height);
    if pixels > MAX_PIXELS {
        let problem = format!("{} x {} pixels are more than {MAX_PIXELS}", s.width, s.height);
        return Err(Error::setting(
            "film",
            problem,
            "make it smaller: every part of a render (`--samples`) has all of its pixels, too",
        ));
    }
    Ok(())
}

fn check_budget(s: &RenderSettings) -> Result<(), Error> {
    for (name, v) in [("time", s.budget.seconds), ("spp", s.budget.spp)] {
        if v.is_some_and(|v| !(v.is_finite() && v > 0.0)) {
            return Err(Error::setting(name, "the budget must be a positive number", "use 20s or 64"));
        }
    }
    if s.budget.spp.is_some_and(|v| v > budget::MAX_MEAN_SPP) {
        return Err(Error::setting("spp", "more samples per pixel than can be counted", "use at most 1e9"));
    }
    if let Some(k) = s.budget.noise {
        if !budget::NOISE_LEVELS.contains(&k) {
            return Err(Error::setting("noise", "the level must be a number from 0.001 to 1000", "use 0.7"));
        }
        if !s.has_sensor() {
            let problem = "the noise target needs the noise of a sensor, and there is no sensor";
            return Err(Error::setting("noise", problem, "choose a sensor, or another budget"));
        }
    }
    if let Some(share) = s.budget.share {
        if !budget::SHARES.contains(&share) {
            return Err(Error::setting("share", "it must be a number from 1 to 100 per cent", "use 90"));
        }
        if s.budget.noise.is_none() {
            let problem = "there is no level of noise that so many pixels shall reach";
            return Err(Error::setting("share", problem, "add a level, as in --noise 0.7"));
        }
    }
    Ok(())
}

fn check_samples(s: &RenderSettings) -> Result<(), Error> {
    if let Some(samples) = &s.run.samples {
        if samples.is_empty() || samples.end > plan::MAX_SPP {
            let problem = format!("the range {}..{} contains no valid samples", samples.start, samples.end);
            return Err(Error::setting("samples", problem, "use 0..64 for the first 64 of every pixel"));
        }
        if s.budget != Budget::default() || s.strategy.is_some_and(|s| s != Strategy::Uniform) {
            let problem = "a part of a render takes a range of samples, and neither a budget nor an allocation";
            return Err(Error::setting("samples", problem, "leave budget and allocation out, or the samples"));
        }
    }
    if !s.run.light_groups.is_empty() && s.run.checkpoint.is_some() {
        let problem = "a checkpoint has no films of groups of lights";
        return Err(Error::setting("light groups", problem, "leave the checkpoint out, or the groups"));
    }
    Ok(())
}

fn check_replay(s: &RenderSettings) -> Result<(), Error> {
    let Some(p) = &s.run.replay else { return Ok(()) };
    if (p.width(), p.height()) != (s.width, s.height) {
        let problem = format!("the plan is {} x {} pixels, the film {} x {}", p.width(), p.height(), s.width, s.height);
        return Err(Error::setting("replay", problem, "render at the size of the plan"));
    }
    if plan::total(p) == 0 {
        return Err(Error::setting("replay", "the plan has no samples", "use a plan of a render that took some"));
    }
    if let Some(most) = p.data().iter().copied().max()
        && most > plan::MAX_SPP
    {
        let problem = format!("the plan has {most} samples in one pixel, more than {}", plan::MAX_SPP);
        return Err(Error::setting("replay", problem, "use a plan that a render wrote"));
    }
    Ok(())
}
