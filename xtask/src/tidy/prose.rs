//! Words and forms that CONVENTIONS.md excludes from the pages.

/// The page that quotes the excluded words.
const RULES: &str = "CONVENTIONS.md";

/// First words of a heading that is a question or a headless clause.
const HEADLESS: [&str; 9] = ["How", "What", "Whatever", "When", "Where", "Whether", "Who", "Whoever", "Why"];

/// Words and phrases that are metaphors of programs and data, in lower case.
const METAPHORS: [&str; 17] = [
    "asks",
    "believes",
    "calls for",
    "foretold",
    "forgets",
    "knows",
    "mend",
    "mended",
    "nobody",
    "says",
    "speak for",
    "speaks",
    "surely",
    "tell",
    "tells",
    "told",
    "whoever",
];

/// The violations of a page.
pub(crate) fn check(name: &str, text: &str) -> Vec<String> {
    let mut faults = Vec::new();
    let mut is_fenced = false;
    for (i, line) in text.lines().enumerate() {
        let is_fence = line.trim_start().starts_with("```");
        is_fenced ^= is_fence;
        if is_fenced || is_fence || name == RULES || !name.ends_with(".md") {
            continue;
        }
        let prose = without_quotations(line);
        let heading = prose.trim_start_matches('#').trim_start();
        let first = heading.split_whitespace().next().unwrap_or_default();
        let starts = |word: &str| prose.starts_with(word) || prose.contains(&format!(". {word}"));
        if heading.len() < prose.len() && prose.starts_with('#') && HEADLESS.contains(&first) {
            faults.push(format!("{name}:{}: the heading is a headless clause; name the thing", i + 1));
        } else if ["What ", "Whatever ", "Whoever "].into_iter().any(starts) {
            faults.push(format!("{name}:{}: a headless clause; name the thing", i + 1));
        }
        let lower = format!(" {} ", prose.to_lowercase().replace(|c: char| !c.is_alphanumeric() && c != '\'', " "));
        for word in METAPHORS.iter().filter(|word| lower.contains(&format!(" {word} "))) {
            faults.push(format!("{name}:{}: `{word}` is a metaphor; CONVENTIONS.md has the rules for prose", i + 1));
        }
    }
    faults
}

/// A line without code in backticks and titles in asterisks.
fn without_quotations(line: &str) -> String {
    let outside = |text: &str, mark: char| -> String { text.split(mark).step_by(2).collect::<Vec<_>>().join(" ") };
    let code_free = outside(line, '`');
    let is_list = code_free.trim_start().starts_with("* ");
    if is_list { code_free } else { outside(&code_free.replace("**", ""), '*') }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headless_clauses_and_metaphors_are_found() {
        let page = "# What it costs\nA pixel tells its noise. What is left is small.\n## How it works\n";
        let found = check("a.md", page);
        assert_eq!(found.len(), 4, "{found:?}");
        assert!(found[0].starts_with("a.md:1:") && found[1].contains("headless"), "{found:?}");
        assert!(found[2].contains("tells") && found[3].starts_with("a.md:3:"), "{found:?}");
    }

    #[test]
    fn code_titles_and_other_files_are_left_out() {
        let page = "# Cost\n`tells` *What Every Computer Scientist Knows*\n```\nWhat tells\n```\n\n**Whole.** Plain.\n";
        assert_eq!(check("a.md", page), Vec::<String>::new());
        assert_eq!(check(RULES, "Nobody tells."), Vec::<String>::new());
        assert_eq!(check("a.rs", "// Nobody tells."), Vec::<String>::new());
    }
}
