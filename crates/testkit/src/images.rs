//! Are two images the same but for noise?

use crate::Outcome;
use crate::artefact::{write_csv, write_pgm};
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};
use statrs::function::beta::beta_reg;

/// An image that is known with an error: the mean of each pixel, and the variance of that mean.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageEstimate {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Mean per pixel and channel, row by row from the top.
    pub mean: Vec<[f64; 3]>,
    /// Variance of the mean, per pixel and channel.
    pub variance: Vec<[f64; 3]>,
    /// Degrees of freedom of each variance: one less than the batches that it was taken from.
    pub freedom: f64,
}

/// A comparison of two images of one scene, made independently of each other.
///
/// Two things are tested. *Pixels*: each by Welch (1947) on its worst channel, with the channel's share counted three
/// times because it was picked (Bonferroni). Of n pixels the worst `tolerated` are forgiven; the next one has the
/// p-value p, and the test's own is the probability that this many of n uniform numbers lie below p, the regularised
/// incomplete beta function `I_p(tolerated + 1, n - tolerated)`. With nothing forgiven that is Sidak's (1967)
/// `1 - (1 - p)^n`. *Means*: the channels' means over all pixels, by a Z-test. The outcome is the worse of the two,
/// doubled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageTest {
    /// Share of the pixels that must agree, above 0 and at most 1; what is left is forgiven. Pixels that many rare,
    /// bright samples make up are not normally distributed.
    pub minimum_pass_share: f64,
    /// Relative difference that rounding may make; counts as an error of its own.
    pub rounding: f64,
}

impl ImageTest {
    /// Compares. Images that differ in size, are empty or incomplete, or hold a number that is not finite or a negative
    /// variance cannot be judged and fail. Where the p-value is below 1e-6, a map of the scores is left behind as
    /// `<name>.pgm` and `<name>.csv`.
    pub fn run(&self, name: &str, a: &ImageEstimate, b: &ImageEstimate) -> Outcome {
        for (image, which) in [(a, "first"), (b, "second")] {
            if let Some(fault) = image.fault() {
                return Outcome::impossible(format!("{name}: the {which} image {fault}"));
            }
        }
        if (a.width, a.height) != (b.width, b.height) {
            let sizes = format!("{} x {} and {} x {}", a.width, a.height, b.width, b.height);
            return Outcome::impossible(format!("{name}: the images differ in size, {sizes}"));
        }
        let n = a.mean.len();
        let scores: Vec<Score> = (0..n).map(|i| self.pixel(a, b, i)).collect();
        let mut sorted: Vec<f64> = scores.iter().map(|s| s.p_value).collect();
        sorted.sort_by(f64::total_cmp);
        let tolerated = (((1.0 - self.minimum_pass_share) * n as f64 + 1e-9) as usize).min(n - 1);
        let pixels = order_statistic(sorted[tolerated], tolerated, n);
        let (mean, relative) = self.means(a, b);
        let p_value = (2.0 * pixels.min(mean)).min(1.0);
        let mut message = format!(
            "{name}: pixels p = {pixels:.3e} ({tolerated} of {n} forgiven, worst {:.3e}), means p = {mean:.3e}, \
             relative difference {relative:+.4}",
            sorted[0]
        );
        if p_value < 1e-6 {
            let map: Vec<f64> = scores.iter().map(|s| s.score.abs()).collect();
            let rows = scores.iter().enumerate().map(|(i, s)| {
                let [ar, ag, ab] = a.mean[i];
                let [br, bg, bb] = b.mean[i];
                vec![(i % a.width) as f64, (i / a.width) as f64, ar, ag, ab, br, bg, bb, s.score]
            });
            let table = write_csv(name, "column,row,r,g,b,other r,other g,other b,score", rows);
            let picture = write_pgm(name, a.width, a.height, &map);
            message = format!("{message}; {table}; {picture}");
        }
        Outcome { p_value, message }
    }

    /// Welch's test of one pixel.
    fn pixel(&self, a: &ImageEstimate, b: &ImageEstimate, i: usize) -> Score {
        let mut worst = Score { score: 0.0, p_value: 1.0 };
        for c in 0..3 {
            let (va, vb) = (a.variance[i][c], b.variance[i][c]);
            let difference = a.mean[i][c] - b.mean[i][c];
            let rounding = self.rounding * a.mean[i][c].abs().max(b.mean[i][c].abs());
            if difference == 0.0 {
                continue;
            }
            let score = difference / (va + vb + rounding * rounding).sqrt();
            let freedom = (va + vb).powi(2) / (va * va / a.freedom + vb * vb / b.freedom);
            let p_value = (3.0 * two_sided(score, freedom)).min(1.0);
            if p_value < worst.p_value || (p_value == 0.0 && score.abs() > worst.score.abs()) {
                worst = Score { score, p_value };
            }
        }
        worst
    }

    /// The p-value of the worst channel's mean, and its relative difference.
    fn means(&self, a: &ImageEstimate, b: &ImageEstimate) -> (f64, f64) {
        let n = a.mean.len() as f64;
        let sum = |v: &[[f64; 3]], c: usize| v.iter().map(|p| p[c]).sum::<f64>();
        let mut worst = (1.0f64, 0.0);
        for c in 0..3 {
            let (ma, mb) = (sum(&a.mean, c) / n, sum(&b.mean, c) / n);
            let rounding = self.rounding * ma.abs().max(mb.abs());
            let variance = (sum(&a.variance, c) + sum(&b.variance, c)) / (n * n) + rounding * rounding;
            let difference = ma - mb;
            let p_value =
                if difference == 0.0 { 1.0 } else { 3.0 * two_sided(difference / variance.sqrt(), f64::INFINITY) };
            if p_value.min(1.0) <= worst.0 {
                worst = (p_value.min(1.0), difference / mb.abs().max(f64::MIN_POSITIVE));
            }
        }
        worst
    }
}

struct Score {
    /// Difference over its standard error, of the worst channel.
    score: f64,
    p_value: f64,
}

impl ImageEstimate {
    /// The reason why the image cannot be compared.
    fn fault(&self) -> Option<&'static str> {
        let n = self.width * self.height;
        let wrong = |v: &f64| !v.is_finite();
        if n == 0 || self.mean.len() != n || self.variance.len() != n {
            Some("has no pixels, or not one mean and one variance for each")
        } else if self.mean.iter().flatten().any(wrong) {
            Some("holds a mean that is not finite")
        } else if self.variance.iter().flatten().any(|v| wrong(v) || *v < 0.0) {
            Some("holds a variance that is not finite or negative")
        } else if self.freedom.is_nan() || self.freedom < 1.0 {
            Some("has variances without a degree of freedom")
        } else {
            None
        }
    }
}

/// The probability that more than `tolerated` of `n` independent uniform numbers are at most `p`.
fn order_statistic(p: f64, tolerated: usize, n: usize) -> f64 {
    if p <= 0.0 {
        0.0
    } else if p >= 1.0 {
        1.0
    } else {
        beta_reg(tolerated as f64 + 1.0, (n - tolerated) as f64, p)
    }
}

/// Two-sided p-value of Student's t; of a normal number where the degrees of freedom are many or unknown.
fn two_sided(t: f64, freedom: f64) -> f64 {
    let t = t.abs();
    if t.is_infinite() {
        return 0.0;
    }
    let tail = match StudentsT::new(0.0, 1.0, freedom) {
        Ok(student) if freedom < 1e6 => student.sf(t),
        _ => Normal::standard().sf(t),
    };
    (2.0 * tail).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEST: ImageTest = ImageTest { minimum_pass_share: 0.99, rounding: 1e-5 };

    /// A normal number from twelve uniform ones (Marsaglia's 2003 xorshift underneath).
    fn normal(state: &mut u64) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            *state ^= *state << 13;
            *state ^= *state >> 7;
            *state ^= *state << 17;
            sum += (*state >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum
    }

    /// 16 x 16 pixels of mean `level(i)` from 20 batches of standard deviation one.
    fn image(seed: u64, level: impl Fn(usize) -> f64) -> ImageEstimate {
        let mut state = seed;
        let mut image = ImageEstimate { width: 16, height: 16, freedom: 19.0, ..Default::default() };
        for i in 0..256 {
            let mut channels = [(0.0, 0.0); 3];
            for channel in &mut channels {
                let batches: crate::SampleMoments = (0..20).map(|_| level(i) + normal(&mut state)).collect();
                *channel = (batches.mean(), batches.variance() / 20.0);
            }
            image.mean.push(channels.map(|c| c.0));
            image.variance.push(channels.map(|c| c.1));
        }
        image
    }

    #[test]
    fn a_shift_of_all_pixels_that_no_pixel_shows_fails_by_the_mean() {
        // 0.14 standard deviations: half an error of a pixel's difference, 7 errors of the mean's.
        let outcome = TEST.run("self test shift", &image(3, |_| 5.0), &image(4, |_| 5.14));
        assert!(outcome.p_value < 1e-9, "{}", outcome.message);
    }

    #[test]
    fn few_wrong_pixels_are_forgiven_and_more_are_not() {
        // Two of 256 may be wrong at 99 %; opposite signs keep the mean.
        let bad = |k: usize| {
            move |i: usize| {
                if i >= k {
                    5.0
                } else if i.is_multiple_of(2) {
                    9.0
                } else {
                    1.0
                }
            }
        };
        let good = image(5, |_| 5.0);
        assert!(TEST.run("self test two pixels", &good, &image(6, bad(2))).passes(1e-4));
        let four = TEST.run("self test four pixels", &good, &image(7, bad(4)));
        assert!(four.p_value < 1e-9, "{}", four.message);
        let path = four.message.rsplit("details in ").next().expect("a map is written");
        assert!(std::fs::metadata(path).expect("the map exists").len() > 256, "{path}");
        let strict = ImageTest { minimum_pass_share: 1.0, ..TEST };
        assert!(!strict.run("self test one pixel", &good, &image(8, bad(1))).passes(1e-6));
    }

    #[test]
    fn missing_data_fails() {
        let good = image(9, |_| 1.0);
        let fails = |bad: &ImageEstimate| assert_eq!(TEST.run("self test missing", &good, bad).p_value, 0.0);
        fails(&ImageEstimate::default());
        fails(&ImageEstimate { width: 8, height: 32, ..good.clone() });
        fails(&ImageEstimate { mean: good.mean[1..].to_vec(), ..good.clone() });
        fails(&ImageEstimate { variance: vec![[f64::INFINITY; 3]; 256], ..good.clone() });
        fails(&ImageEstimate { variance: vec![[-1.0; 3]; 256], ..good.clone() });
        fails(&ImageEstimate { freedom: 0.0, ..good.clone() });
    }
}
