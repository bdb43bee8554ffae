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

/// The reason why data is no run-length encoding of a mask.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum RleError {
    /// `height * width` exceeds `u32::MAX`.
    TooLarge {
        /// Height and width [px].
        size: [u32; 2],
    },
    /// The slice of pixels has not `height * width` values.
    WrongLength {
        /// Height and width [px].
        size: [u32; 2],
        /// The number of values.
        found: usize,
    },
    /// A byte of the string is outside `0` to `o` (48 to 111).
    Byte {
        /// The place of the byte in the string, from 0.
        at: usize,
        /// The byte.
        byte: u8,
    },
    /// The string ends inside a number.
    Truncated,
    /// A run is negative or exceeds `u32::MAX`.
    Count {
        /// The index of the run, from 0.
        run: usize,
    },
    /// The sum of the runs differs from `height * width`.
    Sum {
        /// Height and width [px].
        size: [u32; 2],
        /// The sum of the runs [px].
        found: u64,
    },
}

impl fmt::Display for RleError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLarge { size: [h, w] } => write!(f, "a mask of {w} x {h} pixels exceeds 2^32 - 1 pixels"),
            Self::WrongLength { size: [h, w], found } => {
                write!(f, "an image of {w} x {h} pixels cannot have {found} values")
            }
            Self::Byte { at, byte } => write!(f, "byte {byte} at place {at} is not part of an RLE string"),
            Self::Truncated => write!(f, "the RLE string ends inside a number"),
            Self::Count { run } => write!(f, "run {run} of the RLE string is negative or too large"),
            Self::Sum { size: [h, w], found } => {
                write!(f, "the runs cover {found} pixels, but the mask has {w} x {h} pixels")
            }
        }
    }
}

impl std::error::Error for RleError {}

impl Rle {
    /// A mask from its size (height, width) and its runs.
    ///
    /// # Errors
    /// If the size is too large, or if the sum of the runs is not `height * width`.
    pub(crate) fn new(size: [u32; 2], counts: Vec<u32>) -> Result<Self, RleError> {
        let pixels = pixels_of(size)?;
        let found = counts.iter().fold(0_u64, |sum, &count| sum.saturating_add(u64::from(count)));
        if found == u64::from(pixels) { Ok(Self { size, counts }) } else { Err(RleError::Sum { size, found }) }
    }

    /// A mask from a function of (x, y), with x in `0..width` and y in `0..height`.
    ///
    /// It calls the function once for each pixel, column by column. For all masks of a label image,
    /// [`runs_of_labels`] is faster.
    ///
    /// # Errors
    /// If `width * height` exceeds `u32::MAX`.
    #[cfg(test)]
    pub(crate) fn from_fn(width: u32, height: u32, inside: impl Fn(usize, usize) -> bool) -> Result<Self, RleError> {
        let size = [height, width];
        pixels_of(size)?;
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
        Ok(Self { size, counts })
    }

    /// A mask from its size (height, width) and its compressed string.
    ///
    /// Its memory is proportional to the length of the string, not to the size.
    ///
    /// # Errors
    /// If the size is too large, the string is damaged, or the sum of the runs is not `height * width`.
    pub(crate) fn from_string(size: [u32; 2], text: &str) -> Result<Self, RleError> {
        pixels_of(size)?;
        let mut counts: Vec<u32> = Vec::new();
        let (mut number, mut shift, mut open) = (0_i64, 0_u32, false);
        for (at, byte) in text.bytes().enumerate() {
            let group = match byte {
                48..=111 => i64::from(byte - 48),
                _ => return Err(RleError::Byte { at, byte }),
            };
            // A difference of two u32 has 33 bits and a sign: seven groups of five bits.
            if shift > 30 {
                return Err(RleError::Count { run: counts.len() });
            }
            number |= (group & 0x1f) << shift;
            shift += 5;
            open = group & 0x20 != 0;
            if open {
                continue;
            }
            if group & 0x10 != 0 {
                number |= -1 << shift;
            }
            let count = u32::try_from(number + reference(&counts, counts.len()));
            counts.push(count.map_err(|_| RleError::Count { run: counts.len() })?);
            (number, shift) = (0, 0);
        }
        if open { Err(RleError::Truncated) } else { Self::new(size, counts) }
    }

    /// Height and width [px].
    pub(crate) fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The lengths of the runs [px], zeros first.
    #[cfg(test)]
    pub(crate) fn counts(&self) -> &[u32] {
        &self.counts
    }

    /// The number of pixels of the mask.
    pub(crate) fn area(&self) -> u32 {
        self.counts.iter().skip(1).step_by(2).sum()
    }

    /// The smallest box [x, y, width, height] that contains the mask [px], all zeros for an empty mask.
    ///
    /// The box contains whole pixels: a mask of the single pixel (x, y) has the box [x, y, 1, 1].
    #[cfg(test)]
    pub(crate) fn bbox(&self) -> [u32; 4] {
        let height = self.size[0];
        let (mut low, mut high) = ([u32::MAX; 2], [0_u32; 2]);
        for (start, end) in self.runs() {
            // A run of ones has at least one pixel, so the height is not 0.
            let (first, last) = (start / height, (end - 1) / height);
            let (top, bottom) = if first == last { (start % height, (end - 1) % height) } else { (0, height - 1) };
            low = [low[0].min(first), low[1].min(top)];
            high = [high[0].max(last), high[1].max(bottom)];
        }
        if low[0] > high[0] {
            return [0; 4];
        }
        [low[0], low[1], high[0] - low[0] + 1, high[1] - low[1] + 1]
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
/// # Errors
/// If `labels` has another number of values, or if `width * height` exceeds `u32::MAX`.
pub(crate) fn runs_of_labels(labels: &[u16], width: u32, height: u32) -> Result<BTreeMap<u16, Rle>, RleError> {
    // 32 columns of u16 are one cache line of each row.
    const BLOCK: usize = 32;
    let size = [height, width];
    let pixels = pixels_of(size)?;
    if labels.len() != pixels as usize {
        return Err(RleError::WrongLength { size, found: labels.len() });
    }
    if pixels == 0 {
        return Ok(BTreeMap::new());
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
    Ok(runs.finish(size, pixels))
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
fn pixels_of(size: [u32; 2]) -> Result<u32, RleError> {
    size[0].checked_mul(size[1]).ok_or(RleError::TooLarge { size })
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

    fn mask_of(labels: &[u16], width: u32, height: u32, label: u16) -> Rle {
        Rle::from_fn(width, height, |x, y| labels[y * width as usize + x] == label).unwrap()
    }

    #[test]
    fn masks_survive_the_string_and_the_pixels() {
        for (width, height, labels) in images() {
            let mask = mask_of(&labels, width, height, labels[0]);
            assert_eq!(Rle::from_string([height, width], &mask.to_string()), Ok(mask.clone()));
            let pixels = mask.decode();
            assert!(pixels.iter().zip(&labels).all(|(&pixel, &label)| pixel == (label == labels[0])));
            assert_eq!(mask.area() as usize, pixels.iter().filter(|&&pixel| pixel).count());
            let at = |i: usize| [i % width as usize, i / width as usize];
            let ones: Vec<_> = (0..pixels.len()).filter(|&i| pixels[i]).map(at).collect();
            let [x, y] = [0, 1].map(|axis| ones.iter().map(|p| p[axis]).min().unwrap());
            let [right, bottom] = [0, 1].map(|axis| ones.iter().map(|p| p[axis]).max().unwrap() + 1);
            assert_eq!(mask.bbox().map(|side| side as usize), [x, y, right - x, bottom - y]);
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
        assert_eq!(runs_of_labels(&[1; 5], 2, 3), Err(RleError::WrongLength { size: [3, 2], found: 5 }));
        assert_eq!(runs_of_labels(&[], 0, 3), Ok(BTreeMap::new()));
        assert!(matches!(runs_of_labels(&[], u32::MAX, 2), Err(RleError::TooLarge { .. })));
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
            assert_eq!(Rle::from_string(size, text), Ok(mask));
        }
    }

    #[test]
    fn the_size_of_masks_has_its_limits() {
        let empty = Rle::from_fn(0, 5, |_, _| true).unwrap();
        assert_eq!((empty.counts(), empty.area(), empty.bbox()), (&[0][..], 0, [0; 4]));
        assert!(empty.decode().is_empty());
        assert_eq!(Rle::from_string([5, 0], &empty.to_string()), Ok(empty));
        assert_eq!(Rle::from_string([0, 0], ""), Rle::new([0, 0], vec![]));
        assert!(matches!(Rle::from_fn(1 << 16, 1 << 16, |_, _| true), Err(RleError::TooLarge { .. })));
        let full = Rle::new([u32::MAX, 1], vec![0, u32::MAX]).unwrap();
        assert_eq!((full.area(), full.bbox()), (u32::MAX, [0, 0, 1, u32::MAX]));
        assert_eq!(Rle::from_string([u32::MAX, 1], &full.to_string()), Ok(full));
        // The largest differences of both signs.
        for counts in [vec![0, u32::MAX, 0, 0], vec![0, 0, 0, u32::MAX]] {
            let mask = Rle::new([u32::MAX, 1], counts).unwrap();
            assert_eq!(Rle::from_string([u32::MAX, 1], &mask.to_string()), Ok(mask));
        }
    }

    #[test]
    fn runs_of_length_zero_are_legal() {
        let mask = Rle::new([4, 2], vec![1, 0, 2, 1, 0, 1, 3, 0]).unwrap();
        assert_eq!((mask.area(), mask.bbox()), (2, [0, 0, 2, 4]));
        assert_eq!(Rle::from_string([4, 2], &mask.to_string()), Ok(mask));
    }

    #[test]
    fn hostile_strings_are_errors() {
        let parse = |text: &str| Rle::from_string([3, 4], text);
        assert_eq!(parse(""), Err(RleError::Sum { size: [3, 4], found: 0 }));
        assert_eq!(parse(";"), Err(RleError::Sum { size: [3, 4], found: 11 }));
        assert_eq!(parse("5/"), Err(RleError::Byte { at: 1, byte: b'/' }));
        assert_eq!(parse("p"), Err(RleError::Byte { at: 0, byte: b'p' }));
        assert!(matches!(parse("5\u{e4}"), Err(RleError::Byte { at: 1, .. })));
        assert_eq!(parse("5P"), Err(RleError::Truncated));
        assert_eq!(parse("O"), Err(RleError::Count { run: 0 }));
        assert_eq!(parse("000O"), Err(RleError::Count { run: 3 }));
        assert_eq!(parse("oooooooo0"), Err(RleError::Count { run: 0 }));
        assert_eq!(parse(&"P".repeat(1000)), Err(RleError::Count { run: 0 }));
        assert_eq!(parse("ooooooo0"), Err(RleError::Count { run: 0 }));
        // 2^32 - 1 three times: the sum does not wrap.
        assert_eq!(parse("oooooo3oooooo3oooooo3"), Err(RleError::Sum { size: [3, 4], found: 3 * 0xffff_ffff }));
        // All short strings of bytes of interest, and random longer ones: no panic, and accepted strings are sound.
        let mut next = random(3);
        for _ in 0..20_000 {
            let text: String = (0..next() % 12).map(|_| char::from((46 + next() % 67) as u8)).collect();
            for size in [[3, 4], [1, 1], [0, 3]] {
                if let Ok(mask) = Rle::from_string(size, &text) {
                    assert_eq!(mask.decode().iter().filter(|&&pixel| pixel).count(), mask.area() as usize);
                    assert_eq!(Rle::from_string(size, &mask.to_string()), Ok(mask));
                }
            }
        }
    }
}
