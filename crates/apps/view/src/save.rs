//! Files of what is shown.

use crate::developed::{Accept, OWN_SENSOR, check_timed, with_knobs};
use crate::protocol::{Camera, Fault, Noise, Ranges, SaveKind, SaveRequest, Saved, SourceKind};
use crate::saved_job::{self, change_lens, describe_lens, select_camera};
use crate::shared::{Shared, lock};
use crate::snapshot::{Content, PictureScene, Snapshot};
use dunkelfeld::io::Factor;
use dunkelfeld::light_layers::add_light_layers;
use dunkelfeld::outputs::{encode_layers, save_exr, save_linear, save_new, save_text};
use dunkelfeld::radiometry::{Number, Seconds};
use dunkelfeld::sensor::{Exposure, ExposureNoise};
use dunkelfeld::{
    DenoiseMethod, Error, ExposeSettings, Frame, RenderSettings, RenderedFilm, SavedFilm, SensorChoice, develop,
    develop_behind_lens, develop_film, save_picture,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml::{Table, Value};

/// The longest stem of a file name \[bytes\].
const MAX_NAME: usize = 100;

/// Writes files of what is shown. No file is replaced.
pub(crate) fn save(shared: &Arc<Shared>, request: &SaveRequest) -> Result<Saved, Fault> {
    check_name(&request.name)?;
    let snapshot = shared.snapshot().ok_or_else(Fault::no_picture)?;
    let is_earlier = shared.is_earlier(&snapshot);
    let files: Vec<(SaveKind, PathBuf)> =
        request.what.iter().map(|&kind| (kind, path_of(shared, kind, &request.name))).collect();
    // Of two requests with one name, the second finds the files of the first, and writes none of its files.
    let _writes = lock(&shared.writes);
    check_new(&files)?;
    check_kinds(&snapshot, request)?;
    let settings = settings_of(shared, &snapshot, &request.camera, request.frame)?;
    let factors = snapshot.factors(request.camera.lights.as_ref())?;
    let weighted = shared.session.install(|| snapshot.weighted(&factors))?;
    let film = weighted.as_ref().or(snapshot.film());
    let mut notes = Vec::new();
    // What is refused is refused before the first file.
    let job = match files.iter().find(|(kind, _)| *kind == SaveKind::Job) {
        None => String::new(),
        Some((_, file)) => {
            let text = job_of(shared, &request.camera, request.frame, &snapshot)?;
            notes.extend(saved_job::check(file, &text, &snapshot.scene.change.without, (&snapshot, &settings))?);
            if request.camera.noise == Noise::None && request.camera.sensor.is_some() {
                let text = "A job makes no picture without the noise of the camera: this one has plain noise.";
                notes.push(text.to_owned());
            }
            text
        }
    };
    if is_earlier {
        notes.push("The picture is that of the scene before its change.".to_owned());
    }
    let frame = frame_of(shared, (&snapshot, film), request, &settings)?;
    write_all(&files, |kind, file| {
        let write = |path: &Path| write(kind, path, (&snapshot, film, &factors), &settings, frame.as_ref(), &job);
        // A file that has appeared meanwhile is not replaced either.
        shared.session.install(|| save_new(file, write))?;
        Ok(())
    })?;
    let names: Vec<String> = files.iter().map(|(_, file)| file.to_string_lossy().into_owned()).collect();
    shared.update(|live| live.saved.extend(names.iter().cloned()));
    Ok(Saved { files: names, note: (!notes.is_empty()).then(|| notes.join(" ")) })
}

/// Checks that no file exists, and that no two have one name.
fn check_new(files: &[(SaveKind, PathBuf)]) -> Result<(), Fault> {
    for (i, (_, file)) in files.iter().enumerate() {
        // A link is not followed: its target may be anywhere.
        if file.symlink_metadata().is_ok() || files[..i].iter().any(|(_, earlier)| earlier == file) {
            return Err(Fault::new(format!("{} exists", file.display()), "use another name"));
        }
    }
    Ok(())
}

/// Is the file a picture of the camera, or does it contain one?
fn has_frame(kind: SaveKind) -> bool {
    matches!(kind, SaveKind::Png | SaveKind::Tiff | SaveKind::Exr)
}

/// Checks that the picture has what the files contain.
fn check_kinds(snapshot: &Snapshot, SaveRequest { what, camera, .. }: &SaveRequest) -> Result<(), Fault> {
    check_timed(snapshot, camera)?;
    match &snapshot.content {
        Content::Exr(_) if what.iter().any(|kind| !matches!(kind, SaveKind::Png | SaveKind::Tiff)) => {
            return Err(Fault::new("an EXR has no samples and no scene", "save a PNG or a TIFF of its frame"));
        }
        Content::Film(_) if what.contains(&SaveKind::Film) && !snapshot.factors(camera.lights.as_ref())?.is_empty() => {
            let help = "save an EXR, which has a layer for each light, or set the factors to 1";
            return Err(Fault::new("a film has the light of its scene, without factors", help));
        }
        Content::Film(_) | Content::Exr(_) => {}
    }
    if what.iter().copied().any(has_frame) && (camera.noise == Noise::None || camera.denoise != DenoiseMethod::Off) {
        return Err(Fault::new(
            "only pictures with the noise of the camera and without a denoiser are saved",
            "choose plain or matched noise, and switch the denoiser off",
        ));
    }
    if camera.vignetting != snapshot.is_vignetted && what.contains(&SaveKind::Exr) {
        let problem = "the layers of an EXR have the vignetting of the film";
        return Err(Fault::new(problem, "save them with that, or render the job with the other one"));
    }
    Ok(())
}

/// The frame of the files that have one.
fn frame_of(
    shared: &Shared,
    (snapshot, film): (&Arc<Snapshot>, Option<&RenderedFilm>),
    request: &SaveRequest,
    settings: &RenderSettings,
) -> Result<Option<Frame>, Fault> {
    if !request.what.iter().copied().any(has_frame) {
        return Ok(None);
    }
    let camera = &request.camera;
    let is_other_lens = camera.vignetting != snapshot.is_vignetted;
    let transmission = if is_other_lens { Some(snapshot.other_transmission()?) } else { None };
    let frame = match (&snapshot.content, film, transmission) {
        (_, Some(film), None) => shared.session.install(|| develop_film(film, settings))?,
        (_, Some(film), Some(lens)) => shared.session.install(|| develop_behind_lens(film, lens, settings))?,
        (Content::Film(_), None, _) => return Ok(None),
        // An EXR has its own lens and pixels.
        (Content::Exr(image), None, _) => {
            let developed = shared.store.find(snapshot, camera, Accept::Exact, &shared.session)?;
            shared.session.install(|| match &developed.exposer {
                Some(exposer) => exposer.develop(request.frame),
                None => develop(image.radiance(), settings),
            })?
        }
    };
    Ok(Some(frame))
}

/// Writes new files: all of them, or none.
fn write_all(
    files: &[(SaveKind, PathBuf)],
    mut write: impl FnMut(SaveKind, &Path) -> Result<(), Fault>,
) -> Result<(), Fault> {
    for (i, (kind, file)) in files.iter().enumerate() {
        if let Err(mut fault) = write(*kind, file) {
            for (_, file) in &files[..i] {
                if let Err(e) = std::fs::remove_file(file) {
                    fault.problem += &format!("; {} was written and cannot be removed: {e}", file.display());
                }
            }
            return Err(fault);
        }
    }
    Ok(())
}

/// A stem of a file name is no path.
fn check_name(name: &str) -> Result<(), Fault> {
    let is_plain = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.' | ' ');
    if name.is_empty() || name.len() > MAX_NAME || name.starts_with('.') || !name.chars().all(is_plain) {
        return Err(Fault::new(
            format!("{name:?} is not usable as a file name"),
            "use letters, digits, `-`, `_` and `.`",
        ));
    }
    Ok(())
}

fn path_of(shared: &Shared, kind: SaveKind, name: &str) -> PathBuf {
    let beside = |ending: &str| shared.subject.output.join(format!("{name}.{ending}"));
    match kind {
        SaveKind::Png => beside("png"),
        SaveKind::Tiff => beside("tif"),
        SaveKind::Exr => beside("exr"),
        SaveKind::Film => beside("film"),
        // Paths in a job are relative to its folder.
        SaveKind::Job => shared.subject.path.with_file_name(format!("{name}.toml")),
    }
}

/// The settings of the film with the camera that is shown.
fn settings_of(shared: &Shared, snapshot: &Snapshot, camera: &Camera, frame: u32) -> Result<RenderSettings, Fault> {
    let mut settings = snapshot.settings.clone();
    let exposure = camera.exposure.map(|time| Exposure::new(Seconds(time))).transpose().map_err(Error::from)?;
    settings.sensor = match snapshot.scene.sensors.model(camera, settings.readout.binning)? {
        None => SensorChoice::None,
        Some(model) => {
            let optics = match &settings.sensor {
                SensorChoice::Emva { optics, .. } => optics.clone(),
                SensorChoice::None => ExposeSettings::new(model.clone())?.optics,
            };
            let optics = with_knobs(optics, camera, &settings)?;
            SensorChoice::Emva { model: Box::new(model), optics, exposure }
        }
    };
    settings.seed = camera.device;
    settings.frame = frame;
    settings.exposure_noise =
        if camera.noise == Noise::Matched { ExposureNoise::Matched } else { ExposureNoise::Plain };
    settings.denoise.method = camera.denoise;
    settings.budget.noise = Some(lock(&shared.live).target);
    Ok(settings)
}

fn write(
    kind: SaveKind,
    file: &Path,
    (snapshot, film, factors): (&Snapshot, Option<&RenderedFilm>, &[f64]),
    settings: &RenderSettings,
    frame: Option<&Frame>,
    job: &str,
) -> Result<(), Error> {
    let frame = || frame.ok_or_else(|| Error::setting("save", "there is no frame", "save a picture"));
    match kind {
        SaveKind::Png => save_picture(frame()?, file)?,
        SaveKind::Tiff => save_linear(frame()?, file)?,
        SaveKind::Exr => {
            // Seed and frame in the file are those of its samples, so that its plan makes them again. Its layers do not
            // depend on the device.
            let mut settings = settings.clone();
            (settings.seed, settings.frame) = (snapshot.settings.seed, snapshot.settings.frame);
            if let Some(film) = film {
                let mut layers = encode_layers(film, frame()?, &settings);
                let factors = factors.iter().copied().chain(std::iter::repeat(1.0));
                let lights: Vec<(&str, f64)> = snapshot.lights().zip(factors).collect();
                if let Some(of_lights) = snapshot.film().filter(|_| !lights.is_empty()) {
                    add_light_layers(&mut layers, of_lights, &lights);
                }
                save_exr(file, layers)?;
            }
        }
        SaveKind::Film => {
            if let Content::Film(film) = &snapshot.content {
                let (film, settings, is_vignetted) = (film.clone(), settings.clone(), snapshot.is_vignetted);
                SavedFilm { film, settings, is_vignetted }.write(file)?;
            }
        }
        SaveKind::Job => save_text(file, job)?,
    }
    Ok(())
}

/// The job that makes the picture: that of the view with the changes of the scene and of the camera. Its first line names the
/// option of the command line for effects that are left out.
fn job_of(shared: &Shared, camera: &Camera, frame: u32, snapshot: &Snapshot) -> Result<String, Fault> {
    if shared.subject.kind != SourceKind::Render {
        return Err(Fault::new("a stored film has no scene", "open the scene or its job"));
    }
    let PictureScene { change, parts, job, .. } = &*snapshot.scene;
    let target = lock(&shared.live).target;
    let mut job = match job {
        Some(text) => text.parse::<Table>().map_err(|e| Fault::new(e.to_string(), "repair the job"))?,
        None => {
            let name = shared.subject.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            Table::from_iter([("scene".to_owned(), Value::from(name))])
        }
    };
    let change = change.with_factors(parts, camera.lights.as_ref())?;
    for (key, entries) in change.overrides(parts) {
        match (job.get_mut(&key), entries) {
            (Some(Value::Array(before)), Value::Array(entries)) => before.extend(entries),
            (_, entries) => drop(job.insert(key, entries)),
        }
    }
    let first = parts.cameras.first().cloned().unwrap_or_default();
    let shown = change.camera.clone().or_else(|| snapshot.settings.camera.clone()).unwrap_or_else(|| first.clone());
    if !parts.cameras.is_empty() {
        select_camera(&mut job, &shown, &parts.cameras);
    }
    job.insert("frame".into(), i64::from(frame).into());
    let seed = i64::try_from(camera.device).map_err(|_| {
        Fault::new(format!("the device {} has no place in a job", camera.device), format!("use 0 to {}", i64::MAX))
    })?;
    job.insert("seed".into(), seed.into());
    let sensor = job.entry("sensor").or_insert_with(|| Table::new().into());
    if let Value::Table(sensor) = sensor {
        describe_sensor(sensor, camera, snapshot.scene.timed.is_some())?;
    }
    describe_denoiser(&mut job, camera.denoise);
    // The samples of the picture: a job by noise ends at the same level.
    let [width, height] = snapshot.size();
    let film = job.entry("film").or_insert_with(|| Table::new().into());
    if let Value::Table(film) = film
        && film.is_empty()
    {
        film.insert("width".into(), i64::from(width).into());
        film.insert("height".into(), i64::from(height).into());
    }
    let budget = if camera.sensor.is_some() {
        ("noise".to_owned(), Value::from(target))
    } else {
        ("spp".to_owned(), Value::from(snapshot.spp()))
    };
    let memory = job.get("budget").and_then(|budget| budget.get("memory")).cloned();
    let memory = memory.map(|memory| ("memory".to_owned(), memory));
    job.insert("budget".into(), Table::from_iter([budget].into_iter().chain(memory)).into());
    if camera.vignetting != snapshot.is_vignetted {
        let value = if camera.vignetting { "cos4" } else { "none" };
        change_lens(&mut job, &shown, |lens| drop(lens.insert("vignetting".into(), value.into())));
    }
    if camera.sensor.is_some() && (camera.f_number.is_some() || camera.glare.is_some()) {
        change_lens(&mut job, &shown, |lens| describe_lens(lens, camera.f_number, camera.glare));
    }
    // Outputs of the job before are not replaced.
    job.remove("output");
    let text = toml::to_string(&job).map_err(|e| Fault::new(e.to_string(), "save another picture"))?;
    if change.without.is_empty() {
        return Ok(text);
    }
    // A job has no key for them.
    let names: Vec<&str> = change.without.iter().map(|effect| effect.name()).collect();
    Ok(format!("# Render it with --without {}\n{text}", names.join(",")))
}

/// The keys of `[sensor]`. A timed exposure is that of the job already.
fn describe_sensor(sensor: &mut Table, camera: &Camera, is_timed: bool) -> Result<(), Fault> {
    match camera.sensor.as_deref() {
        None => {
            *sensor = Table::from_iter([("model".to_owned(), Value::from("none"))]);
            return Ok(());
        }
        Some(OWN_SENSOR) => {
            let before = sensor.get("gain").and_then(|gain| gain.clone().try_into::<Factor>().ok()).map(|Factor(f)| f);
            if camera.gain != 1.0 {
                let before = before.unwrap_or(1.0);
                check_gain(before, camera.gain)?;
                sensor.insert("gain".into(), (before * camera.gain).into());
            }
        }
        Some(name) => {
            sensor.insert("model".into(), name.into());
            sensor.remove("temperature");
            sensor.remove("black_level");
            sensor.insert("gain".into(), camera.gain.into());
        }
    }
    camera.black_level.map(|level| sensor.insert("black_level".into(), level.into()));
    match camera.exposure {
        _ if is_timed => {}
        None => drop(sensor.insert("exposure".into(), "auto".into())),
        Some(time) => drop(sensor.insert("exposure".into(), format!("{time}s").into())),
    }
    camera.temperature.map(|temperature| sensor.insert("temperature".into(), temperature.into()));
    let noise = if camera.noise == Noise::Matched { "matched" } else { "plain" };
    sensor.insert("exposure_noise".into(), noise.into());
    Ok(())
}

/// Checks the gain of a job whose own gain the knob multiplies.
fn check_gain(of_job: f64, of_knob: f64) -> Result<(), Fault> {
    let [low, high] = Ranges::KNOBS.gain;
    if (low..=high).contains(&(of_job * of_knob)) {
        return Ok(());
    }
    let (job, knob) = (Number(of_job), Number(of_knob));
    let problem = format!("the knob has the gain {knob}, and {knob} times the gain {job} of the job is out of range");
    Err(Fault::new(problem, format!("choose a gain from {} to {}", Number(low / of_job), Number(high / of_job))))
}

/// The section `[denoise]`: the place of the library stays where it is used.
fn describe_denoiser(job: &mut Table, denoise: DenoiseMethod) {
    if denoise == DenoiseMethod::Off {
        job.remove("denoise");
        return;
    }
    if let Value::Table(section) = job.entry("denoise").or_insert_with(|| Table::new().into()) {
        section.insert("method".into(), denoise.name().into());
        if denoise == DenoiseMethod::Builtin {
            section.remove("oidn");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_beyond_the_range_names_the_knob() {
        assert_eq!(check_gain(2.0, 50.0), Ok(()));
        let fault = check_gain(2.0, 60.0).expect_err("a gain of 120");
        assert!(fault.problem.starts_with("the knob has the gain 60,") && fault.place.is_none(), "{fault}");
        assert_eq!(fault.help.as_deref(), Some("choose a gain from 0.005 to 50"));
    }

    #[test]
    fn the_denoiser_of_a_job_is_that_of_the_picture() {
        let text = "[denoise]\nmethod = \"auto\"\noidn = \"lib\"\n";
        let described = |denoise: DenoiseMethod| {
            let mut job: Table = text.parse().expect("TOML");
            describe_denoiser(&mut job, denoise);
            job.get("denoise").map(ToString::to_string)
        };
        assert_eq!(described(DenoiseMethod::Off), None);
        assert_eq!(described(DenoiseMethod::Builtin).as_deref(), Some("{ method = \"builtin\" }"));
        assert_eq!(described(DenoiseMethod::Oidn).as_deref(), Some("{ method = \"oidn\", oidn = \"lib\" }"));
    }

    #[test]
    fn of_files_that_cannot_all_be_written_none_stays() {
        let folder = tempfile::tempdir().expect("a folder");
        let [job, gone] = ["a.toml", "gone/a.png"].map(|name| folder.path().join(name));
        let files = [(SaveKind::Job, job.clone()), (SaveKind::Png, gone)];
        let write = |_, file: &Path| std::fs::write(file, "x").map_err(|e| Fault::new(e.to_string(), ""));
        assert!(write_all(&files, write).is_err() && !job.exists());
        write_all(&files[..1], write).expect("a folder that exists");
        assert!(job.exists());
    }

    #[test]
    fn names_of_files_stay_in_their_folder() {
        for name in ["view", "part 7-a_2.1", "Grauwert-ä"] {
            assert_eq!(check_name(name), Ok(()), "{name}");
        }
        for name in ["", ".", "..", ".hidden", "a/b", "a\\b", "/etc/x", "a\0b", "a:b", &"x".repeat(101)] {
            assert!(check_name(name).is_err(), "{name:?}");
        }
    }
}
