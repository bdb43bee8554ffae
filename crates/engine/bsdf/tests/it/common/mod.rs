//! The surfaces and directions that the tests of this crate use.

pub(crate) mod chart;

use chart::{Chart, Way};
use dunkelfeld_bsdf::{Bsdf, Dielectric, Principled, PrincipledModel, PrincipledParams, ThinSheet, Translucent};
use dunkelfeld_geometry::LocalDir;
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::{Pcg, keyed_stream, mix64};
use rand_core::Rng;

/// A stream of uniform numbers in `[0, 1)` with a fixed key.
pub(crate) struct Uniform(Pcg);

impl Uniform {
    pub(crate) fn new(key: u64) -> Self {
        Self(keyed_stream(20, 0, 0, mix64(key)))
    }

    pub(crate) fn next(&mut self) -> f32 {
        (self.0.next_u32() >> 8) as f32 / (1 << 24) as f32
    }

    pub(crate) fn pair(&mut self) -> [f32; 2] {
        [self.next(), self.next()]
    }

    /// A direction, uniform over the sphere.
    pub(crate) fn direction(&mut self) -> LocalDir {
        LocalDir(dunkelfeld_sampling::warp::sample_sphere(self.pair()))
    }

    /// One of the given values.
    pub(crate) fn pick(&mut self, values: &[f32]) -> f32 {
        values[((self.next() * values.len() as f32) as usize).min(values.len() - 1)]
    }
}

/// A direction from the cosine to the normal and the azimuth.
pub(crate) fn direction(cos: f32, phi: f32) -> LocalDir {
    let sin = (1.0 - cos * cos).sqrt();
    LocalDir::new(sin * phi.cos(), sin * phi.sin(), cos)
}

pub(crate) fn principled(p: PrincipledParams) -> Bsdf {
    Bsdf::Principled(Principled::new(&p))
}

/// Surfaces without very narrow lobes, so that a grid over the sphere resolves them: every lobe alone, and mixes.
pub(crate) fn wide_surfaces() -> Vec<(String, Bsdf)> {
    let base = Rgb::new(0.8, 0.5, 0.2);
    let plain = PrincipledParams { base_color: base, ..Default::default() };
    // Without specular reflection only the named lobe is left.
    let bare = PrincipledParams { specular_factor: 0.0, base_color: Rgb::BLACK, ..plain };
    let mut list: Vec<(String, PrincipledParams)> = vec![
        ("diffuse".into(), PrincipledParams { base_color: base, ..bare }),
        ("sheen".into(), PrincipledParams { sheen: 1.0, ..bare }),
        ("satin coat".into(), PrincipledParams { clearcoat: 1.0, clearcoat_gloss: 0.0, ..bare }),
        ("tinted specular".into(), PrincipledParams { base_color: base, spec_tint: 1.0, ..plain }),
        (
            "coloured specular".into(),
            PrincipledParams { specular_color: Rgb::new(2.0, 0.0, 0.5), specular_factor: 0.7, ..plain },
        ),
        ("anisotropic metal".into(), PrincipledParams { metallic: 1.0, anisotropic: 0.9, roughness: 0.6, ..plain }),
        (
            "anisotropic, other way".into(),
            PrincipledParams { metallic: 1.0, anisotropic: -0.6, roughness: 0.5, ..plain },
        ),
        ("matched glass".into(), PrincipledParams { spec_trans: 0.7, eta: 1.0, metallic: 0.2, ..plain }),
        ("thinner inside".into(), PrincipledParams { spec_trans: 0.8, eta: 1.0 / 1.5, roughness: 0.5, ..plain }),
        (
            "everything".into(),
            PrincipledParams {
                metallic: 0.3,
                anisotropic: 0.5,
                spec_tint: 0.4,
                spec_trans: 0.4,
                sheen: 0.5,
                sheen_color: Rgb::new(1.5, 0.5, 0.1),
                sheen_tint: 0.5,
                clearcoat: 0.8,
                clearcoat_gloss: 0.1,
                ..plain
            },
        ),
    ];
    for roughness in [0.25, 0.5, 1.0] {
        list.push((format!("plastic {roughness}"), PrincipledParams { roughness, ..plain }));
        list.push((format!("metal {roughness}"), PrincipledParams { roughness, metallic: 1.0, ..plain }));
        list.push((format!("glass {roughness}"), PrincipledParams { roughness, spec_trans: 1.0, eta: 1.49, ..plain }));
    }
    let mut surfaces: Vec<_> = list.into_iter().map(|(n, p)| (n, principled(p))).collect();
    for alpha in [0.1, 0.4, 1.0] {
        // A nearly matched index narrows the refracted lobe to alpha (eta - 1). A high index concentrates light that
        // enters at grazing angles around the pole. These are the limits that a grid over the sphere resolves.
        // `facet_surfaces` has the rest, on grids that resolve it.
        for eta in [1.49, 1.0 / 1.49, if alpha > 0.3 { 1.05 } else { 1.2 }, 4.0] {
            let b = Bsdf::Dielectric(Dielectric::new(eta, alpha, Rgb::WHITE, base));
            surfaces.push((format!("rough dielectric {alpha}, eta {eta:.3}"), b));
        }
        let b = Bsdf::ThinSheet(ThinSheet::new(1.49, alpha, Rgb::WHITE, base));
        surfaces.push((format!("rough sheet {alpha}"), b));
    }
    for share in [0.3, 1.0] {
        let Bsdf::Principled(surface) = principled(plain) else { continue };
        let b = Bsdf::Translucent(Translucent::new(surface, share, base * share));
        surfaces.push((format!("translucent {share}"), b));
    }
    surfaces
}

/// A surface whose density, apart from the diffuse lobe, is that of one set of facets: charts resolve it at any roughness.
pub(crate) struct FacetSurface {
    pub(crate) name: String,
    pub(crate) bsdf: Bsdf,
    /// Index of refraction below over above, 1 if nothing is refracted.
    pub(crate) eta: f32,
    pub(crate) charts: Vec<Chart>,
}

impl FacetSurface {
    /// The least slope.
    pub(crate) fn narrowest(&self) -> f32 {
        let slopes = self.charts.iter().filter_map(|c| match c {
            Chart::Facets { slopes: [x, y], .. } => Some(x.min(*y) as f32),
            Chart::Cosine { .. } | Chart::Horizon { .. } => None,
        });
        // The coat's chart is centred between its slope and one.
        let least = slopes.fold(1.0, f32::min);
        if self.name.starts_with("coat") { least * least } else { least }
    }
}

/// Facets of every kind, from the narrowest lobe to the widest.
pub(crate) fn facet_surfaces() -> Vec<FacetSurface> {
    let mut list = Vec::new();
    for alpha in [1e-4f32, 1e-2, 0.2, 1.0] {
        let slopes = [f64::from(alpha); 2];
        // With a nearly matched index the refracted lobe is as narrow as alpha (eta - 1). A high index concentrates all
        // entering light within 1 / eta of the pole, and only light from there can leave.
        for eta in [1.49f32, 1.0 / 1.49, 1.05, 1.0 / 1.05, 4.0, 30.0, 1.0 / 30.0] {
            list.push(FacetSurface {
                name: format!("dielectric {alpha}, eta {eta:.3}"),
                bsdf: Bsdf::Dielectric(Dielectric::new(eta, alpha, Rgb::WHITE, Rgb::WHITE)),
                eta,
                charts: vec![Chart::reflect(slopes), Chart::Facets { slopes, way: Way::Refract(f64::from(eta)) }],
            });
        }
        list.push(FacetSurface {
            name: format!("sheet {alpha}"),
            bsdf: Bsdf::ThinSheet(ThinSheet::new(1.49, alpha, Rgb::WHITE, Rgb::WHITE)),
            eta: 1.0,
            charts: vec![Chart::reflect(slopes), Chart::Facets { slopes, way: Way::Pass }],
        });
    }
    let metal = PrincipledParams { base_color: Rgb::new(0.9, 0.6, 0.3), metallic: 1.0, ..Default::default() };
    for roughness in [0.0f32, 0.4, 1.0] {
        for anisotropic in [0.0f32, 0.7, -1.0] {
            let aspect = (1.0 - 0.9 * anisotropic.abs()).sqrt();
            let (long, short) = (roughness * roughness / aspect, roughness * roughness * aspect);
            let (x, y) = if anisotropic < 0.0 { (short, long) } else { (long, short) };
            let slopes = [x, y].map(|a| f64::from(a.max(0.001)));
            list.push(FacetSurface {
                name: format!("metal {roughness}, anisotropic {anisotropic}"),
                bsdf: principled(PrincipledParams { roughness, anisotropic, ..metal }),
                eta: 1.0,
                charts: vec![Chart::reflect(slopes)],
            });
            if anisotropic > 0.0 {
                continue;
            }
            let glass = PrincipledParams { metallic: 0.0, spec_trans: 1.0, eta: 1.49, ..metal };
            list.push(FacetSurface {
                name: format!("glass {roughness}, anisotropic {anisotropic}"),
                bsdf: principled(PrincipledParams { roughness, anisotropic, ..glass }),
                eta: 1.49,
                charts: vec![Chart::reflect(slopes), Chart::Facets { slopes, way: Way::Refract(1.49) }],
            });
        }
    }
    for clearcoat_gloss in [0.0f32, 0.5, 1.0] {
        let bare = PrincipledParams { specular_factor: 0.0, base_color: Rgb::BLACK, ..Default::default() };
        list.push(FacetSurface {
            name: format!("coat {clearcoat_gloss}"),
            bsdf: principled(PrincipledParams { clearcoat: 1.0, clearcoat_gloss, ..bare }),
            eta: 1.0,
            // Long tails: the geometric mean of alpha and 1 as the centre of the chart resolves both ends.
            charts: vec![Chart::reflect([f64::from(0.1 - 0.099 * clearcoat_gloss).sqrt(); 2])],
        });
    }
    list
}

/// Surfaces at and beyond the ends of their parameter ranges.
pub(crate) fn extreme_surface(u: &mut Uniform) -> Bsdf {
    const VALUES: [f32; 9] = [0.0, 1.0, 0.5, 1e-6, 0.999_999, 0.03, -1.0, 1e9, f32::NAN];
    const ETAS: [f32; 12] = [1.0, 1.5, 0.67, 1e3, 1e-3, 1.000_001, 0.999, 1.002, 0.0, -1.0, f32::NAN, f32::INFINITY];
    const ALPHAS: [f32; 7] = [0.0, 1e-6, 1e-4, 1e-2, 1.0, 50.0, f32::NAN];
    let color = |u: &mut Uniform| Rgb::new(u.pick(&VALUES), u.pick(&VALUES), u.pick(&VALUES));
    let tint = |u: &mut Uniform| Rgb::new(u.pick(&[0.0, 1.0]), u.next(), u.pick(&[0.0, 1e-6, 1.0]));
    match (u.next() * 5.0) as u32 {
        0 => Bsdf::Dielectric(Dielectric::new(u.pick(&ETAS), u.pick(&ALPHAS), tint(u), tint(u))),
        1 => Bsdf::ThinSheet(ThinSheet::new(u.pick(&ETAS), u.pick(&ALPHAS), tint(u), tint(u))),
        _ => principled(PrincipledParams {
            base_color: color(u),
            metallic: u.pick(&VALUES),
            roughness: u.pick(&VALUES),
            anisotropic: u.pick(&VALUES),
            eta: u.pick(&ETAS),
            specular_factor: u.pick(&VALUES),
            specular_color: color(u),
            spec_tint: u.pick(&VALUES),
            spec_trans: u.pick(&VALUES),
            sheen: u.pick(&VALUES),
            sheen_color: color(u),
            sheen_tint: u.pick(&VALUES),
            clearcoat: u.pick(&VALUES),
            clearcoat_gloss: u.pick(&VALUES),
            model: if u.next() < 0.5 { PrincipledModel::Layered } else { PrincipledModel::Mitsuba },
        }),
    }
}
