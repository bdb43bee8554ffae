//! Tests every writer of files on a disk that fails, operation by operation. The target is the complete old file
//! or the complete new one. No other file remains. The error contains file, cause and help.

use dunkelfeld_files::faults::{Fault, Operation, with_fault};
use dunkelfeld_film::{Accumulate, PixelSums, Plane, Sample};
use dunkelfeld_io::checkpoint::{CheckpointHead, write_checkpoint};
use dunkelfeld_io::emva_descriptor::{EmvaDescriptor, FrameBlock, write_descriptor};
use dunkelfeld_io::exr::{Channel, ExrLayers, write_exr};
use dunkelfeld_io::new_folder::NewFolder;
use dunkelfeld_io::picture::Picture;
use dunkelfeld_io::png::write_png;
use dunkelfeld_io::results::ResultsFolder;
use dunkelfeld_io::tiff::write_tiff;
use dunkelfeld_io::{InputError, atomic};
use dunkelfeld_radiometry::Rgb;
use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

/// All operations except locks.
const OPERATIONS: [Operation; 5] =
    [Operation::Create, Operation::Write, Operation::Seek, Operation::Sync, Operation::Rename];
const EINTR: i32 = 4;
const EIO: i32 = 5;
const EXDEV: i32 = 18;
const EFBIG: i32 = 27;
const ENOSPC: i32 = 28;
const EROFS: i32 = 30;
const ENOLCK: i32 = 37;

/// A fault, the operations where it may occur, and the text of its error; no text if the write must succeed.
type Case = (Fault, &'static [Operation], Option<&'static str>);
/// The first one refuses locks. Single files are written without locks, folders are not.
const CASES: [Case; 9] = [
    (Fault::EverAfter(ENOLCK), &[Operation::Lock], None),
    (Fault::Once(EINTR), &OPERATIONS, None),
    (Fault::Short, &[Operation::Write], None),
    (Fault::EverAfter(ENOSPC), &[Operation::Create, Operation::Write, Operation::Sync], Some("free some space")),
    (Fault::EverAfter(EFBIG), &[Operation::Write], Some("limit")),
    (Fault::EverAfter(EROFS), &[Operation::Create, Operation::Rename], Some("no permission to write")),
    (Fault::Once(EXDEV), &[Operation::Rename], Some("mount point")),
    (Fault::Once(EIO), &OPERATIONS, Some("os error 5")),
    (Fault::EverAfter(EIO), &[Operation::Sync], Some("check the disk")),
];

type Writer = fn(&Path, u32) -> io::Result<()>;

/// All writers of a single file. Their contents depend on a number.
const WRITERS: [(&str, Writer); 10] = [
    ("a.png", |path, n| write_png(path, Picture::Gray8(&values(n).map(|&v| v as u8)), &[("Software", "x")])),
    ("colour.png", |path, n| write_png(path, Picture::Rgb8(&values(n).map(|&v| [v as u8, 1, 2])), &[])),
    ("a16.png", |path, n| write_png(path, Picture::Gray16(&values(n).map(|&v| v as u16)), &[])),
    ("a.tif", |path, n| write_tiff(path, Picture::Gray16(&values(n).map(|&v| v as u16)), Some("words"))),
    ("a.exr", |path, n| {
        let channels = vec![
            ("R".into(), Channel::F32(values(n).map(|&v| v as f32).into_vec())),
            ("spp.Y".into(), Channel::U32(values(n).into_vec())),
        ];
        write_exr(path, ExrLayers { width: SIDE, height: SIDE, channels, attributes: "{}".into(), frame: None })
    }),
    ("plan.exr", |path, n| {
        let channels = vec![("spp.Y".into(), Channel::U32(values(n).into_vec()))];
        write_exr(path, ExrLayers { width: SIDE, height: SIDE, channels, attributes: String::new(), frame: None })
    }),
    ("a.film", |path, n| {
        let mut rows = |rows: std::ops::Range<u32>, out: &mut Vec<PixelSums>| {
            for i in 0..rows.len() as u32 * SIDE {
                let mut pixel = PixelSums::default();
                pixel.add(0, &Sample { radiance: Rgb::splat((i + n) as f32), ..Sample::MISS });
                out.push(pixel);
            }
        };
        let plane = values(n);
        let head = CheckpointHead {
            width: SIDE,
            height: SIDE,
            text: "{}",
            weights: None,
            target: Some(&plane),
            objects: Some(&plane),
            materials: None,
        };
        write_checkpoint(path, &head, &mut rows)
    }),
    ("emva.txt", |path, n| {
        let block = FrameBlock { exposure_ns: 1.0, photons: f64::from(n), frames: vec!["a.png".into(); 300], line: 0 };
        text(path, &write_descriptor(&EmvaDescriptor { version: None, format: None, blocks: vec![block; 4] }))
    }),
    // Statistics, reports, tables, charts.
    ("a.json", |path, n| text(path, &format!("{{\"seed\": {n}, \"long\": \"{}\"}}", "x".repeat(20_000)))),
    ("report.html", |path, n| text(path, &format!("<p>{n}</p>"))),
];

const SIDE: u32 = 20;

fn values(n: u32) -> Plane<u32> {
    Plane::from_fn(SIDE, SIDE, |x, y| (x * 7 + y * 31 + n).wrapping_mul(0x9e37_79b9) >> 20)
}

fn text(path: &Path, text: &str) -> io::Result<()> {
    atomic::write_atomically(path, |w| w.write_all(text.as_bytes()))
}

/// A folder in memory, if there is one: many files are synced.
fn home() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a temporary folder")
}

/// All files of a folder, by their paths in it.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).expect("there") {
        let path = entry.expect("readable").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        if path.is_dir() {
            all.extend(contents(&path).into_iter().map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
            all.insert(name, Vec::new());
        } else {
            all.insert(name, fs::read(&path).expect("readable"));
        }
    }
    all
}

/// Writes `old` into an empty folder, and `new` over it with each fault at each operation until no operation is left.
/// Compares the result with both. Returns the number of faults.
fn try_all(
    name: &str,
    names_file: &str,
    old: impl Fn(&Path),
    new: impl Fn(&Path) -> Result<(), String>,
    cases: &[Case],
) -> usize {
    let home = home();
    let fresh = |work: &dyn Fn(&Path)| {
        fs::remove_dir_all(home.path()).expect("removable");
        fs::create_dir(home.path()).expect("free");
        work(home.path());
        contents(home.path())
    };
    let before = fresh(&old);
    let after = fresh(&|folder| {
        old(folder);
        new(folder).expect("nothing fails");
    });
    assert_ne!(before, after, "{name}: the contents differ");
    let mut faults = 0;
    for &(fault, kinds, words) in cases {
        for at in 0.. {
            assert!(at < 1000, "{name}: the fault never ends");
            fresh(&old);
            let (result, met) = with_fault(fault, kinds, at, || new(home.path()));
            let there = contents(home.path());
            let what = format!("{name}, {fault:?} of {kinds:?} number {at}, {met:?}: {result:?}");
            let Some(met) = met else {
                assert!(result.is_ok() && there == after, "{what}: no fault");
                break;
            };
            faults += 1;
            match (result, words) {
                (Ok(()), None) => assert!(there == after, "{what}: the new one"),
                (Err(message), Some(words)) => {
                    // Only if the sync of the name fails, the new file is there.
                    let is_new = met == Operation::Sync && there == after;
                    assert!(there == before || is_new, "{what}: {:?}", there.keys());
                    assert!(message.contains(names_file), "{what}: names no file");
                    assert!(message.contains(words), "{what}: does not contain \"{words}\"");
                }
                (Ok(()), Some(_)) => panic!("{what}: goes unnoticed"),
                (Err(_), None) => panic!("{what}: does no harm"),
            }
            let partial: Vec<_> = there.keys().filter(|n| n.contains(".partial") || n.contains(".lock")).collect();
            assert!(partial.is_empty(), "{what}: leaves {partial:?}");
        }
    }
    faults
}

#[test]
fn every_writer_leaves_the_old_file_or_the_new_one_whatever_fails() {
    let faults: usize = WRITERS
        .iter()
        .map(|(name, write)| {
            let old = |folder: &Path| write(&folder.join(name), 1).expect("nothing fails");
            let new = |folder: &Path| write(&folder.join(name), 2).map_err(|e| e.to_string());
            let replaced = try_all(name, name, old, new, &CASES);
            let made = try_all(name, name, |_| {}, new, &CASES);
            assert!(replaced >= 20 && made >= 20, "{name}: {replaced} and {made} faults");
            replaced + made
        })
        .sum();
    println!("{faults} faults of single files");
    assert!(faults > 500, "{faults}");
}

#[test]
fn a_new_folder_is_there_whole_or_not_at_all_whatever_fails() {
    let fill = |folder: &Path| -> Result<(), String> {
        let place = folder.join("set");
        let named = |e: io::Error| format!("set: {e}");
        let begun = NewFolder::start(&place).map_err(|e: InputError| e.to_string())?;
        for i in 0..2 {
            let image = begun.file(&format!("images/{i}.png")).map_err(named)?;
            write_png(&image, Picture::Gray8(&values(i).map(|&v| v as u8)), &[]).map_err(named)?;
        }
        begun.write_text("emva.txt", "v 4.0").map_err(named)?;
        begun.finish().map_err(named)
    };
    let nothing = |_: &Path| {};
    let empty = |folder: &Path| fs::create_dir(folder.join("set")).expect("free");
    let faults = [
        try_all("a new folder", "set", nothing, fill, &CASES[1..]),
        try_all("an empty folder", "set", empty, fill, &CASES[1..]),
    ];
    println!("{faults:?} faults of new folders");
    assert!(faults.iter().all(|&n| n > 30), "{faults:?}");
}

#[test]
fn a_folder_of_results_has_whole_files_only_whatever_fails() {
    let grow = |folder: &Path| -> Result<(), String> {
        let results = ResultsFolder::open(&folder.join("units")).map_err(|e| e.to_string())?;
        let channels = vec![("R".into(), Channel::F32(vec![0.5; 4]))];
        let layers = ExrLayers { width: 2, height: 2, channels, attributes: String::new(), frame: None };
        write_exr(&results.file("1.exr"), layers).map_err(|e| e.to_string())?;
        results.write_text("1.json", "{\"seed\": 1}").map_err(|e| e.to_string())
    };
    let whole = home();
    grow(whole.path()).expect("nothing fails");
    let whole = contents(whole.path());
    let mut faults = 0;
    for (fault, kinds, _) in CASES {
        for at in 0.. {
            let home = home();
            let (result, met) = with_fault(fault, kinds, at, || grow(home.path()));
            let there = contents(home.path());
            assert!(there.iter().all(|(name, bytes)| whole.get(name) == Some(bytes)), "{fault:?} {at}: {there:?}");
            // The next run repeats the lost work.
            grow(home.path()).expect("nothing fails");
            assert_eq!(contents(home.path()), whole);
            if met.is_none() {
                assert!(result.is_ok());
                break;
            }
            faults += 1;
        }
    }
    println!("{faults} faults of a folder of results");
    assert!(faults > 30, "{faults}");
}
