//! Entries of defects: numbers by draws and formulas, and keys that a kind does not use.

use super::*;
use dunkelfeld_geometry::DVec3;

fn study(draws: &str, entry: &str) -> Result<Study, dunkelfeld::Error> {
    let text = format!("scene = \"none\"\n[study]\n[study.draw]\n{draws}\n[[study.defect]]\non = \"plate\"\n{entry}\n");
    Study::from_text("study.toml", &text)
}

/// The numbers of defects of the first images.
fn numbers(draws: &str, count: &str) -> Vec<u32> {
    let study = study(draws, &format!("kind = \"dust\"\nlength = \"1mm\"\ncount = {count}")).expect("a study");
    let entry = entries(&study).expect("entries").remove(0);
    let number = |index| {
        let draws = study.draws(index);
        entry.number(draws, &mut study.named(draws), &mut |_, _| {}).expect("a number")
    };
    (0..12).map(number).collect()
}

#[test]
fn draws_and_formulas_give_numbers_of_defects() {
    let turn = "n = { sequence = [0, 1, 2, 5] }";
    let in_turn = [0, 1, 2, 5, 0, 1, 2, 5, 0, 1, 2, 5];
    assert_eq!(numbers(turn, "{ draw = \"n\" }"), in_turn.to_vec());
    assert_eq!(numbers(turn, "{ expression = \"2 * n + 1\" }"), in_turn.map(|n| 2 * n + 1).to_vec());
    assert_eq!(numbers(turn, "{ expression = \"floor(n / 2)\" }"), in_turn.map(|n| n / 2).to_vec());
    let chain = format!("{turn}\nm = {{ draw = \"n\" }}");
    assert_eq!(numbers(&chain, "{ choice = [{ draw = \"m\" }, 3], weights = [1, 0] }"), in_turn.to_vec());
    let formula = format!("{turn}\nm = {{ expression = \"n * n\" }}");
    assert_eq!(numbers(&formula, "{ draw = \"m\" }"), in_turn.map(|n| n * n).to_vec());
}

#[test]
fn numbers_of_defects_that_are_not_whole_are_refused_with_the_draw() {
    for (draws, count, words) in [
        ("n = { sequence = [0.5] }", "{ draw = \"n\" }", "is 0.5, by the draw `n`"),
        ("n = { integer = [1001, 1002] }", "{ draw = \"n\" }", "is 100"),
        ("n = { integer = [-2, -1] }\nm = { draw = \"n\" }", "{ draw = \"m\" }", ", by the draw `m`"),
        ("n = { sequence = [1, 3] }\nm = { expression = \"-n\" }", "{ draw = \"m\" }", "is -1, by the draw `m`"),
        ("n = { sequence = [1, 3] }", "{ expression = \"n / 2\" }", "\"dust\" is 0.5"),
        ("n = { sequence = [1, 3] }\nm = { expression = \"n / 2\" }", "{ draw = \"m\" }", "is 0.5, by the draw `m`"),
        (
            "n = { sequence = [1, 3] }",
            "{ expression = \"400 * n\" }",
            "image 1: the number of defects \"dust\" is 1200",
        ),
        ("n = { sequence = [1, 3] }", "{ expression = \"n\", unit = \"mm\" }", "is \"1mm\""),
    ] {
        let study = study(draws, &format!("kind = \"dust\"\nlength = \"1mm\"\ncount = {count}")).expect("a study");
        let error = study.check_jobs(4).expect_err(count).to_string();
        assert!(error.contains(words) && error.contains("[[study.defect]] 1, count"), "{count}: {error}");
    }
}

#[test]
fn a_key_that_the_kind_does_not_use_is_refused() {
    for (kind, key, known) in [
        ("stain", "width", "length, strength, roughness, color, metallic, facing"),
        ("dust", "depth", "length, roughness, color, metallic, facing"),
        ("scratch", "strength", "length, width, depth, angle, curvature, burr, roughness, color, metallic, facing"),
        ("dent", "angle", "length, depth, roughness, color, metallic, facing"),
        ("bubble", "color", "length, roughness"),
        ("missing", "length", "none"),
        ("faded", "facing", "strength"),
        ("shifted", "roughness", "length, angle"),
        ("fibre", "lenght", "did you mean `length`?"),
    ] {
        let study = study("", &format!("kind = \"{kind}\"\n{key} = 1")).expect("a study");
        let entry = entries(&study).expect("entries").remove(0);
        let draws = study.draws(0);
        let fault = entry.draw("", draws, &mut study.named(draws), &mut |_, _| {}).expect_err(kind);
        assert_eq!(fault.path, [key], "{fault:?}");
        assert!(fault.help.contains(known), "{fault:?}");
    }
}

#[test]
fn errors_of_draws_have_their_names() {
    for (draws, words) in [
        ("load = { uniform = [2, 1] }", "[study.draw] load"),
        ("load = { expression = \"1 +\" }", "[study.draw] load"),
        ("load = { sequence = [1] }\ninverse = { expression = \"1 / (load - load)\" }", "[study.draw] inverse"),
        ("load = { expression = \"2 * lode\" }", "[study.draw] load"),
        ("load = { choice = [1, 2], weights = [1] }", "[study.draw] load"),
    ] {
        let error = study(draws, "kind = \"missing\"").expect_err(draws).to_string();
        assert!(error.contains(words), "{draws}: {error}");
    }
    // At the key that refers to the draw.
    let draws = "load = { sequence = [1] }\ninverse = { expression = \"1 / (load - load)\" }";
    let study = Study::from_text(
        "study.toml",
        &format!("scene = \"none\"\n[study]\n[study.draw]\n{draws}\n[budget]\nspp = {{ draw = \"inverse\" }}\n"),
    );
    let error = study.expect_err("infinite").to_string();
    assert!(error.contains("[budget] spp") && error.contains("in the draw `inverse`"), "{error}");
}

/// A part that is changed and carries dust, with the entries in both orders: the record of the first image.
fn both_orders(change: &str) -> [(Vec<AddedDefect>, BTreeMap<String, Value>, SceneBuilder); 2] {
    let dust = "[[study.defect]]\nkind = \"dust\"\non = \"part\"\nfacing = [0, 1, 0]\nlength = \"1mm\"\n";
    [format!("{dust}{change}"), format!("{change}{dust}")].map(|defects| {
        let study = Study::from_text("study.toml", &format!("scene = \"none\"\n[study]\n{defects}")).expect("a study");
        let mut scene = SceneBuilder::default();
        let material = scene.add_material(dunkelfeld_scene::Material::default());
        let corner = dunkelfeld_geometry::Vec3::splat(0.01);
        scene.add_object("part", dunkelfeld_scene::shapes::cuboid(-corner, corner * 2.0), material);
        let mut drawn = BTreeMap::new();
        let added = add_defects(&entries(&study).expect("entries"), &study, &mut scene, study.draws(0), &mut drawn);
        (added.expect("defects"), drawn, scene)
    })
}

#[test]
fn defects_follow_a_shifted_object_in_any_order_of_the_entries() {
    let shifted = "[[study.defect]]\nkind = \"shifted\"\non = \"part\"\nlength = \"30mm\"\nangle = \"0deg\"\n";
    let [(a, _, scene), (b, ..)] = both_orders(shifted);
    let places = |added: &[AddedDefect]| added.iter().map(|d| d.placed.clone()).collect::<Vec<_>>();
    assert_eq!(places(&a), places(&b));
    let names: Vec<&str> = scene.instances.iter().map(|i| i.name.as_str()).collect();
    assert_eq!(names, ["shifted 1", "dust 1"]);
    let [shift, dust] = [&a[0].placed, &a[1].placed];
    assert_eq!((dust.on.as_str(), dust.host), ("part", 0));
    // The dust lies on the moved part.
    let [low, high] = scene.bounds_of(&scene.instances[0]).expect("bounds");
    assert!(dust.at.cmpge(low - 1e-9).all() && dust.at.cmple(high + 1e-9).all(), "{} in {low} to {high}", dust.at);
    assert!(shift.at.distance(DVec3::splat(0.005)) > 0.029);
}

#[test]
fn an_object_without_a_surface_carries_no_defect_in_any_order_of_the_entries() {
    // By default the strength of a faded object is 1, and nothing of it is left.
    for kind in ["missing", "faded"] {
        let change = format!("[[study.defect]]\nkind = \"{kind}\"\non = \"part\"\ncount = 2\n");
        for (added, drawn, scene) in both_orders(&change) {
            assert_eq!((added.len(), added[0].kind.as_str(), scene.instances.len()), (1, kind, 1));
            let notes: Vec<_> = drawn.iter().filter(|(_, value)| value.to_string().contains("not made")).collect();
            let mut names: Vec<&str> = notes.iter().map(|(name, _)| name.as_str()).collect();
            names.sort_unstable();
            let changed = format!("defect[{kind}][2]");
            let mut expected = ["defect[dust][1]", changed.as_str()];
            expected.sort_unstable();
            assert_eq!(names, expected, "{notes:?}");
        }
    }
    let weak = "[[study.defect]]\nkind = \"faded\"\non = \"part\"\nstrength = 0.9\n";
    for (added, _, scene) in both_orders(weak) {
        assert_eq!((added.len(), scene.instances.len()), (2, 2));
    }
}
