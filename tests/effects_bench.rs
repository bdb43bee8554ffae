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
#[path = "../benches/effects/unused.rs"]
mod unused;

use callgrind::{Lines, Price, Run, lines, price};
use dunkelfeld_scene::Effect;
use scene::Case;
use table::{BEGIN, END, Row, markdown, replaced};
use unused::{EFFECTS, Part, begins, parts, sums};

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
fn the_profile_of_callgrind_is_read() {
    let profile = "# callgrind format\ncmd: effects --render=plain\npositions: line\nevents: Ir\nsummary: 999\n\n\
                   fl=/p/a.rs\nfn=outer\n3 5\nfi=/p/b.rs\n7 2\nfe=/p/a.rs\n4 1\ncfi=/p/c.rs\ncfn=inner\n\
                   calls=2 9\n4 300\n3 10\n\nfl=/p/c.rs\nfn=inner\n9 300\n\ntotals: 999\n";
    assert_eq!(
        lines(profile),
        profile_of([("/p/a.rs", 3, 15), ("/p/a.rs", 4, 1), ("/p/b.rs", 7, 2), ("/p/c.rs", 9, 300)])
    );
}

fn profile_of<N, const K: usize>(costs: [(&str, u32, N); K]) -> Lines<N> {
    costs.into_iter().map(|(file, line, cost)| ((file.into(), line), cost)).collect()
}

#[test]
fn constant_costs_cancel() {
    let run = |samples: u64| Run {
        lines: profile_of([("start", 1, 1_000_000), ("path", 2, 250 * samples)]),
        image: format!("{samples} samples"),
    };
    let found = price(&run(64), &run(128), 64).expect("it grows");
    let lines = profile_of([("start", 1, 0.0), ("path", 2, 250.0)]);
    assert_eq!(found, Price { instructions: 250.0, lines, image: "128 samples".into() });
    assert!(price(&run(64), &run(64), 64).is_err() && price(&run(64), &run(63), 64).is_err());
    assert!(price(&run(64), &run(128), 0).is_err());
}

#[test]
fn instructions_are_those_of_effects_by_file_function_and_test() {
    let text = "fn wave() {\n    if scene.has_chance() {\n    }\n    next();\n}\n\
                    fn arrive<F>(\n    ray: F,\n) {\n    next();\n}\nfn reach() {\n}\n";
    let [s, e, t] = [Part::Shared, Part::Effect, Part::Test];
    assert_eq!(parts("/p/integrator/src/wavefront/mod.rs", text), [s, t, s, s, s, e, e, e, e, e, s, s]);
    assert!(parts("/p/integrator/src/mnee/mod.rs", text).iter().all(|part| *part == e));
    let costs = [("/p/integrator/src/wavefront/mod.rs", 2, 1.0), ("/p/integrator/src/wavefront/mod.rs", 4, 2.0)];
    let more = [("/p/integrator/src/wavefront/mod.rs", 9, 4.0), ("/p/core.rs", 3, 8.0)];
    let lines: Lines<f64> = profile_of(costs).into_iter().chain(profile_of(more)).collect();
    assert_eq!(sums(&lines, |file| (file != "/p/core.rs").then(|| text.into())), [2.0, 4.0, 1.0, 8.0]);
}

#[test]
fn listed_code_exists() {
    let crates = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    for (path, functions) in EFFECTS {
        let at = crates.join(path);
        assert!(at.exists(), "{path}");
        for name in functions {
            let text = std::fs::read_to_string(&at).expect("a file");
            assert!(begins(&text, name), "{path}: {name}");
        }
    }
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
