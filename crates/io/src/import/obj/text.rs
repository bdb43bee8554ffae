//! Converts the bytes of an OBJ or MTL file to numbered logical lines: encodings, line ends, continuations, inexact
//! numbers.

use std::borrow::Cow;
use std::iter::Zip;
use std::ops::RangeFrom;
use std::str::SplitInclusive;

/// Decodes a text of unknown encoding. The note contains the assumed encoding if it was not UTF-8.
///
/// A byte-order mark has priority (UTF-8, UTF-16). Bytes that are not UTF-8 are read as Latin-1, where every byte is a
/// character. Lines then end with `\n` or `\r\n`. `None` if the bytes are no text at all.
pub(super) fn decode(bytes: Vec<u8>) -> Option<(String, Option<&'static str>)> {
    characters(bytes).map(|(text, note)| (end_lines(text), note))
}

fn characters(bytes: Vec<u8>) -> Option<(String, Option<&'static str>)> {
    let utf16 = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let units = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
        char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect::<String>()
    };
    const UTF16: Option<&str> = Some("the text is UTF-16 and was converted");
    match bytes.as_slice() {
        [0xff, 0xfe, rest @ ..] => return Some((utf16(rest, u16::from_le_bytes), UTF16)),
        [0xfe, 0xff, rest @ ..] => return Some((utf16(rest, u16::from_be_bytes), UTF16)),
        // Without a mark: ASCII in UTF-16 has a zero in every other byte.
        [a, 0, b, 0, ..] if *a != 0 && *b != 0 => return Some((utf16(&bytes, u16::from_le_bytes), UTF16)),
        [0, a, 0, b, ..] if *a != 0 && *b != 0 => return Some((utf16(&bytes, u16::from_be_bytes), UTF16)),
        _ => {}
    }
    if bytes.contains(&0) {
        return None;
    }
    match String::from_utf8(bytes) {
        Ok(mut text) => {
            if text.starts_with('\u{feff}') {
                text.drain(..'\u{feff}'.len_utf8());
            }
            Some((text, None))
        }
        Err(e) => {
            let text = e.as_bytes().iter().map(|b| char::from(*b)).collect();
            Some((text, Some("the text is not UTF-8 and was read as Latin-1")))
        }
    }
}

/// Ends all lines with `\n` or `\r\n`: a `\r` alone, as old systems write it, becomes `\n`. Works in place.
fn end_lines(mut text: String) -> String {
    if !text.contains('\r') {
        return text;
    }
    let mut bytes = std::mem::take(&mut text).into_bytes();
    for i in 0..bytes.len() {
        if bytes[i] == b'\r' && bytes.get(i + 1) != Some(&b'\n') {
            bytes[i] = b'\n';
        }
    }
    // Replacing one ASCII character by another keeps the text valid.
    String::from_utf8(bytes).unwrap_or_default()
}

/// The logical lines of a decoded text with the number (from 1) of their first physical line, and with their line ends.
/// A backslash at the end of a line joins the next one to it. In comments it has no effect.
pub(super) fn lines(text: &str) -> Lines<'_> {
    Lines { physical: (1..).zip(text.split_inclusive('\n')) }
}

/// The iterator of [`lines`].
pub(super) struct Lines<'a> {
    physical: Zip<RangeFrom<u32>, SplitInclusive<'a, char>>,
}

impl<'a> Iterator for Lines<'a> {
    type Item = (u32, Cow<'a, str>);

    fn next(&mut self) -> Option<Self::Item> {
        let (first, mut last) = self.physical.next()?;
        if !is_continued(last) {
            return Some((first, Cow::Borrowed(last)));
        }
        let mut joined = String::new();
        while is_continued(last) {
            let end = last.trim_end();
            joined.push_str(&end[..end.len() - 1]);
            joined.push(' ');
            match self.physical.next() {
                Some((_, line)) => last = line,
                None => return Some((first, Cow::Owned(joined))),
            }
        }
        joined.push_str(last);
        Some((first, Cow::Owned(joined)))
    }
}

fn is_continued(line: &str) -> bool {
    line.trim_end().ends_with('\\') && !line.trim_start().starts_with('#')
}

/// Splits a line into its first word and the trimmed rest.
pub(super) fn keyword(line: &str) -> (&str, &str) {
    let line = line.trim();
    line.split_once(char::is_whitespace).map_or((line, ""), |(key, rest)| (key, rest.trim()))
}

/// The text before a comment. A `#` inside a word belongs to the word (`Material#3`).
pub(super) fn without_comment(text: &str) -> &str {
    let mut previous = ' ';
    for (i, c) in text.char_indices() {
        if c == '#' && previous.is_whitespace() {
            return text[..i].trim_end();
        }
        previous = c;
    }
    text
}

/// Reads a number by the rules of C's `atof`, and also Windows' spellings of NaN. The flag is set if the spelling was
/// invalid and only a part of it was used. `None` if there is no number at all.
pub(super) fn number(word: &str) -> Option<(f64, bool)> {
    if let Ok(value) = word.parse::<f64>() {
        return Some((value, false));
    }
    let unsigned = word.trim_start_matches(['-', '+']);
    if unsigned.starts_with("1.#") || unsigned.to_ascii_lowercase().starts_with("nan") {
        return Some((f64::NAN, false));
    }
    // A decimal comma, as some locales write it.
    if word.bytes().filter(|b| *b == b',').count() == 1
        && !word.contains('.')
        && let Ok(value) = word.replace(',', ".").parse::<f64>()
    {
        return Some((value, true));
    }
    // The longest prefix that is a number; no exponent is longer than a few characters, so few are tried.
    let plain = word.bytes().take_while(|b| matches!(b, b'0'..=b'9' | b'.' | b'+' | b'-' | b'e' | b'E')).count();
    (1..=plain.min(64)).rev().find_map(|n| word[..n].parse::<f64>().ok()).map(|value| (value, true))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn collect(text: &str) -> Vec<(u32, String)> {
        let text = end_lines(text.to_string());
        lines(&text).map(|(n, l)| (n, l.trim_end_matches(['\r', '\n']).to_string())).collect()
    }

    #[test]
    fn all_line_ends_and_continuations() {
        let want = |list: &[(u32, &str)]| list.iter().map(|(n, l)| (*n, (*l).to_string())).collect::<Vec<_>>();
        assert_eq!(collect("a\nb\r\nc\rd"), want(&[(1, "a"), (2, "b"), (3, "c"), (4, "d")]));
        assert_eq!(collect("f 1 \\\n 2\\\r\n 3\nv"), want(&[(1, "f 1   2  3"), (4, "v")]));
        assert_eq!(collect("# art \\\nv 1"), want(&[(1, "# art \\"), (2, "v 1")]));
        assert_eq!(collect("v \\"), want(&[(1, "v  ")]));
        assert_eq!(collect("\n\nx"), want(&[(1, ""), (2, ""), (3, "x")]));
        assert!(collect("").is_empty());
    }

    #[test]
    fn encodings() {
        let utf16le: Vec<u8> = "\u{feff}v ä".encode_utf16().flat_map(u16::to_le_bytes).collect();
        let utf16be: Vec<u8> = "v ä".encode_utf16().flat_map(u16::to_be_bytes).collect();
        for bytes in
            [utf16le, utf16be, "v ä".as_bytes().to_vec(), b"\xef\xbb\xbfv \xc3\xa4".to_vec(), b"v \xe4".to_vec()]
        {
            assert_eq!(decode(bytes.clone()).expect("text").0, "v ä", "{bytes:?}");
        }
        assert!(decode(b"glTF\x02\0\0\0".to_vec()).is_none());
    }

    #[test]
    fn loose_numbers() {
        for (word, value, broken) in [
            ("1.", 1.0, false),
            ("+.5e1", 5.0, false),
            ("3.1+e2", 3.1, true),
            ("2,5", 2.5, true),
            ("1.0f", 1.0, true),
            ("-7abc", -7.0, true),
        ] {
            assert_eq!(number(word), Some((value, broken)), "{word}");
        }
        for word in ["1.#QNAN", "-1.#IND", "-nan(ind)", "nan"] {
            assert!(number(word).is_some_and(|(v, _)| v.is_nan()), "{word}");
        }
        for word in ["", "x", "-", "é1", "1é"] {
            assert!(number(word).is_none_or(|(v, _)| v == 1.0), "{word}");
        }
    }

    #[test]
    fn comments_end_a_line_but_not_a_name() {
        assert_eq!(without_comment("1 2 3 # four"), "1 2 3");
        assert_eq!(without_comment("Material#3"), "Material#3");
        assert_eq!(without_comment("# all"), "");
    }
}
