//! Checkpoint files: a written file is read again with the same bits, and a cut or changed file is refused with a message.
//!
//! Replay: `cargo test -p dunkelfeld-files --test checkpoint NAME`.

use dunkelfeld_files::InputError;
use dunkelfeld_files::checkpoint::{
    CHECKPOINT_VERSION, Checkpoint, CheckpointHead, PIXEL_BYTES, read_checkpoint, write_checkpoint,
};
use dunkelfeld_film::{Accumulate, Film, PixelSums, Plane, Sample};
use dunkelfeld_radiometry::Rgb;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Two bands, the second of them incomplete.
const SIZE: (u32, u32) = (1, 18);

fn example() -> Checkpoint {
    let mut film = Film::new(SIZE.0, SIZE.1);
    for row in 0..SIZE.1 {
        let mut pixel = PixelSums::default();
        for index in 0..row {
            let radiance = Rgb::new(0.1 * index as f32, 1e-7, 3e9);
            pixel.add(index, &Sample { radiance, hit: index % 2 == 0, depth: 2.5, ..Sample::MISS });
        }
        film.add_rows(row, &[pixel]).expect("memory");
    }
    Checkpoint {
        text: "{\"seed\":7,\"of\":\"Gr\u{fc}n\"}".into(),
        weights: Some(Plane::from_fn(SIZE.0, SIZE.1, |x, y| 0.1 + (x * y) as f32)),
        target: Some(Plane::from_fn(SIZE.0, SIZE.1, |x, y| x + 100 * y)),
        objects: Some(Plane::from_fn(SIZE.0, SIZE.1, |_, y| y % 3)),
        materials: None,
        film,
    }
}

/// A film without a word.
fn bare(film: Film) -> Checkpoint {
    let text = String::new();
    Checkpoint { text, weights: None, target: None, objects: None, materials: None, film }
}

fn write(path: &Path, checkpoint: &Checkpoint) {
    let head = CheckpointHead {
        width: checkpoint.film.width(),
        height: checkpoint.film.height(),
        text: &checkpoint.text,
        weights: checkpoint.weights.as_ref(),
        target: checkpoint.target.as_ref(),
        objects: checkpoint.objects.as_ref(),
        materials: checkpoint.materials.as_ref(),
    };
    let rows = |rows: std::ops::Range<u32>, out: &mut Vec<PixelSums>| checkpoint.film.read_rows(rows, out);
    write_checkpoint(path, &head, &mut { rows }).expect("writable");
}

/// A folder with one checkpoint, and its bytes.
struct Bench {
    _folder: TempDir,
    path: PathBuf,
    bytes: Vec<u8>,
}

impl Bench {
    fn new() -> Self {
        let folder = TempDir::new().expect("a temporary folder");
        let path = folder.path().join("a.film");
        write(&path, &example());
        let bytes = fs::read(&path).expect("readable");
        Self { _folder: folder, path, bytes }
    }

    fn read(&self, bytes: &[u8]) -> Result<Checkpoint, InputError> {
        fs::write(&self.path, bytes).expect("writable");
        read_checkpoint(&self.path)
    }

    #[track_caller]
    fn refused(&self, bytes: &[u8], what: &str) -> InputError {
        let error = self.read(bytes).map(|_| ()).expect_err(what);
        assert!(error.file == self.path && !error.problem.is_empty() && !error.help.is_empty(), "{what}: {error}");
        error
    }
}

/// XXH3 of a section, appended where it belongs: a file as a malicious writer would make it.
fn seal(bytes: &mut [u8], section: u64, from: usize, to: usize) {
    let sum = twox_hash::XxHash3_64::oneshot_with_seed(section, &bytes[from..to]);
    bytes[to..to + 8].copy_from_slice(&sum.to_le_bytes());
}

#[test]
fn a_checkpoint_is_read_to_the_last_bit() {
    let folder = TempDir::new().expect("a temporary folder");
    let path = folder.path().join("a.film");
    let whole = example();
    for planes in 0..16 {
        let some = Checkpoint {
            weights: whole.weights.clone().filter(|_| planes & 1 != 0),
            target: whole.target.clone().filter(|_| planes & 2 != 0),
            objects: whole.objects.clone().filter(|_| planes & 4 != 0),
            materials: whole.objects.clone().filter(|_| planes & 8 != 0).map(|p| p.map(|v| u32::MAX - v)),
            ..whole.clone()
        };
        write(&path, &some);
        assert_eq!(read_checkpoint(&path).expect("readable"), some);
    }
    let tiny = bare(Film::new(1, 1));
    write(&path, &tiny);
    assert_eq!(read_checkpoint(&path).expect("readable"), tiny);
}

#[test]
fn the_length_of_a_file_follows_from_its_head() {
    let bench = Bench::new();
    let pixels = (SIZE.0 * SIZE.1) as usize;
    // Head and text, three planes, two bands of sums; each with a checksum.
    let expected = 28 + example().text.len() + 3 * 4 * pixels + PIXEL_BYTES * pixels + 6 * 8;
    assert_eq!(bench.bytes.len(), expected);
}

#[test]
#[ignore = "long: .ci/run runs it"]
fn truncated_and_extended_files_are_refused_at_every_length() {
    let bench = Bench::new();
    for length in (0..bench.bytes.len()).rev() {
        let error = bench.refused(&bench.bytes[..length], &format!("{length} bytes"));
        assert!(error.problem.contains("cut short"), "{length} bytes: {error}");
    }
    let error = bench.refused(&[&bench.bytes[..], b"x"].concat(), "one byte more");
    assert!(error.problem.contains("more than belongs"), "{error}");
    assert_eq!(bench.read(&bench.bytes).expect("the whole file"), example());
}

#[test]
#[ignore = "long: .ci/run runs it"]
fn every_changed_bit_is_noticed() {
    let bench = Bench::new();
    let mut bytes = bench.bytes.clone();
    // Every bit of the head, the text and the planes; of the sums each byte has one of its bits flipped.
    let early = bytes.len() - PIXEL_BYTES * (SIZE.0 * SIZE.1) as usize;
    for at in 0..bytes.len() {
        let bits = if at < early { 0..8 } else { at % 8..at % 8 + 1 };
        for bit in bits {
            bytes[at] ^= 1 << bit;
            bench.refused(&bytes, &format!("bit {bit} of byte {at}"));
            bytes[at] ^= 1 << bit;
        }
    }
}

#[test]
fn other_files_and_other_versions_are_distinguished() {
    let bench = Bench::new();
    assert!(bench.refused(&b"PNG".repeat(100), "another file").problem.contains("not that of a checkpoint"));
    let mut later = bench.bytes.clone();
    later[8..12].copy_from_slice(&(CHECKPOINT_VERSION + 1).to_le_bytes());
    let error = bench.refused(&later, "a later version");
    let versions = [CHECKPOINT_VERSION, CHECKPOINT_VERSION + 1].map(|v| format!("version {v}"));
    assert!(versions.iter().all(|v| error.problem.contains(v)), "{error}");
    let missing = read_checkpoint(&bench.path.with_file_name("nowhere.film")).expect_err("there is none");
    assert!(missing.to_string().contains("nowhere.film"), "{missing}");
    assert!(read_checkpoint(bench.path.parent().expect("a folder")).is_err(), "a folder is no file");
}

#[test]
fn a_head_that_promises_too_much_costs_no_memory() {
    let bench = Bench::new();
    for (at, value) in
        [(12, u32::MAX), (12, 32_768), (16, 0), (16, 1 << 31), (20, u32::MAX), (20, 1 << 24), (24, 32), (24, 15)]
    {
        let mut bytes = bench.bytes.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let text = 28 + example().text.len();
        seal(&mut bytes, 0, 0, text);
        bench.refused(&bytes, &format!("{value} at byte {at}"));
    }
}

#[test]
fn contents_that_cannot_be_are_refused_even_with_right_checksums() {
    let bench = Bench::new();
    let text = example().text.len();
    let plane = 4 * (SIZE.0 * SIZE.1) as usize;
    let weights = 28 + text + 8;
    let target = weights + plane + 8;
    let sums = target + 2 * (plane + 8);

    let mut bytes = bench.bytes.clone();
    bytes[28] = 0xff;
    seal(&mut bytes, 0, 0, 28 + text);
    assert!(bench.refused(&bytes, "a text in no encoding").problem.contains("UTF-8"));

    let mut bytes = bench.bytes.clone();
    bytes[target + 3] = 0x80;
    seal(&mut bytes, 2, target, target + plane);
    assert!(bench.refused(&bytes, "an endless plan").problem.contains("more samples than a pixel can have"));

    let mut bytes = bench.bytes.clone();
    // The last byte of the first pixel's fourth count.
    bytes[sums + 192 + 15] = 0xff;
    let band = PIXEL_BYTES * (SIZE.0 * 16) as usize;
    seal(&mut bytes, 4, sums, sums + band);
    assert!(bench.refused(&bytes, "endless samples").problem.contains("no samples add up to"));

    // Exchanged bands are detected, although each is complete: take the first for the second of the same length.
    let tall = |height: u32| bare(Film::new(2, height));
    write(&bench.path, &tall(32));
    let mut bytes = fs::read(&bench.path).expect("readable");
    let band = PIXEL_BYTES * 32 + 8;
    let first = 28 + 8;
    let (left, right) = bytes[first..].split_at_mut(band);
    left.swap_with_slice(right);
    assert!(bench.refused(&bytes, "bands in another order").problem.contains("checksum"));
}

#[test]
fn values_beyond_the_format_are_not_written_and_leave_the_old_file() {
    let bench = Bench::new();
    let weights = Plane::new(2, 2, 1.0);
    let objects = Plane::new(2, 2, 1);
    let head =
        CheckpointHead { width: 3, height: 2, text: "", weights: None, target: None, objects: None, materials: None };
    let cases = [
        CheckpointHead { width: 0, ..head },
        CheckpointHead { height: 40_000, ..head },
        CheckpointHead { width: 32_768, height: 32_768, ..head },
        CheckpointHead { weights: Some(&weights), ..head },
        CheckpointHead { objects: Some(&objects), ..head },
        head, // The rows below are too short.
    ];
    for head in cases {
        let error = write_checkpoint(&bench.path, &head, &mut |_, out| out.push(PixelSums::default()));
        assert_eq!(error.expect_err("refused").kind(), std::io::ErrorKind::InvalidInput, "{head:?}");
        assert_eq!(fs::read(&bench.path).expect("readable"), bench.bytes);
    }
}
