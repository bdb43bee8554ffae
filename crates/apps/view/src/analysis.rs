//! The thread that analyses the films beside the render: their certificates, the noise for matched exposure, and denoised
//! means.

use crate::developed::{Accept, Developed};
use crate::engine::AFTER_PANIC;
use crate::panics::caught;
use crate::protocol::{Activity, Camera, CertificateState, CurvePoint, Noise, Readiness};
use crate::shared::{Control, Shared, lock};
use crate::snapshot::{Content, Snapshot};
use dunkelfeld::DenoiseMethod;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

/// The analysis of a film may take this share of the time of the threads.
const SHARE: f64 = 0.04;
/// The same while a page shows a picture that waits for the analysis.
const SHARE_IF_WANTED: f64 = 0.2;
/// The same while nothing renders.
const SHARE_WITHOUT_RENDER: f64 = 0.5;
/// The shortest and the longest pause after an analysis \[s\].
const MIN_PAUSE: f64 = 0.05;
const MAX_PAUSE: f64 = 20.0;
/// Noise and denoised mean that no page asks for are computed once in a render, after this time of it \[s\].
const PREPARED_AFTER: f64 = 5.0;

/// Analyses the films that are published, at a small share of the time, until the view ends.
pub(crate) fn run(shared: &Arc<Shared>) {
    while let Some((snapshot, camera)) = next(shared) {
        let began = Instant::now();
        let analysed = caught("the analysis of the noise", AFTER_PANIC, || {
            prepare_shown(shared, &snapshot, &camera);
            certify(shared, &snapshot, &camera.without_noise());
            prepare_others(shared, &snapshot, &camera);
        });
        if let Err(fault) = analysed {
            shared.update(|live| live.error = Some(fault));
        }
        shared.notify();
        pause(shared, &camera, began.elapsed().as_secs_f64());
    }
}

/// The newest film and the camera of the statistics, when one of both is new. `None` at the end of the view.
fn next(shared: &Shared) -> Option<(Arc<Snapshot>, Camera)> {
    let mut control = lock(&shared.control);
    loop {
        if control.quit {
            return None;
        }
        (control.is_analysis_awaited, control.is_certificate_awaited) = (false, false);
        if let Some(snapshot) = shared.snapshot()
            && let Some(camera) = lock(&shared.live).next_camera(snapshot.id)
        {
            return Some((snapshot, camera));
        }
        control = shared.wake.wait(control).unwrap_or_else(PoisonError::into_inner);
    }
}

/// Certifies a film for a camera, and adds the point of the curve.
fn certify(shared: &Shared, snapshot: &Arc<Snapshot>, camera: &Camera) {
    let developed = shared.store.get(snapshot, camera, &shared.session).ok();
    if let Some(developed) = &developed {
        developed.certify(&shared.background);
    }
    let certified_at = |k: f64| certificate_of(snapshot, developed.as_deref()?, k);
    // The target may move meanwhile.
    loop {
        let target = lock(&shared.live).target;
        let state = certified_at(target);
        let mut live = lock(&shared.live);
        if live.target != target {
            continue;
        }
        if live.camera().without_noise() != *camera {
            break;
        }
        let is_of_render = snapshot.restarted == live.render.restarted;
        let statistics = live.statistics.measure(camera);
        statistics.certificate = state;
        // A film has one point. The render may have started again meanwhile.
        if let Some(state) = state
            && is_of_render
            && statistics.curve.last().is_none_or(|point| point.film != snapshot.id)
        {
            let (seconds, spp, film) = (snapshot.seconds, snapshot.spp(), snapshot.id);
            statistics.add_point(CurvePoint { seconds, spp, k99: state.p99, film });
        }
        break;
    }
    shared.notify();
}

/// Computes the noise for matched exposure or the denoised mean of a film that the camera shows.
fn prepare_shown(shared: &Shared, snapshot: &Arc<Snapshot>, camera: &Camera) {
    let readiness = match (camera.denoise, camera.noise) {
        (DenoiseMethod::Off, Noise::Matched) if camera.sensor.is_some() => shared.store.noise(snapshot, camera),
        (DenoiseMethod::Off, _) => Readiness::Exact,
        (method, _) => shared.store.denoised(snapshot, method),
    };
    if readiness != Readiness::Exact {
        compute(shared, snapshot, camera);
    }
}

/// Computes both if the scene has none yet, so that the first picture with them has them at once.
fn prepare_others(shared: &Shared, snapshot: &Arc<Snapshot>, camera: &Camera) {
    // The state of a pause follows its picture.
    let is_paused = lock(&shared.control).is_paused;
    let is_running = lock(&shared.live).render.state == Activity::Running && !is_paused;
    if is_running && snapshot.seconds < PREPARED_AFTER {
        return;
    }
    let plain = camera.without_noise();
    if camera.sensor.is_some() && shared.store.noise(snapshot, camera) == Readiness::None {
        compute(shared, snapshot, &Camera { noise: Noise::Matched, ..plain.clone() });
    }
    let can_be_denoised = !matches!(snapshot.content, Content::Exr(_));
    if can_be_denoised && shared.store.denoised(snapshot, DenoiseMethod::Auto) == Readiness::None {
        compute(shared, snapshot, &Camera { denoise: DenoiseMethod::Auto, ..plain });
    }
}

/// Computes the results that a camera needs. If that fails, a page that asks for the picture gets the reason.
fn compute(shared: &Shared, snapshot: &Arc<Snapshot>, camera: &Camera) {
    let found = shared.store.find(snapshot, camera, Accept::Exact, &shared.background);
    shared.store.finish(snapshot, camera, found.map(drop));
    shared.notify();
}

/// Waits after an analysis that took so many seconds on all threads, so that the render has the other time.
fn pause(shared: &Shared, camera: &Camera, seconds: f64) {
    let is_running = lock(&shared.live).render.state == Activity::Running;
    let is_wanted = camera.noise == Noise::Matched || camera.denoise != DenoiseMethod::Off;
    let share = match (is_running, is_wanted) {
        (false, _) => SHARE_WITHOUT_RENDER,
        (true, true) => SHARE_IF_WANTED,
        (true, false) => SHARE,
    };
    let pause = |share: f64| Duration::from_secs_f64((seconds / share * 0.5).clamp(MIN_PAUSE, MAX_PAUSE));
    // A page whose camera has no certificate waits for this time at most.
    let shortest = pause(share.max(SHARE_IF_WANTED));
    let control = lock(&shared.control);
    let is_over = |c: &Control| c.quit || (is_running && c.is_paused) || c.is_analysis_awaited;
    let waited = shared.wake.wait_timeout_while(control, shortest, |c| !is_over(c));
    let (control, waited) = waited.unwrap_or_else(PoisonError::into_inner);
    if waited.timed_out() {
        let waits = |c: &mut Control| !(is_over(c) || c.is_certificate_awaited);
        drop(shared.wake.wait_timeout_while(control, pause(share).saturating_sub(shortest), waits));
    }
}

/// The certificate of a film at a level.
pub(crate) fn certificate_of(snapshot: &Snapshot, developed: &Developed, k: f64) -> Option<CertificateState> {
    let certified = developed.certified()?;
    // The certificate has ratios of variances, the page levels k.
    let known = |ratio: f64| ratio.is_finite().then(|| ratio.sqrt());
    let certificate = &certified.certificate;
    Some(CertificateState {
        k,
        hidden: certified.hidden_at(k),
        median: known(certificate.median),
        p99: known(certificate.p99),
        saturated: certificate.saturated,
        film: snapshot.id,
    })
}
