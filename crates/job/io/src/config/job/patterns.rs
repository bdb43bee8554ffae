//! Patterns of names with `*` and `?`, and lists of names.

/// Does a name match a pattern with `*` and `?`? `\*` and `\?` stand for these characters. A name that contains them also
/// matches literally.
pub fn matches(pattern: &str, name: &str) -> bool {
    pattern == name || (pattern.contains(['*', '?']) && glob(pattern, name))
}

/// Greedy matching that returns to the last `*`: quadratic in the worst case.
fn glob(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<Token>, Vec<char>) = (tokens(pattern), name.chars().collect());
    let (mut p, mut n) = (0, 0);
    let mut star: Option<(usize, usize)> = None;
    while n < name.len() {
        match pattern.get(p) {
            Some(Token::Any) => {
                star = Some((p, n));
                p += 1;
            }
            Some(token) if *token == Token::One || *token == Token::Char(name[n]) => {
                p += 1;
                n += 1;
            }
            _ => match &mut star {
                Some((at, taken)) => {
                    *taken += 1;
                    (p, n) = (*at + 1, *taken);
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|token| *token == Token::Any)
}

/// A part of a pattern.
#[derive(Clone, Copy, PartialEq)]
enum Token {
    /// `*`: any characters.
    Any,
    /// `?`: one character.
    One,
    Char(char),
}

fn tokens(pattern: &str) -> Vec<Token> {
    let mut chars = pattern.chars().peekable();
    let mut list = Vec::new();
    while let Some(c) = chars.next() {
        list.push(match c {
            '*' => Token::Any,
            '?' => Token::One,
            '\\' => Token::Char(chars.next_if(|next| matches!(next, '*' | '?')).unwrap_or(c)),
            c => Token::Char(c),
        });
    }
    list
}

/// The pattern that a name matches, and no other name.
pub fn literal_pattern(name: &str) -> String {
    name.replace('*', "\\*").replace('?', "\\?")
}

pub(super) fn unique<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut list: Vec<&str> = names.filter(|n| !n.is_empty()).collect();
    list.sort_unstable();
    list.dedup();
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns() {
        for (pattern, name, expected) in [
            ("pmma", "pmma", true),
            ("pmma", "pmma2", false),
            ("symbol *", "symbol 3", true),
            ("*light*", "rear light 2", true),
            ("a?c", "abc", true),
            ("a?c", "ac", false),
            ("*", "", true),
            ("a*b*c", "a-b-b-c", true),
            ("a*b*c", "a-b-b-d", false),
            ("[*]", "[*]", true),
            ("l\\?mp", "l?mp", true),
            ("l\\?mp", "lamp", false),
            ("\\**", "*light", true),
            ("\\**", "light", false),
            ("a\\b*", "a\\bc", true),
        ] {
            assert_eq!(matches(pattern, name), expected, "{pattern} against {name}");
        }
        let names = ["lamp", "l?mp", "l*mp", "l\\\\*mp", "*", "?"];
        for (a, b) in names.iter().flat_map(|a| names.map(|b| (a, b))) {
            assert_eq!(matches(&literal_pattern(a), b), *a == b, "{a} against {b}");
        }
    }
}
