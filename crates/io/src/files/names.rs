//! "Did you mean ...?": the supported names nearest to an unknown one.

/// The supported names nearest to `name`, best first. The result has at most three names, and only those that a typing
/// error explains.
///
/// The distance is the edit distance with swaps of neighbours (optimal string alignment: Damerau 1964, Levenshtein
/// 1966), without regard to case. A name that contains the other counts as near as well.
pub fn nearest_names<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    // A longer name is no spelling error, and the quadratic cost would be noticeable.
    const LONGEST: usize = 200;
    let wanted: Vec<char> = name.to_lowercase().chars().take(LONGEST).collect();
    let wanted_text: String = wanted.iter().collect();
    let mut scored: Vec<(usize, &str)> = known
        .into_iter()
        .filter_map(|candidate| {
            let lower: Vec<char> = candidate.to_lowercase().chars().take(LONGEST).collect();
            let lower_text: String = lower.iter().collect();
            let distance = edit_distance(&wanted, &lower);
            let contained = wanted.len() >= 3
                && lower.len() >= 3
                && (lower_text.contains(&wanted_text) || wanted_text.contains(&lower_text));
            let near = distance <= 1 + wanted.len().max(lower.len()) / 4;
            (near || contained).then_some((distance, candidate))
        })
        .collect();
    scored.sort();
    scored.dedup();
    scored.truncate(3);
    scored.into_iter().map(|(_, candidate)| candidate).collect()
}

/// A sentence for the help of an error: the nearest supported names, or all of them if there are few.
pub fn suggestion(name: &str, what: &str, known: &[&str]) -> String {
    let quoted = |names: &[&str]| names.iter().map(|n| format!("\"{n}\"")).collect::<Vec<_>>().join(", ");
    let near = nearest_names(name, known.iter().copied());
    match (near.as_slice(), known.len()) {
        (_, 0) => format!("there are no {what}"),
        ([], 1..=24) => format!("known {what}: {}", quoted(known)),
        ([], n) => format!("there are {n} {what}, none with a similar name; some are {}", quoted(&known[..12])),
        (near, _) => {
            format!("did you mean {}?", near.iter().map(|n| format!("\"{n}\"")).collect::<Vec<_>>().join(" or "))
        }
    }
}

fn edit_distance(a: &[char], b: &[char]) -> usize {
    let mut before: Vec<usize> = vec![0; b.len() + 1];
    let mut last: Vec<usize> = (0..=b.len()).collect();
    for i in 1..=a.len() {
        let mut row = vec![i; b.len() + 1];
        for j in 1..=b.len() {
            let change = last[j - 1] + usize::from(a[i - 1] != b[j - 1]);
            row[j] = change.min(last[j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                row[j] = row[j].min(before[j - 2] + 1);
            }
        }
        before = std::mem::replace(&mut last, row);
    }
    last[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_recognised_and_strangers_are_not() {
        let known = ["width", "height", "scene", "camera"];
        assert_eq!(nearest_names("widht", known), ["width"]);
        assert_eq!(nearest_names("Scene", known), ["scene"]);
        assert_eq!(nearest_names("camera_name", known), ["camera"]);
        assert!(nearest_names("exposure", known).is_empty());
        assert!(nearest_names("", []).is_empty());
    }

    #[test]
    fn distance_counts_single_edits() {
        let d = |a: &str, b: &str| edit_distance(&a.chars().collect::<Vec<_>>(), &b.chars().collect::<Vec<_>>());
        assert_eq!(d("", "abc"), 3);
        assert_eq!(d("abc", "abc"), 0);
        assert_eq!(d("kitten", "sitting"), 3);
        assert_eq!(d("widht", "width"), 1);
    }

    #[test]
    fn suggestions_read_well() {
        assert_eq!(suggestion("pmna", "materials", &["pmma", "film"]), "did you mean \"pmma\"?");
        assert_eq!(suggestion("x", "materials", &["pmma", "film"]), "known materials: \"pmma\", \"film\"");
        assert_eq!(suggestion("x", "materials", &[]), "there are no materials");
    }
}
