//! Labels of object detection in the text format of YOLO.
//!
//! Source: Redmon et al. 2016 (You Only Look Once), in the files of Darknet and Ultralytics. An image
//! `images/NAME.png` has the label file `labels/NAME.txt` with one line for each object.

use std::fmt::Write;

/// The line `class cx cy w h` of an object, without a line break.
///
/// `class` counts from 0. `bbox` is the box [x, y, width, height] of the object [px], with (0, 0) at the top left corner
/// of the image. The centre and the size in the line are fractions of `width` and `height` of the image [px], 0 to 1,
/// with six decimals, and so that half of the size on both sides of the centre is within 0 to 1. The part of the box
/// outside the image is cut off. The result is `None` if nothing remains or if a number is not finite.
pub(crate) fn line(class: usize, bbox: [f64; 4], width: u32, height: u32) -> Option<String> {
    let [x, y, w, h] = bbox;
    let (cx, w) = fractions(x, w, width)?;
    let (cy, h) = fractions(y, h, height)?;
    let [[cx, w], [cy, h]] = [rounded(cx, w), rounded(cy, h)];
    Some(format!("{class} {cx:.6} {cy:.6} {w:.6} {h:.6}"))
}

/// The end of a line with key points: ` x y v` for each of them. The places [px] become fractions of `width` and `height`
/// of the image [px], with six decimals.
pub(crate) fn keypoints(points: impl IntoIterator<Item = (f64, f64, u8)>, width: u32, height: u32) -> String {
    let mut text = String::new();
    for (x, y, v) in points {
        _ = write!(text, " {:.6} {:.6} {v}", x / f64::from(width), y / f64::from(height));
    }
    text
}

/// The text of `data.yaml`: the folder of the images and the names of the classes by their numbers. With key points it has
/// `kpt_shape`: their number, and three numbers for each.
///
/// The file belongs into the folder that contains `images` and `labels`. It has no key `path`: readers then use the
/// folder of the file. Training and validation both use `images`, because readers require both keys. Names can contain
/// any characters.
pub(crate) fn data_yaml<S: AsRef<str>>(names: impl IntoIterator<Item = S>, keypoints: usize) -> String {
    let mut text = "train: images\nval: images\n".to_owned();
    if keypoints > 0 {
        _ = writeln!(text, "kpt_shape: [{keypoints}, 3]");
    }
    let mut lines = String::new();
    for (class, name) in names.into_iter().enumerate() {
        // Writing to a string cannot fail.
        _ = writeln!(lines, "  {class}: {}", quoted(name.as_ref()));
    }
    text.push_str(if lines.is_empty() { "names: {}\n" } else { "names:\n" });
    text + &lines
}

/// Centre and length of the part of an interval inside `0..size`, as fractions of `size`.
fn fractions(start: f64, length: f64, size: u32) -> Option<(f64, f64)> {
    let size = f64::from(size);
    let (low, high) = (start.max(0.0), (start + length).min(size));
    let usable = start.is_finite() && length.is_finite() && low < high;
    usable.then(|| (0.5 * (low + high) / size, (high - low) / size))
}

/// Centre and length with six decimals, and the length such that it ends within 0 to 1.
fn rounded(centre: f64, length: f64) -> [f64; 2] {
    let [centre, length] = [centre, length].map(|v| (v * 1e6).round());
    [centre / 1e6, length.min(2.0 * centre).min(2.0 * (1e6 - centre)) / 1e6]
}

/// A string as a double-quoted scalar of YAML 1.1 and 1.2.
///
/// It keeps printable ASCII, letters and digits, and escapes all other characters. So the file has no character that
/// YAML forbids or changes.
fn quoted(text: &str) -> String {
    let mut result = String::from('"');
    for c in text.chars() {
        match c {
            '"' | '\\' => result.extend(['\\', c]),
            ' '..='~' => result.push(c),
            _ if c.is_alphanumeric() => result.push(c),
            _ if u32::from(c) <= 0xffff => _ = write!(result, "\\u{:04x}", u32::from(c)),
            _ => _ = write!(result, "\\U{:08x}", u32::from(c)),
        }
    }
    result.push('"');
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_become_fractions() {
        assert_eq!(line(0, [0.0, 0.0, 10.0, 20.0], 10, 20).unwrap(), "0 0.500000 0.500000 1.000000 1.000000");
        assert_eq!(line(7, [2.0, 3.0, 1.0, 2.0], 8, 16).unwrap(), "7 0.312500 0.250000 0.125000 0.125000");
        assert_eq!(line(1, [0.0, 0.0, 1.0, 1.0], 3, 1).unwrap(), "1 0.166667 0.500000 0.333333 1.000000");
        assert_eq!(line(1, [4095.0, 0.0, 1.0, 1.0], 4096, 1).unwrap(), "1 0.999878 0.500000 0.000244 1.000000");
    }

    /// All boxes at the edges of images of many sizes, in the millionths that the line has.
    #[test]
    fn boxes_end_within_the_image() {
        for size in 1..400 {
            for length in 1..=size {
                for start in [0, size - length] {
                    let text = line(0, [start.into(), 0.0, length.into(), 1.0], size, 1).expect("a box");
                    let digits: Vec<i64> =
                        text.split(' ').map(|v| v.replace('.', "").parse().expect("digits")).collect();
                    let (centre, width) = (digits[1], digits[3]);
                    assert!(width > 0 && 2 * centre >= width && 2 * centre + width <= 2_000_000, "{size}: {text}");
                    assert!((width - i64::from(length) * 1_000_000 / i64::from(size)).abs() <= 2, "{size}: {text}");
                }
            }
        }
    }

    #[test]
    fn boxes_are_cut_at_the_image() {
        assert_eq!(line(2, [-4.0, 3.0, 6.0, 9.0], 4, 4).unwrap(), "2 0.250000 0.875000 0.500000 0.250000");
        for bbox in [[0.0; 4], [4.0, 0.0, 1.0, 1.0], [-2.0, 0.0, 2.0, 1.0], [0.0, 1.0, 1.0, -1.0]] {
            assert_eq!(line(0, bbox, 4, 4), None);
        }
        for number in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for i in 0..4 {
                let mut bbox = [1.0; 4];
                bbox[i] = number;
                assert_eq!(line(0, bbox, 4, 4), None);
            }
        }
        assert_eq!(line(0, [0.0, 0.0, 1.0, 1.0], 0, 4), None);
        assert_eq!(line(0, [f64::MAX, 0.0, f64::MAX, 1.0], 4, 4), None);
    }

    #[test]
    fn key_points_become_fractions() {
        assert_eq!(keypoints([(2.0, 3.0, 2), (0.0, 0.0, 0)], 8, 16), " 0.250000 0.187500 2 0.000000 0.000000 0");
        assert_eq!(keypoints([], 8, 16), "");
        let yaml = data_yaml(["part"], 4);
        assert_eq!(yaml, "train: images\nval: images\nkpt_shape: [4, 3]\nnames:\n  0: \"part\"\n");
    }

    #[test]
    fn names_are_quoted() {
        assert_eq!(data_yaml(["screw", "no"], 0), "train: images\nval: images\nnames:\n  0: \"screw\"\n  1: \"no\"\n");
        assert_eq!(data_yaml([""; 0], 0), "train: images\nval: images\nnames: {}\n");
        assert_eq!(quoted("a: \"b\" \\ #c"), r##""a: \"b\" \\ #c""##);
        assert_eq!(
            quoted("x\ny\t\0\u{85}\u{2028}\u{feff}\u{ffff}"),
            r#""x\u000ay\u0009\u0000\u0085\u2028\ufeff\uffff""#
        );
        assert_eq!(quoted("Größe 螺丝 \u{1f529}"), r#""Größe 螺丝 \U0001f529""#);
        assert!(quoted(&"\n".repeat(9)).is_ascii());
    }
}
