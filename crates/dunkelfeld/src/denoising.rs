//! Denoising: choice of the denoiser, its threads and its inputs. Its image is only for display: no measurement,
//! exposure for measurement or certificate uses it.

use crate::commands::denoise::DenoisePlanes;
use crate::frame::{Frame, show_denoised};
use crate::oidn_library;
use crate::stats::DenoiseStats;
use dunkelfeld_denoise::{Builtin, Control, DenoiseInput, Executor};
use dunkelfeld_film::{Film, FilmLayers, Plane};
use dunkelfeld_render::Error;
use dunkelfeld_render::parallel::{map_film, map_film_to, mean_without_gaps};
use dunkelfeld_render::{DenoiseMethod, DenoiseSettings, RenderSettings};
use dunkelfeld_render::{ProgressState, Session, Stage};
use rayon::prelude::*;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

pub use dunkelfeld_denoise::{DenoiseError, Denoiser};
pub use dunkelfeld_render::OIDN_VARIABLE;

/// A denoised image, for display.
#[derive(Clone, Debug, PartialEq)]
pub struct Denoised {
    /// Radiance [W/(m^2 sr)].
    pub mean: Plane<[f32; 3]>,
    /// Name and version of the denoiser.
    pub denoiser: String,
    /// Seconds of denoising.
    pub seconds: f64,
}

/// The denoiser of the settings; `None` if denoising is off.
///
/// # Errors
/// Intel Open Image Denoise is required and cannot be loaded. It is required by [`DenoiseMethod::Oidn`], or by a path
/// in the settings or the environment.
pub fn find_denoiser(settings: &DenoiseSettings) -> Result<Option<Box<dyn Denoiser>>, Error> {
    if let (Some(path), DenoiseMethod::Off | DenoiseMethod::Builtin) = (&settings.oidn, settings.method) {
        let problem = format!("{} is not used: the denoiser is \"{}\"", path.display(), settings.method.name());
        return Err(Error::setting("oidn", problem, "choose the denoiser `oidn`, or do not name the library"));
    }
    let named =
        settings.oidn.clone().or_else(|| std::env::var_os(OIDN_VARIABLE).filter(|v| !v.is_empty()).map(Into::into));
    match settings.method {
        DenoiseMethod::Off => Ok(None),
        DenoiseMethod::Builtin => Ok(Some(Box::new(Builtin))),
        DenoiseMethod::Oidn | DenoiseMethod::Auto => match oidn_library::load(named.as_deref()) {
            Ok(oidn) => Ok(Some(Box::new(oidn))),
            Err(_) if settings.method == DenoiseMethod::Auto && named.is_none() => Ok(Some(Box::new(Builtin))),
            Err(e) => {
                let help = format!("{}, or choose the denoiser `builtin`", how_to_install());
                Err(Error::setting("oidn", e.to_string(), help))
            }
        },
    }
}

/// How this machine gets Intel Open Image Denoise.
fn how_to_install() -> String {
    format!(
        "install Open Image Denoise 1.4 or 2 (`pip install oidn` has it, in its folder oidn/lib.*), and name its library or its folder by --oidn PATH or {OIDN_VARIABLE}"
    )
}

/// The reason why an automatic choice took the built-in filter: the places without Intel Open Image Denoise, and the way to
/// get it. `None` for other choices. `denoiser` is the name of the one that was used.
pub fn why_builtin(settings: &DenoiseSettings, denoiser: &str) -> Option<String> {
    (settings.method == DenoiseMethod::Auto && denoiser == Builtin.name()).then(|| {
        let places = oidn_library::searched_places();
        format!("Intel Open Image Denoise was not found in {OIDN_VARIABLE}, {places}\n  help: {}", how_to_install())
    })
}

/// Replaces a denoiser by that of options. A library without a denoiser selects OIDN.
pub fn select_denoiser(method: Option<DenoiseMethod>, oidn: Option<&Path>, settings: &mut DenoiseSettings) {
    if let Some(method) = method.or(oidn.map(|_| DenoiseMethod::Oidn)) {
        settings.method = method;
        if matches!(method, DenoiseMethod::Off | DenoiseMethod::Builtin) {
            // The library of the job belongs to its denoiser.
            settings.oidn = None;
        }
    }
    if oidn.is_some() {
        settings.oidn = oidn.map(Path::to_path_buf);
    }
}

/// The threads of the current pool.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PoolExecutor;

impl Executor for PoolExecutor {
    fn threads(&self) -> usize {
        rayon::current_num_threads()
    }

    fn for_each(&self, pieces: usize, work: &(dyn Fn(usize) + Sync)) {
        (0..pieces).into_par_iter().for_each(work);
    }
}

/// Denoises a film on the threads of the current pool. Pixels without samples are filled from their neighbours first.
///
/// # Errors
/// Those of the denoiser; [`DenoiseError::Cancelled`] soon after cancellation.
pub fn denoise_film(film: &Film, denoiser: &dyn Denoiser, session: &Session<'_>) -> Result<Denoised, DenoiseError> {
    let began = Instant::now();
    let mean = run(&planes_of(film).input(), denoiser, film.total_samples(), session)?;
    Ok(Denoised { mean, denoiser: denoiser.name(), seconds: began.elapsed().as_secs_f64() })
}

/// Denoises the picture. A failure does not lose the rendered image: the statistics contain the reason.
pub(crate) fn denoise_frame(
    frame: &mut Frame,
    film: &Film,
    denoiser: &dyn Denoiser,
    settings: &RenderSettings,
    session: &Session<'_>,
) -> Result<DenoiseStats, Error> {
    let began = Instant::now();
    let error = match denoise_film(film, denoiser, session) {
        Ok(denoised) => {
            show_denoised(frame, denoised, settings)?;
            None
        }
        Err(e) => Some(e.to_string()),
    };
    Ok(DenoiseStats { denoiser: denoiser.name(), seconds: began.elapsed().as_secs_f64(), error })
}

/// Runs a denoiser on the threads of the current pool and reports its progress about ten times a second.
pub(crate) fn run(
    input: &DenoiseInput<'_>,
    denoiser: &dyn Denoiser,
    samples: u64,
    session: &Session<'_>,
) -> Result<Plane<[f32; 3]>, DenoiseError> {
    let began = Instant::now();
    let next = AtomicU64::new(0);
    let report = |fraction: f64| {
        let spent = began.elapsed();
        let (now, due) = (spent.as_millis() as u64, next.load(Ordering::Relaxed));
        if now >= due && next.compare_exchange(due, now + 100, Ordering::Relaxed, Ordering::Relaxed).is_ok() {
            let remaining = (fraction > 0.05).then(|| spent.as_secs_f64() * (1.0 / fraction - 1.0));
            let elapsed = session.elapsed();
            session.progress().update(&ProgressState { stage: Stage::Denoise, fraction, elapsed, remaining, samples });
        }
        !session.is_cancelled()
    };
    denoiser.denoise(input, &Control { executor: &PoolExecutor, progress: &report })
}

/// The inputs of a denoiser from a film.
fn planes_of(film: &Film) -> DenoisePlanes {
    let mut planes = DenoisePlanes::new(mean_without_gaps(film));
    planes.variance = Some(map_film(film, |p| p.variance_of_mean().map(|v| v as f32)));
    if film.layers() == FilmLayers::All {
        let of_surface = map_film_to(film, |p| {
            [p.mean_first_light(), p.mean_albedo(), p.variance_of_albedo(), p.mean_normal(), p.variance_of_normal()]
        });
        [planes.first_light, planes.albedo, planes.albedo_variance, planes.normal, planes.normal_variance] =
            of_surface.map(Some);
        [planes.depth, planes.depth_variance] =
            map_film_to(film, |p| [p.mean_depth(), p.variance_of_depth()]).map(Some);
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// Fails like a library without memory.
    struct Failing;

    impl Denoiser for Failing {
        fn name(&self) -> String {
            "failing".into()
        }

        fn denoise(&self, _: &DenoiseInput<'_>, _: &Control<'_>) -> Result<Plane<[f32; 3]>, DenoiseError> {
            Err(DenoiseError::Library("out of memory".into()))
        }
    }

    #[test]
    fn a_denoiser_that_fails_leaves_the_picture_as_it_was() {
        let film = Film::new(4, 3);
        let settings = RenderSettings::without_sensor().with_width(4).with_height(3);
        let mut frame = crate::develop(&Plane::from_fn(4, 3, |x, _| [x as f32; 3]), &settings).expect("a frame");
        let before = frame.picture.clone();
        let session = Session::new(1).expect("threads");
        let stats = denoise_frame(&mut frame, &film, &Failing, &settings, &session).expect("no error");
        assert_eq!((frame.picture, frame.denoised), (before, None));
        assert_eq!((stats.denoiser.as_str(), stats.error.as_deref()), ("failing", Some("out of memory")));
    }

    #[test]
    fn more_is_kept_back_for_more_pixels_and_fewer_threads_and_nothing_for_none() {
        let of =
            |method, pixels, threads| DenoiseSettings::default().with_method(method).expected_seconds(pixels, threads);
        assert_eq!(of(DenoiseMethod::Off, 1 << 27, 1), 0.0);
        for method in [DenoiseMethod::Auto, DenoiseMethod::Oidn, DenoiseMethod::Builtin] {
            let one = of(method, 1_000_000, 2);
            assert!(of(method, 2_000_000, 2) > one && of(method, 1_000_000, 1) > one && one > 0.5, "{method:?}");
        }
    }

    fn named(method: DenoiseMethod, oidn: Option<&Path>) -> DenoiseSettings {
        DenoiseSettings::default().with_method(method).with_oidn(oidn.map(Path::to_path_buf))
    }

    #[test]
    fn a_library_that_is_named_and_cannot_be_loaded_is_an_error_also_for_auto() {
        let folder = std::env::temp_dir().join("dunkelfeld-no-such-folder");
        for method in [DenoiseMethod::Auto, DenoiseMethod::Oidn] {
            for path in [folder.join("libOpenImageDenoise.so.2"), std::env::temp_dir().join("dunkelfeld-x")] {
                let error = find_denoiser(&named(method, Some(&path))).err().expect("nothing there").to_string();
                assert!(error.contains(&path.display().to_string()), "{error}");
                assert!(error.contains("help: install") && error.contains(OIDN_VARIABLE), "{error}");
            }
        }
    }
}
