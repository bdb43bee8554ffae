//! Contrast against closed forms, and of defects without an effect.

use super::*;
use crate::make::Worker;
use crate::study::Study;
use crate::surface_path::SurfacePath;
use dunkelfeld::Cancel;
use dunkelfeld_geometry::Vec3;
use dunkelfeld_io::sensor_file::preset;
use dunkelfeld_sampling::mix64;
use dunkelfeld_sensor::{BayerPattern, ColorFilter, Efficiency};

#[test]
fn contrast_and_noise_are_those_of_the_model() {
    let model = preset("imx250").expect("a preset");
    let time = Seconds(0.01);
    // A square of 900 electrons on 400, next to another defect of 5000 electrons.
    let at = |x: u32, y: u32| (8..12).contains(&x) && (8..12).contains(&y);
    let other = |x: u32, y: u32| (14..16).contains(&x) && (8..12).contains(&y);
    let electrons = Plane::from_fn(24, 20, |x, y| {
        if at(x, y) {
            900.0
        } else if other(x, y) {
            5000.0
        } else {
            400.0
        }
    });
    let ids = Plane::from_fn(24, 20, |x, y| {
        if at(x, y) {
            3
        } else if other(x, y) {
            4
        } else {
            0
        }
    });
    let exact = Plane::new(24, 20, 0.0);
    let exposed = Exposed { electrons: &electrons, ratios: Some(&exact), model: &model, time };
    let bounds = Bounds { from: [8, 8], to: [12, 12] };
    let found = visibility(&exposed, &ids, 3, bounds, |id| id == 4, None).expect("surroundings");
    let spec = model.spec();
    assert!((found.contrast - 500.0 * spec.system_gain).abs() < 1e-9);
    let variance = 400.0 + model.dark_variance(time) + 1.0 / (12.0 * spec.system_gain.powi(2));
    assert!((found.cnr.expect("a ratio") - 500.0 / variance.sqrt()).abs() < 1e-9, "{found:?}");
    // With the other one in its surroundings the contrast is smaller.
    let mixed = visibility(&exposed, &ids, 3, bounds, |_| false, None).expect("surroundings");
    assert!(mixed.contrast < found.contrast);
    // Saturated on both sides, and on one.
    let bright = electrons.map(|e| e * 1e4);
    assert_eq!(visibility(&Exposed { electrons: &bright, ..exposed }, &ids, 3, bounds, |id| id == 4, None), None);
    let half = Plane::from_fn(24, 20, |x, y| if at(x, y) { 1e7 } else { 400.0 });
    let found =
        visibility(&Exposed { electrons: &half, ..exposed }, &ids, 3, bounds, |_| false, None).expect("a contrast");
    assert!((found.contrast - (model.saturation().0 - 400.0) * spec.system_gain).abs() < 1e-6);
    // Behind a filter array equal colours are compared: a plate and a print of the same colour have no contrast.
    let mut spec = model.spec().clone();
    let curve = spec.quantum_efficiency.curves()[0].clone();
    let filter =
        ColorFilter { pattern: BayerPattern::Rggb, curves: [curve.clone(), curve.clone(), curve], white_balance: true };
    spec.quantum_efficiency = Efficiency::Mosaic(filter);
    let bayer = SensorModel::new(spec).expect("a sensor");
    let mosaic = Plane::from_fn(24, 20, |x, y| [300.0, 900.0, 900.0, 200.0][(y % 2 * 2 + x % 2) as usize]);
    let odd = Plane::from_fn(24, 20, |x, y| u16::from(x == 9 && (8..13).contains(&y)));
    let colored = Exposed { electrons: &mosaic, ratios: Some(&exact), model: &bayer, time };
    let none =
        visibility(&colored, &odd, 1, Bounds { from: [9, 8], to: [10, 13] }, |_| false, None).expect("surroundings");
    assert_eq!((none.contrast, none.error, none.cnr), (0.0, Some(0.0), Some(0.0)));
    // A contrast below three errors is unknown, unless these are below the noise of a pixel.
    for (contrast, error, cnr_error, is_known) in
        [(5.0, 2.0, 0.5, false), (7.0, 2.0, 0.5, true), (0.1, 2.0, 0.5, false), (0.1, 2.0, 0.3, true)]
    {
        let found = Visibility { contrast, error: Some(error), cnr_error: Some(cnr_error), ..found };
        assert_eq!(found.is_known(), is_known, "{found:?}");
    }
    // Without a certificate the error is unknown.
    let blind = Exposed { ratios: None, ..exposed };
    let found = visibility(&blind, &ids, 3, bounds, |id| id == 4, None).expect("surroundings");
    assert_eq!((found.error, found.cnr), (None, None));
    // Nothing surrounds an instance that fills the image.
    let full = Plane::new(24, 20, 3);
    assert_eq!(visibility(&exposed, &full, 3, Bounds { from: [0, 0], to: [24, 20] }, |_| false, None), None);
}

/// A square of 5 x 5 pixels, on a surface that ends two pixels to the right of it.
const AT: Bounds = Bounds { from: [20, 20], to: [25, 25] };
const SIDE: u32 = 45;
const END: u32 = 28;

fn is_defect(x: u32, y: u32) -> bool {
    (20..25).contains(&x) && (20..25).contains(&y)
}

fn ids() -> Plane<u16> {
    Plane::from_fn(SIDE, SIDE, |x, y| u16::from(is_defect(x, y)))
}

/// No object has changed.
fn on(all: &Plane<SurfacePath>) -> Option<Surfaces<'_>> {
    Some(Surfaces { all, below: None })
}

/// Left of the end one smooth surface, and another one on the right.
fn surfaces() -> Plane<SurfacePath> {
    let of =
        |path| SurfacePath { path, first: path, normals: [Vec3::Z; 2], is_decided: true, ..SurfacePath::default() };
    Plane::from_fn(SIDE, SIDE, |x, _| of(if x < END { 1 } else { 2 }))
}

/// Curved shading of the second degree is continued below the defect, and the surface beside it has no influence. The ring
/// does not reach around the defect.
#[test]
fn a_defect_on_a_curved_surface_near_its_edge_has_its_contrast() {
    let model = preset("imx250").expect("a preset");
    let time = Seconds(0.01);
    let shading = |x: u32, y: u32| {
        let (x, y) = (f64::from(x) - 22.0, f64::from(y) - 22.0);
        2000.0 + 30.0 * x - 20.0 * y - 2.0 * x * x + 1.5 * x * y - y * y
    };
    for change in [0.0, 300.0, -120.0] {
        let electrons = Plane::from_fn(SIDE, SIDE, |x, y| match () {
            () if is_defect(x, y) => (shading(x, y) + change) as f32,
            // Pixels at the end contain a part of the other surface.
            () if x + 1 < END => shading(x, y) as f32,
            () => 9000.0,
        });
        let exact = Plane::new(SIDE, SIDE, 0.0);
        let exposed = Exposed { electrons: &electrons, ratios: Some(&exact), model: &model, time };
        let found = visibility(&exposed, &ids(), 1, AT, |_| false, on(&surfaces())).expect("surroundings");
        assert!((found.contrast / model.spec().system_gain - change).abs() < 0.01, "{change}: {found:?}");
        // The mean of the shading over the square: the squares of -2 to 2 have the mean 2.
        let noise = model.temporal_variance(Electrons(2000.0 - 3.0 * 2.0), time).sqrt();
        let ratio = found.cnr.expect("a ratio");
        assert!((ratio - change.abs() / noise).abs() < 1e-3, "{change}: {ratio}");
        let simple = visibility(&exposed, &ids(), 1, AT, |_| false, None).expect("surroundings");
        assert!(simple.contrast < -300.0 * model.spec().system_gain, "with the other surface: {simple:?}");
    }
    // An edge of the surface below the defect, as that of a box, parts it.
    let bent = Plane::from_fn(SIDE, SIDE, |x, _| SurfacePath {
        path: 1,
        first: 1,
        normals: [if x < 24 { Vec3::Z } else { Vec3::X }; 2],
        is_decided: true,
        ..SurfacePath::default()
    });
    let electrons = Plane::from_fn(SIDE, SIDE, |x, _| if x < 24 { 500.0 } else { 4000.0 });
    let exact = Plane::new(SIDE, SIDE, 0.0);
    let exposed = Exposed { electrons: &electrons, ratios: Some(&exact), model: &model, time };
    let found = visibility(&exposed, &ids(), 1, AT, |_| false, on(&bent)).expect("surroundings");
    assert!(found.contrast.abs() < 1e-9, "{found:?}");
    // Of a surface of the size of the defect nothing is around it.
    let island = Plane::from_fn(SIDE, SIDE, |x, y| SurfacePath {
        path: if (19..26).contains(&x) && (19..26).contains(&y) { 1 } else { 2 },
        first: 1,
        normals: [Vec3::Z; 2],
        ..SurfacePath::default()
    });
    assert_eq!(visibility(&exposed, &ids(), 1, AT, |_| false, on(&island)), None);
}

/// Noise of the render alone: contrasts over their errors have the variance 1, and the squared ratio the mean zero.
///
/// The sum of the squares of 2000 standard normal values is 2000 with the deviation 63. The bound is 6.1 of these above
/// (false-alarm rate below 1e-9). Rare significant scatter, which enters the error, lowers the sum.
#[test]
fn a_defect_without_contrast_has_the_ratio_zero_within_the_error() {
    let model = preset("imx250").expect("a preset");
    let time = Seconds(0.01);
    let ratio = 0.5;
    let ratios = Plane::new(SIDE, SIDE, ratio as f32);
    let (mut squares, mut sum, mut excess) = (0.0, 0.0, 0.0);
    let count = 2000u64;
    for i in 0..count {
        let electrons = Plane::from_fn(SIDE, SIDE, |x, y| {
            let deviation = (ratio * model.temporal_variance(Electrons(1000.0), time) * 12.0).sqrt();
            let bits = mix64(i << 32 | u64::from(y * SIDE + x)) >> 11;
            (1000.0 + deviation * (bits as f64 / (1u64 << 53) as f64 - 0.5)) as f32
        });
        let exposed = Exposed { electrons: &electrons, ratios: Some(&ratios), model: &model, time };
        let found = visibility(&exposed, &ids(), 1, AT, |_| false, on(&surfaces())).expect("surroundings");
        let error = found.error.expect("an error");
        let score = found.contrast / error;
        squares += score * score;
        sum += score;
        excess += found.cnr.expect("a ratio").powi(2);
    }
    let n = count as f64;
    assert!(squares < n + 6.1 * (2.0 * n).sqrt() && squares > 0.8 * n, "{}", squares / n);
    assert!(sum.abs() < 6.1 * n.sqrt(), "{sum}");
    // 25 pixels with half of the variance of the camera: an error of 0.14 and more.
    assert!(excess / n < 0.1, "{}", excess / n);
}

fn made(spots: &str) -> crate::make::Made {
    let text = format!(
        "scene = \"none\"\n[study]\nname = \"test\"\n[study.labels]\ncoverage = 4\n{spots}[film]\nwidth = 96\n\
         height = 96\n[budget]\nspp = 64\n[camera]\nname = \"above\"\nposition = [0, \"200mm\", \"40mm\"]\n\
         look_at = [0, 0, 0]\nvertical_fov = \"12deg\"\n[environment]\nradiance = 0.2\n[[light]]\nname = \"lamp\"\n\
         kind = \"spot\"\ndiameter = \"20mm\"\ncone_angle = \"40deg\"\nposition = [\"60mm\", \"150mm\", 0]\npower = \"1W\"\n\
         [[object]]\nname = \"floor\"\nkind = \"plane\"\nsize = [\"80mm\", \"80mm\"]\n\
         [[object]]\nname = \"ball\"\nkind = \"sphere\"\ndiameter = \"14mm\"\ntranslate = [\"-9mm\", \"7mm\", 0]\n\
         [[object]]\nname = \"block\"\nkind = \"box\"\nsize = [\"12mm\", \"4mm\", \"16mm\"]\n\
         translate = [\"9mm\", \"2mm\", 0]\n"
    );
    image(&text)
}

/// The first image of a study.
fn image(text: &str) -> crate::make::Made {
    let study =
        std::sync::Arc::new(Study::from_text("test.toml", text).unwrap_or_else(|e| panic!("{e}\n{}", e.caret())));
    let mut worker = Worker::open(&study, 2).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()));
    worker.make(0, None, &Cancel::new()).unwrap_or_else(|e| panic!("{e}\n{}", e.caret())).expect("an image")
}

fn spots(strength: f64) -> String {
    let spot = |on: &str| {
        format!(
            "[[study.defect]]\nkind = \"stain\"\nname = \"spot on {on}\"\non = \"{on}\"\ncount = 12\n\
             length = \"1.6mm\"\nfacing = [0, 1, 0]\nstrength = {strength}\n"
        )
    };
    format!("{}{}", spot("ball"), spot("block"))
}

/// Renders with 24 stains on a ball and at the edges of a block. Without strength nothing is visible: each contrast is below
/// 6.1 of its errors, for which normal values have the false-alarm rate 1e-9, and the mean squared score is near 1 or below.
#[test]
fn stains_without_strength_are_invisible_and_black_ones_are_not() {
    let seen = |made: &crate::make::Made| -> Vec<(f64, f64, f64)> {
        let stains = made.record.instances.iter().filter(|i| i.defect.is_some());
        stains.filter_map(|i| Some((i.contrast?, i.contrast_error?, i.cnr?))).collect()
    };
    let clear = seen(&made(&spots(0.0)));
    // Others are unknown: three of their errors are above the noise.
    assert!(clear.len() > 6, "{clear:?}");
    assert!(clear.iter().all(|(contrast, error, _)| contrast.abs() < 6.1 * error), "{clear:?}");
    let mean = clear.iter().map(|(c, e, _)| (c / e).powi(2)).sum::<f64>() / clear.len() as f64;
    assert!(mean < 3.0, "{mean} of {clear:?}");
    // The noise of this render is above that of the camera. The largest ratios are in the highlight of the ball.
    let below = |limit: f64| clear.iter().filter(|(.., cnr)| *cnr < limit).count();
    assert!(below(3.0) == clear.len() && 4 * below(1.0) >= 3 * clear.len(), "{clear:?}");
    let dark = seen(&made(&spots(1.0).replace("strength", "color = [0, 0, 0]\nroughness = 1\nstrength")));
    let shown = dark.iter().filter(|(contrast, _, cnr)| *contrast < 0.0 && *cnr > 3.0).count();
    assert!(dark.len() > 12 && 10 * shown >= 9 * dark.len(), "{shown} of {dark:?}");
}

/// A defect beyond the terminator of a round surface, on pixels so near to the edge that the ring has none of them: the
/// polynomial goes on to zero, and the signal does not. The error contains the difference, and the noise is that of a signal
/// of the ring.
#[test]
fn a_defect_beyond_its_ring_has_the_error_of_the_continuation() {
    let model = preset("imx250").expect("a preset");
    let time = Seconds(0.01);
    let signal = |y: u32| 180.0 + 190.0 * f64::from(y.max(20) - 20);
    let is_defect = |x: u32, y: u32| (20..26).contains(&x) && (18..20).contains(&y);
    let ids = Plane::from_fn(SIDE, SIDE, |x, y| u16::from(is_defect(x, y)));
    let surfaces = Plane::from_fn(SIDE, SIDE, |x, y| SurfacePath {
        path: if y < 20 && !is_defect(x, y) { 2 } else { 1 },
        first: if y < 20 && !is_defect(x, y) { 2 } else { 1 },
        normals: [Vec3::Z; 2],
        is_covered: is_defect(x, y),
        is_decided: true,
        ..SurfacePath::default()
    });
    let at = Bounds { from: [20, 18], to: [26, 20] };
    let exact = Plane::new(SIDE, SIDE, 0.0);
    for change in [0.0, 60.0] {
        let electrons =
            Plane::from_fn(SIDE, SIDE, |x, y| (signal(y) + if is_defect(x, y) { change } else { 0.0 }) as f32);
        let exposed = Exposed { electrons: &electrons, ratios: Some(&exact), model: &model, time };
        let found = visibility(&exposed, &ids, 1, at, |_| false, on(&surfaces)).expect("surroundings");
        let (gain, error) = (model.spec().system_gain, found.error.expect("an error"));
        assert!((found.contrast - change * gain).abs() < 3.0 * error && error > 100.0 * gain, "{change}: {found:?}");
        assert!(found.cnr.expect("a ratio") < 1.0, "{change}: {found:?}");
    }
}

/// Dark stains on a block that is faded, moved, or neither: each has the contrast of its colour to the block.
#[test]
fn a_stain_on_a_changed_object_has_that_object_as_its_surroundings() {
    let stain = "[[study.defect]]\nkind = \"stain\"\nname = \"spot\"\non = \"block\"\ncount = 4\nlength = \"1.6mm\"\n\
                 facing = [0, 1, 0]\ncolor = [0, 0, 0]\nroughness = 1\n";
    let change = |kind: &str| {
        format!(
            "[[study.defect]]\nkind = \"{kind}\"\nname = \"change\"\non = \"block\"\n{}",
            match kind {
                "faded" => "strength = 0.2\n",
                _ => "length = \"1mm\"\n",
            }
        )
    };
    let spots = |text: &str| -> Vec<f64> {
        let instances = made(text).record.instances;
        let spots = instances.iter().filter(|i| i.name.starts_with("spot"));
        spots.filter_map(|i| i.contrast).collect()
    };
    let plain = spots(stain);
    assert!(plain.len() >= 3 && plain.iter().all(|contrast| *contrast < 0.0), "{plain:?}");
    let usual = plain.iter().sum::<f64>() / plain.len() as f64;
    for kind in ["faded", "shifted"] {
        let found = spots(&format!("{stain}{}", change(kind)));
        assert!(found.len() >= 3, "{kind}: {found:?}");
        for contrast in &found {
            // The block is about as bright as before. But beside another defect a stain has the pixels only of which it
            // covers most, so that its contrast is up to twice as large.
            assert!((0.6..2.0).contains(&(contrast / usual)), "{kind}: {contrast} instead of about {usual}");
        }
    }
}

/// White metal in light from everywhere looks the same at each point. A dent of 5 mm with a slope of 0.75 does not show, seen
/// at 51 degrees, and the sheet below it has its whole area. Nothing is behind the sheet.
#[test]
fn a_deep_dent_in_white_metal_is_invisible_in_a_furnace() {
    let text = "scene = \"none\"\n[film]\nwidth = 48\nheight = 48\n[budget]\nspp = 64\n[camera]\n\
        position = [\"80mm\", \"100mm\", 0]\nlook_at = [0, 0, 0]\nvertical_fov = \"8deg\"\n[environment]\nradiance = 1\n\
        [sensor]\nexposure = \"4ms\"\n[[object]]\nname = \"sheet\"\nkind = \"plane\"\nsize = [\"12mm\", \"12mm\"]\n\
        [[material]]\nname = \"sheet\"\nbase_color = 1\nmetallic = 1\nroughness = 0.1\n[study]\nname = \"test\"\n\
        [[study.label]]\ncategory = \"sheet\"\nobjects = \"sheet\"\n";
    let dent =
        "[[study.defect]]\nkind = \"dent\"\non = \"sheet\"\nlength = \"5mm\"\ndepth = \"1.2mm\"\nfacing = [0, 1, 0]\n";
    let [plain, dented] = [text.to_owned(), format!("{text}{dent}")].map(|text| image(&text).record.instances);
    let (sheet, [whole, dent]) = (&plain[0], [&dented[0], &dented[1]]);
    assert!(dent.area > 100 && dent.cnr.expect("a ratio") < 3.0, "{dent:?}");
    assert!((whole.amodal - sheet.amodal).abs() <= 2.0, "{} {}", whole.amodal, sheet.amodal);
    assert!((whole.area + dent.area).abs_diff(sheet.area) <= 2, "{} {} {}", whole.area, dent.area, sheet.area);
}

/// The contrasts of a dark print on a bright label on a dark plate, by name: the label is 1.5 or 3 times as wide as the
/// print, and is a part of the ring of the print alone, or all of it.
fn stack(width: &str, study: &str) -> std::collections::BTreeMap<String, Option<f64>> {
    let object = |name: &str, width: &str, y: &str, color: f64| {
        format!(
            "[[object]]\nname = \"{name}\"\nkind = \"box\"\nsize = [\"{width}\", \"0.2mm\", \"{width}\"]\n\
             translate = [0, \"{y}\", 0]\n[[material]]\nname = \"{name}\"\nbase_color = {color}\n"
        )
    };
    let (plate, label, print) = (
        object("plate", "90mm", "0mm", 0.1),
        object("label", width, "0.25mm", 0.8),
        object("print", "12mm", "0.5mm", 0.2),
    );
    let text = format!(
        "scene = \"none\"\n[study]\nname = \"test\"\n[[study.label]]\ncategory = \"part\"\n\
         objects = [\"print\", \"label\", \"plate\"]\n{study}[film]\nwidth = 60\nheight = 60\n[budget]\nspp = 32\n[camera]\n\
         name = \"above\"\nposition = [0, \"200mm\", 0]\nlook_at = [0, 0, 0]\n[lens]\nprojection = \"telecentric\"\n\
         field_height = \"60mm\"\n[environment]\nradiance = 1\n{plate}{label}{print}"
    );
    let study =
        std::sync::Arc::new(Study::from_text("test.toml", &text).unwrap_or_else(|e| panic!("{e}\n{}", e.caret())));
    let mut worker = Worker::open(&study, 2).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()));
    let made = worker.make(0, None, &Cancel::new()).unwrap_or_else(|e| panic!("{e}\n{}", e.caret()));
    let instances = made.expect("an image").record.instances;
    instances.into_iter().map(|i| (i.name, i.contrast)).collect()
}

/// A changed object is a surface like any other for parts and for other changed objects: their contrasts hardly change.
#[test]
fn contrasts_are_those_to_the_surface_below_also_if_it_is_changed() {
    let change =
        |name: &str, rest: &str| format!("[[study.defect]]\nname = \"{name}\"\non = \"{name}\"\nkind = {rest}\n");
    let faded = change("print", "\"faded\"\nstrength = 0.3");
    for width in ["22mm", "36mm"] {
        let near = |a: Option<f64>, b: Option<f64>, what: &str| match (a, b) {
            (Some(a), Some(b)) => assert!((a / b - 1.0).abs() < 0.12, "{width}, {what}: {a} and {b}"),
            _ => panic!("{width}, {what}: {a:?} and {b:?}"),
        };
        let usual = stack(width, "");
        let on_label = stack(width, &faded);
        assert!(usual["print"] < Some(-100.0) && on_label["print 1"] < Some(-100.0), "{usual:?} {on_label:?}");
        for (below, what) in [
            (change("label", "\"shifted\"\nlength = \"0.1mm\""), "a shifted label"),
            (change("label", "\"faded\"\nstrength = 0.02"), "a faded label"),
            (change("plate", "\"shifted\"\nlength = \"0.1mm\""), "a shifted plate"),
            (change("plate", "\"faded\"\nstrength = 0"), "a faded plate"),
        ] {
            let found = stack(width, &below);
            near(found["print"], usual["print"], what);
            let name = if below.contains("\"label\"") { "label 1" } else { "label" };
            assert!(found[name] > Some(100.0), "{what}: {found:?}");
            near(stack(width, &format!("{faded}{below}"))["print 1"], on_label["print 1"], what);
        }
    }
}
