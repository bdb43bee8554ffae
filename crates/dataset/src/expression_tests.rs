//! Names and units of draws in formulas.

use super::*;
use crate::study::Study;
use toml::{Table, Value};

fn study(draws: &str, formula: &str) -> Result<Study, String> {
    let text = format!("scene = \"none\"\nx = {{ expression = \"{formula}\" }}\n[study]\n[study.draw]\n{draws}\n");
    Study::from_text("study.toml", &text).map_err(|e| e.to_string())
}

/// The values of the formula in the first images.
fn values(draws: &str, formula: &str) -> Vec<f64> {
    let study = study(draws, formula).unwrap_or_else(|e| panic!("{formula}: {e}"));
    let value = |index| {
        let job: Table = study.job(index).expect("a job").text.parse().expect("TOML");
        Quantity::of(&job["x"]).expect("a number").number
    };
    (0..3).map(value).collect()
}

#[test]
fn a_draw_that_a_formula_reads_in_another_way_is_refused_by_its_name() {
    for (name, formula) in [
        ("e", "2 * e"),
        ("E", "E+1"),
        ("PI", "sqrt(PI)"),
        ("TAU", "1/TAU"),
        ("π", "π"),
        ("τ", "2 * τ"),
        ("my-draw", "2 * my-draw"),
        ("max_load", "max_load + 1"),
        ("sin", "sin(sin)"),
        ("two words", "two words"),
    ] {
        let own = format!("{name:?} = {{ sequence = [3, 4, 5] }}\nmy = 100\ndraw = 1");
        let error = study(&own, formula).expect_err(formula);
        let words = format!("`{name}` is");
        assert!(error.contains(&words) && error.contains(&format!("{{{name}}}")), "{formula}: {error}");
        assert_eq!(values(&own, &format!("2 * {{{name}}}")), [6.0, 8.0, 10.0], "{name}");
    }
    // Without a draw of its name, a constant is one; numbers and longer names have no draw.
    let e = std::f64::consts::E;
    assert_eq!(values("load = 2", "load * e"), [2.0 * e; 3]);
    assert_eq!(values("e = 7\nload = 2\nlate = 1", "2 * load + late + sqrt(late)"), [6.0; 3]);
    assert_eq!(values("my = 5\ndraw = 3", "my-draw"), [2.0; 3]);
    let error = study("\"größe\" = 2", "größe").expect_err("a letter");
    assert!(error.contains("`größe` is not read as one name") && error.contains("{größe}"), "{error}");
    let error = study("load = 2", "1 +").expect_err("no formula");
    assert!(error.contains("[x] expression: not a formula") && error.contains("stands in braces"), "{error}");
}

#[test]
fn numbers_of_formulas_have_exponents() {
    let half = "load = 0.5";
    for (formula, expected) in [
        ("1e-5*2", 2e-5),
        ("1E2", 100.0),
        ("2.5e+1 - .5", 24.5),
        ("1.e1 + load", 10.5),
        ("3-1e0", 2.0),
        ("max(1e1, 2)", 10.0),
        ("e1 + 1", 8.0),
        ("2 * e", 2.0 * std::f64::consts::E),
    ] {
        assert_eq!(values(&format!("{half}\ne1 = 7"), formula), [expected; 3], "{formula}");
    }
    for formula in ["1e", "2e+", "1.2.3", "."] {
        assert!(study(half, formula).is_err(), "{formula}");
    }
}

#[test]
fn functions_and_operators_stay_what_they_are() {
    for (name, formula, expected) in
        [("sqrt", "sqrt(4)", 2.0), ("sqrt", "sqrt ({sqrt})", 3.0), ("-", "5 - 2", 3.0), ("*", "5 * {*}", 45.0)]
    {
        assert_eq!(values(&format!("{name:?} = 9"), formula), [expected; 3], "{name}: {formula}");
    }
    let error = study("sqrt = 9", "2 * sqrt").expect_err("no function");
    assert!(error.contains("`sqrt` is") && error.contains("{sqrt}"), "{error}");
}

#[test]
fn formulas_of_all_parts_of_a_study_are_checked() {
    for part in [
        "[study.draw]\nb = { expression = \"2 * e\" }",
        "[[study.place]]\nobjects = { expression = \"2 * e\" }",
        "[[study.defect]]\ncount = { choice = [1, { expression = \"2 * e\" }], weights = [1, 0] }",
        "camera = [{ sequence = [1, { expression = \"2 * e\" }] }]",
    ] {
        let text = format!("scene = \"none\"\n[study]\ndraw.e = 3\n{}", part.replace("[study.draw]\n", "draw."));
        let error = Study::from_text("study.toml", &text).expect_err(part).to_string();
        assert!(error.contains("`e` is a constant"), "{part}: {error}");
    }
}

#[test]
fn a_draw_counts_in_one_unit() {
    for (draw, expected) in [
        ("{ sequence = [\"1us\", \"1ms\", \"2s\"] }", [1.0, 1e3, 2e6]),
        ("{ sequence = [\"1mm\", \"2cm\", 0] }", [1.0, 20.0, 0.0]),
        ("{ sequence = [0, \"2cm\", \"1mm\"] }", [0.0, 2.0, 0.1]),
        ("{ sequence = [{ uniform = [\"3m\", \"3m\"] }, { draw = \"b\" }, \"1m\"] }", [3.0, 0.005, 1.0]),
        ("{ sequence = [\"3deg\", \"5deg\", \"1deg\"] }", [3.0, 5.0, 1.0]),
        ("{ draw = \"c\" }", [1.0, 1e-3, 1.0]),
    ] {
        let draws =
            format!("b = {{ expression = \"5\", unit = \"mm\" }}\nc = {{ sequence = [\"1ms\", \"1us\"] }}\na = {draw}");
        assert_eq!(values(&draws, "a"), expected, "{draw}");
        // The value itself is as it is written.
        let text = study(&draws, "a").expect("a study").job(0).expect("a job").drawn["draw.a"].clone();
        assert!(
            draw.contains("draw") || draw.contains(&text.to_string()) || text == Value::String("0".into()),
            "{text}"
        );
    }
    // A range of plain zeros has any unit.
    assert_eq!(values("a = { sequence = [{ uniform = [0, 0] }, \"1mm\", \"2cm\"] }", "a"), [0.0, 1.0, 20.0]);
    for draw in [
        "{ choice = [\"1mm\", \"1s\"], weights = [1, 0] }",
        "{ choice = [\"1mm\", 2], weights = [1, 0] }",
        "{ sequence = [\"1deg\", \"1rad\"] }",
        "{ choice = [\"1mm\", { draw = \"b\" }], weights = [1, 0] }",
    ] {
        let draws = format!("b = {{ uniform = [\"1s\", \"2s\"] }}\na = {draw}");
        let error = study(&draws, "2 * a").expect_err(draw);
        assert!(error.contains("the draw `a` has values in") && error.contains("of one kind"), "{error}");
        // Without a formula the units may differ.
        assert_eq!(values(&draws, "b"), values(&draws, "b"));
    }
}

#[test]
fn nested_draws_take_time_in_proportion_to_their_number() {
    // Two branches at each of 40 levels: 2^40 ways to the last draw.
    let level = |k: usize| format!("a{k} = {{ choice = [{{ draw = \"a{0}\" }}, {{ draw = \"a{0}\" }}] }}\n", k + 1);
    let draws: String = (0..40).map(level).chain(["a40 = 7".into()]).collect();
    assert_eq!(values(&draws, "2 * a0"), [14.0; 3]);
    let study = study(&draws, "a0").expect("a study");
    let name = study.named_template("a0").expect("a draw");
    assert_eq!(study.alternatives_of(name).len(), 4096);
}
