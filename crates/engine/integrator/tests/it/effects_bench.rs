//! The benchmark of the cost of effects: the effects of its cases, and the code that it lists. No instructions are
//! counted here.
//!
//! Replay: `cargo test -p dunkelfeld-integrator --test it effects_bench::NAME`.

#![allow(dead_code, reason = "the bench uses the rest")]

#[path = "../../../../../benches/effects/callgrind.rs"]
mod callgrind;
#[path = "../../../../../benches/effects/scene.rs"]
mod scene;
#[path = "../../../../../benches/effects/unused.rs"]
mod unused;

use dunkelfeld_scene::Effect;
use scene::Case;
use unused::{EFFECTS, begins};

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
