//! Rewrites the vertices and faces that `tobj` would refuse or misread. Faults are counted with their line numbers.

use super::plain::Counts;
use super::tally::Tally;
use super::text;
use std::fmt::Write as _;

/// Larger coordinates count as damaged: their squares exceed the range of f32.
const FARTHEST: f64 = 1e15;

/// Colour of a vertex without one in a file where others have one. No other written colour is infinite in all channels.
pub(super) const NO_COLOR: &str = "inf inf inf";

/// Does the vertex have a colour? Four values are x y z w, with a weight that only curves use; six or more are
/// x y z r g b.
pub(super) fn has_color(data: &str) -> bool {
    read_numbers(data, &mut [0.0; 7]).0 >= 6
}

/// A vertex of three numbers, or of six if `colored`. The coordinates of an unusable one become NaN.
pub(super) fn vertex(line: u32, data: &str, colored: bool, tally: &mut Tally) -> String {
    let mut values = [0.0; 7];
    let count = numbers(line, data, &mut values, tally);
    let usable = count >= 3 && values[..3].iter().all(|v| v.abs() <= FARTHEST);
    if !usable {
        tally.add(line, "the vertex is not three usable numbers; faces that use it are dropped");
    }
    let mut out = String::from("v");
    write_numbers(&mut out, if usable { &values[..3] } else { &[f64::NAN; 3] });
    if count >= 6 {
        write_numbers(&mut out, &values[3..6]);
    } else if colored {
        out.push(' ');
        out.push_str(NO_COLOR);
    }
    out.push('\n');
    out
}

/// A texture coordinate of two numbers; 0 0 where it is unusable.
pub(super) fn texcoord(line: u32, data: &str, tally: &mut Tally) -> String {
    let mut values = [0.0; 3];
    let count = numbers(line, data, &mut values, tally);
    let usable = count >= 1 && values[..2].iter().all(|v| v.abs() <= 1e6);
    if !usable {
        tally.add(line, "the texture coordinate is not usable and was set to 0");
    }
    statement("vt", if usable { &values[..2] } else { &[0.0; 2] })
}

/// A normal of three numbers. The zero vector where it is unusable.
pub(super) fn normal(line: u32, data: &str, tally: &mut Tally) -> String {
    let mut values = [0.0; 3];
    let count = numbers(line, data, &mut values, tally);
    let length = values.iter().map(|v| v * v).sum::<f64>().sqrt();
    let usable = count == 3 && length.is_finite() && length > 1e-30;
    if !usable {
        tally.add(line, "the normal has no direction; it is computed from the faces instead");
    }
    statement("vn", if usable { &values } else { &[0.0; 3] })
}

fn statement(key: &str, values: &[f64]) -> String {
    let mut out = String::from(key);
    write_numbers(&mut out, values);
    out.push('\n');
    out
}

/// The number with as many digits as are needed to read the same number again.
fn write_numbers(out: &mut String, values: &[f64]) {
    for value in values {
        // Writing to a string cannot fail.
        let _ = write!(out, " {value:?}");
    }
}

/// Reads numbers into `values` and returns how many there are; a word that is none ends the list.
fn numbers(line: u32, data: &str, values: &mut [f64], tally: &mut Tally) -> usize {
    let (count, broken) = read_numbers(data, values);
    (0..broken).for_each(|_| tally.add(line, "a number is misspelled; what could be read of it is used"));
    count
}

/// As [`numbers`]; the second result is the number of misspelled ones.
fn read_numbers(data: &str, values: &mut [f64]) -> (usize, usize) {
    let (mut count, mut misspelled) = (0, 0);
    for (slot, word) in values.iter_mut().zip(data.split_whitespace()) {
        let Some((value, broken)) = text::number(word) else { break };
        misspelled += usize::from(broken);
        *slot = value;
        count += 1;
    }
    (count, misspelled)
}

const NO_VERTEX: &str = "the face has an index that names no vertex and is dropped";
/// Numbers of texture coordinates and normals.
const NO_ENTRY: [&str; 2] = [
    "an index names no texture coordinate and is ignored",
    "an index names no normal; it is computed from the faces instead",
];

/// A face with indices from 1, all in range. In a file with texture coordinates, a corner without one has the index
/// after the last one. The same applies to normals. `None` if the face cannot be used.
///
/// `seen` is the number of entries before the line, to which negative indices refer. `total` is the number in the file.
/// Indices beyond the end of the file are stored in `late`: such faults are reported after all others.
pub(super) fn face(
    line: u32,
    data: &str,
    seen: &Counts,
    total: &Counts,
    tally: &mut Tally,
    late: &mut Tally,
) -> Option<(String, usize)> {
    let mut corners = Vec::new();
    for word in data.split_whitespace() {
        let mut fields = word.split('/');
        let Index::At(position) = resolve(fields.next(), seen[0]) else {
            tally.add(line, NO_VERTEX);
            return None;
        };
        let mut optional = |list: usize| match resolve(fields.next(), seen[list]) {
            Index::At(i) => Some(i),
            Index::Absent => None,
            Index::Bad => {
                tally.add(line, NO_ENTRY[list - 1]);
                None
            }
        };
        corners.push((position, [optional(1), optional(2)]));
    }
    if corners.len() < 3 {
        tally.add(line, "the face has fewer than three corners and is dropped");
        return None;
    }
    let mut out = String::from("f");
    for (position, others) in &corners {
        if *position >= total[0] {
            late.add(line, NO_VERTEX);
            return None;
        }
        let _ = write!(out, " {}", position + 1);
        for (list, index) in (1..).zip(others) {
            let index = index.filter(|i| {
                let in_range = *i < total[list];
                if !in_range {
                    late.add(line, NO_ENTRY[list - 1]);
                }
                in_range
            });
            out.push('/');
            if total[list] > 0 {
                let _ = write!(out, "{}", index.unwrap_or(total[list]) + 1);
            }
        }
    }
    out.push('\n');
    Some((out, corners.len()))
}

enum Index {
    At(u32),
    Absent,
    Bad,
}

/// Converts an index of OBJ (from 1, or backwards from -1) to one from 0.
fn resolve(field: Option<&str>, seen: u32) -> Index {
    let Some(field) = field.filter(|f| !f.is_empty()) else { return Index::Absent };
    let index = match field.parse::<i64>() {
        Ok(i) if i > 0 => i - 1,
        Ok(i) if i < 0 => i64::from(seen) + i,
        _ => -1,
    };
    match u32::try_from(index) {
        Ok(i) if i != u32::MAX => Index::At(i),
        _ => Index::Bad,
    }
}
