//! Comparison with an independent implementation, Mitsuba 3.9.1. `validation/bsdf_grid.py` makes the table and explains
//! its lines: each parameter varied alone, and mixes of all.

use dunkelfeld_bsdf::{Bsdf, Dielectric, Lobe, Principled, PrincipledModel, PrincipledParams, ThinSheet};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;

/// Relative tolerance where f32 permits it: everywhere except on the peak of a glossy coat, see [`Surface::tolerance`].
const TOLERANCE: f64 = 1e-4;

/// The relative index of refraction that Burley (2012) assigns to his `specular`: 0.5 means 4 % at normal incidence.
fn eta_from_specular(specular: f32) -> f32 {
    2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0
}

struct Surface {
    kind: String,
    parameters: Vec<(String, Vec<f32>)>,
    values: Vec<f64>,
}

impl Surface {
    fn number(&self, name: &str) -> Option<f32> {
        self.parameters.iter().find(|(n, _)| n == name).map(|(_, v)| v[0])
    }

    fn bsdf(&self) -> Bsdf {
        let get = |name: &str, default: f32| self.number(name).unwrap_or(default);
        match self.kind.as_str() {
            "principled" => {
                let base = self.parameters.iter().find(|(n, _)| n == "base_color").map(|(_, v)| v.as_slice());
                let Some(&[r, g, b]) = base else { panic!("no base colour: {:?}", self.parameters) };
                let d = PrincipledParams::default();
                let p = PrincipledParams {
                    base_color: Rgb::new(r, g, b),
                    metallic: get("metallic", d.metallic),
                    roughness: get("roughness", d.roughness),
                    anisotropic: get("anisotropic", d.anisotropic),
                    eta: self.number("specular").map_or(get("eta", d.eta), eta_from_specular),
                    spec_tint: get("spec_tint", d.spec_tint),
                    spec_trans: get("spec_trans", d.spec_trans),
                    sheen: get("sheen", d.sheen),
                    sheen_tint: get("sheen_tint", d.sheen_tint),
                    clearcoat: get("clearcoat", d.clearcoat),
                    clearcoat_gloss: get("clearcoat_gloss", d.clearcoat_gloss),
                    model: PrincipledModel::Mitsuba,
                    ..d
                };
                Bsdf::Principled(Principled::new(&p))
            }
            "roughdielectric" => {
                Bsdf::Dielectric(Dielectric::new(get("eta", 0.0), get("alpha", 0.0), Rgb::WHITE, Rgb::WHITE))
            }
            "roughthin" => Bsdf::ThinSheet(ThinSheet::new(get("eta", 0.0), get("alpha", 0.0), Rgb::WHITE, Rgb::WHITE)),
            "dielectric" => Bsdf::Dielectric(Dielectric::smooth(get("eta", 0.0))),
            "thindielectric" => Bsdf::ThinSheet(ThinSheet::new(get("eta", 0.0), 0.0, Rgb::WHITE, Rgb::WHITE)),
            other => panic!("unknown kind {other}"),
        }
    }

    /// Both sides compute in f32. Mitsuba writes the denominator of the coat's distribution as `1 + (a^2 - 1) cos^2`,
    /// which near the normal is the difference of two numbers around one: its rounding, a few times 6e-8, counts against
    /// `a^2 + sin^2`. With a = 0.001 at full gloss nothing of the peak is left.
    fn tolerance(&self, [wo, wi]: [LocalDir; 2]) -> f64 {
        match (self.number("clearcoat"), wo.same_side(wi)) {
            (Some(coat), true) if coat > 0.0 => {
                let alpha = f64::from(0.1 - 0.099 * self.number("clearcoat_gloss").unwrap_or(0.0));
                let m = (wo.0 + wi.0).normalize();
                TOLERANCE + 2.4e-7 / (alpha * alpha + f64::from(m.x * m.x + m.y * m.y))
            }
            _ => TOLERANCE,
        }
    }
}

fn read(table: &str) -> (Vec<[LocalDir; 2]>, Vec<Surface>) {
    let numbers = |text: &str| -> Vec<f64> {
        text.split_whitespace().map(|x| x.parse().unwrap_or_else(|_| panic!("no number: {x}"))).collect()
    };
    let (mut pairs, mut surfaces) = (Vec::new(), Vec::new());
    for line in table.lines().filter(|l| !l.starts_with('#')) {
        let (kind, rest) = line.split_once(' ').expect("a kind and more");
        if kind == "pair" {
            let [ox, oy, oz, ix, iy, iz] = numbers(rest)[..] else { panic!("six numbers: {line}") };
            let local = |v: [f64; 3]| LocalDir::new(v[0] as f32, v[1] as f32, v[2] as f32);
            pairs.push([local([ox, oy, oz]), local([ix, iy, iz])]);
            continue;
        }
        let (parameters, values) = rest.split_once(':').expect("parameters and values");
        let parameters = parameters.split_whitespace().map(|p| {
            let (name, value) = p.split_once('=').expect("name=value");
            (name.to_owned(), value.split(',').map(|x| x.parse().expect("a number")).collect())
        });
        surfaces.push(Surface { kind: kind.into(), parameters: parameters.collect(), values: numbers(values) });
    }
    (pairs, surfaces)
}

/// Our values for a pair of directions: as many numbers as the table has.
fn ours(surface: &Surface, bsdf: &Bsdf, [wo, wi]: [LocalDir; 2]) -> Vec<f64> {
    match surface.kind.as_str() {
        "principled" => bsdf.eval(wo, wi).to_array().map(f64::from).to_vec(),
        "roughdielectric" | "roughthin" => vec![f64::from(bsdf.eval(wo, wi).g)],
        _ => {
            let reflected = bsdf.sample(wo, 0.0, [0.5; 2]).filter(|s| s.lobe.contains(Lobe::REFLECTION));
            vec![reflected.map_or(0.0, |s| f64::from(s.pdf * s.weight.g))]
        }
    }
}

#[test]
fn values_equal_those_of_mitsuba() {
    // DUNKELFELD_MITSUBA_TABLE can contain the path of a larger table for a thorough check.
    let table = match std::env::var("DUNKELFELD_MITSUBA_TABLE") {
        Ok(path) => std::fs::read_to_string(path).expect("the table named by DUNKELFELD_MITSUBA_TABLE is readable"),
        Err(_) => include_str!("mitsuba/table.txt").to_owned(),
    };
    assert!(table.starts_with("# Mitsuba 3.9.1"), "the table does not say which Mitsuba made it");
    let (pairs, surfaces) = read(&table);
    let (mut compared, mut above_zero, mut worst) = (0, 0, 0.0f64);
    let mut wrong = Vec::new();
    for surface in &surfaces {
        let bsdf = surface.bsdf();
        let found: Vec<f64> = pairs.iter().flat_map(|p| ours(surface, &bsdf, *p)).collect();
        assert_eq!(found.len(), surface.values.len(), "{}: values are missing", surface.kind);
        for (k, (&ours, &theirs)) in found.iter().zip(&surface.values).enumerate() {
            let error = (ours - theirs).abs();
            let pair = k * pairs.len() / found.len();
            let tolerance = surface.tolerance(pairs[pair]);
            // The absolute term is for refraction at grazing angles, where f32 directions fix the Fresnel term to 1e-3 only.
            if error.is_nan() || error > tolerance * theirs.abs() + 3e-7 {
                wrong.push(format!(
                    "{ours} instead of {theirs} ({:.1e}) for {} {:?}, number {k}, pair {pair}",
                    error / theirs.abs(),
                    surface.kind,
                    surface.parameters
                ));
            }
            compared += 1;
            above_zero += usize::from(theirs > 1e-6);
            worst = worst.max(if theirs > 1e-3 { error / theirs } else { 0.0 });
        }
    }
    assert!(surfaces.len() >= 135 && pairs.len() >= 22, "the table has lost lines");
    assert!(compared > 6000 && above_zero > compared / 2, "{above_zero} of {compared} values say something");
    let shown = wrong.iter().take(12).cloned().collect::<Vec<_>>().join("\n");
    assert!(
        wrong.is_empty(),
        "{} of {compared} values differ (largest relative error {worst:.1e}):\n{shown}",
        wrong.len()
    );
}
