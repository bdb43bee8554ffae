//! "Did you mean ...?": the supported names nearest to an unknown one.

use strsim::osa_distance;

/// The supported names nearest to `name`, best first. The result has at most three names, and only those that a typing
/// error explains.
///
/// The distance is the edit distance with swaps of neighbours (optimal string alignment: Damerau 1964, Levenshtein
/// 1966), without regard to case. A name that contains the other counts as near as well.
pub fn nearest_names<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    // A longer name is no spelling error, and the quadratic cost would be noticeable.
    const LONGEST: usize = 200;
    let shortened = |name: &str| name.to_lowercase().chars().take(LONGEST).collect::<String>();
    let wanted = shortened(name);
    let mut scored: Vec<(usize, &str)> = known
        .into_iter()
        .filter_map(|candidate| {
            let lower = shortened(candidate);
            let [length, lower_length] = [&wanted, &lower].map(|text| text.chars().count());
            let distance = osa_distance(&wanted, &lower);
            let contained = length >= 3 && lower_length >= 3 && (lower.contains(&wanted) || wanted.contains(&lower));
            let near = distance <= 1 + length.max(lower_length) / 4;
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
    fn suggestions_read_well() {
        assert_eq!(suggestion("pmna", "materials", &["pmma", "film"]), "did you mean \"pmma\"?");
        assert_eq!(suggestion("x", "materials", &["pmma", "film"]), "known materials: \"pmma\", \"film\"");
        assert_eq!(suggestion("x", "materials", &[]), "there are no materials");
    }
}
