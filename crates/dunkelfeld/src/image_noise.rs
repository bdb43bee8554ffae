//! The noise of an image for matched exposure: analysed once, and converted for other cameras and numbers of samples.

use crate::noise_compensation::CompensationInputs;
use dunkelfeld_film::Plane;
use dunkelfeld_render::Error;
use dunkelfeld_sensor::Response;
use rayon::prelude::*;

/// The noise of an image, for matched exposure ([`Exposer::with_noise`](crate::Exposer::with_noise)).
#[derive(Clone, Debug)]
pub struct ImageNoise {
    /// The response of the camera.
    pub(crate) response: Response,
    /// Samples per pixel, if they are known.
    pub(crate) counts: Option<Plane<u32>>,
    pub(crate) inputs: CompensationInputs,
}

impl ImageNoise {
    /// The noise behind a camera with this response, of an image with these numbers of samples per pixel.
    pub(crate) fn converted(
        &self,
        size: [u32; 2],
        response: &Response,
        counts: Option<&Plane<u32>>,
    ) -> Result<CompensationInputs, Error> {
        let mut inputs = self.inputs.clone();
        for of_image in [counts.map_or(size, size_of), size_of(&inputs.variance)] {
            if of_image != size {
                let problem = format!("the noise is that of {of_image:?} pixels, and the image has {size:?}");
                return Err(Error::setting("noise", problem, "use the noise of this image"));
            }
        }
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
        Ok(inputs)
    }
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
        ImageNoise { response: Response::constant(Weights([weight; 3])), counts, inputs }
    }

    /// The variance of a mean has the square of the unit, and the inverse of the number of samples.
    #[test]
    fn variances_follow_the_signal_and_the_samples() {
        let response = Response::constant(Weights([10.0, 20.0, 30.0]));
        let converted = |noise: &ImageNoise, counts: Option<[u32; 2]>| {
            let counts = counts.map(|counts| Plane::of_pixels(2, 1, counts.to_vec()));
            let inputs = noise.converted([2, 1], &response, counts.as_ref()).expect("one size");
            assert_eq!(inputs.is_rare.data(), [false, true]);
            inputs.variance.data().to_vec()
        };
        // The weights have the sums 15 and 60.
        assert_eq!(converted(&noise(5.0, None), None), [48.0, f32::INFINITY]);
        assert_eq!(converted(&noise(5.0, Some([8, 8])), Some([16, 8])), [24.0, f32::INFINITY]);
        assert_eq!(converted(&noise(5.0, Some([8, 8])), None), [48.0, f32::INFINITY]);
        assert_eq!(converted(&noise(20.0, Some([7, 7])), Some([7, 7])), [3.0, f32::INFINITY]);
        // A sensor that saw nothing says nothing.
        assert_eq!(converted(&noise(0.0, None), None), [f32::INFINITY; 2]);
    }
}
