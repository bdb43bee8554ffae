//! The homogeneous medium inside a solid: transmittance, and sampling of distances.
//!
//! Coefficients differ between the channels, and a distance can be sampled for one channel only. The channel is chosen
//! at random. The weight uses the mean density over the channels: the one-sample balance heuristic (Veach and Guibas
//! 1995) over channels instead of wavelengths (Wilkie, Nawaz, Droske, Weidlich and Hanika 2014). The probability of a
//! channel is in proportion to the path throughput in it. So the weights of a whole path are those of that paper, and
//! no vertex increases the sum of the channels.

use crate::material::Volume;
use dunkelfeld_bsdf::HenyeyGreenstein;
use dunkelfeld_lanes::{Lanes, MAX_WIDTH, Mask, exp, ln};
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

/// Coefficients of media, one for each lane.
#[derive(Clone, Copy, Debug)]
pub struct MediumLanes<F = f32> {
    /// Extinction coefficient [1/m]: absorption and scattering.
    pub extinction: Rgb<F>,
    /// Scattering coefficient [1/m].
    pub scattering: Rgb<F>,
}

/// Events of paths in media, one for each lane.
#[derive(Clone, Copy, Debug)]
pub struct MediumEvents<F: Lanes> {
    /// Lanes whose path is scattered. The others reach the end of the segment.
    pub is_scattered: F::Mask,
    /// Distance of the scattering \[m\].
    pub distance: F,
    /// Of a scattering: the scattering coefficient times the transmittance, over the density of the distance. Of the others:
    /// the transmittance over the probability of this event.
    pub weight: Rgb<F>,
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

    /// Its coefficients.
    #[inline]
    pub fn coefficients(&self) -> MediumLanes {
        MediumLanes { extinction: self.extinction(), scattering: self.scattering }
    }

    /// Transmittance over a distance \[m\], which may be infinite.
    #[inline]
    pub fn transmittance(&self, distance: f32) -> Rgb {
        transmittance(self.extinction(), distance)
    }

    /// The density [1/m] with which [`MediumLanes::sample`] scatters at a distance.
    pub fn pdf(&self, throughput: Rgb, distance: f32) -> f32 {
        let (t, shares) = (self.extinction().to_array(), channel_shares(throughput).to_array());
        (0..3).map(|c| shares[c] * t[c] * decay(t[c], distance)).sum()
    }

    /// The probability with which [`MediumLanes::sample`] reaches an end.
    pub fn probability_to_pass(&self, throughput: Rgb, end: f32) -> f32 {
        let (t, shares) = (self.extinction().to_array(), channel_shares(throughput).to_array());
        (0..3).map(|c| shares[c] * decay(t[c], end)).sum()
    }
}

impl MediumLanes {
    /// No medium.
    pub const CLEAR: Self = Self { extinction: Rgb::BLACK, scattering: Rgb::BLACK };
}

impl<F: Lanes> MediumLanes<F> {
    /// The media of lanes.
    #[inline(always)]
    pub fn from_lanes(token: F::Token, media: &[MediumLanes; MAX_WIDTH]) -> Self {
        let [mut extinction, mut scattering] = [[Rgb::BLACK; MAX_WIDTH]; 2];
        for lane in 0..F::WIDTH {
            (extinction[lane], scattering[lane]) = (media[lane].extinction, media[lane].scattering);
        }
        Self { extinction: Rgb::from_lanes(token, &extinction), scattering: Rgb::from_lanes(token, &scattering) }
    }

    /// Samples the events of paths with the weights `throughput` within `end` \[m\] (which may be infinite). `u` in `[0,
    /// 1)`: the distance, the channel, and further digits of the distance, so that more than 16 mean free paths can be
    /// passed. A medium that does not scatter is passed.
    #[inline(always)]
    pub fn sample(&self, throughput: Rgb<F>, end: F, [u_distance, u_channel, u_digits]: [F; 3]) -> MediumEvents<F> {
        let Self { extinction, scattering } = *self;
        let (one, infinity) = (Rgb::splat(end.constant(1.0)), end.constant(f32::INFINITY));
        let scatters = scattering.is_lit();
        let passed = transmittance(extinction, end);
        if !scatters.any() {
            return MediumEvents { is_scattered: scatters, distance: infinity, weight: passed };
        }
        let shares = channel_shares(throughput);
        let is_red = u_channel.lt(shares.r);
        let is_green = u_channel.lt(shares.r + shares.g) | shares.b.eq(end.constant(0.0));
        let is_likely = is_red.select(shares.r, is_green.select(shares.g, shares.b)).is_positive();
        // Else rounding has led to a channel without a share.
        let is_likeliest = [shares.g.gt(shares.r), shares.b.gt(shares.r.max(shares.g))];
        let likeliest = is_likeliest[1].select(extinction.b, is_likeliest[0].select(extinction.g, extinction.r));
        let chosen = is_red.select(extinction.r, is_green.select(extinction.g, extinction.b));
        let rate = is_likely.select(chosen, likeliest);
        // Uniform numbers are multiples of 2^-24. The further digits extend the tail of the exponential.
        let survivors = u_distance.one_minus() - u_digits * (1.0 / (1 << 24) as f32);
        let optical = -ln(survivors.max(end.constant(f32::MIN_POSITIVE)));
        let distance = rate.is_positive().select(optical / rate, infinity);
        let is_scattered = scatters & distance.lt(end);
        let technique = shares * Rgb::select(is_scattered, extinction, one);
        let weight = weigh(technique, extinction, is_scattered.select(distance, end));
        let weight = Rgb::select(is_scattered, weight * scattering, weight);
        MediumEvents { is_scattered, distance, weight: Rgb::select(scatters, weight, passed) }
    }
}

/// `exp(-t_c d) / sum_k technique_k exp(-t_k d)` for each channel c with a technique, 0 for others. A technique is the share of
/// a channel, times its density in the case of a scattering.
///
/// The slowest decay is cancelled in the fraction, so that it has a value also for very small transmittances.
#[inline(always)]
fn weigh<F: Lanes>(technique: Rgb<F>, extinction: Rgb<F>, distance: F) -> Rgb<F> {
    let (zero, infinity) = (distance.constant(0.0), distance.constant(f32::INFINITY));
    let Rgb { r, g, b } = technique;
    let slowest = r.is_positive().select(extinction.r, infinity);
    let slowest = g.is_positive().select(extinction.g, infinity).min(slowest);
    let slowest = b.is_positive().select(extinction.b, infinity).min(slowest);
    // A channel that decays more slowly than all channels that could be sampled has no scattering.
    let Rgb { r: tr, g: tg, b: tb } = extinction - Rgb::splat(slowest);
    let relative = transmittance(Rgb::new(tr.max(zero), tg.max(zero), tb.max(zero)), distance);
    let total = r * relative.r + g * relative.g + b * relative.b;
    Rgb::new(
        (relative.r / total).only(r.is_positive()),
        (relative.g / total).only(g.is_positive()),
        (relative.b / total).only(b.is_positive()),
    )
}

/// Transmittance over distances \[m\], which may be infinite, for extinction coefficients [1/m] (Beer and Lambert).
#[inline(always)]
pub fn transmittance<F: Lanes>(extinction: Rgb<F>, distance: F) -> Rgb<F> {
    let Rgb { r, g, b } = extinction;
    Rgb::new(decay(r, distance), decay(g, distance), decay(b, distance))
}

/// `exp(-coefficient * distance)`, in units of 1/m and m. It is 1 for a coefficient of zero, also over an infinite distance.
#[inline(always)]
fn decay<F: Lanes>(coefficient: F, distance: F) -> F {
    coefficient.is_positive().select(exp(-coefficient * distance), coefficient.constant(1.0))
}

/// The probability of each channel: its share in the throughput.
#[inline(always)]
fn channel_shares<F: Lanes>(throughput: Rgb<F>) -> Rgb<F> {
    // A ratio to the largest channel, so that very small and very large weights stay in range.
    let largest = throughput.max_channel();
    let relative = Rgb::new(throughput.r / largest, throughput.g / largest, throughput.b / largest);
    let shares = relative * (relative.r + relative.g + relative.b).recip();
    let third = Rgb::splat(largest.constant(1.0 / 3.0));
    Rgb::select(largest.is_positive() & largest.is_finite(), shares, third)
}
