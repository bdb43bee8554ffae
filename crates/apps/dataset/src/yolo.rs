//! Labels of object detection in the text format of YOLO.
//!
//! Source: Redmon et al. 2016 (You Only Look Once), in the files of Darknet and Ultralytics. An image
//! `images/NAME.png` has the label file `labels/NAME.txt` with one line for each object.

use std::fmt::Write;

/// The line `class cx cy w h` of an object, without a line break.
///
/// `class` counts from 0. `bbox` is the box [x, y, width, height] of the object [px], with (0, 0) at the top left corner
/// of the image, and lies in the image. The centre and the size in the line are fractions of `width` and `height` of the image
/// [px], 0 to 1, with six decimals, and so that half of the size on both sides of the centre is within 0 to 1.
pub(crate) fn line(class: usize, [x, y, w, h]: [u32; 4], width: u32, height: u32) -> String {
    let [[cx, w], [cy, h]] = [fractions(x, w, width), fractions(y, h, height)];
    format!("{class} {cx:.6} {cy:.6} {w:.6} {h:.6}")
}

/// The line `class x1 y1 x2 y2 ...` of an object with the corners of its polygon \[px\], as fractions of `width` and `height`
/// with six decimals.
pub(crate) fn polygon(class: usize, corners: &[[f64; 2]], width: u32, height: u32) -> String {
    let mut text = class.to_string();
    for [x, y] in corners {
        _ = write!(text, " {:.6} {:.6}", x / f64::from(width), y / f64::from(height));
    }
    text
}

/// The polygons x0, y0, x1, y1, ... of an instance as one, since a line has one. Each is joined to those before it by a line
/// there and back between the nearest corners, which has no area (as `merge_multi_segment` of Ultralytics).
pub(crate) fn joined(polygons: &[Vec<f64>]) -> Vec<[f64; 2]> {
    let mut all: Vec<[f64; 2]> = Vec::new();
    for polygon in polygons {
        let corners: Vec<[f64; 2]> = polygon.chunks_exact(2).map(|corner| [corner[0], corner[1]]).collect();
        let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
        let pairs = (0..all.len()).flat_map(|i| (0..corners.len()).map(move |k| (i, k)));
        let nearest = pairs.min_by(|a, b| {
            let [a, b] = [a, b].map(|&(i, k)| distance(all[i], corners[k]));
            a.total_cmp(&b)
        });
        let Some((i, k)) = nearest else {
            all = corners;
            continue;
        };
        let bridge = corners[k..].iter().chain(&corners[..=k]).chain([&all[i]]).copied();
        all.splice(i + 1..i + 1, bridge.collect::<Vec<_>>());
    }
    all
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

/// Centre and length of an interval inside `0..size`, as fractions of `size` with six decimals. The length is such that the
/// interval ends within 0 to 1.
fn fractions(start: u32, length: u32, size: u32) -> [f64; 2] {
    let [start, length, size] = [start, length, size].map(f64::from);
    let [centre, length] = [0.5 * (start + (start + length)) / size, length / size].map(|v| (v * 1e6).round());
    [centre / 1e6, length.min(2.0 * centre).min(2.0 * (1e6 - centre)) / 1e6]
}

/// A string as a double-quoted scalar of YAML, which has the escapes of JSON.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_become_fractions() {
        assert_eq!(line(0, [0, 0, 10, 20], 10, 20), "0 0.500000 0.500000 1.000000 1.000000");
        assert_eq!(line(7, [2, 3, 1, 2], 8, 16), "7 0.312500 0.250000 0.125000 0.125000");
        assert_eq!(line(1, [0, 0, 1, 1], 3, 1), "1 0.166667 0.500000 0.333333 1.000000");
        assert_eq!(line(1, [4095, 0, 1, 1], 4096, 1), "1 0.999878 0.500000 0.000244 1.000000");
    }

    /// All boxes at the edges of images of many sizes, in the millionths that the line has.
    #[test]
    fn boxes_end_within_the_image() {
        for size in 1..400 {
            for length in 1..=size {
                for start in [0, size - length] {
                    let text = line(0, [start, 0, length, 1], size, 1);
                    let digits: Vec<i64> =
                        text.split(' ').map(|v| v.replace('.', "").parse().expect("digits")).collect();
                    let (centre, width) = (digits[1], digits[3]);
                    assert!(width > 0 && 2 * centre >= width && 2 * centre + width <= 2_000_000, "{size}: {text}");
                    assert!((width - i64::from(length) * 1_000_000 / i64::from(size)).abs() <= 2, "{size}: {text}");
                }
            }
        }
    }

    /// The bridges have no area: that of the polygon is the number of pixels (the formula of Gauss), and each polygon is in
    /// it with all its corners.
    #[test]
    fn polygons_are_joined_without_an_area() {
        let mask = ["##....#", ".#.##.#", "...##..", "#......", "##...##"];
        let inside = |x: usize, y: usize| mask[y].as_bytes()[x] == b'#';
        let polygons = crate::outline::outline([0, 0, 7, 5], inside).polygons;
        assert_eq!(polygons.len(), 5);
        let all = joined(&polygons);
        assert_eq!(all.len(), polygons.iter().map(|p| p.len() / 2).sum::<usize>() + 2 * 4);
        let area: f64 =
            all.iter().zip(all.iter().cycle().skip(1)).map(|(a, b)| 0.5 * (a[0] * b[1] - a[1] * b[0])).sum();
        assert_eq!(area, mask.concat().matches('#').count() as f64);
        // The third is nearest to the first, not to the second.
        assert!(all.windows(2).any(|pair| pair == [[2.0, 0.0], [3.0, 1.0]]), "{all:?}");
        assert_eq!(polygon(3, &[[0.0, 1.0], [4.0, 2.0]], 8, 4), "3 0.000000 0.250000 0.500000 0.500000");
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
        assert_eq!(quoted("x\ny\t\0"), r#""x\ny\t\u0000""#);
        assert_eq!(quoted("Größe 螺丝"), r#""Größe 螺丝""#);
    }
}
