//! Cost of scattering: evaluation with density, and sampling, for the surfaces that scenes are made of.

use criterion::{Criterion, criterion_group, criterion_main};
use dunkelfeld_bsdf::{Bsdf, Dielectric, Principled, PrincipledParams, ThinSheet};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::{Sampler, warp};
use std::hint::black_box;

fn surfaces() -> Vec<(&'static str, Bsdf)> {
    let principled = |p: PrincipledParams| Bsdf::Principled(Principled::new(&p));
    let plain = PrincipledParams::default();
    let all = PrincipledParams {
        metallic: 0.3,
        anisotropic: 0.5,
        spec_tint: 0.4,
        spec_trans: 0.4,
        sheen: 0.5,
        sheen_tint: 0.5,
        clearcoat: 0.8,
        clearcoat_gloss: 0.7,
        ..plain
    };
    vec![
        ("plain", principled(plain)),
        ("metal", principled(PrincipledParams { metallic: 1.0, roughness: 0.2, ..plain })),
        ("rough glass", principled(PrincipledParams { spec_trans: 1.0, roughness: 0.3, ..plain })),
        ("all lobes", principled(all)),
        ("rough dielectric", Bsdf::Dielectric(Dielectric::new(1.49, 0.1, Rgb::WHITE, Rgb::WHITE))),
        ("smooth dielectric", Bsdf::Dielectric(Dielectric::smooth(1.49))),
        ("thin sheet", Bsdf::ThinSheet(ThinSheet::new(1.49, 0.0, Rgb::WHITE, Rgb::WHITE))),
    ]
}

fn bsdf(c: &mut Criterion) {
    let sampler = Sampler::new(1, 0, 0, 0);
    let directions: Vec<(LocalDir, LocalDir, [f32; 3])> = (0..1024)
        .map(|i| {
            let [a, b, c, d] = sampler.get_4d(i);
            let (wo, wi) = (warp::sample_cosine_hemisphere([a, b]), warp::sample_sphere([c, d]));
            (LocalDir(wo), LocalDir(wi), [a, c, d])
        })
        .collect();
    let mut k = 0;
    let mut next = move || {
        k = (k + 1) % 1024;
        black_box(directions[k])
    };
    for (name, surface) in surfaces() {
        let surface = black_box(surface);
        if !surface.is_delta() {
            c.bench_function(&format!("bsdf/eval_pdf/{name}"), |b| {
                b.iter(|| {
                    let (wo, wi, _) = next();
                    // Lights below an opaque surface do not reach it.
                    let wi = if name == "plain" || name == "metal" {
                        LocalDir::new(wi.0.x, wi.0.y, wi.0.z.abs())
                    } else {
                        wi
                    };
                    surface.eval_pdf(wo, wi)
                });
            });
        }
        c.bench_function(&format!("bsdf/sample/{name}"), |b| {
            b.iter(|| {
                let (wo, _, [a, b, c]) = next();
                surface.sample(wo, a, [b, c])
            });
        });
    }
    c.bench_function("bsdf/Principled::new", |b| {
        let p = PrincipledParams::default();
        b.iter(|| Principled::new(black_box(&p)));
    });
}

criterion_group!(benches, bsdf);
criterion_main!(benches);
