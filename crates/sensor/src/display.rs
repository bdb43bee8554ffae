//! Pictures for the eye: 8 bit, gamma 2.2. Nothing is ever measured on them.

use dunkelfeld_film::Plane;

use crate::model::SensorModel;

/// The exponent of the encoding: the pure power law of the paper, not the piecewise sRGB curve.
pub const GAMMA: f64 = 2.2;

/// 8-bit picture of a frame: offset to 0, saturation to 255, clipped there, gamma 2.2.
pub fn frame_to_8bit(frame: &Plane<u16>, model: &SensorModel) -> Plane<u8> {
    let offset = model.spec().offset.0;
    let span = model.saturation_value().0 - offset;
    let table: Vec<u8> = (0..=model.max_value()).map(|y| encode((f64::from(y) - offset) / span)).collect();
    // Values beyond the sensor's range can only come from another camera's frame; they are white.
    frame.map(|&y| table.get(usize::from(y)).copied().unwrap_or(u8::MAX))
}

/// 8-bit picture of radiance as it is, without a sensor: clipped at 1, gamma 2.2.
pub fn linear_to_8bit(radiance: &Plane<[f32; 3]>) -> Plane<[u8; 3]> {
    radiance.map(|pixel| pixel.map(|v| encode(f64::from(v))))
}

/// The 8-bit code of a linear value, 0 below 0 and for NaN, 255 from 1 on.
pub fn encode(linear: f64) -> u8 {
    // A saturating cast: NaN becomes 0.
    (linear.clamp(0.0, 1.0).powf(1.0 / GAMMA) * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::tests::example;

    #[test]
    fn codes_are_those_of_the_power_law() {
        // By hand: 0.5^(1/2.2) * 255 = 186.08; 0.01 -> 31.44; the code 1 begins at (0.5/255)^2.2 = 1.1e-6.
        for (linear, code) in
            [(-1.0, 0), (0.0, 0), (1.0e-6, 0), (1.2e-6, 1), (0.01, 31), (0.5, 186), (1.0, 255), (7.0, 255)]
        {
            assert_eq!(encode(linear), code, "of {linear}");
        }
        assert_eq!(encode(f64::NAN), 0);
        assert_eq!(encode(f64::INFINITY), 255);
    }

    #[test]
    fn a_frame_spans_from_its_offset_to_its_saturation() {
        let model = SensorModel::new(example()).expect("valid");
        // Offset 60, saturation 2560.
        let frame = Plane::from_vec(6, 1, vec![0, 60, 1310, 2560, 4095, u16::MAX]).expect("6 x 1");
        assert_eq!(frame_to_8bit(&frame, &model).data(), &[0, 0, 186, 255, 255, 255]);
    }

    #[test]
    fn channels_stay_in_their_order() {
        let plane = Plane::new(1, 1, [0.0, 0.5, 2.0]);
        assert_eq!(linear_to_8bit(&plane).data(), &[[0, 186, 255]]);
    }
}
