//! IES profiles (ANSI/IES LM-63, editions 1986 to 2019): the measured intensity of a luminaire by direction.
//!
//! Type C photometry is read: vertical angles from the nadir, horizontal ones around it. Files that rely on symmetry
//! are expanded. Candela become W/sr by the multiplier, the ballast factor and [`LUMENS_PER_WATT`]. The data after
//! `TILT=` describe the ageing of a lamp in a tilted luminaire. No luminaire is tilted here, so they are skipped.

use crate::error::{ImportWarning, InputError, SourceSpan};
use crate::import::mesh_file::without_mark;
use crate::import::options::LUMENS_PER_WATT;
use crate::import::warnings::Warnings;
use crate::input::{InputFiles, Role};
use dunkelfeld_scene::LightProfile;
use std::path::{Path, PathBuf};

/// Larger files are refused. A measurement every degree in both angles has half of a megabyte.
const LARGEST: u64 = 16 << 20;

/// Reads an IES file from any folder: the path comes from the user, not from a scene file. The profile has the name of
/// the file.
///
/// # Errors
/// If the file cannot be read, or is no IES file of type C; with line and caret.
pub fn load_ies(path: &Path) -> Result<(LightProfile, Vec<ImportWarning>), InputError> {
    let bytes = InputFiles::new().read(path, Role::LightProfile, LARGEST).map_err(|fault| fault.at(path))?;
    parse_ies(path, &bytes)
}

/// Reads an IES file that is in memory. `path` appears in messages, and its last part is the profile's name.
///
/// # Errors
/// As [`load_ies`].
pub fn parse_ies(path: &Path, bytes: &[u8]) -> Result<(LightProfile, Vec<ImportWarning>), InputError> {
    let mut warnings = Warnings::new(path);
    if bytes.len() as u64 > LARGEST {
        let problem = format!("it has {} bytes, more than 16 MiB", bytes.len());
        return Err(InputError::of_file(path, problem, "check that this is the right file"));
    }
    // Keywords may be in any encoding. Only ASCII is used.
    let text = String::from_utf8_lossy(without_mark(bytes, path)?);
    let text = if text.contains('\n') { text } else { text.replace('\r', "\n").into() };
    let mut file = Reader { path: path.to_path_buf(), text: &text, at: 0, last: 0..0 };
    let edition = file.skip_to_tilt(&mut warnings)?;
    let profile = file.profile(edition, &mut warnings)?;
    Ok((profile, warnings.finish()))
}

/// The meaning of the numbers, from the first line.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Edition {
    /// Before 1995: the second number after the ballast factor is a factor too.
    Early,
    /// From 1995 on it is reserved, or contains the origin of the file.
    Late,
}

/// Reads number after number, with their positions.
struct Reader<'a> {
    path: PathBuf,
    text: &'a str,
    /// Start of the next number.
    at: usize,
    /// Position of the last number.
    last: std::ops::Range<usize>,
}

impl Reader<'_> {
    /// Skips the labels and the tilt data.
    fn skip_to_tilt(&mut self, warnings: &mut Warnings) -> Result<Edition, InputError> {
        let first = self.text.lines().next().unwrap_or_default().trim();
        let edition = match first.get(..3) {
            Some(head) if head.eq_ignore_ascii_case("IES") && first != "IESNA91" => Edition::Late,
            _ => Edition::Early,
        };
        let mut start = 0;
        for line in self.text.split_inclusive('\n') {
            let end = start + line.len();
            let content = line.trim();
            if content.get(..5).is_some_and(|head| head.eq_ignore_ascii_case("TILT=")) {
                (self.at, self.last) = (end, start..start + line.trim_end().len());
                match content[5..].trim() {
                    tilt if tilt.eq_ignore_ascii_case("NONE") => {}
                    tilt if tilt.eq_ignore_ascii_case("INCLUDE") => {
                        self.number("the lamp's position in the luminaire")?;
                        let pairs = self.count("the number of tilt angles")?;
                        for _ in 0..2 * pairs {
                            self.number("a tilt angle or its factor")?;
                        }
                        warnings.push(self.place(), "its factors for tilted luminaires are not used");
                    }
                    file => {
                        warnings.push(self.place(), format!("factors for tilted luminaires in {file} are not used"))
                    }
                }
                return Ok(edition);
            }
            start = end;
        }
        let (problem, help) = ("there is no line that begins with TILT=", "name an IES file (ANSI/IES LM-63)");
        Err(InputError::of_file(&self.path, problem, help))
    }

    /// The numbers after the tilt.
    fn profile(&mut self, edition: Edition, warnings: &mut Warnings) -> Result<LightProfile, InputError> {
        self.number("the number of lamps")?;
        self.number("the lumens per lamp")?;
        let multiplier = self.factor("the candela multiplier")?;
        let rows = self.count("the number of vertical angles")?;
        let columns = self.count("the number of horizontal angles")?;
        match self.number("the photometric type")? {
            1.0 => {}
            kind => {
                let name = match kind {
                    2.0 => "type B".to_owned(),
                    3.0 => "type A".to_owned(),
                    other => format!("{other}"),
                };
                let problem = format!("the photometry is {name}; only type C (1) is read");
                return Err(self.error(problem, "convert the file to type C with a photometric editor"));
            }
        }
        for what in ["the unit of length", "the width", "the length", "the height"] {
            self.number(what)?;
        }
        let ballast = self.factor("the ballast factor")?;
        let second = self.number("the number after the ballast factor")?;
        let second = if edition == Edition::Early && second > 0.0 { second } else { 1.0 };
        self.number("the input watts")?;
        let vertical = self.angles(rows, "vertical", 0.0..=180.0)?;
        let horizontal = self.angles(columns, "horizontal", 0.0..=360.0)?;
        let around = Symmetry::from_angles(&horizontal).ok_or_else(|| {
            let (first, last) = (horizontal.first().unwrap_or(&0.0), horizontal.last().unwrap_or(&0.0));
            self.error(
                format!("horizontal angles from {first} to {last} describe no symmetry"),
                "let them be 0 alone, or run from 0 to 90, 180 or 360, or from 90 to 270",
            )
        })?;
        let scale = multiplier * ballast * second / f64::from(LUMENS_PER_WATT);
        let mut runs = Vec::with_capacity(columns);
        for _ in 0..columns {
            let mut run = Vec::with_capacity(rows);
            for _ in 0..rows {
                let candela = self.number("a candela value")?;
                let intensity = (candela * scale) as f32;
                if !(intensity.is_finite() && intensity >= 0.0) {
                    let problem = format!("the candela value {candela} is negative or too large");
                    return Err(self.error(problem, "correct the value"));
                }
                run.push(intensity);
            }
            runs.push(run);
        }
        if self.next_word().is_some() {
            warnings.push(self.place(), "what follows the last candela value is not used");
        }
        let (horizontal, intensity) = around.expand(&horizontal, &runs);
        let name = self.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        LightProfile::new(name, &vertical, &horizontal, intensity)
            .map_err(|e| InputError::of_file(&self.path, e.to_string(), "correct the angles and values"))
    }

    /// `count` angles \[degrees\], ascending within a range.
    fn angles(
        &mut self,
        count: usize,
        which: &str,
        range: std::ops::RangeInclusive<f64>,
    ) -> Result<Vec<f64>, InputError> {
        let mut angles: Vec<f64> = Vec::with_capacity(count);
        for _ in 0..count {
            let angle = self.number(&format!("a {which} angle"))?;
            if !range.contains(&angle) {
                let problem =
                    format!("the {which} angle {angle} lies outside {} to {} degrees", range.start(), range.end());
                return Err(self.error(problem, "correct the angle; type C photometry has no negative ones"));
            }
            if angles.last().is_some_and(|last| *last >= angle) {
                return Err(self.error(format!("the {which} angle {angle} does not ascend"), "sort the angles"));
            }
            angles.push(angle);
        }
        if which == "vertical" && count < 2 {
            return Err(self.error("a single vertical angle describes no distribution", "give two at least"));
        }
        Ok(angles)
    }

    /// A factor above zero.
    fn factor(&mut self, what: &str) -> Result<f64, InputError> {
        let v = self.number(what)?;
        if v > 0.0 { Ok(v) } else { Err(self.error(format!("{what} is {v}"), "write a number above zero, such as 1")) }
    }

    /// A count above zero. The rest of the file must have room for this number of values.
    fn count(&mut self, what: &str) -> Result<usize, InputError> {
        let v = self.number(what)?;
        // A number and the blank before it have two bytes. Larger allocations are never made.
        let most = (self.text.len() - self.at) / 2;
        if v >= 1.0 && v.fract() == 0.0 && v <= most as f64 {
            return Ok(v as usize);
        }
        Err(self
            .error(format!("{what} is {v}, for which the file is too short or which is no count"), "correct the count"))
    }

    fn number(&mut self, what: &str) -> Result<f64, InputError> {
        let Some(word) = self.next_word() else {
            self.last = self.text.len()..self.text.len();
            return Err(self.error(format!("the file ends where {what} should stand"), "get the whole file again"));
        };
        match word.parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => {
                let shown: String = word.chars().take(30).collect();
                Err(self.error(format!("{what} should stand here, not \"{shown}\""), "write a number"))
            }
        }
    }

    /// The next word. Blanks, commas and line ends separate words.
    fn next_word(&mut self) -> Option<&str> {
        let between = |c: char| c.is_whitespace() || c == ',' || c == '\0' || c == '\u{1a}';
        let rest = &self.text[self.at..];
        let start = self.at + rest.find(|c| !between(c))?;
        let end = self.text[start..].find(between).map_or(self.text.len(), |n| start + n);
        (self.at, self.last) = (end, start..end);
        Some(&self.text[start..end])
    }

    /// The line of the last word.
    fn place(&self) -> String {
        format!("line {}", self.text[..self.last.start].matches('\n').count() + 1)
    }

    fn error(&self, problem: impl Into<String>, help: &str) -> InputError {
        let mut error = InputError::new(&self.path, self.place(), problem, help);
        error.source_span = Some(Box::new(SourceSpan { text: self.text.to_owned(), range: self.last.clone() }));
        error
    }
}

/// The part of the circle that the horizontal angles of a file cover. The rest is its mirror image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Symmetry {
    /// One angle: rotationally symmetric.
    Axis,
    /// 0 to 90 degrees: mirrored at both planes.
    Quadrant,
    /// 0 to 180: mirrored at the plane through 0 and 180.
    Side,
    /// 90 to 270 (edition of 1995): mirrored at the plane through 90 and 270.
    AcrossSide,
    /// From 0 to 360, or nearly.
    None,
}

impl Symmetry {
    fn from_angles(horizontal: &[f64]) -> Option<Self> {
        match (horizontal, horizontal.first().copied()?, horizontal.last().copied()?) {
            ([_], ..) => Some(Self::Axis),
            (_, 0.0, 90.0) => Some(Self::Quadrant),
            (_, 0.0, 180.0) => Some(Self::Side),
            (_, 90.0, 270.0) => Some(Self::AcrossSide),
            // Some writers leave the last angle out because it repeats the first.
            (_, 0.0, last) if last > 180.0 => Some(Self::None),
            _ => None,
        }
    }

    /// All angles around the circle, from 0 to 360 degrees, and the values of all, run after run.
    fn expand(self, horizontal: &[f64], runs: &[Vec<f32>]) -> (Vec<f64>, Vec<f32>) {
        if self == Self::Axis {
            return (vec![0.0], runs.concat());
        }
        let images = |h: f64| match self {
            Self::Quadrant => vec![h, 180.0 - h, 180.0 + h, 360.0 - h],
            Self::Side => vec![h, 360.0 - h],
            Self::AcrossSide => vec![h, if h <= 180.0 { 180.0 - h } else { 540.0 - h }],
            Self::Axis | Self::None => vec![h],
        };
        let mut all: Vec<(f64, Vec<f32>)> =
            horizontal.iter().zip(runs).flat_map(|(h, run)| images(*h).into_iter().map(|h| (h, run.clone()))).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        // On a mirror plane an angle is its own mirror image.
        all.dedup_by(|b, a| b.0 - a.0 < 1e-9);
        // The circle closes at 0 and 360.
        if let (Some((low, first)), Some((high, last))) = (all.first().cloned(), all.last().cloned()) {
            let seam: Vec<f32> = if low == 0.0 {
                first
            } else if high == 360.0 {
                last
            } else {
                let t = ((360.0 - high) / (low + 360.0 - high)) as f32;
                last.iter().zip(&first).map(|(a, b)| a + t * (b - a)).collect()
            };
            if low > 0.0 {
                all.insert(0, (0.0, seam.clone()));
            }
            if high < 360.0 {
                all.push((360.0, seam));
            }
        }
        let angles = all.iter().map(|(h, _)| *h).collect();
        (angles, all.into_iter().flat_map(|(_, run)| run).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld_geometry::Vec3;
    use std::f32::consts::PI;

    /// Values in candela that give integers in W/sr.
    fn file(horizontal: &str, counts: &str, values: &str) -> String {
        format!(
            "IESNA:LM-63-2002\n[TEST] none\n[MANUFAC] Größe\nTILT=NONE\n1 -1 1 {counts} 1 2 0.1 0.1 0\n1 1 35.5\n0 90 180\n{horizontal}\n{values}\n"
        )
    }

    fn read(text: &str) -> LightProfile {
        let (profile, warnings) =
            parse_ies(Path::new("lamps/lamp.ies"), text.as_bytes()).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()));
        assert!(warnings.is_empty(), "{warnings:?}");
        profile
    }

    fn refused(text: &str) -> InputError {
        parse_ies(Path::new("lamp.ies"), text.as_bytes()).expect_err(text)
    }

    /// The intensity in the horizontal plane at an angle [degrees], in candela.
    fn at(p: &LightProfile, degrees: f32) -> f32 {
        let (sin, cos) = (degrees * PI / 180.0).sin_cos();
        p.intensity(Vec3::new(cos, sin, 0.0)) * 683.0
    }

    #[test]
    fn a_symmetric_file_has_its_values_at_its_angles() {
        let p = read(&file("0", "3 1", "683 1366 0"));
        assert_eq!(p.name(), "lamp.ies");
        assert!((p.intensity(-Vec3::Z) - 1.0).abs() < 1e-6 && (p.intensity(Vec3::X) - 2.0).abs() < 1e-5);
        assert!(p.intensity(Vec3::Z) < 1e-6 && (p.peak() - 2.0).abs() < 1e-6);
        // Commas and line breaks in any place, CRLF, Latin-1 and upper case are valid as well.
        let bytes = b"IESNA91\r\n[X] \xe4\r\nTilt=none\r\n1,-1,1\r\n3 1 1 2 0 0\r\n0\r\n1 1\r\n0 0,90\r\n180 0 683\r\n1366, 0\r\n";
        let (q, _) = parse_ies(Path::new("lamp.ies"), bytes).expect("reads");
        assert_eq!(p, q);
        let (q, _) =
            parse_ies(Path::new("lamp.ies"), bytes.split(|b| *b == b'\n').collect::<Vec<_>>().concat().as_slice())
                .expect("CR alone");
        assert_eq!(p, q);
    }

    #[test]
    fn multiplier_and_ballast_scale_and_the_third_factor_only_in_early_editions() {
        let text = |head: &str| format!("{head}\nTILT=NONE\n1 -1 2 2 1 1 2 0 0 0\n0.5 0.25 9\n0 90\n0\n683 683\n");
        for (head, want) in [("IESNA:LM-63-1995", 1.0), ("IES:LM-63-2019", 1.0), ("IESNA91", 0.25), ("A lamp", 0.25)] {
            let p = read(&text(head));
            assert!((p.peak() - want).abs() < 1e-6, "{head}: {}", p.peak());
            // Half of the sphere at a constant intensity: 2 pi.
            assert!((p.power() / (2.0 * PI * want) - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn symmetries_are_expanded() {
        let quadrant = read(&file("0 30 90", "3 3", "0 10 0 0 20 0 0 30 0"));
        let side = read(&file("0 30 180", "3 3", "0 10 0 0 20 0 0 30 0"));
        let across = read(&file("90 120 270", "3 3", "0 10 0 0 20 0 0 30 0"));
        let full = read(&file("0 90 180 270 360", "3 5", "0 10 0 0 20 0 0 30 0 0 40 0 0 10 0"));
        let open = read(&file("0 90 180 270", "3 4", "0 10 0 0 20 0 0 30 0 0 40 0"));
        for (p, angle, want) in [
            (&quadrant, 30.0, 20.0),
            (&quadrant, 150.0, 20.0),
            (&quadrant, 210.0, 20.0),
            (&quadrant, -30.0, 20.0),
            (&quadrant, -90.0, 30.0),
            (&quadrant, 180.0, 10.0),
            (&side, -30.0, 20.0),
            (&side, 105.0, 25.0),
            (&side, -105.0, 25.0),
            (&across, 120.0, 20.0),
            (&across, 60.0, 20.0),
            // Between 120 and 270 degrees: 20 + 10 (180 - 120) / 150 = 24, and mirrored at 0.
            (&across, 180.0, 24.0),
            (&across, 0.0, 24.0),
            (&across, -90.0, 30.0),
            (&full, -45.0, 25.0),
            (&open, -45.0, 25.0),
        ] {
            assert!((at(p, angle) - want).abs() < 1e-3, "{} at {angle} degrees instead of {want}", at(p, angle));
        }
        assert_eq!(full, open);
    }

    #[test]
    fn tilt_data_are_passed_over_with_a_word() {
        for tilt in ["TILT=INCLUDE\n1\n3\n0 45 90\n1 0.9 0.8", "TILT=lamp.tlt"] {
            let text = file("0", "3 1", "683 1366 0").replace("TILT=NONE", tilt);
            let (p, warnings) = parse_ies(Path::new("lamp.ies"), text.as_bytes()).expect("reads");
            assert!((p.peak() - 2.0).abs() < 1e-6);
            assert!(warnings.len() == 1 && warnings[0].to_string().contains("not used"), "{warnings:?}");
        }
    }

    #[test]
    fn faults_are_named_with_their_line() {
        let good = file("0", "3 1", "683 1366 0");
        for (old, new, line, word) in [
            ("TILT=NONE", "TILE=NONE", "the file", "TILT="),
            ("3 1 1 2", "3 1 2 2", "line 5", "type B"),
            ("3 1 1 2", "3 1 3 2", "line 5", "type A"),
            ("3 1 1 2", "3 1 7 2", "line 5", "only type C"),
            ("3 1 1 2", "300000 1 1 2", "line 5", "too short"),
            ("3 1 1 2", "2.5 1 1 2", "line 5", "vertical angles"),
            ("3 1 1 2", "0 1 1 2", "line 5", "vertical angles"),
            ("1 -1 1 3", "1 -1 0 3", "line 5", "multiplier"),
            ("35.5", "watts", "line 6", "watts"),
            ("0 90 180", "0 180 90", "line 7", "ascend"),
            ("0 90 180", "-90 0 90", "line 7", "outside"),
            ("683 1366", "683 -1", "line 9", "negative"),
            ("683 1366", "683 nan", "line 9", "candela"),
            ("1366 0", "1366", "line 10", "ends"),
        ] {
            let text = good.replace(old, new);
            assert_ne!(text, good, "{old}");
            let e = refused(&text);
            assert!(e.place == line && e.problem.contains(word), "{new}: {e}");
            assert!(!e.help.is_empty() && (line == "the file" || e.caret().contains('^')));
        }
        let e = refused(&file("0 45", "3 2", "1 1 1 1 1 1"));
        assert!(e.place == "line 8" && e.problem.contains("from 0 to 45"), "{e}");
        let (_, warnings) = parse_ies(Path::new("lamp.ies"), (good.clone() + "7").as_bytes()).expect("reads");
        assert!(warnings[0].message.contains("follows"));
    }
}
