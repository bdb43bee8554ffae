//! The text of an OBJ file in a form that `tobj` accepts. It is generated line by line while `tobj` reads it.
//!
//! Lines that `tobj` reads correctly are borrowed from the file's text. The others are rewritten or left out.

use super::groups::Groups;
use super::plain::{self, Counts};
use super::read::Face;
use super::repair::{self, NO_COLOR};
use super::tally::Tally;
use super::text::{self, Lines};
use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::{self, BufRead, Read};

/// Number of entries in one line of the register.
pub(super) const REGISTER_LINE: u32 = 256;

/// The cleaned text. It begins with the register: faces with every position, texture coordinate and normal in their
/// order. `tobj` numbers them in the order of their first use, so it keeps the file's numbers. It also returns entries
/// that no face uses. All faces form one model, because `tobj` numbers each model separately.
pub(super) struct Cleaner<'a> {
    lines: Lines<'a>,
    chunk: Cow<'a, str>,
    /// Read bytes of the chunk [bytes].
    done: usize,
    ended: bool,
    /// Has any vertex a colour?
    colored: bool,
    /// Entries of the register that are written.
    registered: u32,
    seen: Counts,
    budget: u64,
    tally: &'a mut Tally,
    late: Tally,
    pub found: Found,
}

/// The results of the cleaning, apart from the text.
pub(super) struct Found {
    /// Numbers of positions, texture coordinates and normals of the whole file.
    pub total: Counts,
    /// Names: the present ones and all.
    pub groups: Groups,
    /// The faces for `tobj`, without their corners.
    pub faces: Vec<Face>,
    /// Faces that cannot be used and are not passed on.
    pub dropped_faces: usize,
    /// The line in the file that was read last.
    pub line: u32,
    /// Do the vertices and faces so far need more memory than allowed?
    pub too_large: bool,
}

/// The treatment of a line.
enum Cleaned {
    AsItIs,
    As(String),
    Not,
}

impl<'a> Cleaner<'a> {
    /// Cleans `source`; `most_bytes` bounds the meshes that are made of it. The text must be shorter than 4 GiB, so that
    /// 32-bit numbers suffice.
    pub(super) fn new(source: &'a str, most_bytes: u64, tally: &'a mut Tally) -> Self {
        let (total, colored) = count(source);
        let found =
            Found { total, groups: Groups::new(), faces: Vec::new(), dropped_faces: 0, line: 0, too_large: false };
        Self {
            lines: text::lines(source),
            chunk: Cow::Borrowed(""),
            done: 0,
            ended: false,
            colored,
            registered: 0,
            seen: [0; 3],
            budget: most_bytes,
            tally,
            late: Tally::default(),
            found,
        }
    }

    /// Returns the results of the cleaning, apart from the text.
    pub(super) fn finish(self) -> Found {
        self.tally.append(self.late);
        self.found
    }

    /// Moves to the next piece of text; `false` at the end.
    fn advance(&mut self) -> io::Result<bool> {
        self.done = 0;
        if let Some(faces) = self.register() {
            self.chunk = Cow::Owned(faces);
            return Ok(true);
        }
        while let Some((number, line)) = self.lines.next() {
            self.found.line = number;
            let cleaned = self.statement(number, &line);
            if self.found.too_large {
                return Err(io::ErrorKind::FileTooLarge.into());
            }
            self.chunk = match cleaned {
                Cleaned::AsItIs => line,
                Cleaned::As(text) => Cow::Owned(text),
                Cleaned::Not => continue,
            };
            return Ok(true);
        }
        // The entries that mean none. They are last and change no index. A line without an end may precede them.
        let [_, texcoords, normals] = self.found.total;
        let texcoord = if texcoords > 0 { "vt 0 0\n" } else { "" };
        let normal = if normals > 0 { "vn 0 0 0\n" } else { "" };
        self.chunk = Cow::Owned(format!("\n{texcoord}{normal}"));
        Ok(!std::mem::replace(&mut self.ended, true))
    }

    /// The next line of the register.
    fn register(&mut self) -> Option<String> {
        let [positions, texcoords, normals] = with_none(&self.found.total);
        let first = self.registered;
        let end = positions.max(texcoords).max(normals);
        if positions == 0 || first >= end {
            return None;
        }
        self.registered = end.min(first.saturating_add(REGISTER_LINE));
        let mut out = String::with_capacity(32 * REGISTER_LINE as usize);
        out.push('f');
        for entry in first + 1..=self.registered {
            let _ = write!(out, " {}", entry.min(positions));
            for list in [texcoords, normals] {
                out.push('/');
                if list > 0 {
                    let _ = write!(out, "{}", entry.min(list));
                }
            }
        }
        out.push('\n');
        Some(out)
    }

    fn statement(&mut self, line: u32, content: &str) -> Cleaned {
        let (key, rest) = keyword(content);
        match key {
            "v" => {
                self.seen[0] += 1;
                self.charge(if self.colored { 28 } else { 12 });
                match plain::numbers(rest, 15) {
                    Some(found) if found.count == if self.colored { 6 } else { 3 } => Cleaned::AsItIs,
                    Some(found) if found.count == 3 => Cleaned::As(format!("{} {NO_COLOR}\n", content.trim_end())),
                    _ => Cleaned::As(repair::vertex(line, text::without_comment(rest), self.colored, self.tally)),
                }
            }
            "vt" => {
                self.seen[1] += 1;
                match plain::numbers(rest, 6) {
                    Some(found) if found.count >= 2 => Cleaned::AsItIs,
                    _ => Cleaned::As(repair::texcoord(line, text::without_comment(rest), self.tally)),
                }
            }
            "vn" => {
                self.seen[2] += 1;
                match plain::numbers(rest, 15) {
                    Some(found) if found.count == 3 && found.nonzero => Cleaned::AsItIs,
                    _ => Cleaned::As(repair::normal(line, text::without_comment(rest), self.tally)),
                }
            }
            "f" | "fo" => self.face(line, key, rest),
            "" => Cleaned::Not,
            _ => {
                if !key.starts_with('#') && !self.found.groups.statement(line, key, rest) {
                    self.left_out(line, key);
                }
                Cleaned::Not
            }
        }
    }

    fn face(&mut self, line: u32, key: &str, rest: &str) -> Cleaned {
        let (cleaned, corners) = match plain::face(rest, &self.seen, &self.found.total) {
            Some(corners) if corners >= 3 && key == "f" => (Cleaned::AsItIs, corners),
            _ => {
                let data = text::without_comment(rest);
                let (seen, total) = (&self.seen, &self.found.total);
                match repair::face(line, data, seen, total, self.tally, &mut self.late) {
                    Some((text, corners)) => (Cleaned::As(text), corners),
                    None => {
                        self.found.dropped_faces += 1;
                        return Cleaned::Not;
                    }
                }
            }
        };
        self.charge(12 * (corners as u64 - 2));
        let Groups { smoothing, object, material, .. } = self.found.groups;
        self.found.faces.push(Face { first: 0, count: 0, line, smoothing, object, material });
        cleaned
    }

    /// Counts memory of the final mesh before `tobj` allocates its own.
    fn charge(&mut self, bytes: u64) {
        match self.budget.checked_sub(bytes) {
            Some(left) => self.budget = left,
            None => self.found.too_large = true,
        }
    }

    /// Records a statement without effect on images, if a user may expect one.
    fn left_out(&mut self, line: u32, key: &str) {
        match key {
            "p" | "l" => self.tally.add(line, "points and lines have no surface and are left out"),
            "vp" | "cstype" | "deg" | "bmat" | "step" | "curv" | "curv2" | "surf" | "parm" | "trim" | "hole"
            | "scrv" | "sp" | "end" | "con" => {
                self.tally.add(line, "free-form curves and surfaces are not read; export polygons")
            }
            "call" | "csh" => self.tally.add(line, "`call` and `csh` statements are never carried out"),
            // Display hints, and data of other programs without effect on images.
            "mg" | "bevel" | "c_interp" | "d_interp" | "lod" | "maplib" | "usemap" | "shadow_obj" | "trace_obj"
            | "ctech" | "stech" | "vw" => {}
            _ => {
                let shown: String = key.chars().take(20).collect();
                self.tally.add(line, &format!("the unknown statement `{shown}` is skipped"));
            }
        }
    }
}

/// As [`text::keyword`]. For the most frequent statements of a mesh, the rest is not trimmed, to save time.
fn keyword(line: &str) -> (&str, &str) {
    match line.as_bytes() {
        [b'v' | b'f', b' ', ..] => (&line[..1], &line[2..]),
        [b'v', b't' | b'n', b' ', ..] => (&line[..2], &line[3..]),
        _ => text::keyword(line),
    }
}

/// Numbers of positions, texture coordinates and normals, and whether any vertex has a colour.
fn count(source: &str) -> (Counts, bool) {
    let (mut counts, mut colored) = ([0; 3], false);
    for (_, line) in text::lines(source) {
        let (key, rest) = keyword(&line);
        match key {
            "v" => {
                counts[0] += 1;
                // Six words have five gaps. Few lines have so many, and counting bytes is fast.
                let gaps = || rest.bytes().filter(|b| *b <= b' ' || !b.is_ascii()).count();
                colored = colored || (gaps() >= 5 && repair::has_color(text::without_comment(rest)));
            }
            "vt" => counts[1] += 1,
            "vn" => counts[2] += 1,
            _ => {}
        }
    }
    (counts, colored)
}

/// The counts with the entries that mean none. An empty list has no such entry.
pub(super) fn with_none([positions, texcoords, normals]: &Counts) -> Counts {
    let and_none = |n: u32| n + u32::from(n > 0);
    [*positions, and_none(*texcoords), and_none(*normals)]
}

impl Read for Cleaner<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(buffer)?;
        self.consume(count);
        Ok(count)
    }
}

impl BufRead for Cleaner<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        while self.done >= self.chunk.len() {
            if !self.advance()? {
                return Ok(&[]);
            }
        }
        Ok(&self.chunk.as_bytes()[self.done..])
    }

    fn consume(&mut self, amount: usize) {
        self.done += amount;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cleaned(source: &str) -> (String, Found, Vec<String>) {
        let mut tally = Tally::default();
        let mut cleaner = Cleaner::new(source, u64::MAX, &mut tally);
        let mut text = String::new();
        cleaner.read_to_string(&mut text).expect("in memory");
        let found = cleaner.finish();
        let mut warnings = crate::import::warnings::Warnings::new(std::path::Path::new("a.obj"));
        tally.report("", &mut warnings);
        (text, found, warnings.finish().iter().map(ToString::to_string).collect())
    }

    #[test]
    fn the_register_comes_first_and_the_entries_for_none_last() {
        let lines = "v 0 0 0\nv 1 0 0\r\nv 0 1 0\nvt 0.5 0.5\nf 1/1 2/1 -1/-1";
        let (text, found, warnings) = cleaned(lines);
        assert_eq!(text, format!("f 1/1/ 2/2/ 3/2/\n{lines}\nvt 0 0\n"));
        assert_eq!((found.total, found.faces.len(), found.dropped_faces), ([3, 1, 0], 1, 0));
        assert!(warnings.is_empty(), "{warnings:?}");
        let (text, _, _) = cleaned(&"v 0 0 0\n".repeat(600));
        let register: Vec<usize> =
            text.lines().filter(|l| l.starts_with('f')).map(|l| l.matches(' ').count()).collect();
        assert_eq!(register, [256, 256, 88]);
    }

    #[test]
    fn lines_that_need_no_cleaning_are_lent() {
        let mut tally = Tally::default();
        let source = "vn 0 0 1\nv 1 2 3\n";
        let mut cleaner = Cleaner::new(source, u64::MAX, &mut tally);
        let mut lent = 0;
        while !cleaner.fill_buf().expect("in memory").is_empty() {
            lent += usize::from(matches!(cleaner.chunk, Cow::Borrowed(line) if source.contains(line)));
            let all = cleaner.chunk.len();
            cleaner.consume(all);
        }
        assert_eq!(lent, 2);
    }

    #[test]
    fn lines_that_tobj_refuses_or_misreads_are_rewritten() {
        let start = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        for (line, expected) in [
            ("f 1 2 3 # c", "f 1// 2// 3//"),
            ("f 1 \\\n 2 3 \\\n", "f 1   2 3  "),
            ("fo 1 2 3", "f 1// 2// 3//"),
            ("f 1/1 2 3", "f 1// 2// 3//"),
            ("v 1 2 3 4", "v 1.0 2.0 3.0"),
            ("v 1,5 2 1e3", "v 1.5 2.0 1000.0"),
            ("v 1.#QNAN 2 3", "v NaN NaN NaN"),
            ("vt 0.5", "vt 0.5 0.0"),
            ("vn 0 0 0", "vn 0.0 0.0 0.0"),
            ("l 1 2", ""),
            ("f 1 2 9", ""),
            ("g a b", ""),
        ] {
            let (text, _, _) = cleaned(&format!("{start}{line}\n"));
            let body = text.split_once(start).map(|(_, body)| body.split("\nvt 0 0\n").next().unwrap_or(body));
            let body = body.map(|b| b.split("\nvn 0 0 0\n").next().unwrap_or(b).trim_matches('\n'));
            assert_eq!(body, Some(expected), "{line}");
        }
        let (text, _, _) = cleaned("v 0 0 0\nv 1 0 0 1 0.5 0\n");
        assert!(text.contains("v 0 0 0 inf inf inf\nv 1 0 0 1 0.5 0\n"), "{text}");
    }

    #[test]
    fn faults_beyond_the_end_of_the_file_are_reported_last() {
        let (_, found, warnings) = cleaned("v 0 0 0\nf 1 1 9\nf 1 1 x\nf 1 1/7 1\n");
        assert_eq!(found.dropped_faces, 2);
        assert_eq!(
            warnings,
            [
                "a.obj: lines 3, 2: the face has an index that names no vertex and is dropped",
                "a.obj: line 4: an index names no texture coordinate and is ignored"
            ]
        );
    }

    #[test]
    fn the_limit_stops_the_text_before_tobj_allocates() {
        let mut tally = Tally::default();
        let source = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        for (most, too_large) in [(48, false), (47, true)] {
            let mut cleaner = Cleaner::new(source, most, &mut tally);
            let outcome = cleaner.read_to_string(&mut String::new());
            assert_eq!((outcome.is_err(), cleaner.finish().too_large), (too_large, too_large));
        }
    }
}
