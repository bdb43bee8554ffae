//! Spectrograms: the frequencies of a mean image along its rows and columns (EMVA 1288 release 4.0 Linear, section
//! 8.3).

use realfft::RealFftPlanner;
use serde::Serialize;

use crate::stack::SpatialStack;

/// The spectrum along one direction, averaged over all lines.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spectrogram {
    /// Square root of the mean power at each frequency \[DN\], normalised so that white noise of standard deviation s
    /// has s everywhere. Entry k has the frequency k / length [cycles per pixel].
    pub amplitude: Vec<f64>,
    /// Pixels in a line.
    pub length: u32,
    /// Noise of the mean image, sigma_y.stack / sqrt(L) \[DN\]: the floor of the spectrum.
    pub noise: f64,
}

impl Spectrogram {
    /// Frequency of an entry \[cycles per pixel\], 0 to 0.5.
    pub fn frequency(&self, entry: usize) -> f64 {
        entry as f64 / f64::from(self.length.max(1))
    }
}

/// The spectrogram along the rows. With a dark stack, that of the light alone.
pub(crate) fn horizontal(stack: &SpatialStack, dark: Option<&SpatialStack>) -> Spectrogram {
    lines(stack, dark, stack.width as usize, stack.height as usize, |line, i| line * stack.width as usize + i)
}

/// The spectrogram along the columns. With a dark stack, that of the light alone.
pub(crate) fn vertical(stack: &SpatialStack, dark: Option<&SpatialStack>) -> Spectrogram {
    lines(stack, dark, stack.height as usize, stack.width as usize, |line, i| i * stack.width as usize + line)
}

fn lines(
    stack: &SpatialStack,
    dark: Option<&SpatialStack>,
    length: usize,
    count: usize,
    place: impl Fn(usize, usize) -> usize,
) -> Spectrogram {
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    let (mut line, mut spectrum) = (transform.make_input_vec(), transform.make_output_vec());
    let mut power = vec![0.0; spectrum.len()];
    let frames = f64::from(stack.frames);
    let sum = |s: &SpatialStack, at: usize| s.sums().get(at).map_or(0.0, |&v| f64::from(v));
    let (mut mean, mut noise) = (stack.mean, stack.temporal_variance / frames);
    if let Some(d) = dark {
        mean -= d.mean;
        noise += d.temporal_variance / f64::from(d.frames);
    }
    for k in 0..count {
        for (i, v) in line.iter_mut().enumerate() {
            let at = place(k, i);
            *v = sum(stack, at) / frames - dark.map_or(0.0, |d| sum(d, at) / f64::from(d.frames)) - mean;
        }
        // The buffers come from the plan and have the right size.
        if transform.process(&mut line, &mut spectrum).is_ok() {
            power.iter_mut().zip(&spectrum).for_each(|(p, c)| *p += c.norm_sqr());
        }
    }
    let amplitude = power.into_iter().map(|p| (p / (length * count) as f64).sqrt()).collect();
    Spectrogram { amplitude, length: length as u32, noise: noise.sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stack::tests::still;

    /// Alternating columns of 100 and 104: a wave of amplitude 2 at half a cycle per pixel. One entry has the whole
    /// power, 4 times the length.
    #[test]
    fn a_wave_of_columns_is_one_peak_of_the_spectrum() {
        let s = still(32, 20, |x, _| 100 + 4 * (x % 2) as u16);
        let h = horizontal(&s, None);
        assert_eq!((h.amplitude.len(), h.frequency(16)), (17, 0.5));
        assert!((h.amplitude[16] - 2.0 * 32f64.sqrt()).abs() < 1e-9, "{h:?}");
        assert!(h.amplitude[..16].iter().all(|a| a.abs() < 1e-9));
        // A column is constant: its whole power is at frequency zero.
        let v = vertical(&s, None);
        assert!((v.amplitude[0] - 2.0 * 20f64.sqrt()).abs() < 1e-9 && v.amplitude[1] < 1e-9, "{v:?}");
        assert!(horizontal(&s, Some(&s)).amplitude.iter().all(|a| a.abs() < 1e-9));
    }

    /// Parseval: the mean power over all frequencies is the variance.
    #[test]
    fn the_power_is_the_variance() {
        let s = still(40, 30, |x, y| ((x * 7919 + y * 104_729) % 97) as u16);
        let variance = s.means().map(|y| (y - s.mean).powi(2)).sum::<f64>() / s.pixels() as f64;
        for (spectrum, length) in [(horizontal(&s, None), 40), (vertical(&s, None), 30)] {
            let ends = |k: usize| if k == 0 || 2 * k == length { 1.0 } else { 2.0 };
            let sum: f64 = spectrum.amplitude.iter().enumerate().map(|(k, a)| ends(k) * a * a).sum();
            assert!((sum / length as f64 - variance).abs() < 1e-9 * variance, "{sum} {variance}");
        }
    }
}
