//! Works that are cited by author and year have an entry in the bibliography.

use std::collections::BTreeSet;

/// The page with the entries.
pub(crate) const BIBLIOGRAPHY: &str = "docs/bibliography.md";

/// Words before a year that are no authors.
const NOT_AUTHORS: [&str; 11] =
    ["Before", "December", "From", "ICASSP", "In", "JCGT", "November", "October", "Of", "Since", "The"];

/// A cited work: author and year.
type Citation = (String, String);

/// The works that a file cites: of source code the comments, of a page the whole text.
pub(crate) fn cited(name: &str, text: &str) -> BTreeSet<Citation> {
    let words: Vec<&str> = match name.rsplit('.').next() {
        Some("rs") => text
            .lines()
            .filter_map(|l| l.split_once("//"))
            .flat_map(|(_, c)| c.trim_start_matches(['/', '!']).split_whitespace())
            .collect(),
        Some("md") if name != BIBLIOGRAPHY => text.split_whitespace().collect(),
        _ => Vec::new(),
    };
    let at = |i: usize, back: usize| i.checked_sub(back).map(|k| words[k]);
    let citation = |(i, word): (usize, &&str)| {
        let year = word.trim_matches(|c: char| !c.is_alphanumeric());
        let digits = year.trim_end_matches(['a', 'b', 'c']);
        let is_year = digits.len() == 4 && digits.parse().is_ok_and(|y: u32| (1700..2100).contains(&y));
        let before = at(i, 1).filter(|_| is_year)?;
        let author = if before == "al." { at(i, 3)? } else { before };
        let author = author.trim_start_matches(['(', '/', '*', '[']).trim_end_matches([',', '\'', 's']);
        let stem = before.trim_matches(|c: char| !c.is_alphanumeric());
        let is_name = author.chars().next().is_some_and(char::is_uppercase)
            && author.chars().filter(|c| c.is_lowercase()).count() >= 2
            && author.chars().all(|c| c.is_alphabetic() || "-'’".contains(c));
        (is_name && !NOT_AUTHORS.contains(&stem)).then(|| (author.to_owned(), year.to_owned()))
    };
    words.iter().enumerate().filter_map(citation).collect()
}

/// The citations of a file without an entry.
pub(crate) fn check(name: &str, cited: &BTreeSet<Citation>, bibliography: &str) -> Vec<String> {
    let heads: Vec<String> = bibliography
        .lines()
        .filter_map(|line| line.strip_prefix("- ")?.split_once(": "))
        .map(|(head, _)| without_accents(head))
        .collect();
    let is_listed = |(author, year): &&Citation| {
        let (author, year) = (without_accents(author), year.as_str());
        heads.iter().any(|head| head.contains(&author) && head.contains(year))
    };
    cited
        .iter()
        .filter(|work| !is_listed(work))
        .map(|(author, year)| format!("{name}: {BIBLIOGRAPHY} has no entry for {author} {year}"))
        .collect()
}

/// Lower case, and letters with accents as in ASCII: comments write names without them.
fn without_accents(text: &str) -> String {
    let mut plain = String::new();
    for c in text.chars().flat_map(char::to_lowercase) {
        match c {
            'ä' | 'á' | 'å' => plain.push('a'),
            'é' | 'è' => plain.push('e'),
            'ö' | 'ó' => plain.push('o'),
            'ü' => plain.push('u'),
            'ř' => plain.push('r'),
            'ñ' => plain.push('n'),
            'æ' => plain.push_str("ae"),
            other => plain.push(other),
        }
    }
    plain
}
