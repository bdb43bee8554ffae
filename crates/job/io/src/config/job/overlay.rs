//! Keys that overrides replace together, before two texts are merged key by key.

use toml::{Table, Value};

/// Settings of the model of a sensor, which another model does not have.
const OF_MODEL: [&str; 3] = ["gain", "temperature", "black_level"];

/// Prepares the keys of a job and those that override it.
///
/// - A limit (`time`, `spp`, `noise`) replaces all limits of the job, and the share that belongs to them.
/// - The vignetting is that of all lenses.
/// - A sensor replaces the gain, the temperature and the black level that the job sets for its own. Without one
///   (`"none"`) the image is not exposed; film and lens stay those of the job's sensor.
/// - An exposure is that of all captures.
/// - A denoiser and its library are replaced together.
/// - A size alone is that of the render ([`Job::size`](super::Job::size)), so it is not merged. Beside other keys of the film it
///   is that of the film.
pub(super) fn replace_together(job: &mut Table, overrides: &mut Table) {
    if let Some(film) = section(overrides, "film").filter(|film| is_size(film)) {
        film.clear();
    }
    let vignetting = section(overrides, "lens").and_then(|lens| lens.get("vignetting").cloned());
    if let Some(vignetting) = vignetting {
        let cameras: Vec<&mut Table> = match job.get_mut("camera") {
            Some(Value::Table(camera)) => vec![camera],
            Some(Value::Array(cameras)) => cameras.iter_mut().filter_map(Value::as_table_mut).collect(),
            _ => Vec::new(),
        };
        for lens in cameras.into_iter().filter_map(|camera| section(camera, "lens")) {
            lens.insert("vignetting".into(), vignetting.clone());
        }
    }
    if section(overrides, "sensor").is_some_and(|sensor| sensor.contains_key("exposure"))
        && let Some(Value::Array(captures)) = job.get_mut("capture")
    {
        captures.iter_mut().filter_map(Value::as_table_mut).for_each(|capture| drop(capture.remove("exposure")));
    }
    let limits = ["time", "spp", "noise"];
    let sets_limit =
        section(overrides, "budget").is_some_and(|budget| limits.iter().any(|key| budget.contains_key(*key)));
    if let Some(budget) = section(job, "budget").filter(|_| sets_limit) {
        limits.iter().chain(&["share"]).for_each(|key| drop(budget.remove(*key)));
    }
    // A library belongs to its method, and selects it.
    if section(overrides, "denoise")
        .is_some_and(|denoise| ["method", "oidn"].iter().any(|key| denoise.contains_key(*key)))
    {
        let keeps = section(overrides, "denoise").and_then(|denoise| denoise.get("method")?.as_str());
        let keeps = keeps.is_some_and(|method| method == "auto" || method == "oidn");
        if let Some(denoise) = section(job, "denoise") {
            denoise.remove("method");
            denoise.retain(|key, _| keeps || key != "oidn");
        }
    }
    let model = section(overrides, "sensor").and_then(|sensor| Some(sensor.get("model")?.as_str()?.to_owned()));
    let own = section(job, "sensor");
    match model.as_deref() {
        None => {}
        Some("none") if own.as_ref().is_some_and(|own| own.get("model").and_then(Value::as_str) == Some("none")) => {}
        Some("none") => {
            let sensor = section(overrides, "sensor").into_iter();
            sensor.for_each(|sensor| {
                sensor.remove("model");
                sensor.insert("expose".into(), false.into());
            });
        }
        Some(_) => own.into_iter().for_each(|own| {
            OF_MODEL.iter().for_each(|key| drop(own.remove(*key)));
            own.remove("expose");
        }),
    }
}

/// Does `[film]` set nothing but the number of pixels?
pub(super) fn is_size(film: &Table) -> bool {
    film.keys().all(|key| ["width", "height"].contains(&key.as_str()))
}

fn section<'a>(table: &'a mut Table, key: &str) -> Option<&'a mut Table> {
    table.get_mut(key)?.as_table_mut()
}
