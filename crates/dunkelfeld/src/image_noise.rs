//! The noise of an image for matched exposure: analysed once, and converted for other cameras and numbers of samples.

use crate::noise_compensation::CompensationInputs;
use dunkelfeld_film::Plane;
use dunkelfeld_render::Error;
use dunkelfeld_sensor::Response;
use rayon::prelude::*;

/// The noise of independent films that are added, for matched exposure ([`Exposer::with_noise`](crate::Exposer::with_noise)).
#[derive(Clone, Debug, Default)]
pub struct ImageNoise {
    parts: Vec<FilmPart>,
}

/// The noise of a film.
#[derive(Clone, Debug)]
pub(crate) struct FilmPart {
    /// The response of the camera, times the factor of the film.
    pub(crate) response: Response,
    /// Samples per pixel, if they are known.
    pub(crate) counts: Option<Plane<u32>>,
    pub(crate) inputs: CompensationInputs,
}

impl ImageNoise {
    pub(crate) fn new(parts: Vec<FilmPart>) -> Self {
        Self { parts }
    }

    /// The noise behind a camera with this response, of films with these numbers of samples per pixel and factors.
    pub(crate) fn converted(
        &self,
        size: [u32; 2],
        response: &Response,
        films: &[(Option<&Plane<u32>>, f64)],
    ) -> Result<CompensationInputs, Error> {
        let sizes = films.iter().map(|(counts, factor)| (counts.map_or(size, size_of), *factor));
        check_films(size, sizes.chain(self.parts.iter().map(|part| (size_of(&part.inputs.variance), 1.0))))?;
        if films.len() != self.parts.len() {
            let problem = format!("there are {} films, the noise is of {}", films.len(), self.parts.len());
            return Err(Error::setting("films", problem, "use the noise of these films"));
        }
        let lit = self.parts.iter().zip(films).filter(|(_, (_, factor))| *factor > 0.0);
        let parts = lit.map(|(part, &(counts, factor))| part.converted(&response.scaled(factor), counts));
        Ok(CompensationInputs::sum(parts).unwrap_or_else(|| CompensationInputs::none(size)))
    }
}

impl FilmPart {
    fn converted(&self, response: &Response, counts: Option<&Plane<u32>>) -> CompensationInputs {
        let mut inputs = self.inputs.clone();
        let grey = |response: &Response, x: u32, y: u32| response.at(x, y).electrons([1.0; 3]).0;
        let counts = self.counts.as_ref().zip(counts);
        let width = inputs.variance.width() as usize;
        inputs.variance.data_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            let signals = [0, 1].map(|x| grey(response, x, y as u32) / grey(&self.response, x, y as u32));
            let number = |counts: &Plane<u32>, x: usize| f64::from(counts.data()[y * width + x].max(1));
            for (x, variance) in row.iter_mut().enumerate() {
                let signal = signals[x & 1];
                let samples = counts.map_or(1.0, |(before, now)| number(before, x) / number(now, x));
                let scaled = (f64::from(*variance) * signal * signal * samples) as f32;
                *variance = if scaled.is_nan() { f32::INFINITY } else { scaled };
            }
        });
        inputs
    }
}

/// Checks films that are added: sizes \[pixels\] and factors.
pub(crate) fn check_films(size: [u32; 2], films: impl Iterator<Item = ([u32; 2], f64)>) -> Result<(), Error> {
    for (of_film, factor) in films {
        if of_film != size {
            let problem = format!("a film has {of_film:?} pixels, another one {size:?}");
            return Err(Error::setting("films", problem, "add films of one size"));
        }
        if !(factor.is_finite() && factor >= 0.0) {
            return Err(Error::setting("films", format!("the factor {factor} is out of range"), "use 0 or more"));
        }
    }
    Ok(())
}

fn size_of<T>(plane: &Plane<T>) -> [u32; 2] {
    [plane.width(), plane.height()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_sensor::Weights;

    fn noise(weight: f64, counts: Option<[u32; 2]>) -> ImageNoise {
        let inputs = CompensationInputs::new(
            Plane::of_pixels(2, 1, vec![3.0, f32::INFINITY]),
            Plane::of_pixels(2, 1, vec![false, true]),
        );
        let counts = counts.map(|counts| Plane::of_pixels(2, 1, counts.to_vec()));
        ImageNoise::new(vec![FilmPart { response: Response::constant(Weights([weight; 3])), counts, inputs }])
    }

    /// The variance of a mean has the square of the unit, and the inverse of the number of samples.
    #[test]
    fn variances_follow_the_signal_and_the_samples() {
        let response = Response::constant(Weights([10.0, 20.0, 30.0]));
        let converted = |noise: &ImageNoise, counts: Option<[u32; 2]>, factor: f64| {
            let counts = counts.map(|counts| Plane::of_pixels(2, 1, counts.to_vec()));
            let inputs = noise.converted([2, 1], &response, &[(counts.as_ref(), factor)]).expect("one size");
            assert_eq!(inputs.is_rare.data(), if factor > 0.0 { [false, true] } else { [false, false] });
            inputs.variance.data().to_vec()
        };
        // The weights have the sums 15 and 60.
        assert_eq!(converted(&noise(5.0, None), None, 1.0), [48.0, f32::INFINITY]);
        assert_eq!(converted(&noise(5.0, None), None, 0.5), [12.0, f32::INFINITY]);
        assert_eq!(converted(&noise(5.0, Some([8, 8])), Some([16, 8]), 1.0), [24.0, f32::INFINITY]);
        assert_eq!(converted(&noise(5.0, Some([8, 8])), None, 1.0), [48.0, f32::INFINITY]);
        assert_eq!(converted(&noise(20.0, Some([7, 7])), Some([7, 7]), 1.0), [3.0, f32::INFINITY]);
        // A dark film has no noise. A sensor that saw nothing says nothing.
        assert_eq!(converted(&noise(5.0, None), None, 0.0), [0.0, 0.0]);
        assert_eq!(converted(&noise(0.0, None), None, 1.0), [f32::INFINITY; 2]);
    }
}
