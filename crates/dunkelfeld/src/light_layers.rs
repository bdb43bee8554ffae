//! The layers of an EXR with the light of each group of lights, and the mean of an image with factors on them.

use dunkelfeld_film::{MeanImage, Plane};
use dunkelfeld_io::exr::{Channel, ExrLayers};
use dunkelfeld_render::parallel::mean_without_gaps;
use dunkelfeld_render::{Error, RenderedFilm};
use rayon::prelude::*;

/// The sum of means of one size, each times its factor: the mean of [`RenderedFilm::weighted`] from those of the groups, in
/// less time. Runs on the threads of the current pool.
///
/// # Errors
/// No mean, means of different sizes, and factors below zero.
pub fn sum_of_means(means: &[(&MeanImage, f64)]) -> Result<MeanImage, Error> {
    let (first, _) = means.first().ok_or_else(|| Error::setting("films", "there is no film", "render one"))?;
    for (mean, factor) in means {
        if mean.size() != first.size() {
            let problem = format!("a film has {:?} pixels, another one {:?}", mean.size(), first.size());
            return Err(Error::setting("films", problem, "add films of one size"));
        }
        if !(factor.is_finite() && *factor >= 0.0) {
            return Err(Error::setting("films", format!("the factor {factor} is out of range"), "use 0 or more"));
        }
    }
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

/// Adds the mean radiance of each group of lights of a film at factor 1, as `light.NAME.R`, `.G` and `.B`. The attribute
/// `lights` contains the names with their layers and factors. `lights` has name and factor of each group. Runs on the threads of
/// the current pool.
pub fn add_light_layers(layers: &mut ExrLayers, film: &RenderedFilm, lights: &[(&str, f64)]) {
    let names = layer_names(lights.iter().map(|(name, _)| *name));
    let mut entries = Vec::new();
    for ((group, (name, factor)), layer) in film.groups.iter().zip(lights).zip(names) {
        let mean = mean_without_gaps(group);
        for (component, channel) in ["R", "G", "B"].into_iter().enumerate() {
            let values = mean.data().iter().map(|pixel| pixel[component]).collect();
            layers.channels.push((format!("{layer}.{channel}"), Channel::F32(values)));
        }
        entries.push(serde_json::json!({ "name": name, "layer": layer, "factor": factor }));
    }
    let attributes = serde_json::from_str::<serde_json::Map<String, serde_json::Value>>(&layers.attributes);
    let mut attributes = attributes.unwrap_or_default();
    attributes.insert("lights".into(), entries.into());
    layers.attributes = serde_json::Value::from(attributes).to_string();
}

/// The longest name of a light in the name of a layer \[bytes\].
const MAX_NAME: usize = 200;

/// The layers of the lights: their names, as far as the name of a channel can contain them, each once.
fn layer_names<'a>(lights: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for light in lights {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | ' ');
        let plain: String = light.chars().map(|c| if is_plain(c) { c } else { '_' }).take(MAX_NAME).collect();
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
        let names = layer_names(["bar", "bär", "b.r", "", "b_r_2"].into_iter());
        assert_eq!(names, ["light.bar", "light.b_r", "light.b_r_2", "light.", "light.b_r_2_2"]);
    }
}
