//! The benchmark of the cost of effects: its arithmetic, and the effects of its cases. No instructions are counted
//! here.
//!
//! Replay: `cargo test -p dunkelfeld-integrator --test effects_bench NAME`.

#![allow(dead_code, reason = "the bench uses the rest")]

#[path = "../benches/effects/callgrind.rs"]
mod callgrind;
#[path = "../benches/effects/scene.rs"]
mod scene;
#[path = "../benches/effects/table.rs"]
mod table;

use callgrind::{Price, Run, collected, price};
use dunkelfeld_scene::Effect;
use scene::Case;
use table::{BEGIN, END, Row, markdown, replaced};

#[test]
fn the_plain_scene_needs_techniques_only() {
    let scene = Case::Plain.scene().expect("it can be built");
    for effect in Effect::ALL {
        let users = scene.effects().users(effect);
        let is_used = matches!(effect, Effect::EveryLight | Effect::LearnedRoulette);
        assert_eq!(!users.is_empty(), is_used, "{}: {users:?}", effect.name());
    }
    assert_eq!(scene.summary().placed_triangles, 4 * 2 + 81 * 12 + 3 * 2);
}

/// A case uses its effect, and no other effect but its parts.
#[test]
fn each_case_needs_its_effect() {
    for effect in Effect::ALL {
        let scene = Case::Effect(effect).scene().expect("it can be built");
        assert!(scene.effects().has(effect), "{} is not used", effect.name());
        if effect.is_technique() {
            let without = Case::Without(effect).scene().expect("it can be left out");
            assert!(!without.effects().has(effect), "{} is not left out", effect.name());
            assert_eq!(scene.summary(), without.summary(), "{}: not the same scene", effect.name());
        }
        let brought: &[Effect] = match effect {
            Effect::Textures | Effect::Coverage | Effect::VertexColors => &[Effect::Color, Effect::Textures],
            Effect::Nesting | Effect::Absorption | Effect::Scattering | Effect::CoverConnection => {
                &[Effect::SmoothRefraction]
            }
            _ => &[],
        };
        for other in Effect::ALL.into_iter().filter(|o| *o != effect && !o.is_technique()) {
            assert!(
                !scene.effects().has(other) || brought.contains(&other),
                "{} brings {}",
                effect.name(),
                other.name()
            );
        }
    }
}

#[test]
fn cases_have_names_of_their_own() {
    let mut names: Vec<String> = Case::all().into_iter().map(Case::name).collect();
    let count = names.len();
    let techniques = Effect::ALL.into_iter().filter(|e| e.is_technique()).count();
    assert_eq!(count, 1 + Effect::ALL.len() + techniques);
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), count);
}

// --- Arithmetic and text ------------------------------------------------------------------------------------------------

#[test]
fn the_report_of_callgrind_is_read() {
    let report = "==7== Callgrind, a call-graph generating cache profiler\n==7== \n==7== Events    : Ir\n\
                  ==7== Collected : 215764312\n==7== \n==7== I   refs:      215,764,312\n";
    assert_eq!(collected(report), Some(215_764_312));
    assert_eq!(collected("==7== Collected : many\n"), None);
    assert_eq!(collected(""), None);
}

#[test]
fn constant_costs_cancel() {
    let run = |samples: u64| Run { instructions: 1_000_000 + 250 * samples, image: format!("{samples} samples") };
    let price = price(&run(64), &run(128), 64).expect("it grows");
    assert_eq!(price, Price { instructions: 250.0, image: "128 samples".into() });
}

#[test]
fn runs_that_do_not_grow_have_no_price() {
    let run = |instructions| Run { instructions, image: String::new() };
    assert!(price(&run(10), &run(10), 4).is_err() && price(&run(10), &run(9), 4).is_err());
    assert!(price(&run(10), &run(20), 0).is_err());
}

fn row(instructions: f64, same_image: bool) -> Row {
    let how = "a millionth".into();
    Row { name: "sheen".into(), how, instructions, against: 8000.0, same_image }
}

#[test]
fn prices_are_shares_of_what_they_are_compared_with() {
    assert!((row(8200.0, true).percent() - 2.5).abs() < 1e-9);
    assert!((row(7600.0, true).percent() + 5.0).abs() < 1e-9);
    let text = markdown(&[row(8200.4, false), row(7600.0, true)]);
    assert!(text.contains("| `sheen` | a millionth | 8200 | +2.5 % | up to noise |\n"), "{text}");
    assert!(text.contains("| 7600 | -5.0 % | to the last bit |\n"), "{text}");
    let columns: Vec<usize> = text.lines().map(|line| line.matches('|').count()).collect();
    assert_eq!(columns, [6; 4], "{text}");
}

#[test]
fn only_what_stands_between_the_marks_is_replaced() {
    let page = format!("# Page\n\n{BEGIN}\nold\n{END}\n\ntail\n");
    let new = replaced(&page, "| new |\n").expect("the page has marks");
    assert_eq!(new, format!("# Page\n\n{BEGIN}\n\n| new |\n\n{END}\n\ntail\n"));
    assert_eq!(replaced(&new, "| new |\n").expect("it still has"), new, "once is as good as twice");
    for unmarked in ["no marks", BEGIN, &format!("{END}{BEGIN}")] {
        assert!(replaced(unmarked, "x").is_err_and(|e| e.contains("help")), "{unmarked}");
    }
}
