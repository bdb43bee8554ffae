//! Distributions against their closed forms, and refusals.

use super::*;
use dunkelfeld_testkit::chi_squared;
use std::collections::BTreeMap;

/// Each test compares with at most 20 bins; ten tests of this rate stay below 1e-7 together.
const RATE: f64 = 1e-8;
const IMAGES: u64 = 20_000;

struct NoDraws;

impl Named for NoDraws {
    fn value(&mut self, name: &str) -> Result<Value, Fault> {
        Err(Fault::new(format!("no draw {name}"), "none"))
    }
}

fn template(text: &str) -> Result<Template, Fault> {
    let mut table: Table = format!("x = {text}").parse().expect("TOML");
    Template::parse(table.remove("x").expect("a value"))
}

fn draw(template: &Template, index: u64) -> Value {
    template.draw(Draws { seed: 7, index }, "x", &mut NoDraws, &mut |_, _| {}).expect("a value")
}

/// The share of images below each limit, as counts of bins, against the probabilities of a cumulative distribution.
fn check(text: &str, unit: &str, limits: &[f64], cdf: impl Fn(f64) -> f64) {
    let template = template(text).expect("a distribution");
    let mut counts = vec![0u64; limits.len() + 1];
    for index in 0..IMAGES {
        let value = draw(&template, index);
        let quantity = Quantity::of(&value).expect("a quantity");
        assert_eq!(quantity.unit, unit, "{value}");
        counts[limits.iter().filter(|limit| quantity.number >= **limit).count()] += 1;
    }
    let mut edges = vec![0.0];
    edges.extend(limits.iter().map(|limit| cdf(*limit)));
    edges.push(1.0);
    let expected: Vec<f64> = edges.windows(2).map(|w| (w[1] - w[0]) * IMAGES as f64).collect();
    chi_squared(&counts, &expected).assert(RATE, text);
}

fn phi(z: f64) -> f64 {
    Normal::standard().cdf(z)
}

#[test]
fn draws_follow_their_distributions() {
    check("{ uniform = [2, 4] }", "", &[2.25, 2.5, 3.0, 3.5, 3.9], |x| (x - 2.0) / 2.0);
    check("{ uniform = [0, \"5mm\"] }", "mm", &[1.0, 2.0, 3.0, 4.0], |x| x / 5.0);
    check("{ uniform = [\"1mm\", \"1cm\"] }", "mm", &[2.0, 5.5, 8.0], |x| (x - 1.0) / 9.0);
    check("{ log_uniform = [\"1ms\", \"100ms\"] }", "ms", &[2.0, 5.0, 10.0, 50.0], |x| x.ln() / 100f64.ln());
    check("{ normal = [\"10W\", \"2W\"] }", "W", &[6.0, 8.0, 10.0, 11.0, 14.0], |x| phi((x - 10.0) / 2.0));
    let (low, high) = (phi(-0.5), phi(1.0));
    check("{ normal = [0, 1], min = -0.5, max = 1 }", "", &[-0.3, 0.0, 0.5, 0.9], |x| (phi(x) - low) / (high - low));
    // A tail in which the quantiles need the precision of the other side.
    let tail = phi(-6.0) - phi(-7.0);
    check("{ normal = [0, 1], min = 5, max = 6 }", "", &[5.1, 5.2, 5.5], |x| {
        (phi(-5.0) - phi(-x)) / (phi(-5.0) - phi(-6.0))
    });
    assert!(tail > 0.0);
    check("{ log_normal = [3, 2] }", "", &[1.0, 2.0, 3.0, 6.0, 12.0], |x| phi((x / 3.0).ln() / 2f64.ln()));
    check("{ integer = [-1, 3] }", "", &[-0.5, 0.5, 1.5, 2.5], |x| (x + 1.5) / 5.0);
    check("{ choice = [1, 2, 3], weights = [1, 0, 3] }", "", &[1.5, 2.5], |_| 0.25);
}

#[test]
fn sequences_take_their_values_in_turn() {
    let template = template("{ sequence = [\"a\", \"b\", { uniform = [1, 1] }], repeat = 2 }").expect("a sequence");
    let values: Vec<String> = (0..8).map(|index| draw(&template, index).to_string()).collect();
    assert_eq!(values, ["\"a\"", "\"a\"", "\"b\"", "\"b\"", "1.0", "1.0", "\"a\"", "\"a\""]);
}

/// The draw `n` is the index of the image, and `q` a quarter of it.
struct Index(u64);

impl Named for Index {
    fn value(&mut self, name: &str) -> Result<Value, Fault> {
        match name {
            "n" => Ok(Value::Integer(self.0 as i64)),
            "q" => Ok(Value::Float(self.0 as f64 / 4.0)),
            _ => NoDraws.value(name),
        }
    }
}

/// Rounding to integers has closed forms in whole numbers: floor(i / 4) = i div 4, ceil(i / 4) = (i + 3) div 4, and
/// round(i / 4) = (i + 2) div 4 from 0 on, because halves are rounded up.
#[test]
fn formulas_with_whole_values_are_integers() {
    let value = |text: &str, i: u64| {
        let template = template(text).expect("a formula");
        template.draw(Draws { seed: 7, index: i }, "x", &mut Index(i), &mut |_, _| {}).expect("a value")
    };
    for i in 0..20u64 {
        let whole = |n: u64| Value::Integer(n as i64);
        assert_eq!(value("{ expression = \"floor(q)\" }", i), whole(i / 4));
        assert_eq!(value("{ expression = \"ceil(q)\" }", i), whole(i.div_ceil(4)));
        assert_eq!(value("{ expression = \"round(q)\" }", i), whole((i + 2) / 4));
        assert_eq!(value("{ expression = \"2 * n + 1\" }", i), whole(2 * i + 1));
        let quarter = value("{ expression = \"q\" }", i);
        assert_eq!(quarter.is_integer(), i % 4 == 0, "{quarter}");
        assert_eq!(Quantity::of(&quarter).map(|q| q.number), Some(i as f64 / 4.0));
    }
    assert_eq!(value("{ expression = \"4 * q\", unit = \"mm\" }", 3), Value::String("3mm".into()));
    assert_eq!(value("{ expression = \"-n\" }", 0), Value::Integer(0));
    // Beyond 2^53 not all whole numbers are numbers of f64.
    assert!(value("{ expression = \"2^60\" }", 0).is_float());
}

#[test]
fn a_draw_depends_on_seed_index_and_name_alone() {
    let several = template("[{ uniform = [0, 1] }, 5, { uniform = [0, 1] }]").expect("a list");
    let mut names = BTreeMap::new();
    let value = several
        .draw(Draws { seed: 7, index: 3 }, "light[rear].power", &mut NoDraws, &mut |name, value| {
            names.insert(name.to_owned(), value.clone());
        })
        .expect("values");
    assert_eq!(names.keys().collect::<Vec<_>>(), ["light[rear].power[0]", "light[rear].power[2]"]);
    let list = value.as_array().expect("a list");
    assert_ne!(list[0], list[2], "each part has its own number");
    let alone = template("{ uniform = [0, 1] }").expect("a distribution");
    let draws = Draws { seed: 7, index: 3 };
    let again = alone.draw(draws, "light[rear].power[2]", &mut NoDraws, &mut |_, _| {}).expect("a value");
    assert_eq!(again, list[2], "other entries change nothing");
    for other in [Draws { seed: 8, ..draws }, Draws { index: 4, ..draws }] {
        assert_ne!(alone.draw(other, "light[rear].power[2]", &mut NoDraws, &mut |_, _| {}).expect("a value"), again);
    }
}

#[test]
fn entries_of_one_name_have_their_own_numbers() {
    let cubes =
        template("[{ name = \"cube\", x = { uniform = [0, 1] } }, { name = \"cube\", x = { uniform = [0, 1] } }]");
    let mut names = Vec::new();
    let value = cubes.expect("a list").draw(Draws { seed: 7, index: 3 }, "object", &mut NoDraws, &mut |name, _| {
        names.push(name.to_owned());
    });
    assert_eq!(names, ["object[cube].x", "object[cube #2].x"]);
    let value = value.expect("values");
    assert_ne!(value[0]["x"], value[1]["x"]);
}

#[test]
fn numbers_of_neighbouring_images_are_independent() {
    // Pairs of neighbours on a grid of 4 x 4 cells.
    let template = template("{ uniform = [0, 1] }").expect("a distribution");
    let numbers: Vec<f64> = (0..IMAGES).map(|i| Quantity::of(&draw(&template, i)).expect("a number").number).collect();
    let mut counts = vec![0u64; 16];
    for pair in numbers.chunks_exact(2) {
        counts[(pair[0] * 4.0) as usize * 4 + (pair[1] * 4.0) as usize] += 1;
    }
    chi_squared(&counts, &[IMAGES as f64 / 32.0; 16]).assert(RATE, "neighbours");
}

#[test]
fn impossible_distributions_are_refused_with_their_place() {
    for (text, place, words) in [
        ("{ uniform = [2, 1] }", "uniform", "above the upper end"),
        ("{ uniform = [\"1mm\", \"2s\"] }", "uniform", "differ"),
        ("{ uniform = [1] }", "uniform", "two finite numbers"),
        ("{ uniform = [1, 2], min = 0 }", "min", "unknown key"),
        ("{ uniform = [1, inf] }", "uniform", "two finite numbers"),
        ("{ uniform = [-1e308, 1e308] }", "uniform", "wider than numbers reach"),
        ("{ choice = [1, 2], weights = [1e308, 1e308] }", "weights", "sum above 0"),
        ("{ integer = [1, 2.5] }", "integer", "whole numbers"),
        ("{ log_uniform = [0, 1] }", "log_uniform", "above zero"),
        ("{ normal = [0, 0] }", "normal", "above zero"),
        ("{ normal = [0, 1], min = 3, max = 2 }", "max", "not below"),
        ("{ normal = [0, 1], min = 20, max = 21 }", "", "1e-9"),
        ("{ normal = [\"1mm\", \"1mm\"], min = \"0s\" }", "min", "not a finite quantity in \"mm\""),
        ("{ log_normal = [1, 0.5] }", "log_normal", "factor above 1"),
        ("{ choice = [] }", "choice", "empty"),
        ("{ choice = 3 }", "choice", "list"),
        ("{ choice = [1, 2], weights = [1] }", "weights", "1 weights for 2"),
        ("{ choice = [1, 2], weights = [0, 0] }", "weights", "sum above 0"),
        ("{ choice = [1, { uniform = [2, 1] }] }", "choice.1.uniform", "above"),
        ("{ sequence = [1], repeat = 0 }", "repeat", "from 1"),
        ("{ draw = 3 }", "draw", "name"),
        ("{ expression = \"1 + 1\", unit = 3 }", "unit", "not a unit"),
        ("[1, { uniform = [2, 1] }]", "1.uniform", "above"),
        ("{ a = { uniform = [2, 1] } }", "a.uniform", "above"),
    ] {
        let fault = template(text).expect_err(text);
        assert_eq!(fault.path.join("."), place, "{text}");
        assert!(fault.problem.contains(words), "{text}: {}", fault.problem);
        assert!(!fault.help.is_empty());
    }
    let unknown = template("{ expression = \"2 * load\" }").expect("a formula");
    unknown.draw(Draws { seed: 0, index: 0 }, "x", &mut NoDraws, &mut |_, _| {}).expect_err("no such draw");
}
