//! The descriptor of an EMVA 1288 data set: its frames, with their exposure times and photons per pixel. The format is
//! that of the standard's reference implementation (PyPI `emva1288`).
//!
//! ```text
//! v 4.0                     # release of the standard
//! n 12 640 480              # bits per value, width, height
//! b 2000000 1250.5          # exposure time [ns], photons per pixel; then its frames
//! i images/b_001_0.png      # relative to the descriptor
//! i images/b_001_1.png
//! d 2000000                 # the same without light
//! i images/d_001_0.png
//! i images/d_001_1.png
//! ```
//!
//! Two frames in a block are a pair, more are a stack.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::error::{InputError, SourceSpan};
use crate::input::{InputFiles, Role};

/// Limit of a descriptor, which is a short text \[bytes\].
const MAX_BYTES: u64 = 64 << 20;
/// Range of photons per pixel in a level of light: both ends are far beyond any pixel, and far from an overflow of
/// squares.
const PHOTONS: std::ops::RangeInclusive<f64> = 1e-6..=1e12;
/// The longest exposure time \[ns\].
const MAX_NS: f64 = 1e18;

/// A data set.
#[derive(Clone, Debug, PartialEq)]
pub struct EmvaDescriptor {
    /// Release of the standard, as in `4.0`.
    pub version: Option<String>,
    /// Bits per value, width and height.
    pub format: Option<FrameFormat>,
    /// The frames.
    pub blocks: Vec<FrameBlock>,
}

/// Bits and size of the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameFormat {
    /// Bits per value, 1 to 16.
    pub bits: u32,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
}

/// Frames with the same light.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameBlock {
    /// Exposure time \[ns\].
    pub exposure_ns: f64,
    /// Photons per pixel on average; zero in the dark.
    pub photons: f64,
    /// The frames, relative to the descriptor or absolute.
    pub frames: Vec<PathBuf>,
    /// Line of the block in the file, from 1; 0 if it was not read from one.
    pub line: usize,
}

/// Reads a descriptor.
///
/// It is as tolerant as the reference: line ends of any system, empty lines and comments (`#`), backslashes in paths,
/// commas in numbers, blocks in any order, unknown versions. A line with an unknown word and the frames below it are left
/// out with a warning. In addition, names of files may contain spaces, and `n` may be missing.
///
/// # Errors
/// The file cannot be read, or a line is invalid. The error has the line.
pub fn read_descriptor(path: &Path) -> Result<(EmvaDescriptor, Vec<String>), InputError> {
    let bytes = InputFiles::new().read(path, Role::Descriptor, MAX_BYTES).map_err(|fault| fault.at(path))?;
    // Comments may be in any encoding. Only ASCII matters.
    let text = String::from_utf8_lossy(&bytes).trim_start_matches('\u{feff}').replace("\r\n", "\n").replace('\r', "\n");
    parse(path, &text)
}

/// The text of a descriptor. Paths are written with forward slashes.
pub fn write_descriptor(descriptor: &EmvaDescriptor) -> String {
    let mut text = String::new();
    if let Some(version) = &descriptor.version {
        let _ = writeln!(text, "v {version}");
    }
    if let Some(FrameFormat { bits, width, height }) = descriptor.format {
        let _ = writeln!(text, "n {bits} {width} {height}");
    }
    for block in &descriptor.blocks {
        let _ = match block.photons > 0.0 {
            true => writeln!(text, "b {} {}", block.exposure_ns, block.photons),
            false => writeln!(text, "d {}", block.exposure_ns),
        };
        for frame in &block.frames {
            let _ = writeln!(text, "i {}", frame.to_string_lossy().replace('\\', "/"));
        }
    }
    text
}

fn parse(path: &Path, text: &str) -> Result<(EmvaDescriptor, Vec<String>), InputError> {
    let mut descriptor = EmvaDescriptor { version: None, format: None, blocks: Vec::new() };
    let mut warnings = Vec::new();
    // The last line that is no frame, which the frames below belong to.
    let mut head = "";
    let mut start = 0;
    for (index, whole) in text.split('\n').enumerate() {
        let line = whole.trim();
        let begin = start + (whole.len() - whole.trim_start().len());
        start += whole.len() + 1;
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let error = |problem: String, help: &str| InputError {
            source_span: Some(Box::new(SourceSpan { text: text.to_owned(), range: begin..begin + line.len() })),
            ..InputError::new(path, format!("line {}", index + 1), problem, help)
        };
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let words: Vec<&str> = rest.split_whitespace().collect();
        head = if key == "i" { head } else { key };
        match key {
            "v" if rest.trim().is_empty() => {
                return Err(error("the release is missing".into(), "write `v RELEASE`, as in `v 4.0`"));
            }
            "v" => descriptor.version = Some(rest.trim().to_owned()),
            "n" if descriptor.format.is_some() => {
                return Err(error("the format is given twice".into(), "keep one line `n BITS WIDTH HEIGHT`"));
            }
            "n" => descriptor.format = Some(format_of(&words).map_err(|(problem, help)| error(problem, help))?),
            "b" | "d" => {
                let (exposure_ns, photons) = block_of(key, &words).map_err(|(problem, help)| error(problem, help))?;
                descriptor.blocks.push(FrameBlock { exposure_ns, photons, frames: Vec::new(), line: index + 1 });
            }
            "i" => {
                let name = rest.trim();
                if name.is_empty() {
                    return Err(error("the frame has no name".into(), "write `i PATH`, relative to the descriptor"));
                }
                match (head, descriptor.blocks.last_mut()) {
                    ("b" | "d", Some(block)) => block.frames.push(PathBuf::from(name.replace('\\', "/"))),
                    ("" | "v" | "n", _) => {
                        let help = "write a line `b ...` or `d ...` before it";
                        return Err(error("the frame belongs to no block".into(), help));
                    }
                    // Those of an unknown word, which has its warning.
                    _ => {}
                }
            }
            other if words.is_empty() => {
                // The reference refuses single words, and warns of other unknown lines.
                return Err(error(
                    format!("`{other}` alone is no line of a descriptor"),
                    "write lines `v`, `n`, `b`, `d` and `i` with their values, and comments behind `#`",
                ));
            }
            other => warnings.push(format!(
                "{}: line {}: `{other}` is unknown: the line and the frames below it were left out",
                path.display(),
                index + 1
            )),
        }
    }
    check_blocks(path, &descriptor.blocks)?;
    Ok((descriptor, warnings))
}

/// The format of frames of a line `n BITS WIDTH HEIGHT`, or the problem and the help.
fn format_of(words: &[&str]) -> Result<FrameFormat, (String, &'static str)> {
    let numbers: Vec<u32> = words.iter().filter_map(|w| w.parse().ok()).collect();
    let (&[bits, width, height], 3) = (numbers.as_slice(), words.len()) else {
        return Err(("this is no format of frames".into(), "write `n BITS WIDTH HEIGHT`, as in `n 12 640 480`"));
    };
    if !(1..=16).contains(&bits) || width == 0 || height == 0 {
        return Err(("the format is out of range".into(), "write 1 to 16 bits, and a size of at least one pixel"));
    }
    Ok(FrameFormat { bits, width, height })
}

/// Exposure time \[ns\] and photons per pixel of a line `b` or `d`, or the problem and the help.
fn block_of(key: &str, words: &[&str]) -> Result<(f64, f64), (String, &'static str)> {
    let expected = if key == "b" { 2 } else { 1 };
    // Some systems write decimals with a comma.
    let number = |w: &&str| w.replace(',', ".").parse::<f64>().ok().filter(|v| v.is_finite() && *v >= 0.0);
    let numbers: Vec<f64> = words.iter().filter_map(number).collect();
    if numbers.len() != expected || words.len() != expected {
        let help = match key {
            "b" => "write `b EXPOSURE_NS PHOTONS`, as in `b 2000000 1250.5`",
            _ => "write `d EXPOSURE_NS`, as in `d 2000000`",
        };
        return Err(("this is no block of frames".into(), help));
    }
    let (exposure_ns, photons) = (numbers[0], numbers.get(1).copied().unwrap_or(0.0));
    if photons != 0.0 && !PHOTONS.contains(&photons) {
        let help = "write 0 or 1e-6 to 1e12 photons, the mean number that a pixel receives in the exposure time";
        return Err((format!("{photons:e} photons per pixel are out of range"), help));
    }
    if exposure_ns > MAX_NS {
        let help = "write the time in nanoseconds, 1e18 at most";
        return Err((format!("an exposure time of {exposure_ns:e} ns is out of range"), help));
    }
    Ok((exposure_ns, photons))
}

/// Blocks have frames, and none is there twice.
fn check_blocks(path: &Path, blocks: &[FrameBlock]) -> Result<(), InputError> {
    let fail =
        |line: usize, problem: String, help: &str| Err(InputError::new(path, format!("line {line}"), problem, help));
    let mut seen: Vec<(f64, f64, bool, usize)> = Vec::new();
    for block in blocks {
        if block.frames.len() < 2 {
            let problem = format!("the block has {} frame(s)", block.frames.len());
            return fail(block.line, problem, "list two frames for a level, 16 or more for a stack");
        }
        let key = (block.exposure_ns, block.photons, block.frames.len() > 2);
        if let Some(first) = seen.iter().find(|s| (s.0, s.1, s.2) == key) {
            let problem = format!("the block has the time and the light of the one in line {}", first.3);
            return fail(block.line, problem, "keep one of them");
        }
        seen.push((key.0, key.1, key.2, block.line));
    }
    if blocks.is_empty() {
        return fail(1, "there are no frames in it".into(), "see the format of descriptors in docs/emva.md");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &[u8]) -> Result<(EmvaDescriptor, Vec<String>), InputError> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("set.txt");
        std::fs::write(&path, text).expect("written");
        read_descriptor(&path)
    }

    #[test]
    fn a_written_descriptor_is_read() {
        let block = |exposure_ns, photons, names: &[&str]| FrameBlock {
            exposure_ns,
            photons,
            frames: names.iter().map(PathBuf::from).collect(),
            line: 0,
        };
        let descriptor = EmvaDescriptor {
            version: Some("4.0".into()),
            format: Some(FrameFormat { bits: 12, width: 640, height: 480 }),
            blocks: vec![
                block(2e6, 1_250.123_456_789_012, &["images/a.png", "images/b.png"]),
                block(2e6, 0.0, &["images/c.png", "images/d.png", "images/e.png"]),
            ],
        };
        let (mut back, warnings) = read(write_descriptor(&descriptor).as_bytes()).expect("readable");
        back.blocks.iter_mut().for_each(|b| b.line = 0);
        assert_eq!((back, warnings), (descriptor, vec![]));
    }

    /// The style of the reference implementation's own example: a comment of the maker, release 3.0, backslashes,
    /// floating-point times, and other variants that its reader accepts.
    #[test]
    fn the_reference_s_tolerance_is_ours() {
        let text = "###\n# Copyright M\u{fc}ller\n#\nv 3.0\nn 12 640 480\nb 40000.0 120,5\ni images\\b_000_snap_001.tif\n\
                    i images\\b_000_snap_002.tif\n\n  d 40000.0 \n\ti images\\d_000_snap_001.tif\ni  images/d 2.tif\ndc 1\ni x.tif\ni y.tif\n";
        let (unix, warnings) = read(text.as_bytes()).expect("readable");
        assert_eq!(unix.version.as_deref(), Some("3.0"));
        assert_eq!(
            (unix.blocks[0].photons, unix.blocks[0].frames[1].clone()),
            (120.5, "images/b_000_snap_002.tif".into())
        );
        assert_eq!((unix.blocks[1].photons, unix.blocks[1].frames[1].clone()), (0.0, "images/d 2.tif".into()));
        assert!(warnings.len() == 1 && warnings[0].contains("line 13: `dc`"), "{warnings:?}");
        assert_eq!(
            unix.blocks.iter().map(|b| b.frames.len()).collect::<Vec<_>>(),
            [2, 2],
            "a frame of an unknown block"
        );
        for ends in ["\r", "\r\n"] {
            let other = format!("\u{feff}{}", text.replace('\n', ends));
            assert_eq!(read(other.as_bytes()).expect("readable").0, unix, "{ends:?}");
        }
        let latin: Vec<u8> = text.chars().map(|c| c as u8).collect();
        assert_eq!(read(&latin).expect("readable").0, unix);
    }

    proptest::proptest! {
        /// Lines of valid words in any order are read, or refused with a line that can be printed. The data that was
        /// read can be written and read again.
        #[test]
        fn any_lines_are_read_or_refused(lines in proptest::collection::vec("[vnbdix#] ?[0-9a-z.,\\\\ \u{e9}-]{0,12}", 0..12)) {
            match parse(Path::new("x"), &lines.join("\n")) {
                Ok((descriptor, _)) => {
                    let (mut again, warnings) = parse(Path::new("x"), &write_descriptor(&descriptor)).expect("readable");
                    again.blocks.iter_mut().zip(&descriptor.blocks).for_each(|(a, b)| a.line = b.line);
                    assert!(warnings.is_empty() && again == descriptor, "{descriptor:?} {again:?}");
                }
                Err(e) => assert!(!e.caret().is_empty() || e.place.starts_with("line ")),
            }
        }
    }

    #[test]
    fn errors_name_the_line_and_help() {
        let frames = "i a.png\ni b.png\n";
        for (text, place, problem) in [
            (String::new(), "line 1", "no frames"),
            ("n 12 640\n".into(), "line 1", "no format"),
            ("n 17 640 480\n".into(), "line 1", "out of range"),
            ("n 12 6 4\nn 12 6 4\n".into(), "line 2", "twice"),
            ("\nb 100\n".into(), "line 2", "no block"),
            ("d ten\n".into(), "line 1", "no block"),
            ("b 1 -5\n".into(), "line 1", "no block"),
            ("d nan\n".into(), "line 1", "no block"),
            (format!("v\n{frames}"), "line 1", "release is missing"),
            (format!("hello\nd 1\n{frames}"), "line 1", "`hello` alone"),
            ("v 4.0\nb 1 1e308\n".into(), "line 2", "out of range"),
            ("b 1 1e-300\n".into(), "line 1", "out of range"),
            ("d 1e300\n".into(), "line 1", "out of range"),
            ("i a.png\n".into(), "line 1", "belongs to no block"),
            (format!("d 1\n{frames}v 4.0\n{frames}"), "line 5", "belongs to no block"),
            ("d 1\ni \n".into(), "line 2", "no name"),
            ("d 1\ni a.png\n".into(), "line 1", "1 frame(s)"),
            (format!("d 1\n{frames}b 1 0\n{frames}"), "line 4", "of the one in line 1"),
        ] {
            let e = read(text.as_bytes()).expect_err(&text);
            assert_eq!(e.place, place, "{text:?}: {e}");
            assert!(e.problem.contains(problem) && !e.help.is_empty(), "{text:?}: {e}");
        }
        let e = read(b"v 4.0\nn 12 640\n").expect_err("a short line");
        assert!(e.caret().contains("2 | n 12 640\n  | ^^^^^^^^"), "{}", e.caret());
    }
}
