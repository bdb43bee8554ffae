//! 8-bit gamma-2.2 images for display. No measurement uses them.

use dunkelfeld_film::Plane;

use crate::demosaic::demosaic;
use crate::efficiency::ColorFilter;
use crate::model::SensorModel;

/// The exponent of the encoding: the pure power law of the paper, not the piecewise sRGB curve.
pub const GAMMA: f64 = 2.2;

/// 8-bit image of a frame: offset to 0, saturation to 255, clipped there, gamma 2.2.
pub fn frame_to_8bit(frame: &Plane<u16>, model: &SensorModel) -> Plane<u8> {
    let offset = model.spec().offset.0;
    let span = model.saturation_value().0 - offset;
    let table: Vec<u8> = (0..=model.max_value()).map(|y| encode((f64::from(y) - offset) / span)).collect();
    // Values beyond the sensor's range can only come from a frame of another camera. They become white.
    frame.map(|&y| table.get(usize::from(y)).copied().unwrap_or(u8::MAX))
}

/// 8-bit image of a frame with a colour filter. The steps are those of [`frame_to_8bit`] for each channel after
/// interpolation. If the filter requests it, the channels are scaled so that grey is neutral
/// ([`ColorFilter::grey_gains`]). Colours are those of the filter: no colour is computed from another.
pub fn mosaic_to_8bit(frame: &Plane<u16>, model: &SensorModel, filter: &ColorFilter) -> Plane<[u8; 3]> {
    let offset = model.spec().offset.0;
    let span = model.saturation_value().0 - offset;
    let gains = if filter.white_balance { filter.grey_gains() } else { [1.0; 3] };
    let mut values = frame.data().iter();
    let mosaic = Plane::from_fn(frame.width(), frame.height(), |x, y| {
        let value = values.next().map_or(0.0, |&y| f64::from(y));
        // The value is clipped before it is scaled. So a pixel that saturates in all colours is white.
        (((value - offset) / span).min(1.0) * gains[filter.pattern.color_at(x, y) as usize]) as f32
    });
    demosaic(&mosaic, filter.pattern).map(|pixel| pixel.map(|v| encode(f64::from(v))))
}

/// 8-bit image of radiance without a sensor: clipped at 1, gamma 2.2.
pub fn linear_to_8bit(radiance: &Plane<[f32; 3]>) -> Plane<[u8; 3]> {
    radiance.map(|pixel| pixel.map(|v| encode(f64::from(v))))
}

/// The 8-bit code of a linear value: 0 below 0 and for NaN, 255 from 1 on.
pub fn encode(linear: f64) -> u8 {
    // A saturating cast: NaN becomes 0.
    (linear.clamp(0.0, 1.0).powf(1.0 / GAMMA) * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::efficiency::{BayerPattern, Efficiency, QuantumEfficiency};
    use crate::model::SensorSpec;
    use crate::model::tests::example;
    use dunkelfeld_radiometry::Nanometres;

    #[test]
    fn codes_are_those_of_the_power_law() {
        // By hand: 0.5^(1/2.2) * 255 = 186.08. 0.01 gives 31.44. The code 1 begins at (0.5/255)^2.2 = 1.1e-6.
        for (linear, code) in
            [(-1.0, 0), (0.0, 0), (1.0e-6, 0), (1.2e-6, 1), (0.01, 31), (0.5, 186), (1.0, 255), (7.0, 255)]
        {
            assert_eq!(encode(linear), code, "of {linear}");
        }
        assert_eq!(encode(f64::NAN), 0);
        assert_eq!(encode(f64::INFINITY), 255);
    }

    /// Grey light on a filter with responses 2 : 4 : 1 is neutral with white balance and green without. Pixels that
    /// saturate in all colours are white in both cases.
    #[test]
    fn grey_light_is_displayed_grey_behind_a_filter() {
        let flat = |eta| QuantumEfficiency::new(vec![(Nanometres(550.0), eta)]).expect("a curve");
        let filter = |white_balance| ColorFilter {
            pattern: BayerPattern::Grbg,
            curves: [flat(0.2), flat(0.4), flat(0.1)],
            white_balance,
        };
        let spec = SensorSpec { quantum_efficiency: Efficiency::Mosaic(filter(true)), ..example() };
        let model = SensorModel::new(spec).expect("valid");
        // Offset 60, saturation 2560. Green is at half of the range.
        let light = [625, 1250, 312];
        let grey = Plane::from_fn(6, 6, |x, y| 60 + light[BayerPattern::Grbg.color_at(x, y) as usize]);
        let picture = mosaic_to_8bit(&grey, &model, &filter(true));
        assert!(picture.data().iter().all(|p| p.iter().all(|v| v.abs_diff(186) <= 1)), "{picture:?}");
        let green = mosaic_to_8bit(&grey, &model, &filter(false));
        assert!(green.data().iter().all(|&[r, g, b]| g == 186 && (135..=137).contains(&r) && (98..=100).contains(&b)));
        for balanced in [true, false] {
            let white = mosaic_to_8bit(&Plane::new(5, 3, 4095), &model, &filter(balanced));
            assert!(white.data().iter().all(|p| *p == [255; 3]), "{white:?}");
        }
    }
}
