//! Paths that a page names in backticks must exist.

/// Folders of the repository's root: a word that begins with one of them is a path, with or without an extension.
const ROOTS: [&str; 9] =
    ["crates/", "xtask/", "scenes/", "benches/", "tests/", "examples/", "validation/", "fuzz/", ".ci/"];

/// The named paths that `exists` denies.
pub(crate) fn check(page: &str, exists: impl Fn(&str) -> bool) -> Vec<String> {
    let missing = |path: &&str| looks_like_a_path(path) && !exists(path.trim_end_matches('/'));
    quoted(page).filter(missing).map(|path| format!("ARCHITECTURE.md: names `{path}`, which does not exist")).collect()
}

/// The text between single backticks on one line. Fenced blocks are skipped.
fn quoted(page: &str) -> impl Iterator<Item = &str> {
    let mut fenced = false;
    page.lines()
        .filter(move |line| {
            let fence = line.trim_start().starts_with("```");
            fenced ^= fence;
            !fenced && !fence
        })
        .flat_map(|line| line.split('`').skip(1).step_by(2))
}

fn looks_like_a_path(text: &str) -> bool {
    let clean = !text.contains(|c: char| c.is_whitespace() || "*<>{}()[]:|".contains(c));
    let named = ROOTS.iter().any(|root| text.starts_with(root));
    let extension = text.rsplit('/').next().is_some_and(|last| last.contains('.'));
    clean && text.contains('/') && !text.starts_with('/') && (named || extension || text.ends_with('/'))
}
