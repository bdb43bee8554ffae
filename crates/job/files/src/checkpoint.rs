//! Checkpoint files: the exact sums of a film, a text that identifies the render, and the progress of its plan.
//! `docs/checkpoints.md` defines every byte. A file is written row by row, without a second film in memory. The reader
//! verifies every byte: the length follows from the head, every section has a checksum, and sums that no samples can
//! give are refused.

mod pixel;
mod size;

pub use pixel::{MAX_SAMPLES, PIXEL_BYTES};
pub use size::checkpoint_size;

use crate::atomic::write_atomically;
use crate::error::InputError;
use crate::input::{InputFiles, MAX_STREAMED, OpenFile, Role};
use dunkelfeld_film::{Film, MAX_PIXELS, MAX_SIDE, PixelSums, Plane};
use std::io::{self, BufReader, Read, Write};
use std::ops::Range;
use std::path::Path;
use twox_hash::XxHash3_64;

/// Version of the format.
pub const CHECKPOINT_VERSION: u32 = 9;
/// The first bytes: no text, and changed by programs that convert line ends, as in PNG.
const MAGIC: [u8; 8] = *b"\x89DFC\r\n\x1a\n";
/// Magic, version, width, height, length of the text, flags.
const HEAD: usize = 28;
const HAS_WEIGHTS: u32 = 1;
const HAS_TARGET: u32 = 2;
const HAS_OBJECTS: u32 = 4;
const HAS_MATERIALS: u32 = 8;
const ALL_FLAGS: u32 = HAS_WEIGHTS | HAS_TARGET | HAS_OBJECTS | HAS_MATERIALS;
/// The longest text \[bytes\]. The maps of a sensor take 16 bytes of it for each pixel.
const MAX_TEXT: u32 = 1 << 30;
/// Rows that share a checksum.
const BAND: u32 = 16;
const CHECKSUM: u64 = 8;

const HELP: &str = "use a file that `render --checkpoint` or `merge` wrote, or another name to begin anew";

/// The content of a checkpoint file.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// The identity and progress of the render: JSON, defined by the writer.
    pub text: String,
    /// Weights of the plan.
    pub weights: Option<Plane<f32>>,
    /// Target of the open round: samples per pixel, as totals since the first sample.
    pub target: Option<Plane<u32>>,
    /// Number of the object at the pixel's centre, defined by the writer.
    pub objects: Option<Plane<u32>>,
    /// Number of the material at the pixel's centre, defined by the writer.
    pub materials: Option<Plane<u32>>,
    /// The sums.
    pub film: Film,
}

/// All content but the sums.
#[derive(Clone, Copy, Debug)]
pub struct CheckpointHead<'a> {
    /// Width of the film \[pixels\].
    pub width: u32,
    /// Height of the film \[pixels\].
    pub height: u32,
    /// See [`Checkpoint::text`].
    pub text: &'a str,
    /// See [`Checkpoint::weights`].
    pub weights: Option<&'a Plane<f32>>,
    /// See [`Checkpoint::target`].
    pub target: Option<&'a Plane<u32>>,
    /// See [`Checkpoint::objects`].
    pub objects: Option<&'a Plane<u32>>,
    /// See [`Checkpoint::materials`].
    pub materials: Option<&'a Plane<u32>>,
}

/// Writes a checkpoint, completely or not at all. `rows` appends the sums of the pixels of some rows. It is called once
/// for each row, from the top, so that the film may be merged during the write.
///
/// # Errors
/// Those of the file system; sizes or a text beyond the limits of the format, planes or rows of another size.
pub fn write_checkpoint(
    path: &Path,
    head: &CheckpointHead<'_>,
    rows: &mut dyn FnMut(Range<u32>, &mut Vec<PixelSums>),
) -> io::Result<()> {
    let refuse = |problem: &str| Err(io::Error::new(io::ErrorKind::InvalidInput, problem.to_string()));
    let text_bytes = u32::try_from(head.text.len()).unwrap_or(u32::MAX);
    if !is_size(head.width, head.height) || text_bytes > MAX_TEXT {
        return refuse("the film or its description is beyond the limits of a checkpoint");
    }
    let size = (head.width, head.height);
    let integers = [head.target, head.objects, head.materials];
    if head.weights.is_some_and(|p| (p.width(), p.height()) != size)
        || integers.into_iter().flatten().any(|p| (p.width(), p.height()) != size)
    {
        return refuse("the planes of a checkpoint must have the size of its film");
    }
    write_atomically(path, |file| {
        let flags = u32::from(head.weights.is_some()) * HAS_WEIGHTS
            + u32::from(head.target.is_some()) * HAS_TARGET
            + u32::from(head.objects.is_some()) * HAS_OBJECTS
            + u32::from(head.materials.is_some()) * HAS_MATERIALS;
        let mut bytes = MAGIC.to_vec();
        for v in [CHECKPOINT_VERSION, head.width, head.height, text_bytes, flags] {
            bytes.extend(v.to_le_bytes());
        }
        bytes.extend(head.text.as_bytes());
        let mut section = 0;
        let mut put = |bytes: &mut Vec<u8>| -> io::Result<()> {
            file.write_all(bytes)?;
            file.write_all(&checksum(section, bytes).to_le_bytes())?;
            section += 1;
            bytes.clear();
            Ok(())
        };
        put(&mut bytes)?;
        if let Some(plane) = head.weights {
            plane.data().iter().for_each(|v| bytes.extend(v.to_le_bytes()));
            put(&mut bytes)?;
        }
        for plane in integers.into_iter().flatten() {
            plane.data().iter().for_each(|v| bytes.extend(v.to_le_bytes()));
            put(&mut bytes)?;
        }
        let mut sums = Vec::new();
        for band in bands(head.height) {
            sums.clear();
            let pixels = band.len() * head.width as usize;
            rows(band, &mut sums);
            if sums.len() != pixels {
                return Err(io::Error::new(io::ErrorKind::InvalidInput, "rows of another width than the film's"));
            }
            sums.iter().for_each(|s| pixel::encode(s, &mut bytes));
            put(&mut bytes)?;
        }
        Ok(())
    })
}

/// Reads a checkpoint.
///
/// # Errors
/// The file cannot be read, is not a checkpoint, is of another version, was cut short or changed.
pub fn read_checkpoint(path: &Path) -> Result<Checkpoint, InputError> {
    let fault = |place: &str, problem: String| InputError::new(path, place, problem, HELP);
    let file = InputFiles::new().open(path, Role::Checkpoint, MAX_STREAMED).map_err(|fault| fault.at(path))?;
    let length = file.length();
    let mut source = Source { file: BufReader::new(file), left: length, section: 0, path };

    let mut head = source.bytes("the head", HEAD as u64)?;
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    if head[..8] != MAGIC {
        return Err(fault("the head", "is not that of a checkpoint".into()));
    }
    let [version, width, height, text_bytes, flags] = [8, 12, 16, 20, 24].map(word);
    if version != CHECKPOINT_VERSION {
        let problem = format!("is of version {version} of the format; this program reads version {CHECKPOINT_VERSION}");
        return Err(fault("the head", problem));
    }
    if !is_size(width, height) || text_bytes > MAX_TEXT || flags > ALL_FLAGS {
        return Err(fault("the head", "holds numbers that no checkpoint has".into()));
    }
    let pixels = u64::from(width) * u64::from(height);
    let planes = u64::from(flags.count_ones());
    let sections = 1 + planes + bands(height).count() as u64;
    let rest = u64::from(text_bytes) + (4 * planes + PIXEL_BYTES as u64) * pixels + sections * CHECKSUM;
    if source.left != rest {
        let (has, should) = (length, rest + HEAD as u64);
        let word = if source.left < rest { "was cut short" } else { "has more than belongs to it" };
        return Err(fault("the file", format!("{word}: it has {has} bytes instead of {should}")));
    }

    head.extend(source.bytes("the text", u64::from(text_bytes))?);
    source.check("the head", &head)?;
    let text = String::from_utf8(head.split_off(HEAD)).map_err(|_| fault("the text", "is not UTF-8".into()))?;
    let misfit = || fault("a plane", "does not have the size of the film".into());
    let mut weights = None;
    if flags & HAS_WEIGHTS != 0 {
        let words = source.words("the weights", pixels)?;
        let plane = Plane::from_vec(width, height, words.into_iter().map(f32::from_bits).collect());
        weights = Some(plane.ok_or_else(misfit)?);
    }
    let mut integers = [None, None, None];
    let sections = [(HAS_TARGET, "the plan"), (HAS_OBJECTS, "the objects"), (HAS_MATERIALS, "the materials")];
    for (slot, (flag, place)) in integers.iter_mut().zip(sections) {
        if flags & flag != 0 {
            let words = source.words(place, pixels)?;
            if flag == HAS_TARGET && words.iter().any(|&n| n > MAX_SAMPLES) {
                return Err(fault(place, "requires more samples than a pixel can have".into()));
            }
            *slot = Some(Plane::from_vec(width, height, words).ok_or_else(misfit)?);
        }
    }
    let [target, objects, materials] = integers;
    let mut film = Film::new(width, height);
    let mut sums = Vec::new();
    for band in bands(height) {
        let place = format!("rows {} to {}", band.start, band.end - 1);
        let bytes = source.bytes(&place, band.len() as u64 * u64::from(width) * PIXEL_BYTES as u64)?;
        source.check(&place, &bytes)?;
        sums.clear();
        for pixel in bytes.chunks_exact(PIXEL_BYTES) {
            let impossible = || fault(&place, "holds sums that no samples add up to".into());
            sums.push(pixel::decode(pixel).ok_or_else(impossible)?);
        }
        film.add_rows(band.start, &sums).map_err(|e| {
            let help = "make its film smaller, or free some memory";
            InputError::new(path, &place, format!("cannot be held: {e}"), help)
        })?;
    }
    Ok(Checkpoint { text, weights, target, objects, materials, film })
}

fn is_size(width: u32, height: u32) -> bool {
    let side = 1..=MAX_SIDE;
    side.contains(&width) && side.contains(&height) && u64::from(width) * u64::from(height) <= MAX_PIXELS
}

fn bands(height: u32) -> impl Iterator<Item = Range<u32>> {
    (0..height).step_by(BAND as usize).map(move |y| y..(y + BAND).min(height))
}

/// The seed is the number of the section, so that exchanged sections are detected.
fn checksum(section: u64, bytes: &[u8]) -> u64 {
    XxHash3_64::oneshot_with_seed(section, bytes)
}

/// A file during reading.
struct Source<'a> {
    file: BufReader<OpenFile>,
    /// Remaining bytes of the file. No larger allocation is made.
    left: u64,
    section: u64,
    path: &'a Path,
}

impl Source<'_> {
    fn bytes(&mut self, place: &str, count: u64) -> Result<Vec<u8>, InputError> {
        let fault = |problem: String| InputError::new(self.path, place, problem, HELP);
        if count > self.left {
            return Err(fault("is not there: the file was cut short".into()));
        }
        let mut bytes = vec![0; count as usize];
        self.file.read_exact(&mut bytes).map_err(|e| fault(format!("cannot be read: {e}")))?;
        self.left -= count;
        Ok(bytes)
    }

    /// Compares with the checksum that follows.
    fn check(&mut self, place: &str, bytes: &[u8]) -> Result<(), InputError> {
        let stored = self.bytes(place, CHECKSUM)?;
        let right = checksum(self.section, bytes).to_le_bytes();
        self.section += 1;
        // A fuzzer cannot find checksums. Without the check it reaches the code behind it.
        if stored == right || cfg!(fuzzing) {
            return Ok(());
        }
        Err(InputError::new(self.path, place, "was damaged: its checksum is another", HELP))
    }

    fn words(&mut self, place: &str, count: u64) -> Result<Vec<u32>, InputError> {
        let bytes = self.bytes(place, 4 * count)?;
        self.check(place, &bytes)?;
        Ok(bytes.as_chunks::<4>().0.iter().map(|&b| u32::from_le_bytes(b)).collect())
    }
}
