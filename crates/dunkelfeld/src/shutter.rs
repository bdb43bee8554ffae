//! The shutter of a project: the exposure of its sensor, and the film and the lamps for which its scene was built.

use dunkelfeld_io::ImportWarning;
use dunkelfeld_io::job::Job;
use dunkelfeld_radiometry::{Number, Seconds};
use dunkelfeld_render::{Error, RenderSettings, SensorChoice};
use dunkelfeld_scene::{BuildReport, Finding, Scene, Severity, Shutter};
use dunkelfeld_sensor::Exposure;

/// Sets the exposure time of a pixel, that of all stages of a line scan together, where the samples are those of this
/// time. A strobe does not shorten it: the lamp is dark for the rest of it.
pub(crate) fn expose_for(settings: &mut RenderSettings, shutter: Option<&Shutter>, job: &Job) -> Result<(), Error> {
    let Some(shutter) = shutter else { return Ok(()) };
    if let (SensorChoice::Emva { exposure, .. }, Some(seconds)) = (&mut settings.sensor, job.total_exposure()) {
        *exposure = Some(Exposure::new(Seconds(seconds))?);
    }
    if let Shutter::Lines(lines) = shutter {
        settings.readout.line_scan_stages = lines.stages;
    }
    Ok(())
}

/// Refuses a film or an exposure that is not the one for which the scene was built: a line scan has a time for each row,
/// objects move for the time of the exposure, and the strobe of a lamp is a share of it.
pub(crate) fn check_shutter(scene: &Scene, settings: &RenderSettings, job: &Job) -> Result<(), Error> {
    let shutter = scene.shutter();
    if let Some(Shutter::Lines(lines)) = shutter
        && lines.rows != settings.height
    {
        let problem = format!("the line scan of the job has {} rows", lines.rows);
        return Err(Error::setting("height", problem, "set `height` in [film] of the job"));
    }
    let SensorChoice::Emva { exposure, .. } = &settings.sensor else { return Ok(()) };
    if let Some(TimedExposure { time, reason }) = timed_exposure(scene, job)
        && exposure.map(|e| e.time()) != Some(time)
    {
        let problem = format!("{reason} for an exposure of {} s", Number(time.0));
        return Err(Error::setting("exposure", problem, "set `exposure` in [sensor] of the job"));
    }
    Ok(())
}

/// The exposure time for which the samples of a scene are made: its film cannot be exposed for another time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedExposure {
    /// The exposure time of a pixel \[s\]: that of all stages of a line scan together.
    pub time: Seconds,
    /// The reason, the subject and verb of a sentence: "the strobe of a lamp is timed".
    pub reason: &'static str,
}

/// See [`Project::timed_exposure`](crate::Project::timed_exposure).
pub(crate) fn timed_exposure(scene: &Scene, job: &Job) -> Option<TimedExposure> {
    let shutter = scene.shutter();
    let has_strobe = job.first_strobe().is_some();
    let reason = match shutter {
        Some(_) => "objects move, or rows are scanned,",
        None if has_strobe => "the strobe of a lamp is timed",
        None => return None,
    };
    let built = job.total_exposure().or(shutter.map(Shutter::exposure));
    built.map(|built| TimedExposure { time: Seconds(built), reason })
}

/// Adds the hazard of strobes beside other light to the report of a scene.
pub(crate) fn report_strobes(hazard: Option<ImportWarning>, report: &mut BuildReport) {
    let finding =
        |hazard: ImportWarning| Finding { severity: Severity::Hazard, place: hazard.place, message: hazard.message };
    report.findings.extend(hazard.map(finding));
}

/// The share of the light that the beam splitters in front of a camera let pass to it.
pub(crate) fn splitter_of(job: &Job, scene: &Scene, camera: &str) -> f64 {
    job.splitter_transmission(camera, scene.cameras().first().map(|first| first.name.as_str()))
}

#[cfg(test)]
mod tests {
    use crate::{Error, Project};
    use dunkelfeld_radiometry::Seconds;
    use dunkelfeld_render::SensorChoice;
    use dunkelfeld_scene::{Severity, Shutter};
    use dunkelfeld_sensor::Exposure;

    const CAMERA: &str = "[camera]\nlook_at = \"part\"\nworking_distance = 0.3\n";
    const PANEL: &str = "[[light]]\nkind = \"panel\"\nwidth = 0.1\ndistance = 0.2\nstrobe = 5e-5\n";
    const MOVING: &str = "velocity = [1, 0, 0]\n";

    /// A box under a camera, with the exposure of 1 ms; the keys of the box, and other sections.
    fn open(keys: &str, text: &str) -> Project {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("job.toml");
        let job = format!(
            "scene = \"none\"\n[film]\nwidth = 8\nheight = 8\n[lens]\nfocal_length = \"25mm\"\n[sensor]\n\
             exposure = \"1ms\"\n[[object]]\nname = \"part\"\nkind = \"box\"\nsize = [0.02, 0.01, 0.02]\n{keys}{text}"
        );
        std::fs::write(&path, job).expect("writable");
        Project::open(&path).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()))
    }

    fn exposed(mut project: Project, seconds: Option<f64>) -> Result<Option<f64>, Error> {
        if let SensorChoice::Emva { exposure, .. } = &mut project.settings.sensor
            && let Some(seconds) = seconds
        {
            *exposure = Some(Exposure::new(Seconds(seconds))?);
        }
        match project.fitted()?.sensor {
            SensorChoice::Emva { exposure, .. } => Ok(exposure.map(|e| e.time().0)),
            SensorChoice::None => Ok(None),
        }
    }

    #[test]
    fn an_exposure_that_is_not_that_of_a_strobe_is_refused() {
        let text = format!("{CAMERA}{PANEL}");
        assert_eq!(exposed(open("", &text), None).expect("the exposure of the job"), Some(1e-3));
        assert_eq!(open("", &text).timed_exposure().map(|timed| timed.time), Some(Seconds(1e-3)));
        let error = exposed(open("", &text), Some(2e-3)).expect_err("another exposure").to_string();
        assert!(error.contains("strobe") && error.contains("0.001 s") && error.contains("[sensor]"), "{error}");
        // Without a strobe each exposure is possible.
        let steady = text.replace("strobe", "# strobe");
        assert_eq!(exposed(open("", &steady), Some(2e-3)).expect("no strobe"), Some(2e-3));
        assert_eq!(open("", &steady).timed_exposure(), None);
    }

    #[test]
    fn a_common_strobe_freezes_motion_and_not_the_exposure_of_the_sensor() {
        let project = open(MOVING, &format!("{CAMERA}{PANEL}"));
        assert_eq!(project.scene.shutter(), Some(&Shutter::Frame { exposure: 5e-5 }));
        let strobes = |project: &Project| {
            let findings = project.report.findings.iter();
            findings.filter(|f| f.place.contains("strobe") && f.severity == Severity::Hazard).count()
        };
        assert_eq!(strobes(&project), 0);
        assert_eq!(exposed(project, None).expect("the exposure of the job"), Some(1e-3));
        let mixed = open(MOVING, &format!("{CAMERA}{PANEL}[environment]\nradiance = 1\n"));
        assert_eq!(mixed.scene.shutter(), Some(&Shutter::Frame { exposure: 1e-3 }));
        assert_eq!(strobes(&mixed), 1);
    }

    #[test]
    fn a_beam_splitter_dims_its_own_camera_only() {
        let cameras = "[[camera]]\nname = \"top\"\nlook_at = \"part\"\nworking_distance = 0.3\n[[camera]]\n\
                       name = \"side\"\nlook_at = \"part\"\nposition = [0.3, 0, 0]\n";
        let coaxial = "[[light]]\nkind = \"coaxial\"\nwidth = 0.05\ndistance = 0.1\nsplitter = 0.4\n";
        // Without a sensor there is no lens and no splitter.
        let mut plain = open("", &format!("{cameras}{coaxial}"));
        let splitters = |project: &Project| {
            let findings = project.findings().findings;
            findings.iter().filter(|f| f.place == "beam splitter").count()
        };
        assert_eq!(splitters(&plain), 0);
        plain.settings.sensor = SensorChoice::None;
        assert_eq!(splitters(&plain), 1, "of one camera");
        let transmissions = |text: &str| {
            let mut project = open("", text);
            ["top", "side"].map(|camera| {
                project.settings.camera = Some(camera.into());
                match project.fitted().unwrap_or_else(|e| panic!("{e}")).sensor {
                    // The transmission of the default lens remains, so that other lenses have the splitter too.
                    SensorChoice::Emva { optics, .. } if optics.transmission() == 0.9 => optics.bands().transmission[1],
                    SensorChoice::Emva { optics, .. } => panic!("a lens of {}", optics.transmission()),
                    SensorChoice::None => panic!("no sensor"),
                }
            })
        };
        for (camera, expected) in [("", [0.6, 1.0]), ("camera = \"side\"\n", [1.0, 0.6])] {
            let found = transmissions(&format!("{cameras}{coaxial}{camera}"));
            let agree = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9);
            assert!(agree, "{camera}: {found:?} instead of {expected:?}");
        }
    }
}
