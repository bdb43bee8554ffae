//! The answers to the requests of a page.

use crate::ablation;
use crate::developed::Developed;
use crate::engine;
use crate::light_films::check_number;
use crate::measure;
use crate::path::trace_path;
use crate::protocol::{
    AblationAnswer, AblationRequest, Action, Camera, Fault, FrameHeader, FrameRequest, Line, LineRequest, MapHeader,
    MapKind, MapRequest, Noise, PathAnswer, PathRequest, PhotonTransfer, PhotonTransferRequest, Probe, ProbeRequest,
    Regions, RegionsRequest, RenderRequest, SceneRequest, SourceKind, TargetRequest,
};
use crate::scenes::Scenes;
use crate::shared::{Shared, lock};
use dunkelfeld::trace::PixelSample;
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::Duration;

/// The range of the target k.
const TARGETS: std::ops::RangeInclusive<f64> = 0.05..=4.0;

/// Seconds that a request waits for the thread that renders.
const PATIENCE: Duration = Duration::from_secs(20);

fn no_picture() -> Fault {
    Fault::new("there is no picture yet", "wait for the first one")
}

fn developed(shared: &Shared, camera: &Camera) -> Result<Arc<Developed>, Fault> {
    let snapshot = shared.snapshot().ok_or_else(no_picture)?;
    let sensors = lock(&shared.live).sensors.clone();
    shared.store.get(&snapshot, camera, &sensors, &shared.session)
}

/// A frame. Its camera becomes that of the statistics.
pub(crate) fn frame(shared: &Shared, request: &FrameRequest) -> Result<(FrameHeader, Vec<u8>), Fault> {
    let developed = developed(shared, &request.camera)?;
    let is_new = {
        let mut live = lock(&shared.live);
        let is_new = live.shown.as_ref() != Some(&request.camera);
        live.shown = Some(request.camera.clone());
        is_new
    };
    if is_new {
        shared.wake();
    }
    shared.session.install(|| developed.frame(request.frame, request.tone))
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
    let ablation = lock(&shared.ablation).clone();
    let difference = ablation.as_ref().and_then(|ablation| ablation.difference());
    shared.session.install(|| developed.map(request.map, difference))
}

/// A pixel.
pub(crate) fn probe(shared: &Shared, request: &ProbeRequest) -> Result<Probe, Fault> {
    let unbiased = developed(shared, &request.camera.without_noise())?;
    unbiased.certify(&shared.session);
    let developed = developed(shared, &request.camera)?;
    let materials = lock(&shared.live).materials.clone();
    shared.session.install(|| measure::probe(&developed, &unbiased, &materials, request.frame, [request.x, request.y]))
}

/// Regions.
pub(crate) fn regions(shared: &Shared, request: &RegionsRequest) -> Result<Regions, Fault> {
    let developed = developed(shared, &request.camera)?;
    shared.session.install(|| measure::regions(&developed, request.frame, &request.regions))
}

/// A line profile.
pub(crate) fn line(shared: &Shared, request: &LineRequest) -> Result<Line, Fault> {
    let developed = developed(shared, &request.camera)?;
    shared.session.install(|| measure::line(&developed, request.frame, request.from, request.to))
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
        if let (Some(true), Some((lights, memory))) = (request.per_light, &live.light_films) {
            check_number(*lights)?;
            memory.check()?;
        }
        let mut change = waiting.unwrap_or_else(|| live.change.clone());
        change.add(request, &live.parts)?;
        control.change = Some(change);
        Ok(())
    })
}

/// A path of a sample, traced by the thread that renders.
pub(crate) fn path(shared: &Shared, request: &PathRequest) -> Result<PathAnswer, Fault> {
    needs_scene(shared)?;
    let snapshot = shared.snapshot().ok_or_else(no_picture)?;
    let [width, height] = snapshot.size();
    if request.x >= width || request.y >= height {
        return Err(Fault::new("the pixel is outside the image", "choose a pixel of the image"));
    }
    // Of several films, the sample is that of the one with the heaviest sample.
    let factors = snapshot.factors(lock(&shared.live).camera().lights.as_ref())?;
    let heaviest = snapshot.heaviest(&factors, request.x, request.y);
    let none = || Fault::new("no sample of the pixel has light", "choose a brighter pixel, or a number of a sample");
    let index = request.index.or(heaviest.map(|heaviest| heaviest.index)).ok_or_else(none)?;
    let light = snapshot.light(heaviest.map_or(0, |heaviest| heaviest.film)).map(str::to_owned);
    let at = PixelSample { x: request.x, y: request.y, index };
    let (answer, waiting) = channel();
    let job = move |scenes: Scenes<'_>| {
        let gone = || Fault::new("the films of the lights have changed", "ask again for the new picture");
        let path = scenes.of_film(light.as_deref()).ok_or_else(gone).and_then(|project| trace_path(project, at));
        drop(answer.send(path));
    };
    shared.control(|control| control.jobs.push(Box::new(job)));
    let late = || Fault::new("the render is busy", "ask again when it runs");
    waiting.recv_timeout(PATIENCE).map_err(|_| late())?
}

/// Compares the image with one that an effect is left out of. Starts the comparison, or reports its state.
pub(crate) fn ablation(shared: &Arc<Shared>, request: &AblationRequest) -> Result<AblationAnswer, Fault> {
    needs_scene(shared)?;
    let developed = developed(shared, &request.camera.without_noise())?;
    ablation::ask(shared, &request.effect, developed)
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
    let state = developed(shared, &camera).ok().and_then(|developed| {
        developed.certify(&shared.session);
        engine::certificate_of(&developed.snapshot, &developed, request.k)
    });
    shared.update(|live| {
        live.certificate = state.or(live.certificate);
        live.curve.iter_mut().for_each(|point| {
            // The share of an earlier film at another level is not known.
            if state.is_none_or(|state| point.k99 != state.p99) {
                point.hidden = if point.k99.is_some_and(|k99| k99 <= request.k) { 0.99 } else { 0.0 };
            }
        });
    });
    Ok(())
}
