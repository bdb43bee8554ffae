//! Images from the films of single lights. Light is additive, and the films are independent: the image with any factors of
//! the lights is the sum of the means times the factors, and its variance is the sum of the variances times their squares.

use crate::commands::expose::ExposeSettings;
use crate::exposer::{Exposer, through_lens};
use crate::frame::{Frame, develop};
use crate::image_noise::check_films;
use crate::outputs::{layer_attributes, layers_of_band, plane};
use dunkelfeld_film::{Film, FilmLayers, MeanImage, PixelSums, Plane};
use dunkelfeld_io::exr::{Channel, ExrLayers};
use dunkelfeld_io::layers::{Single, Triple};
use dunkelfeld_render::parallel::mean_image;
use dunkelfeld_render::{Error, RenderSettings, RenderedFilm};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

pub use crate::project::LightFilmsMemory;

/// A film with the name of its light, and the factor of its radiance.
#[derive(Clone, Copy, Debug)]
pub struct FilmOfLight<'a> {
    /// Name of the light.
    pub name: &'a str,
    /// The film, at factor 1.
    pub film: &'a RenderedFilm,
    /// The factor, zero or more.
    pub factor: f64,
}

/// The sum of means of one size, each times its factor. Runs on the threads of the current pool.
///
/// # Errors
/// No mean, means of different sizes, and factors below zero.
pub fn sum_of_means(means: &[(&MeanImage, f64)]) -> Result<MeanImage, Error> {
    let (first, _) = means.first().ok_or_else(|| Error::setting("films", "there is no film", "render one"))?;
    check_films(first.size(), means.iter().map(|(mean, factor)| (mean.size(), *factor)))?;
    // An infinite radiance of a dark light is dark.
    let lit: Vec<_> = means.iter().filter(|(_, factor)| *factor > 0.0).collect();
    let sum = |of: &(dyn Fn(&MeanImage) -> Option<&[[f32; 3]]> + Sync)| {
        let [width, height] = first.size();
        let mut sum = Plane::new(width, height, [0.0f32; 3]);
        let columns = width.max(1) as usize;
        sum.data_mut().par_chunks_mut(columns).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let mut total = [0.0; 3];
                for (mean, factor) in &lit {
                    let value = of(mean).map_or([0.0; 3], |plane| plane[y * columns + x]);
                    (0..3).for_each(|channel| total[channel] += factor * f64::from(value[channel]));
                }
                *pixel = total.map(|v| v as f32);
            }
        });
        sum
    };
    let has_moments = means.iter().any(|(mean, _)| mean.moments.is_some());
    Ok(MeanImage {
        is_spread: means.iter().any(|(mean, _)| mean.is_spread),
        radiance: sum(&|mean| Some(mean.radiance.data())),
        moments: has_moments
            .then(|| [0, 1].map(|axis: usize| sum(&|mean| mean.moments.as_ref().map(|axes| axes[axis].data())))),
    })
}

/// [`develop_film`](crate::develop_film) of the sum of independent films, each times its factor, behind a lens with another
/// transmission than that of the films if one is given ([`Exposer::of_films`]). Runs on the threads of the current pool.
///
/// # Errors
/// As [`sum_of_means`] and [`Exposer::of_films`].
pub fn develop_films(
    films: &[FilmOfLight<'_>],
    transmission: Option<Arc<Plane<f32>>>,
    settings: &RenderSettings,
) -> Result<Frame, Error> {
    let means: Vec<(MeanImage, f64)> =
        films.iter().map(|light| (mean_image(&light.film.sums, light.film.is_spread), light.factor)).collect();
    let mean = sum_of_means(&means.iter().map(|(mean, factor)| (mean, *factor)).collect::<Vec<_>>())?;
    drop(means);
    let mean = match &transmission {
        None => mean,
        Some(transmission) => mean.map(|plane| through_lens(plane, transmission)),
    };
    let Some(camera) = ExposeSettings::of_render(settings)? else { return develop(&mean.radiance, settings) };
    let weighted: Vec<(&RenderedFilm, f64)> = films.iter().map(|light| (light.film, light.factor)).collect();
    let exposer = Exposer::of_films(&weighted, &mean, transmission, &camera)?;
    let lit = films.iter().filter(|light| light.factor > 0.0);
    let variances: Vec<_> = lit.map(|light| (exposer.film_variances(light.film), light.factor)).collect();
    let k = settings.budget.noise.unwrap_or(dunkelfeld_adaptive::required_samples::DEFAULT_TARGET);
    let variances: Vec<_> = variances.iter().map(|(variances, factor)| (variances, *factor)).collect();
    let mut certified = exposer.certify_sum(&variances, k)?;
    certified.certificate.share = settings.budget.hidden_share();
    exposer.into_frame(settings.frame, Some(certified), &settings.without)
}

/// The layers of [`encode_layers`](crate::outputs::encode_layers) for the sum of independent films of single lights, each times its
/// factor, and the mean radiance of each light at factor 1 as `light.NAME.R`, `.G` and `.B`. The attribute `lights` contains
/// names, layers and factors. Samples are those of all films together. There is no seed: the samples of the sum cannot be
/// rendered again by a plan.
///
/// # Errors
/// No film, films of different sizes, and factors below zero.
pub fn encode_light_layers(
    films: &[FilmOfLight<'_>],
    frame: &Frame,
    settings: &RenderSettings,
) -> Result<ExrLayers, Error> {
    let first = films.first().ok_or_else(|| Error::setting("films", "there is no film", "render one"))?.film;
    let size = |film: &RenderedFilm| [film.sums.width(), film.sums.height()];
    check_films(size(first), films.iter().map(|light| (size(light.film), light.factor)))?;
    let names = layer_names(films);
    let bands = (0..first.sums.height()).step_by(Film::TILE as usize);
    let bands: Vec<Range<u32>> = bands.map(|y| y..(y + Film::TILE).min(first.sums.height())).collect();
    let bands: Vec<ExrLayers> = bands.into_par_iter().map(|rows| layers_of_sum(films, &names, frame, rows)).collect();
    let mut bands = bands.into_iter();
    let mut all = bands.next().unwrap_or_else(|| ExrLayers::new(first.sums.width(), 0));
    bands.for_each(|band| all.append_rows(band));
    let mut attributes = layer_attributes(frame, settings, first);
    if let Some(attributes) = attributes.as_object_mut() {
        let entry = |(light, layer): (&FilmOfLight<'_>, &String)| serde_json::json!({ "name": light.name, "layer": layer, "factor": light.factor });
        attributes.insert("lights".into(), films.iter().zip(&names).map(entry).collect());
        attributes.retain(|key, _| !["seed", "frame"].contains(&&key[..]));
    }
    all.attributes = attributes.to_string();
    Ok(all)
}

/// The layers of a few rows.
fn layers_of_sum(films: &[FilmOfLight<'_>], names: &[String], frame: &Frame, rows: Range<u32>) -> ExrLayers {
    let sums: Vec<Vec<PixelSums>> = films
        .iter()
        .map(|light| {
            let mut sums = Vec::new();
            light.film.sums.read_rows(rows.clone(), &mut sums);
            sums
        })
        .collect();
    let pixels = sums.first().map_or(0, Vec::len);
    // Normals, albedo, depth and samples are those of all films.
    let merged: Vec<PixelSums> = (0..pixels)
        .map(|pixel| {
            let mut merged = PixelSums::default();
            sums.iter().filter_map(|sums| sums.get(pixel)).for_each(|sums| merged.merge(sums));
            merged
        })
        .collect();
    let Some(FilmOfLight { film: first, .. }) = films.first() else { return ExrLayers::new(0, 0) };
    let mut out =
        layers_of_band((first.sums.layers(), first.sums.has_moments()), &merged, &first.ids, frame, rows.clone());
    let of_radiance = |name: &str| {
        let is_layer = |layer: &str| name.strip_prefix(layer).is_some_and(|rest| rest.starts_with('.'));
        ["R", "G", "B"].contains(&name)
            || ["variance", "covariance", "scatter", "first_light"].into_iter().any(is_layer)
    };
    out.channels.retain(|(name, _)| !of_radiance(name));
    let (width, height) = (first.sums.width(), rows.len() as u32);
    let lit: Vec<(&Vec<PixelSums>, f64)> =
        sums.iter().zip(films).map(|(sums, light)| (sums, light.factor)).filter(|(_, factor)| *factor > 0.0).collect();
    let triples = |f: &dyn Fn(&PixelSums, f64) -> [f64; 3]| {
        let of_pixel = |pixel: usize| {
            let of_light = |(sums, factor): &(&Vec<PixelSums>, f64)| f(&sums[pixel], *factor);
            let all = lit.iter().map(of_light).fold([0.0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
            all.map(|v| v as f32)
        };
        plane(width, height, (0..pixels).map(of_pixel), [0.0; 3])
    };
    out.push_triples(Triple::Mean, &triples(&|p, f| p.mean().map(|v| f * v)));
    if first.sums.layers() == FilmLayers::All {
        out.push_triples(Triple::FirstLight, &triples(&|p, f| p.mean_first_light().map(|v| f * f64::from(v))));
    }
    out.push_triples(Triple::Variance, &triples(&|p, f| p.variance_of_mean().map(|v| f * f * v)));
    out.push_triples(Triple::Covariance, &triples(&|p, f| p.covariance_of_mean().map(|v| f * f * v)));
    let scatter = |pixel: usize| {
        let parts = lit.iter().map(|(sums, factor)| sums[pixel].scatter().map(|s| (s, factor * factor)));
        parts.collect::<Option<Vec<_>>>().map(|parts| {
            let all: f64 = parts.iter().map(|(s, square)| square * s.all).sum();
            (all, parts.iter().map(|(s, square)| square * s.largest).fold(0.0, f64::max))
        })
    };
    let floats = |f: &dyn Fn((f64, f64)) -> f64| {
        let value = |pixel: usize| scatter(pixel).map_or(f32::INFINITY, |s| f(s) as f32);
        plane(width, height, (0..pixels).map(value), 0.0)
    };
    out.push_floats(Single::Scatter, floats(&|(all, _)| all));
    out.push_floats(Single::LargestScatter, floats(&|(_, largest)| largest));
    for (sums, name) in sums.iter().zip(names) {
        for (component, channel) in ["R", "G", "B"].into_iter().enumerate() {
            let samples = sums.iter().map(|p| p.mean()[component] as f32).collect();
            out.channels.push((format!("{name}.{channel}"), Channel::F32(samples)));
        }
    }
    out
}

/// The longest name of a light in the name of a layer \[bytes\].
const MAX_NAME: usize = 200;

/// The layers of the lights: their names, as far as the name of a channel can contain them, each once.
fn layer_names(films: &[FilmOfLight<'_>]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for light in films {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | ' ');
        let plain: String = light.name.chars().map(|c| if is_plain(c) { c } else { '_' }).take(MAX_NAME).collect();
        let numbered = (2u32..).map(|number| format!("light.{plain}_{number}"));
        let mut candidates = std::iter::once(format!("light.{plain}")).chain(numbered);
        names.extend(candidates.find(|name| !names.contains(name)));
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_linear_and_a_dark_light_adds_nothing() {
        let a = MeanImage::from(Plane::from_fn(3, 2, |x, y| [x as f32, y as f32, 0.5]));
        let b = MeanImage::from(Plane::new(3, 2, [f32::INFINITY; 3]));
        let sum = sum_of_means(&[(&a, 2.0), (&b, 0.0), (&a, 0.25)]).expect("one size");
        assert_eq!(*sum.radiance.at(2, 1), [4.5, 2.25, 1.125]);
        assert_eq!(sum_of_means(&[(&a, 1.0)]).expect("one"), a);
        let small = MeanImage::from(Plane::new(3, 1, [0.0; 3]));
        for wrong in [&[][..], &[(&a, 1.0), (&small, 1.0)], &[(&a, -1.0)], &[(&a, f64::NAN)]] {
            assert!(sum_of_means(wrong).is_err());
        }
    }

    #[test]
    fn layers_have_the_names_of_the_lights() {
        let film = RenderedFilm::without_ids(Film::new(1, 1));
        let lights = ["bar", "bär", "b.r", "", "b_r_2"].map(|name| FilmOfLight { name, film: &film, factor: 1.0 });
        assert_eq!(layer_names(&lights), ["light.bar", "light.b_r", "light.b_r_2", "light.", "light.b_r_2_2"]);
    }
}
