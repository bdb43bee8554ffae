//! Our values against those of an independent implementation: Mitsuba 3.9.1 (table and script in `tests/mitsuba/`).

use dunkelfeld_bsdf::{Bsdf, Dielectric, Principled, PrincipledParams};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;

/// Both sides compute in f32; at the narrowest lobe of the table (alpha 0.006) a rounding of a direction (6e-8) moves a
/// value by 4 * 6e-8 / 0.006 in relative terms for each operation on it.
const TOLERANCE: f32 = 2e-4;

fn row_to_case(row: &str) -> Option<(Bsdf, LocalDir, LocalDir, Rgb)> {
    let (kind, numbers) = row.split_once(' ')?;
    let x: Vec<f32> = numbers.split(' ').map(str::parse).collect::<Result<_, _>>().ok()?;
    let [r, g, b, metallic, roughness, anisotropic, eta, spec_tint, spec_trans, sheen, sheen_tint, coat, gloss] =
        *x.first_chunk::<13>()?;
    let bsdf = match kind {
        "p" => Bsdf::Principled(Principled::new(&PrincipledParams {
            base_color: Rgb::new(r, g, b),
            metallic,
            roughness,
            anisotropic,
            eta,
            spec_tint,
            spec_trans,
            sheen,
            sheen_tint,
            clearcoat: coat,
            clearcoat_gloss: gloss,
            ..Default::default()
        })),
        "r" => Bsdf::Dielectric(Dielectric::new(r, g, Rgb::WHITE, Rgb::WHITE)),
        _ => return None,
    };
    let [ox, oy, oz, ix, iy, iz, vr, vg, vb] = *x[13..].first_chunk::<9>()?;
    Some((bsdf, LocalDir::new(ox, oy, oz), LocalDir::new(ix, iy, iz), Rgb::new(vr, vg, vb)))
}

#[test]
fn values_equal_those_of_mitsuba() {
    // DUNKELFELD_MITSUBA_TABLE names a larger table for a thorough check.
    let table = match std::env::var("DUNKELFELD_MITSUBA_TABLE") {
        Ok(path) => std::fs::read_to_string(path).expect("the table named by DUNKELFELD_MITSUBA_TABLE is readable"),
        Err(_) => include_str!("mitsuba/table.txt").to_owned(),
    };
    let mut rows = 0;
    let mut wrong = Vec::new();
    for row in table.lines().filter(|l| !l.starts_with('#')) {
        let (bsdf, wo, wi, expected) = row_to_case(row).unwrap_or_else(|| panic!("unreadable row: {row}"));
        let value = bsdf.eval(wo, wi);
        for c in 0..3 {
            if (value[c] - expected[c]).abs() > TOLERANCE * expected[c].abs() + 1e-7 {
                wrong.push(format!("channel {c}: {} instead of {} in\n  {row}", value[c], expected[c]));
            }
        }
        rows += 1;
    }
    assert!(rows >= 150, "the table has lost rows: {rows}");
    assert!(
        wrong.is_empty(),
        "{} of {} values differ:\n{}",
        wrong.len(),
        3 * rows,
        wrong[..wrong.len().min(12)].join("\n")
    );
}
