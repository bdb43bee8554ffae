//! Converts the bytes of an OBJ or MTL file to numbered lines: encodings, comments.

/// Decodes a text in UTF-8, with or without a byte order mark, or else in Latin-1, where every byte is a character.
/// `None` if the bytes are no text in these.
pub(super) fn decode(bytes: Vec<u8>) -> Option<String> {
    if bytes.contains(&0) {
        return None;
    }
    let text = String::from_utf8(bytes).unwrap_or_else(|e| e.as_bytes().iter().map(|b| char::from(*b)).collect());
    Some(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// Splits a line into its first word and the trimmed rest.
pub(super) fn keyword(line: &str) -> (&str, &str) {
    let line = line.trim();
    line.split_once(char::is_whitespace).map_or((line, ""), |(key, rest)| (key, rest.trim()))
}

/// The text before a comment. A `#` inside a word belongs to the word (`Material#3`).
pub(super) fn without_comment(text: &str) -> &str {
    let mut comments = text.match_indices('#').map(|(i, _)| i);
    let start = comments.find(|i| *i == 0 || text[..*i].ends_with(char::is_whitespace));
    start.map_or(text, |i| text[..i].trim_end())
}

/// The first line that `refuses` is true of, for a text that `tobj` refuses: its errors contain no line.
pub(super) fn first_refused(text: &str, refuses: impl Fn(&str) -> bool) -> u32 {
    (1..).zip(text.lines()).find(|(_, line)| refuses(line)).map_or(0, |(number, _)| number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings() {
        for bytes in ["v ä".as_bytes(), b"\xef\xbb\xbfv \xc3\xa4", b"v \xe4"] {
            assert_eq!(decode(bytes.to_vec()).as_deref(), Some("v ä"), "{bytes:?}");
        }
        assert!(decode(b"glTF\x02\0\0\0".to_vec()).is_none());
    }

    #[test]
    fn comments_end_a_line_but_not_a_name() {
        assert_eq!(without_comment("1 2 3 # four"), "1 2 3");
        assert_eq!(without_comment("Material#3"), "Material#3");
        assert_eq!(without_comment("# all"), "");
    }
}
