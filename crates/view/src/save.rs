//! Files of what is shown.

use crate::desk::at_render;
use crate::developed::{Accept, OWN_SENSOR, check_timed, with_knobs};
use crate::light_sum;
use crate::protocol::{Camera, Denoise, Fault, Noise, Ranges, SaveKind, SaveRequest, Saved, SourceKind};
use crate::saved_job::{self, Difference, change_lens, describe_lens, select_camera};
use crate::shared::{Shared, lock};
use crate::snapshot::{Content, PictureScene, Snapshot};
use dunkelfeld::io::Factor;
use dunkelfeld::radiometry::{Number, Seconds};
use dunkelfeld::sensor::{Exposure, ExposureNoise};
use dunkelfeld::{
    Error, ExposeSettings, FilmOfLight, Frame, RenderSettings, SavedFilm, SensorChoice, develop, develop_behind_lens, develop_film,
    encode_layers, encode_light_layers, save_exr, save_linear, save_new, save_picture, save_text,
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
    for (i, (_, file)) in files.iter().enumerate() {
        // A link is not followed: its target may be anywhere.
        if file.symlink_metadata().is_ok() || files[..i].iter().any(|(_, earlier)| earlier == file) {
            let problem = format!("{} exists", file.display());
            return Err(Fault::new(problem, "use another name"));
        }
    }
    let is_film = files.iter().any(|(kind, _)| *kind == SaveKind::Checkpoint);
    match &snapshot.content {
        Content::Exr(_) if files.iter().any(|(kind, _)| !matches!(kind, SaveKind::Png | SaveKind::Tiff)) => {
            return Err(Fault::new("an EXR has no samples and no scene", "save a PNG or a TIFF of its frame"));
        }
        Content::Lights(_) if is_film => {
            let help = "save an EXR, which has a layer for each light, or use one film for all lights";
            return Err(Fault::new("a file has one film, and each light has its own", help));
        }
        Content::Lights(_) | Content::Film(_) | Content::Exr(_) => {}
    }
    check_timed(&snapshot, &request.camera)?;
    let factors = snapshot.factors(request.camera.lights.as_ref())?;
    let settings = settings_of(shared, &snapshot, &request.camera, request.frame)?;
    let needs_frame = files.iter().any(|(kind, _)| matches!(kind, SaveKind::Png | SaveKind::Tiff | SaveKind::Exr));
    if needs_frame && (request.camera.noise == Noise::None || request.camera.denoise != Denoise::Off) {
        return Err(Fault::new(
            "only pictures with the noise of the camera and without a denoiser are saved",
            "choose plain or matched noise, and switch the denoiser off",
        ));
    }
    let kinds = || files.iter().map(|(kind, _)| *kind);
    let is_continued = kinds().any(|kind| kind == SaveKind::Checkpoint) && shared.subject.kind == SourceKind::Render;
    if is_continued && snapshot.scene.number != lock(&shared.live).scene_number {
        return Err(Fault::earlier_scene());
    }
    if is_continued && kinds().any(|kind| kind == SaveKind::Job) && request.camera.device != snapshot.settings.seed {
        return Err(Fault::new(
            "a job has one seed for the samples and the device, so that it cannot continue this film",
            format!("choose the device {}, or save the job alone", snapshot.settings.seed),
        ));
    }
    let is_other_lens = request.camera.vignetting != snapshot.is_vignetted;
    if is_other_lens && kinds().any(|kind| kind == SaveKind::Exr) {
        let problem = "the layers of an EXR have the vignetting of the film";
        return Err(Fault::new(problem, "save them with that, or render the job with the other one"));
    }
    if is_other_lens && is_continued && kinds().any(|kind| kind == SaveKind::Job) {
        let problem = "the job has another vignetting than the film, so that it cannot continue it";
        return Err(Fault::new(problem, "save the job alone, or choose the vignetting of the film"));
    }
    let transmission = if is_other_lens { Some(snapshot.other_transmission()?) } else { None };
    let continued =
        files.iter().find(|(kind, _)| is_continued && *kind == SaveKind::Checkpoint).map(|(_, file)| file.as_path());
    // The frame of a continued film is that of its samples.
    let frame_of_job = if is_continued { snapshot.settings.frame } else { request.frame };
    // What is refused is refused before the first file.
    let (job, difference) = match files.iter().find(|(kind, _)| *kind == SaveKind::Job) {
        Some((_, file)) => {
            let text = job_of(shared, &request.camera, frame_of_job, &snapshot, continued)?;
            let without = &snapshot.scene.change.without;
            let difference = saved_job::check(file, &text, without, (&snapshot, &settings))?;
            (text, difference)
        }
        None => (String::new(), None),
    };
    if let (Some(Difference::Film(text)), true) = (&difference, is_continued) {
        let problem = format!("the job cannot continue this film. {text}");
        return Err(Fault::new(problem, "save the job alone, or choose the sensor of the job"));
    }
    // All files of a request are of one film: that of the checkpoint.
    let checkpoint = continued.map(|file| save_checkpoint(shared, file, &settings, &snapshot)).transpose()?.flatten();
    let (snapshot, written) = match checkpoint {
        Some(snapshot) => (snapshot, continued),
        None => (snapshot, None),
    };
    // All files are written, or none.
    let without_written = |fault: Fault| {
        if let Some(file) = written {
            drop(std::fs::remove_file(file));
        }
        fault
    };
    let has_job = kinds().any(|kind| kind == SaveKind::Job);
    // The job has the samples of this film, and names a film that it continues.
    let job = if has_job && is_continued {
        job_of(shared, &request.camera, frame_of_job, &snapshot, written).map_err(without_written)?
    } else {
        job
    };
    let frame = if needs_frame {
        // An EXR has its own lens and pixels.
        let developed = match &snapshot.content {
            Content::Exr(_) => Some(shared.store.find(&snapshot, &request.camera, Accept::Exact, &shared.session)?),
            Content::Film(_) | Content::Lights(_) => None,
        };
        let frame = shared.session.install(|| match &snapshot.content {
            Content::Film(film) if transmission.is_none() => develop_film(film, &settings).map(Some),
            Content::Film(film) => {
                let film = FilmOfLight { name: "", film, factor: 1.0 };
                develop_behind_lens(&[film], transmission.clone(), &settings).map(Some)
            }
            Content::Lights(films) => {
                let films = light_sum::with_names(films, &factors);
                develop_behind_lens(&films, transmission.clone(), &settings).map(Some)
            }
            Content::Exr(image) => match developed.as_ref().and_then(|developed| developed.exposer.as_ref()) {
                Some(exposer) => exposer.develop(request.frame).map(Some),
                None => develop(image.radiance(), &settings).map(Some),
            },
        });
        frame.map_err(|error| without_written(Fault::from(error)))?
    } else {
        None
    };
    let is_other_frame = is_continued && request.frame != snapshot.settings.frame;
    let mut notes = Vec::new();
    if is_other_frame && needs_frame && has_job {
        let of_samples = snapshot.settings.frame;
        notes.push(format!(
            "The job has frame {of_samples}, that of the samples; the picture has frame {}.",
            request.frame
        ));
    }
    if has_job && request.camera.noise == Noise::None && request.camera.sensor.is_some() {
        notes.push("A job makes no picture without the noise of the camera: this one has plain noise.".to_owned());
    }
    if is_continued && written.is_none() {
        notes.push("The film is that of no render that runs, so that no render continues it.".to_owned());
    }
    if is_earlier {
        notes.push("The picture is that of the scene before its change.".to_owned());
    }
    notes.extend(difference.as_ref().map(|difference| difference.text().to_owned()));
    let note = (!notes.is_empty()).then(|| notes.join(" "));
    write_others(&files, written, |kind, file| {
        let write = |path: &Path| write(kind, path, (&snapshot, &factors), &settings, frame.as_ref(), &job);
        // A file that has appeared meanwhile is not replaced either.
        shared.session.install(|| save_new(file, write))?;
        Ok(())
    })?;
    let names: Vec<String> = files.iter().map(|(_, file)| file.to_string_lossy().into_owned()).collect();
    shared.update(|live| live.saved.extend(names.iter().cloned()));
    Ok(Saved { files: names, note })
}

/// Writes new files: all of them, or none. `written` exists already; without the others it is removed too.
fn write_others(
    files: &[(SaveKind, PathBuf)],
    written: Option<&Path>,
    mut write: impl FnMut(SaveKind, &Path) -> Result<(), Fault>,
) -> Result<(), Fault> {
    let mut present: Vec<&Path> = written.into_iter().collect();
    for (kind, file) in files.iter().filter(|(_, file)| written != Some(file)) {
        if let Err(mut fault) = write(*kind, file) {
            for file in present {
                if let Err(e) = std::fs::remove_file(file) {
                    fault.problem += &format!("; {} was written and cannot be removed: {e}", file.display());
                }
            }
            return Err(fault);
        }
        present.push(file);
    }
    Ok(())
}

/// Writes the film of the render that runs, so that the command line can continue it, and shows it. Returns the picture of
/// this film; `None` if no render runs.
///
/// # Errors
/// The render is that of another scene than the picture.
fn save_checkpoint(
    shared: &Arc<Shared>,
    file: &Path,
    settings: &RenderSettings,
    picture: &Snapshot,
) -> Result<Option<Arc<Snapshot>>, Fault> {
    let (file, settings, number, state) = (file.to_owned(), settings.clone(), picture.scene.number, shared.clone());
    at_render(shared, move |_, film| {
        if lock(&state.live).scene_number != number {
            return Err(Fault::earlier_scene());
        }
        let Some(film) = film else { return Ok(None) };
        save_new(&file, |path| film.save(path, &settings))?;
        let shown = state.snapshot().ok_or_else(Fault::no_picture)?;
        if shown.samples == film.film().sums.total_samples() {
            return Ok(Some(shown));
        }
        let seconds = lock(&state.live).render.elapsed.max(shown.seconds);
        Ok(Some(state.publish(shown.next(Content::Film(film.film().clone()), seconds))))
    })?
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
        SaveKind::Checkpoint => beside("film"),
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
    settings.denoise.method = camera.denoise.method();
    settings.budget.noise = Some(lock(&shared.live).target);
    Ok(settings)
}

fn write(
    kind: SaveKind,
    file: &Path,
    (snapshot, factors): (&Snapshot, &[f64]),
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
            match &snapshot.content {
                Content::Film(film) => save_exr(file, encode_layers(film, frame()?, &settings))?,
                Content::Lights(films) => {
                    save_exr(file, encode_light_layers(&light_sum::with_names(films, factors), frame()?, &settings)?)?;
                }
                Content::Exr(_) => {}
            }
        }
        SaveKind::Checkpoint => {
            if let Content::Film(film) = &snapshot.content {
                let (film, settings, is_vignetted) = (film.clone(), settings.clone(), snapshot.is_vignetted);
                SavedFilm { film, settings, is_vignetted }.write(file)?;
            }
        }
        SaveKind::Job => save_text(file, job)?,
    }
    Ok(())
}

/// The job that makes the picture: that of the view with the changes of the scene and of the camera. Its first line names
/// options of the command line, such as a checkpoint that is saved with it.
fn job_of(
    shared: &Shared,
    camera: &Camera,
    frame: u32,
    snapshot: &Snapshot,
    checkpoint: Option<&Path>,
) -> Result<String, Fault> {
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
    let mut options = Vec::new();
    if let Some(file) = checkpoint {
        options.push(format!("--checkpoint {:?}", path_from(&shared.subject.path, file)?));
    }
    if !change.without.is_empty() {
        let names: Vec<&str> = change.without.iter().map(|effect| effect.name()).collect();
        options.push(format!("--without {}", names.join(",")));
    }
    let text = toml::to_string(&job).map_err(|e| Fault::new(e.to_string(), "save another picture"))?;
    // A job has no keys for these options.
    Ok(if options.is_empty() { text } else { format!("# Render it with {}\n{text}", options.join(" ")) })
}

/// The path of a file from the folder of `scene`: its name if it is in this folder, and otherwise the whole path.
fn path_from(scene: &Path, file: &Path) -> Result<String, Fault> {
    let folder = |path: &Path| {
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        parent.canonicalize().map_err(|e| Fault::new(format!("{}: {e}", parent.display()), "save to another folder"))
    };
    let (name, of_file) = (file.file_name().unwrap_or_default(), folder(file)?);
    let path = if of_file == folder(scene)? { PathBuf::from(name) } else { of_file.join(name) };
    Ok(path.to_string_lossy().into_owned())
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
fn describe_denoiser(job: &mut Table, denoise: Denoise) {
    if denoise == Denoise::Off {
        job.remove("denoise");
        return;
    }
    if let Value::Table(section) = job.entry("denoise").or_insert_with(|| Table::new().into()) {
        section.insert("method".into(), denoise.method().name().into());
        if denoise == Denoise::Builtin {
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
        let described = |denoise: Denoise| {
            let mut job: Table = text.parse().expect("TOML");
            describe_denoiser(&mut job, denoise);
            job.get("denoise").map(ToString::to_string)
        };
        assert_eq!(described(Denoise::Off), None);
        assert_eq!(described(Denoise::Builtin).as_deref(), Some("{ method = \"builtin\" }"));
        assert_eq!(described(Denoise::Oidn).as_deref(), Some("{ method = \"oidn\", oidn = \"lib\" }"));
    }

    #[test]
    fn of_files_that_cannot_all_be_written_none_stays() {
        let folder = tempfile::tempdir().expect("a folder");
        let [job, gone] = ["a.toml", "gone/a.png"].map(|name| folder.path().join(name));
        let files = [(SaveKind::Job, job.clone()), (SaveKind::Png, gone)];
        let write = |_, file: &Path| std::fs::write(file, "x").map_err(|e| Fault::new(e.to_string(), ""));
        assert!(write_others(&files, None, write).is_err() && !job.exists());
        write_others(&files[..1], None, write).expect("a folder that exists");
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
