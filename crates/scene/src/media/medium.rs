//! The homogeneous medium inside a solid: transmittance, and sampling of distances.
//!
//! Coefficients differ between the channels, and a distance can be sampled for one channel only. The channel is chosen
//! at random. The weight uses the mean density over the channels: the one-sample balance heuristic (Veach and Guibas
//! 1995) over channels instead of wavelengths (Wilkie, Nawaz, Droske, Weidlich and Hanika 2014). The probability of a
//! channel is in proportion to the path throughput in it. So the weights of a whole path are those of that paper, and
//! no vertex increases the sum of the channels.

use crate::material::Volume;
use dunkelfeld_bsdf::HenyeyGreenstein;
use dunkelfeld_lanes::{Lanes, Mask, exp};
use dunkelfeld_radiometry::Rgb;

/// Largest mean number of scatterings of a path through a body of white medium. The paths that reach its middle have
/// about a fifth of the square of it, which takes a second.
const MAX_SCATTERINGS: f64 = 3000.0;
/// The same for any absorption: beyond it, the way between two scatterings is lost in the rounding of a position.
const MAX_RESOLVED: f64 = 2e6;

/// A homogeneous medium in compiled form.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Medium {
    /// Absorption coefficient [1/m].
    pub absorption: Rgb,
    /// Scattering coefficient [1/m].
    pub scattering: Rgb,
    /// The distribution of deflections.
    pub phase: HenyeyGreenstein,
}

/// Event of a path in a medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MediumEvent {
    /// The path is scattered.
    Scatter {
        /// Distance of the scattering \[m\].
        distance: f32,
        /// The scattering coefficient times the transmittance, over the density of the distance.
        weight: Rgb,
    },
    /// The path reaches the end of the segment.
    Pass {
        /// The transmittance over the probability of this event.
        weight: Rgb,
    },
}

impl Medium {
    /// No medium: nothing is absorbed or scattered.
    pub fn clear() -> Self {
        Self { absorption: Rgb::BLACK, scattering: Rgb::BLACK, phase: HenyeyGreenstein::new(0.0) }
    }

    /// The coefficients of a volume.
    ///
    /// Beer and Lambert: the colour is the transmittance over the distance. A black channel counts as 1e-39 of the
    /// light, the least that f32 resolves. Values out of range are clamped.
    pub fn new(v: &Volume) -> Self {
        let attenuates = v.attenuation_distance.is_finite() && v.attenuation_distance > 0.0;
        let extinction = if attenuates {
            v.attenuation_color.map(|c| (-c.clamp(1e-39, 1.0).ln() / v.attenuation_distance).max(0.0))
        } else {
            Rgb::BLACK
        };
        let albedo = v.scattering_albedo.map(|a| a.clamp(0.0, 1.0));
        Self {
            absorption: v.absorption.map(|a| a.max(0.0)) + extinction * albedo.map(|a| 1.0 - a),
            scattering: v.scattering.map(|s| s.max(0.0)) + extinction * albedo,
            phase: HenyeyGreenstein::new(v.scattering_anisotropy),
        }
    }

    /// Extinction coefficient [1/m]: absorption and scattering.
    #[inline]
    pub fn extinction(&self) -> Rgb {
        self.absorption + self.scattering
    }

    /// True if it scatters in any channel.
    #[inline]
    pub fn scatters(&self) -> bool {
        !self.scattering.is_black()
    }

    /// The mean number of scatterings in a body of this mean chord \[m\], and the largest number possible, if it is
    /// larger. A path that is absorbed before it is scattered as often as the longest paths in the largest white medium
    /// is short enough.
    pub(crate) fn excess(&self, chord: f64) -> Option<(f64, f64)> {
        let longest = 0.2 * MAX_SCATTERINGS * MAX_SCATTERINGS;
        let channels = self.scattering.to_array().into_iter().zip(self.absorption.to_array());
        channels.map(|(s, a)| (f64::from(s), f64::from(a))).find_map(|(scattering, absorption)| {
            let is_absorbed = scattering <= longest * absorption;
            let most = if is_absorbed { MAX_RESOLVED } else { MAX_SCATTERINGS };
            let scatterings = scattering * chord;
            (scatterings > most).then_some((scatterings, most))
        })
    }

    /// True if light passes it unchanged.
    #[inline]
    pub fn is_clear(&self) -> bool {
        self.absorption.is_black() && !self.scatters()
    }

    /// Single-scattering albedo per channel: scattering over extinction.
    pub fn albedo(&self) -> Rgb {
        let share = |s: f32, t: f32| if t > 0.0 { s / t } else { 0.0 };
        let (s, t) = (self.scattering, self.extinction());
        Rgb::new(share(s.r, t.r), share(s.g, t.g), share(s.b, t.b))
    }

    /// Transmittance over a distance \[m\], which may be infinite (Beer and Lambert).
    #[inline]
    pub fn transmittance(&self, distance: f32) -> Rgb {
        self.extinction().map(|t| decay(t, distance))
    }

    /// Samples the event of a path with the weight `throughput` within `end` \[m\] (which may be infinite). `u` in `[0,
    /// 1)`: the distance, the channel, and further digits of the distance, so that more than 16 mean free paths can be
    /// passed.
    #[inline]
    pub fn sample(&self, throughput: Rgb, end: f32, [u_distance, u_channel, u_digits]: [f32; 3]) -> MediumEvent {
        let extinction = self.extinction().to_array();
        let shares = channel_shares(throughput);
        let channel = if u_channel < shares[0] {
            0
        } else if u_channel < shares[0] + shares[1] || shares[2] == 0.0 {
            1
        } else {
            2
        };
        let channel = if shares[channel] > 0.0 { channel } else { largest(shares) };
        // Uniform numbers are multiples of 2^-24. The further digits extend the tail of the exponential.
        let survivors = (1.0 - u_distance) - u_digits * (1.0 / (1 << 24) as f32);
        let optical = -survivors.max(f32::MIN_POSITIVE).ln();
        let distance = if extinction[channel] > 0.0 { optical / extinction[channel] } else { f32::INFINITY };
        if distance < end {
            let weight = self.weigh(shares, extinction, distance, |c| extinction[c]);
            let scattering = self.scattering.to_array();
            MediumEvent::Scatter {
                distance,
                weight: Rgb::from_array(std::array::from_fn(|c| weight[c] * scattering[c])),
            }
        } else {
            MediumEvent::Pass { weight: Rgb::from_array(self.weigh(shares, extinction, end, |_| 1.0)) }
        }
    }

    /// The density [1/m] with which [`Self::sample`] scatters at a distance.
    pub fn pdf(&self, throughput: Rgb, distance: f32) -> f32 {
        let (t, shares) = (self.extinction().to_array(), channel_shares(throughput));
        (0..3).map(|c| shares[c] * t[c] * decay(t[c], distance)).sum()
    }

    /// The probability with which [`Self::sample`] reaches an end.
    pub fn probability_to_pass(&self, throughput: Rgb, end: f32) -> f32 {
        let (t, shares) = (self.extinction().to_array(), channel_shares(throughput));
        (0..3).map(|c| shares[c] * decay(t[c], end)).sum()
    }

    /// `exp(-t_c d) / sum_k share_k density(k) exp(-t_k d)` for each channel c in which the path has a weight above
    /// zero, 0 for others.
    ///
    /// The slowest decay is cancelled in the fraction, so that it has a value also for very small transmittances.
    #[inline]
    fn weigh(&self, shares: [f32; 3], extinction: [f32; 3], distance: f32, density: impl Fn(usize) -> f32) -> [f32; 3] {
        let technique: [f32; 3] = std::array::from_fn(|c| shares[c] * density(c));
        let slowest = (0..3).filter(|&c| technique[c] > 0.0).map(|c| extinction[c]).fold(f32::INFINITY, f32::min);
        let relative: [f32; 3] = std::array::from_fn(|c| decay((extinction[c] - slowest).max(0.0), distance));
        let total: f32 = (0..3).map(|c| technique[c] * relative[c]).sum();
        std::array::from_fn(|c| {
            // A channel that decays more slowly than all channels that could be sampled has no scattering.
            if technique[c] > 0.0 { relative[c] / total } else { 0.0 }
        })
    }
}

/// `exp(-coefficient * distance)`, in units of 1/m and m. It is 1 for a coefficient of zero, also over an infinite distance.
#[inline(always)]
pub fn decay<F: Lanes>(coefficient: F, distance: F) -> F {
    coefficient.is_positive().select(exp(-coefficient * distance), coefficient.constant(1.0))
}

/// The probability of each channel: its share in the throughput.
#[inline]
fn channel_shares(throughput: Rgb) -> [f32; 3] {
    // A ratio to the largest channel, so that very small and very large weights stay in range.
    let largest = throughput.max_channel();
    if !(largest > 0.0 && largest.is_finite()) {
        return [1.0 / 3.0; 3];
    }
    let relative = throughput.map(|v| v / largest);
    let scale = 1.0 / (relative.r + relative.g + relative.b);
    (relative * scale).to_array()
}

#[inline]
fn largest(shares: [f32; 3]) -> usize {
    (0..3).fold(0, |best, c| if shares[c] > shares[best] { c } else { best })
}
