//! Run-length encoding of binary masks, as COCO defines it.
//!
//! Source: Lin et al. 2014 (Microsoft COCO). The file `maskApi.c` of cocoapi is the reference of the format.

use dunkelfeld_film::Plane;
use std::collections::BTreeMap;
use std::fmt;

/// A binary mask as lengths of runs.
///
/// The runs follow the pixels column by column from the top left. The first run counts zeros and can be 0. After it,
/// runs of ones and of zeros alternate. The sum of all runs is `height * width`, at most `u32::MAX`.
///
/// No run but the first one has the length 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Rle {
    size: [u32; 2],
    counts: Vec<u32>,
}

impl Rle {
    /// Height and width [px].
    pub(crate) fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The number of pixels of the mask.
    pub(crate) fn area(&self) -> u32 {
        self.counts.iter().skip(1).step_by(2).sum()
    }
}

/// The compressed string of the runs, in ASCII.
///
/// From the fourth run on, a number is the difference to the run two places before. A number has groups of five bits,
/// the lowest first, in two's complement. Bit 5 of a group is set if another group follows. A character is the group
/// plus 48.
impl fmt::Display for Rle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = String::with_capacity(2 * self.counts.len());
        for (run, &count) in self.counts.iter().enumerate() {
            let mut number = i64::from(count) - reference(&self.counts, run);
            loop {
                let group = (number & 0x1f) as u8;
                number >>= 5;
                let last = number == if group & 0x10 != 0 { -1 } else { 0 };
                text.push(char::from(48 + group + if last { 0 } else { 0x20 }));
                if last {
                    break;
                }
            }
        }
        f.pad(&text)
    }
}

/// The masks of all labels of an image except 0, in one pass over the image.
///
/// The result has one mask for each non-zero value that occurs. The time depends on the number of pixels and of runs, not on
/// the number of labels. An image has at most `u32::MAX` pixels.
pub(crate) fn runs_of_labels(labels: &Plane<u16>) -> BTreeMap<u16, Rle> {
    let (width, height) = (labels.width(), labels.height());
    // The runs of each label that occurs, with the end of its last run.
    let mut found: BTreeMap<u16, (Vec<u32>, u32)> = BTreeMap::new();
    let pixels = (0..width).flat_map(|x| (0..height).map(move |y| (y as usize) * width as usize + x as usize));
    let (mut label, mut start) = (0, 0);
    for (at, next) in (0..).zip(pixels.map(|i| labels.data()[i]).chain([0])) {
        if next == label {
            continue;
        }
        if label != 0 {
            let (counts, end) = found.entry(label).or_default();
            counts.extend([start - *end, at - start]);
            *end = at;
        }
        (label, start) = (next, at);
    }
    let close = |(label, (mut counts, end)): (u16, (Vec<u32>, u32))| {
        if end < width * height {
            counts.push(width * height - end);
        }
        (label, Rle { size: [height, width], counts })
    };
    found.into_iter().map(close).collect()
}

/// The number that the compressed string subtracts from a run: the run two places before, from the fourth run on.
fn reference(counts: &[u32], run: usize) -> i64 {
    if run < 3 { 0 } else { counts.get(run - 2).map_or(0, |&count| i64::from(count)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_sampling::mix64;

    /// The mask of a label by the definition.
    fn mask_of(labels: &Plane<u16>, label: u16) -> Rle {
        let (width, height) = (labels.width(), labels.height());
        let mut counts = Vec::new();
        let (mut run, mut value) = (0_u32, false);
        for i in 0..width * height {
            let (x, y) = (i / height, i % height);
            if (labels.data()[(y * width + x) as usize] == label) != value {
                counts.push(run);
                (run, value) = (0, !value);
            }
            run += 1;
        }
        counts.push(run);
        Rle { size: [height, width], counts }
    }

    #[test]
    fn one_pass_gives_the_mask_of_each_label() {
        for (width, height) in [(1, 1), (1, 40), (40, 1), (3, 2), (31, 7), (32, 33), (33, 65), (100, 71)] {
            for (kinds, hold) in [(1, 1), (2, 1), (2, 9), (3, 90), (60_000, 1), (60_000, 30)] {
                let random = |x: u32, y: u32| mix64(u64::from((y * width + x) / hold) << 20 | kinds);
                let labels = Plane::from_fn(width, height, |x, y| (random(x, y) % kinds) as u16);
                let all = runs_of_labels(&labels);
                let mut expected: Vec<u16> = labels.data().to_vec();
                expected.sort_unstable();
                expected.dedup();
                expected.retain(|&label| label != 0);
                assert_eq!(all.keys().copied().collect::<Vec<_>>(), expected);
                for (&label, mask) in all.iter().take(50) {
                    assert_eq!(*mask, mask_of(&labels, label));
                    let area = labels.data().iter().filter(|other| **other == label).count();
                    assert_eq!(mask.area() as usize, area);
                }
            }
        }
    }

    #[test]
    fn strings_are_those_of_pycocotools() {
        // From pycocotools 2.0.11, `frPyObjects` of these counts.
        for (counts, size, text) in [
            (vec![12], [3, 4], "<"),
            (vec![0, 12], [3, 4], "0<"),
            (vec![5, 1, 6], [3, 4], "516"),
            (vec![16, 15, 1, 31, 37], [10, 10], "`0?1`0T1"),
            (vec![1, 1000, 2, 1, 8996], [100, 100], "1Xo02iPORi8"),
            (vec![u32::MAX - 1, 1], [u32::MAX, 1], "nooooo31"),
        ] {
            assert_eq!(Rle { size, counts }.to_string(), text);
        }
    }
}
