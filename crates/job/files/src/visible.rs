//! Text of files for terminals: names in a scene may contain escape sequences, which a terminal would execute.

use std::borrow::Cow;
use std::fmt::Write;

/// The text with `\u{...}` in place of each character that a terminal executes or that reorders its neighbours. Line
/// feeds and tabs remain.
pub fn visible(text: &str) -> Cow<'_, str> {
    escaped(text, |c| c != '\n' && c != '\t' && is_command(c), |out, c| write!(out, "\\u{{{:x}}}", u32::from(c)))
}

/// As [`visible`], for a text of one line: line feeds and tabs are replaced, too.
pub fn visible_line(text: &str) -> Cow<'_, str> {
    escaped(text, is_command, |out, c| write!(out, "\\u{{{:x}}}", u32::from(c)))
}

/// JSON with such characters escaped by the rules of JSON. Its meaning does not change.
pub fn visible_json(text: &str) -> Cow<'_, str> {
    escaped(text, |c| c != '\n' && is_command(c), |out, c| write!(out, "\\u{:04x}", u32::from(c)))
}

/// A line of a source with such characters as U+FFFD, one for one: columns do not change.
pub(crate) fn visible_columns(line: &str) -> Cow<'_, str> {
    escaped(line, is_command, |out, _| out.write_char('\u{fffd}'))
}

/// Control characters (C0, DEL, C1), line separators, and the marks, embeddings, overrides and isolates of bidirectional text
/// (Unicode Standard Annex 9).
fn is_command(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn escaped(
    text: &str,
    is_replaced: impl Fn(char) -> bool,
    replace: impl Fn(&mut String, char) -> std::fmt::Result,
) -> Cow<'_, str> {
    if !text.contains(&is_replaced) {
        return text.into();
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        // Writing into a string does not fail.
        let _ = if is_replaced(c) { replace(&mut out, c) } else { out.write_char(c) };
    }
    out.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped_and_others_stay() {
        let name = "a\u{1b}[31m\u{7f}\u{9b}2J\u{202e}gpj\r\n\tä 中 \u{1f600}";
        assert_eq!(visible(name), "a\\u{1b}[31m\\u{7f}\\u{9b}2J\\u{202e}gpj\\u{d}\n\tä 中 \u{1f600}");
        assert!(visible_line(name).ends_with("gpj\\u{d}\\u{a}\\u{9}ä 中 \u{1f600}"));
        assert_eq!(visible_columns("a\u{1b}\tb"), "a\u{fffd}\u{fffd}b");
        assert!(matches!(visible("plain ä"), Cow::Borrowed("plain ä")));
        for c in (0..0x20).chain(0x7f..0xa0).chain(0x202a..0x202f).chain(0x2066..0x206a) {
            let c = char::from_u32(c).expect("a character");
            assert!(!visible_line(&format!("x{c}y")).contains(c), "{c:?}");
        }
    }

    #[test]
    fn json_means_the_same() {
        let name = "a\u{1b}\u{9b}\u{202e}b\u{7f}";
        let json = serde_json::to_string_pretty(&[name]).expect("JSON");
        let shown = visible_json(&json);
        assert!(shown.is_ascii(), "{shown}");
        assert_eq!(serde_json::from_str::<Vec<String>>(&shown).expect("JSON"), [name]);
    }
}
