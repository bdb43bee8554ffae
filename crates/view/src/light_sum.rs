//! Films of single lights, and the picture of all of them with a factor for each.
//!
//! The films are independent renders. So the mean of the picture is the sum of their means times the factors, and its
//! variance the sum of their variances times the squares of the factors.

use crate::protocol::{Camera, Fault};
use dunkelfeld::film::{Certified, MeanImage, mean_image};
use dunkelfeld::light_films::sum_of_means;
use dunkelfeld::sensor::FilmVariances;
use dunkelfeld::{Exposer, RenderedFilm, Session};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// The largest factor of a light.
pub(crate) const MAX_FACTOR: f64 = 1e6;
/// Results of an analysis that are kept for a film: those of two cameras that are compared.
const KEPT: usize = 2;

/// Mean radiance [W/(m² sr)] of each pixel.
type Mean = MeanImage;

/// The film of a light that no longer changes, with results that do not depend on its factor.
#[derive(Debug)]
pub(crate) struct LightFilm {
    pub(crate) name: String,
    pub(crate) film: Arc<RenderedFilm>,
    mean: OnceLock<Mean>,
    /// The noise for cameras, each with the octave of its exposure.
    variances: Mutex<Vec<(Camera, i32, Arc<FilmVariances>)>>,
}

impl LightFilm {
    pub(crate) fn new(name: String, film: Arc<RenderedFilm>) -> Self {
        Self { name, film, mean: OnceLock::new(), variances: Mutex::new(Vec::new()) }
    }

    /// Mean radiance [W/(m² sr)], without gaps.
    fn mean(&self) -> &Mean {
        self.mean.get_or_init(|| mean_image(&self.film.sums, self.film.is_spread))
    }

    /// The variances of the mean behind a camera.
    fn variances(&self, exposer: &Exposer, camera: &Camera) -> Arc<FilmVariances> {
        let octave = exposer.exposure_octave();
        // The variances depend on the sensor alone.
        let camera = Camera { exposure: None, lights: None, black_level: None, ..camera.without_noise() };
        let list = || self.variances.lock().unwrap_or_else(PoisonError::into_inner);
        let is_it = |entry: &&(Camera, i32, Arc<FilmVariances>)| entry.0 == camera && entry.1 == octave;
        if let Some((.., found)) = list().iter().find(is_it) {
            return found.clone();
        }
        let variances = Arc::new(exposer.film_variances(&self.film));
        let mut list = list();
        if list.len() >= KEPT {
            list.remove(0);
        }
        list.push((camera, octave, variances.clone()));
        variances
    }
}

/// Computes the means of all films, once. Not for threads of the session.
pub(crate) fn find_means(films: &[LightFilm], session: &Session<'_>) {
    for light in films {
        light.mean.get_or_init(|| session.install(|| mean_image(&light.film.sums, light.film.is_spread)));
    }
}

/// The factor of each film. A light that the list leaves out has the factor 1. A name without a film is that of a light
/// that is off, or of an earlier scene.
///
/// # Errors
/// A factor out of range.
pub(crate) fn factors(films: &[LightFilm], lights: Option<&BTreeMap<String, f64>>) -> Result<Vec<f64>, Fault> {
    if let Some((name, factor)) =
        lights.and_then(|lights| lights.iter().find(|(_, factor)| !(0.0..=MAX_FACTOR).contains(*factor)))
    {
        let problem = format!("the factor {factor} of the light {name:?} is out of range");
        return Err(Fault::new(problem, "use 0 to 1000000"));
    }
    let of_light = |light: &LightFilm| lights.and_then(|lights| lights.get(&light.name)).copied().unwrap_or(1.0);
    Ok(films.iter().map(of_light).collect())
}

/// The mean of the picture [W/(m² sr)].
pub(crate) fn mean(films: &[LightFilm], factors: &[f64]) -> Result<Mean, Fault> {
    let means: Vec<_> = films.iter().map(LightFilm::mean).zip(factors.iter().copied()).collect();
    Ok(sum_of_means(&means)?)
}

/// The sum of means of films times their factors.
pub(crate) fn sum(means: &[Mean], factors: &[f64]) -> Result<Mean, Fault> {
    Ok(match (means, factors) {
        ([mean], [1.0]) => mean.clone(),
        _ => sum_of_means(&means.iter().zip(factors.iter().copied()).collect::<Vec<_>>())?,
    })
}

/// The certificate of the picture behind a camera at `k`. Runs on the threads of the session.
pub(crate) fn certify(
    films: &[LightFilm],
    factors: &[f64],
    (exposer, camera): (&Exposer, &Camera),
    k: f64,
) -> Option<Certified> {
    let lit = films.iter().zip(factors).filter(|(_, factor)| **factor > 0.0);
    let variances: Vec<(Arc<FilmVariances>, f64)> =
        lit.map(|(light, &factor)| (light.variances(exposer, camera), factor)).collect();
    let variances: Vec<_> = variances.iter().map(|(variances, factor)| (&**variances, *factor)).collect();
    exposer.certify_sum(&variances, k).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld::film::Film;

    fn plane(value: f32) -> Mean {
        dunkelfeld::film::Plane::new(2, 1, [value; 3]).into()
    }

    fn film(name: &str) -> LightFilm {
        LightFilm::new(name.into(), Arc::new(RenderedFilm::without_ids(Film::new(2, 1))))
    }

    #[test]
    fn lights_have_the_factors_of_their_names() {
        let films = [film("left"), film("right")];
        assert_eq!(factors(&films, None), Ok(vec![1.0, 1.0]));
        let given = BTreeMap::from([("right".to_owned(), 0.5), ("gone".to_owned(), 3.0)]);
        assert_eq!(factors(&films, Some(&given)), Ok(vec![1.0, 0.5]));
        for wrong in [-1.0, 2e6, f64::NAN, f64::INFINITY] {
            let given = BTreeMap::from([("right".to_owned(), wrong)]);
            assert!(factors(&films, Some(&given)).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_picture_is_the_sum_of_its_means() {
        let means = [1.5, 0.25].map(plane);
        assert_eq!(sum(&means[..1], &[1.0]).as_ref(), Ok(&means[0]));
        assert_eq!(sum(&means, &[2.0, 4.0]), Ok(plane(4.0)));
        assert_eq!(sum(&means, &[0.0, 0.0]), Ok(plane(0.0)));
    }
}
