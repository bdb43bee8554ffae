//! Names and units of draws in formulas.

use crate::quantity::Quantity;
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
fn a_draw_that_a_formula_reads_in_another_way_is_refused() {
    for name in
        ["e", "E", "PI", "TAU", "π", "τ", "my-draw", "max_load", "sin", "sqrt", "two words", "{a}", "-", "größe", ""]
    {
        let error = study(&format!("{name:?} = 3"), "1").expect_err(name);
        assert!(error.contains("[study.draw]") && error.contains("as the name of a draw"), "{name}: {error}");
    }
    // Constants, functions, and longer names with them.
    let e = std::f64::consts::E;
    assert_eq!(values("load = 2", "load * e"), [2.0 * e; 3]);
    assert_eq!(values("load = 2\nlate = 1", "2 * load + late + sqrt(late)"), [5.0 + 1.0; 3]);
    assert_eq!(values("my = 5\ndraw = 3", "my-draw"), [2.0; 3]);
    let error = study("load = 2", "1 +").expect_err("no formula");
    assert!(error.contains("[x] expression: not a formula"), "{error}");
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
    for draw in [
        "{ sequence = [\"1mm\", \"1s\"] }",
        "{ sequence = [\"1mm\", 2] }",
        "{ sequence = [\"1mm\", { draw = \"b\" }] }",
    ] {
        let study = study(&format!("b = {{ uniform = [\"1s\", \"2s\"] }}\na = {draw}"), "2 * a").expect("image 0");
        let error = study.job(1).expect_err(draw).to_string();
        assert!(error.contains("the draw `a` is") && error.contains("of one kind"), "{error}");
    }
}
