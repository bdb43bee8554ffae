//! Standard errors of results of measured numbers: each number is changed by its own error, once up and once down.
//!
//! To first order this is Gauss's law with all covariances, without analytic derivatives. It also holds if a number
//! affects a result in several ways (the same dark level in gain and dark noise).

/// A set of measured numbers whose errors are independent of each other.
pub(crate) trait Inputs: Clone {
    /// The number of independent errors.
    fn count(&self) -> usize;

    /// The numbers with error `index` at `sign` times its standard deviation.
    fn moved(&self, index: usize, sign: f64) -> Self;
}

/// The standard errors of all results of a function.
pub(crate) fn errors<I: Inputs, const N: usize>(inputs: &I, results: impl Fn(&I) -> [f64; N]) -> [f64; N] {
    let mut squares = [0.0; N];
    for index in 0..inputs.count() {
        let (up, down) = (results(&inputs.moved(index, 1.0)), results(&inputs.moved(index, -1.0)));
        for (square, (up, down)) in squares.iter_mut().zip(up.into_iter().zip(down)) {
            *square += (0.5 * (up - down)).powi(2);
        }
    }
    squares.map(f64::sqrt)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone)]
    struct Two([f64; 2]);

    impl Inputs for Two {
        fn count(&self) -> usize {
            2
        }

        fn moved(&self, index: usize, sign: f64) -> Self {
            let mut values = self.0;
            values[index] += sign * [0.3, 0.4][index];
            Self(values)
        }
    }

    #[test]
    fn sums_products_and_differences_by_hand() {
        let got = errors(&Two([10.0, 5.0]), |t| [t.0[0] + t.0[1], t.0[0] * t.0[1], t.0[0] - t.0[0]]);
        assert!((got[0] - 0.5).abs() < 1e-12);
        // (5 * 0.3)^2 + (10 * 0.4)^2.
        assert!((got[1] - (2.25f64 + 16.0).sqrt()).abs() < 1e-12);
        assert_eq!(got[2], 0.0);
    }
}
