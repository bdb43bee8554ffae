//! The answers to the requests of a page.

use crate::analysis;
use crate::developed::{Accept, Developed};
use crate::measure;
use crate::panics::caught;
use crate::path::trace_path;
use crate::protocol::{
    Action, Camera, Fault, FrameHeader, FrameRequest, Line, LineRequest, MapHeader, MapKind, MapRequest, Noise,
    PathAnswer, PathRequest, PhotonTransfer, PhotonTransferRequest, Probe, ProbeRequest, Regions, RegionsRequest,
    RenderRequest, SceneRequest, SourceKind, TargetRequest,
};
use crate::shared::{Job, Shared, lock};
use crate::snapshot::Snapshot;
use dunkelfeld::Project;
use dunkelfeld::trace::PixelSample;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::Duration;

/// The range of the target k.
const TARGETS: RangeInclusive<f64> = 0.05..=4.0;
/// Seconds that a request waits for the thread that renders.
const PATIENCE: Duration = Duration::from_secs(20);

fn developed(shared: &Shared, camera: &Camera) -> Result<Arc<Developed>, Fault> {
    let snapshot = shared.snapshot().ok_or_else(Fault::no_picture)?;
    developed_of(shared, &snapshot, camera)
}

fn developed_of(shared: &Shared, snapshot: &Arc<Snapshot>, camera: &Camera) -> Result<Arc<Developed>, Fault> {
    shared.store.get(snapshot, camera, &shared.session).map_err(|fault| until_change(shared, snapshot, camera, fault))
}

/// A fault of the picture before a change of the scene: the next picture may have the sensor and the exposure that this one has
/// not, so that the same request is answered later.
fn until_change(shared: &Shared, snapshot: &Snapshot, camera: &Camera, fault: Fault) -> Fault {
    let sensors = lock(&shared.live).sensors.clone();
    let is_known = camera.sensor.as_ref().is_none_or(|name| sensors.all().iter().any(|(listed, _)| listed == name));
    Fault { is_early: is_known && shared.is_outdated(snapshot), ..fault }
}

/// A frame.
pub(crate) fn frame(shared: &Shared, request: &FrameRequest) -> Result<(FrameHeader, Vec<u8>), Fault> {
    let snapshot = shared.snapshot().ok_or_else(Fault::no_picture)?;
    let accept = if request.exact { Accept::Exact } else { Accept::Provisional };
    let found = shared.store.find(&snapshot, &request.camera, accept, &shared.session);
    let developed = found.map_err(|fault| until_change(shared, &snapshot, &request.camera, fault))?;
    if request.statistics {
        let (is_new, is_unknown) = {
            let statistics = &mut lock(&shared.live).statistics;
            let is_known = statistics.of(&request.camera.without_noise()).is_some_and(|of| of.certificate.is_some());
            (statistics.show(&request.camera), !is_known)
        };
        if is_new {
            shared.control(|control| {
                control.is_analysis_awaited |= !developed.is_exact();
                control.is_certificate_awaited |= is_unknown;
            });
        }
    }
    developed.frame(request.frame, request.tone, &shared.session)
}

/// A map.
pub(crate) fn map(shared: &Shared, request: &MapRequest) -> Result<(MapHeader, Vec<u8>), Fault> {
    let is_noise = matches!(request.map, MapKind::Ratio | MapKind::RenderSigma | MapKind::CameraSigma);
    // A denoised image has no noise that is known.
    let camera = if is_noise { request.camera.without_noise() } else { request.camera.clone() };
    let developed = developed(shared, &camera)?;
    if is_noise {
        developed.certify(&shared.session);
    }
    if request.map == MapKind::FirstLight {
        developed.find_film(&shared.session);
    }
    shared.session.install(|| developed.map(request.map))
}

/// A pixel.
pub(crate) fn probe(shared: &Shared, request: &ProbeRequest) -> Result<Probe, Fault> {
    // Both are of one picture.
    let snapshot = shared.snapshot().ok_or_else(Fault::no_picture)?;
    let unbiased = developed_of(shared, &snapshot, &request.camera.without_noise())?;
    unbiased.certify(&shared.session);
    unbiased.find_film(&shared.session);
    let developed = developed_of(shared, &snapshot, &request.camera)?;
    shared.session.install(|| measure::probe(&developed, &unbiased, request.frame, [request.x, request.y]))
}

/// Regions.
pub(crate) fn regions(shared: &Shared, request: &RegionsRequest) -> Result<Regions, Fault> {
    let developed = developed(shared, &request.camera)?;
    shared.session.install(|| measure::regions(&developed, request.frame, &request.regions, request.channel))
}

/// A line profile.
pub(crate) fn line(shared: &Shared, request: &LineRequest) -> Result<Line, Fault> {
    let developed = developed(shared, &request.camera)?;
    shared.session.install(|| measure::line(&developed, request.frame, [request.from, request.to], request.channel))
}

/// The photon transfer of frames with all of the camera's noise.
pub(crate) fn photon_transfer(shared: &Shared, request: &PhotonTransferRequest) -> Result<PhotonTransfer, Fault> {
    let developed = developed(shared, &Camera { noise: Noise::Plain, ..request.camera.clone() })?;
    shared.session.install(|| measure::photon_transfer(&developed))
}

/// A change of the scene: the render starts again.
pub(crate) fn scene(shared: &Shared, request: SceneRequest) -> Result<(), Fault> {
    needs_scene(shared)?;
    shared.control(|control| {
        // A change that waits or is being made is not lost.
        let waiting = control.change.clone().or_else(|| control.in_progress.clone());
        let live = lock(&shared.live);
        if let (Some(true), Some(films)) = (request.per_light, &live.light_films) {
            films.fits.clone()?;
        }
        let mut change = waiting.unwrap_or_else(|| live.change.clone());
        change.add(request, &live.parts)?;
        control.change = Some(change);
        // A pause would keep the picture of the scene before the change.
        control.is_paused = false;
        Ok(())
    })
}

/// A path of a sample of the picture, traced by the thread that renders.
pub(crate) fn path(shared: &Arc<Shared>, request: &PathRequest) -> Result<PathAnswer, Fault> {
    needs_scene(shared)?;
    let snapshot = shared.snapshot().ok_or_else(Fault::no_picture)?;
    let [width, height] = snapshot.size();
    if request.x >= width || request.y >= height {
        return Err(Fault::new("the pixel is outside the image", "choose a pixel of the image"));
    }
    let developed = developed_of(shared, &snapshot, &request.camera)?;
    developed.find_film(&shared.session);
    let heaviest = developed.heaviest(request.x, request.y);
    let none = || Fault::new("no sample of the pixel has light", "choose a brighter pixel, or a number of a sample");
    let index = request.index.or(heaviest.map(|heaviest| heaviest.index)).ok_or_else(none)?;
    let at = PixelSample { x: request.x, y: request.y, index };
    let (number, state) = (snapshot.scene.number, shared.clone());
    at_render(shared, move |project| match lock(&state.live).scene_number == number {
        true => trace_path(project, at),
        false => Err(Fault::earlier_scene()),
    })?
}

/// Runs work on the thread that renders, between two passes.
fn at_render<T: Send + 'static>(
    shared: &Shared,
    work: impl FnOnce(&Project) -> T + Send + 'static,
) -> Result<T, Fault> {
    let (answer, waiting) = channel();
    let job: Job = Box::new(move |project| {
        // A fault of the program ends the answer, and not the render.
        drop(answer.send(caught("work beside the render", "ask again", || work(project))));
    });
    shared.control(|control| control.jobs.push(job));
    waiting.recv_timeout(PATIENCE).map_err(|_| Fault::new("the render is busy", "ask again when it runs"))?
}

/// Pauses the render, continues it, or starts it again.
pub(crate) fn render(shared: &Shared, request: RenderRequest) -> Result<(), Fault> {
    needs_scene(shared)?;
    shared.control(|control| match request.action {
        Action::Pause => control.is_paused = true,
        Action::Resume => control.is_paused = false,
        Action::Restart => {
            control.is_paused = false;
            control.reload = true;
        }
    });
    Ok(())
}

fn needs_scene(shared: &Shared) -> Result<(), Fault> {
    if shared.subject.kind == SourceKind::Render {
        return Ok(());
    }
    Err(Fault::new("a stored film has no scene", "open the scene or its job"))
}

/// Sets the level of noise of the certificate.
pub(crate) fn target(shared: &Shared, request: TargetRequest) -> Result<(), Fault> {
    if !TARGETS.contains(&request.k) {
        let (low, high) = (TARGETS.start(), TARGETS.end());
        return Err(Fault::new(format!("the level {} is out of range", request.k), format!("use {low} to {high}")));
    }
    let camera = {
        let mut live = lock(&shared.live);
        live.target = request.k;
        live.camera().without_noise()
    };
    // The shares of another level need no new analysis.
    let known = developed(shared, &camera).ok().and_then(|developed| {
        developed.certify(&shared.session);
        Some((camera, analysis::certificate_of(&developed.snapshot, &developed, request.k)?))
    });
    shared.update(|live| {
        // Another request may have moved target or camera meanwhile.
        if let Some((camera, state)) = known.filter(|(_, state)| state.k == live.target)
            && live.camera().without_noise() == camera
        {
            live.statistics.measure(&camera).certificate = Some(state);
        }
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::Tone;
    use crate::shared::Subject;
    use crate::snapshot::{Content, PictureScene};
    use dunkelfeld::{Cancel, Session, Silent};

    const JOB: &str = "scene = 'none'\nfilm = { width = 16, height = 16 }\nbudget = { spp = 2 }\n\
        camera = { look_at = [0, 0, 0], position = [0, 0.3, 0.4] }\n\
        [[object]]\nname = 'ball'\nkind = 'sphere'\ndiameter = '400mm'\n[environment]\nradiance = 1\n";

    /// A view with a picture of a small scene, its third one.
    fn view() -> (Arc<Shared>, Project) {
        let project = Project::from_text("ball.toml", JOB).expect("a job");
        let (mut rendering, settings, is_vignetted) =
            project.render_film(&Silent, &Cancel::new()).expect("a render without files");
        rendering.film.material_names.fill("of the picture".to_owned());
        let scene = Arc::new(PictureScene { number: 3, ..PictureScene::default() });
        let snapshot = Snapshot::new(1, Content::Film(rendering.film), (settings, is_vignetted), scene, 0.0, None);
        let subject = Subject { path: "ball.toml".into(), kind: SourceKind::Render, output: ".".into(), nice: 0 };
        let session = Session::new(1).expect("a thread");
        let shared = Arc::new(Shared::new(subject, session.clone(), session));
        shared.update(|live| (live.snapshot, live.scene_number) = (Some(Arc::new(snapshot)), 3));
        (shared, project)
    }

    /// The answer of a path while this thread is the one that renders.
    fn path_of(shared: &Arc<Shared>, project: &Project) -> Result<PathAnswer, Fault> {
        std::thread::scope(|scope| {
            let asked =
                scope.spawn(|| path(shared, &PathRequest { x: 8, y: 8, index: Some(1), camera: Camera::plain(None) }));
            loop {
                let jobs = shared.control(|control| std::mem::take(&mut control.jobs));
                if !jobs.is_empty() {
                    jobs.into_iter().for_each(|job| job(project));
                    break;
                }
                std::thread::yield_now();
            }
            asked.join().expect("no panic")
        })
    }

    /// The path of a sample is that of the picture, or refused: another scene has other paths.
    #[test]
    fn paths_belong_to_the_scene_of_the_picture() {
        let (shared, project) = view();
        let path = path_of(&shared, &project).expect("the scene of the picture");
        let film = shared.snapshot().expect("a picture");
        let film = film.film().expect("a film");
        assert!(path.vertices.len() > 1);
        // The largest sample of the pixel has the luminance that the film has of it.
        let (index, luminance) = film.sums.pixel(8, 8).heaviest().expect("light");
        if index == 1 {
            assert_eq!(path.luminance as f32, luminance);
        } else {
            assert!(path.luminance as f32 <= luminance);
        }
        lock(&shared.live).scene_number = 4;
        assert_eq!(path_of(&shared, &project), Err(Fault::earlier_scene()));
    }

    /// A frame makes its camera that of the statistics. Picture B does not.
    #[test]
    fn the_statistics_are_those_of_the_last_picture() {
        let (shared, _) = view();
        let first = lock(&shared.live).first_camera();
        let show = |statistics: bool, gain: f64| {
            let camera = Camera { gain, ..first.clone() };
            frame(&shared, &FrameRequest { camera, frame: 0, tone: Tone::Gamma, exact: false, statistics })
        };
        let gain = || shared.state().statistics_of.gain;
        assert_eq!(gain(), 1.0);
        for (statistics, gain_of_frame, expected) in [(true, 2.0, 2.0), (false, 4.0, 2.0), (true, 3.0, 3.0)] {
            show(statistics, gain_of_frame).expect("a frame");
            assert_eq!(gain(), expected);
        }
    }

    /// A camera that the old picture refuses may be right for the scene that is being loaded.
    #[test]
    fn a_refusal_of_an_old_picture_is_early() {
        use crate::protocol::Activity;
        let (shared, _) = view();
        let camera = Camera { sensor: Some("as in the job".into()), ..lock(&shared.live).first_camera() };
        let model = Box::new(dunkelfeld::find_sensor("imx250").expect("a preset"));
        let optics = dunkelfeld::ExposeSettings::new((*model).clone()).expect("a sensor").optics;
        let choice = dunkelfeld::SensorChoice::Emva { model, optics, exposure: None };
        lock(&shared.live).sensors = crate::developed::Sensors::new(&choice);
        let body = FrameRequest { camera, frame: 0, tone: Tone::Gamma, exact: false, statistics: false };
        let is_early = || frame(&shared, &body).expect_err("no sensor of the list").is_early;
        assert!(!is_early());
        lock(&shared.live).render.state = Activity::Loading;
        assert!(!is_early());
        lock(&shared.live).scene_number = 4;
        assert!(is_early());
        // A name that no sensor has.
        let unknown =
            FrameRequest { camera: Camera { sensor: Some("x".into()), ..body.camera.clone() }, ..body.clone() };
        assert!(!frame(&shared, &unknown).expect_err("no sensor of the list").is_early);
        // Without a scene, no picture follows.
        lock(&shared.live).error = Some(Fault::new("an unknown key", "remove it"));
        assert!(!is_early());
    }

    #[test]
    fn names_are_those_of_the_picture() {
        let (shared, _) = view();
        let camera = lock(&shared.live).first_camera();
        let found = probe(&shared, &ProbeRequest { camera, frame: 0, x: 8, y: 8 }).expect("a pixel");
        assert_eq!((found.object.as_deref(), found.material.as_deref()), (Some("ball"), Some("of the picture")));
    }
}
