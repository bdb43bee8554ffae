//! Run-length encoding of binary masks, as COCO defines it.
//!
//! Source: Lin et al. 2014 (Microsoft COCO). The file `maskApi.c` of cocoapi is the reference of the format.

use std::collections::BTreeMap;
use std::fmt;

/// A binary mask as lengths of runs.
///
/// The runs follow the pixels column by column from the top left. The first run counts zeros and can be 0. After it,
/// runs of ones and of zeros alternate. The sum of all runs is `height * width`, at most `u32::MAX`.
///
/// Masks from pixels have no run of length 0 except the first one. `new` and `from_string` keep the runs of their
/// input, so two equal masks can have different runs if one of them comes from a foreign file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Rle {
    size: [u32; 2],
    counts: Vec<u32>,
}

impl Rle {
    /// A mask from its size (height, width) and its runs; `None` if the sum of the runs is not `height * width`.
    pub(crate) fn new(size: [u32; 2], counts: Vec<u32>) -> Option<Self> {
        let pixels = pixels_of(size)?;
        let found = counts.iter().fold(0_u64, |sum, &count| sum.saturating_add(u64::from(count)));
        (found == u64::from(pixels)).then_some(Self { size, counts })
    }

    /// A mask from its size (height, width) and its compressed string; `None` if the string is damaged or does not fit the
    /// size.
    ///
    /// Its memory is proportional to the length of the string, not to the size.
    pub(crate) fn from_string(size: [u32; 2], text: &str) -> Option<Self> {
        let mut counts: Vec<u32> = Vec::new();
        let (mut number, mut shift) = (0_i64, 0_u32);
        for byte in text.bytes() {
            let group = i64::from(byte.checked_sub(48).filter(|group| *group < 64)?);
            // A difference of two u32 has 33 bits and a sign: seven groups of five bits.
            if shift > 30 {
                return None;
            }
            number |= (group & 0x1f) << shift;
            shift += 5;
            if group & 0x20 != 0 {
                continue;
            }
            if group & 0x10 != 0 {
                number |= -1 << shift;
            }
            counts.push(u32::try_from(number + reference(&counts, counts.len())).ok()?);
            (number, shift) = (0, 0);
        }
        // The end is not inside of a number.
        if shift == 0 { Self::new(size, counts) } else { None }
    }

    /// Height and width [px].
    pub(crate) fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The number of pixels of the mask.
    pub(crate) fn area(&self) -> u32 {
        self.counts.iter().skip(1).step_by(2).sum()
    }

    /// The pixels of the mask, `height * width` values, row by row from the top left.
    ///
    /// It allocates one byte for each pixel. A caller with a mask from a file compares `size` with the size of the
    /// image first.
    pub(crate) fn decode(&self) -> Vec<bool> {
        let [height, width] = self.size.map(|side| side as usize);
        let mut pixels = vec![false; height * width];
        for (start, end) in self.runs() {
            let (mut x, mut y) = (start as usize / height, start as usize % height);
            for _ in start..end {
                if let Some(pixel) = pixels.get_mut(y * width + x) {
                    *pixel = true;
                }
                y += 1;
                if y == height {
                    (x, y) = (x + 1, 0);
                }
            }
        }
        pixels
    }

    /// The runs of ones as (start, end) in column order, without empty ones.
    fn runs(&self) -> impl Iterator<Item = (u32, u32)> {
        self.counts
            .chunks_exact(2)
            .scan(0_u32, |at, pair| {
                let start = *at + pair[0];
                *at = start + pair[1];
                Some((start, *at))
            })
            .filter(|(start, end)| start < end)
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
/// `labels` has `width * height` values, row by row from the top left. The result has one mask for each non-zero value
/// that occurs. The time depends on the number of pixels and of runs, not on the number of labels.
///
/// `None` if `labels` has another number of values, or if `width * height` exceeds `u32::MAX`.
pub(crate) fn runs_of_labels(labels: &[u16], width: u32, height: u32) -> Option<BTreeMap<u16, Rle>> {
    // 32 columns of u16 are one cache line of each row.
    const BLOCK: usize = 32;
    let size = [height, width];
    let pixels = pixels_of(size)?;
    if labels.len() != pixels as usize {
        return None;
    }
    if pixels == 0 {
        return Some(BTreeMap::new());
    }
    let mut runs = LabelRuns::default();
    let (width, height) = (width as usize, height as usize);
    // A distance of columns that is no power of two: columns at such a distance share few places of the cache.
    let pitch = (height + BLOCK) | 1;
    let mut block = vec![0_u16; BLOCK.min(width) * pitch];
    for left in (0..width).step_by(BLOCK) {
        for (y, row) in labels.chunks_exact(width).enumerate() {
            let from = row.get(left..).unwrap_or_default();
            for (to, &label) in block.iter_mut().skip(y).step_by(pitch).zip(from) {
                *to = label;
            }
        }
        for column in block.chunks_exact(pitch).take(width - left) {
            runs.append(column.get(..height).unwrap_or_default());
        }
    }
    Some(runs.finish(size, pixels))
}

/// The runs of each label of a sequence of pixels.
#[derive(Default)]
struct LabelRuns {
    /// The runs of each label that occurs, with the end of its last run.
    found: BTreeMap<u16, (Vec<u32>, u32)>,
    /// The label of the pixel before.
    label: u16,
    /// The start of the run that contains the pixel before.
    start: u32,
    /// The number of pixels so far.
    at: u32,
}

impl LabelRuns {
    /// Appends pixels to the sequence.
    fn append(&mut self, mut pixels: &[u16]) {
        while let Some(&first) = pixels.first() {
            if first != self.label {
                self.close();
                (self.label, self.start) = (first, self.at);
            }
            let length = equal_prefix(pixels, first);
            self.at += length as u32;
            pixels = pixels.get(length..).unwrap_or_default();
        }
    }

    /// Stores the run that ends here.
    fn close(&mut self) {
        if self.label != 0 && self.at > self.start {
            let (counts, end) = self.found.entry(self.label).or_default();
            counts.extend([self.start - *end, self.at - self.start]);
            *end = self.at;
        }
    }

    /// The masks of all labels.
    fn finish(mut self, size: [u32; 2], pixels: u32) -> BTreeMap<u16, Rle> {
        self.close();
        let close = |(label, (mut counts, end)): (u16, (Vec<u32>, u32))| {
            if end < pixels {
                counts.push(pixels - end);
            }
            (label, Rle { size, counts })
        };
        self.found.into_iter().map(close).collect()
    }
}

/// The number of pixels at the start that are equal to `label`.
fn equal_prefix(pixels: &[u16], label: u16) -> usize {
    const STEP: usize = 32;
    // A comparison of whole steps without a branch for each pixel compiles to vector instructions.
    let differs = |step: &[u16]| step.iter().fold(0, |bits, &pixel| bits | (pixel ^ label)) != 0;
    let whole = pixels.chunks_exact(STEP).take_while(|step| !differs(step)).count() * STEP;
    whole + pixels.iter().skip(whole).take_while(|&&pixel| pixel == label).count()
}

/// The number of pixels of a mask of a size (height, width).
fn pixels_of(size: [u32; 2]) -> Option<u32> {
    size[0].checked_mul(size[1])
}

/// The number that the compressed string subtracts from a run: the run two places before, from the fourth run on.
fn reference(counts: &[u32], run: usize) -> i64 {
    if run < 3 { 0 } else { counts.get(run - 2).map_or(0, |&count| i64::from(count)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pseudo-random bits: splitmix64 (Steele et al. 2014).
    fn random(seed: u64) -> impl FnMut() -> u64 {
        let mut state = seed;
        move || {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ (z >> 31)
        }
    }

    /// Label images of several sizes, with few and with many runs.
    fn images() -> Vec<(u32, u32, Vec<u16>)> {
        let mut next = random(7);
        let mut all = Vec::new();
        for (width, height) in [(1, 1), (1, 40), (40, 1), (3, 2), (31, 7), (32, 33), (33, 65), (100, 71)] {
            for kinds in [1, 2, 3, 60_000] {
                for hold in [1, 5, 90] {
                    let mut label = 0;
                    let mut pixel = || {
                        if next().is_multiple_of(hold) {
                            label = (next() % kinds) as u16;
                        }
                        label
                    };
                    all.push((width, height, (0..width * height).map(|_| pixel()).collect()));
                }
            }
        }
        all
    }

    /// A mask from a function of (x, y).
    fn mask_from(width: u32, height: u32, inside: impl Fn(usize, usize) -> bool) -> Rle {
        let mut counts = Vec::new();
        let (mut run, mut value) = (0_u32, false);
        for x in 0..width as usize {
            for y in 0..height as usize {
                if inside(x, y) != value {
                    counts.push(run);
                    (run, value) = (0, !value);
                }
                run += 1;
            }
        }
        counts.push(run);
        Rle::new([height, width], counts).unwrap()
    }

    fn mask_of(labels: &[u16], width: u32, height: u32, label: u16) -> Rle {
        mask_from(width, height, |x, y| labels[y * width as usize + x] == label)
    }

    #[test]
    fn masks_survive_the_string_and_the_pixels() {
        for (width, height, labels) in images() {
            let mask = mask_of(&labels, width, height, labels[0]);
            assert_eq!(Rle::from_string([height, width], &mask.to_string()), Some(mask.clone()));
            let pixels = mask.decode();
            assert!(pixels.iter().zip(&labels).all(|(&pixel, &label)| pixel == (label == labels[0])));
            assert_eq!(mask.area() as usize, pixels.iter().filter(|&&pixel| pixel).count());
        }
    }

    #[test]
    fn one_pass_gives_the_mask_of_each_label() {
        for (width, height, labels) in images() {
            let all = runs_of_labels(&labels, width, height).unwrap();
            let mut expected = labels.clone();
            expected.sort_unstable();
            expected.dedup();
            expected.retain(|&label| label != 0);
            assert_eq!(all.keys().copied().collect::<Vec<_>>(), expected);
            for (&label, mask) in all.iter().take(50) {
                assert_eq!(*mask, mask_of(&labels, width, height, label));
            }
        }
        assert_eq!(runs_of_labels(&[1; 5], 2, 3), None);
        assert_eq!(runs_of_labels(&[], 0, 3), Some(BTreeMap::new()));
        assert_eq!(runs_of_labels(&[], u32::MAX, 2), None);
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
            let mask = Rle::new(size, counts).unwrap();
            assert_eq!(mask.to_string(), text);
            assert_eq!(Rle::from_string(size, text), Some(mask));
        }
    }

    #[test]
    fn the_size_of_masks_has_its_limits() {
        let empty = mask_from(0, 5, |_, _| true);
        assert_eq!((empty.area(), empty.decode().len()), (0, 0));
        assert_eq!(Rle::from_string([5, 0], &empty.to_string()), Some(empty));
        assert_eq!(Rle::from_string([0, 0], ""), Rle::new([0, 0], vec![]));
        assert_eq!(Rle::new([1 << 16, 1 << 16], vec![]), None);
        let full = Rle::new([u32::MAX, 1], vec![0, u32::MAX]).unwrap();
        assert_eq!(full.area(), u32::MAX);
        assert_eq!(Rle::from_string([u32::MAX, 1], &full.to_string()), Some(full));
        // The largest differences of both signs.
        for counts in [vec![0, u32::MAX, 0, 0], vec![0, 0, 0, u32::MAX]] {
            let mask = Rle::new([u32::MAX, 1], counts).unwrap();
            assert_eq!(Rle::from_string([u32::MAX, 1], &mask.to_string()), Some(mask));
        }
    }

    #[test]
    fn runs_of_length_zero_are_legal() {
        let mask = Rle::new([4, 2], vec![1, 0, 2, 1, 0, 1, 3, 0]).unwrap();
        assert_eq!(mask.area(), 2);
        assert_eq!(Rle::from_string([4, 2], &mask.to_string()), Some(mask));
    }

    #[test]
    fn hostile_strings_are_errors() {
        // A wrong sum, a wrong byte, an open number, and runs that are negative or too large. Sums of 2^32 - 1 do not wrap.
        for text in [
            "",
            ";",
            "5/",
            "p",
            "5\u{e4}",
            "5P",
            "O",
            "000O",
            "oooooooo0",
            &"P".repeat(1000),
            "ooooooo0",
            "oooooo3oooooo3oooooo3",
        ] {
            assert_eq!(Rle::from_string([3, 4], text), None, "{text}");
        }
        // All short strings of bytes of interest, and random longer ones: no panic, and accepted strings are sound.
        let mut next = random(3);
        for _ in 0..20_000 {
            let text: String = (0..next() % 12).map(|_| char::from((46 + next() % 67) as u8)).collect();
            for size in [[3, 4], [1, 1], [0, 3]] {
                if let Some(mask) = Rle::from_string(size, &text) {
                    assert_eq!(mask.decode().iter().filter(|&&pixel| pixel).count(), mask.area() as usize);
                    assert_eq!(Rle::from_string(size, &mask.to_string()), Some(mask));
                }
            }
        }
    }
}
