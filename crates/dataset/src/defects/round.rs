//! Round patches: dents and stains.

use super::draw::Harmonics;
use super::material;
use super::patch::Patch;
use super::shell;
use super::site::{Made, Site};
use super::walk::{Footing, tangent_at};
use dunkelfeld_geometry::{DVec3, Vec3};
use dunkelfeld_radiometry::Rgb;
use dunkelfeld_sampling::Pcg;
use std::f64::consts::{PI, TAU};

/// Number of radii and of rings of a patch.
const SPOKES: usize = 64;
const RINGS: usize = 20;
/// Largest distance between facets and patch, over the diameter.
const LARGEST_RISE: f64 = 0.03;
/// Mean radius of a stain over its length, and the largest amplitude of the deviations from it.
const STAIN_RADIUS: f64 = 0.42;
const STAIN_WAVES: f64 = 0.13;
/// Share of the radius over which the coverage of a stain ends.
const SOFT: f64 = 0.25;
/// Coverage in the middle of a stain over that near its rim. A drop that dries leaves more at its rim (Deegan et al.
/// 1997).
const MIDDLE: f64 = 0.7;
/// Colour and roughness of a dried drop of oil.
const STAIN_COLOR: Rgb = Rgb::new(0.22, 0.12, 0.05);
const STAIN_ROUGHNESS: f32 = 0.3;

/// A middle point and rings on the surface. The radius \[m\] is a function of the angle \[rad\]. With each point, the
/// unit direction away from the middle. `None` if the surface ends within the radius.
fn rings(site: &Site<'_>, radius: impl Fn(f64) -> f64) -> Option<(Patch, Vec<DVec3>)> {
    let middle = site.foot;
    let mut spokes = Vec::with_capacity(SPOKES);
    for j in 0..SPOKES {
        let angle = TAU * j as f64 / SPOKES as f64;
        let mut foot = Footing { hit: middle, along: tangent_at(middle.normal, angle) };
        let mut points = Vec::with_capacity(RINGS);
        for _ in 0..RINGS {
            foot = foot.step(&site.surface, radius(angle) / RINGS as f64, 0.0)?;
            points.push(foot);
        }
        spokes.push(points);
    }
    let ordered = (0..RINGS).flat_map(|k| spokes.iter().map(move |s| s[k]));
    let first = Footing { hit: middle, along: DVec3::ZERO };
    let all: Vec<Footing> = [first].into_iter().chain(ordered).collect();
    let patch = Patch::disk(all.iter().map(|f| f.hit).collect(), SPOKES);
    Some((patch, all.iter().map(|f| f.along).collect()))
}

/// Distance from the middle over the radius, of a point of a patch.
fn share(i: usize) -> f64 {
    if i == 0 { 0.0 } else { (1 + (i - 1) / SPOKES) as f64 / RINGS as f64 }
}

/// A dent with the depth `d (1 + cos(pi r / R)) / 2` at the distance r from its middle.
pub(super) fn dent(site: &Site<'_>) -> Option<Made> {
    let (spec, surface) = (site.spec, &site.surface);
    let radius = 0.5 * spec.length;
    let (patch, outward) = rings(site, |_| radius)?;
    let rise = patch.rise(surface).filter(|rise| *rise <= LARGEST_RISE * spec.length)?;
    let offset = site.lift + rise;
    let normal = |i: usize| {
        let slope = 0.5 * PI * spec.depth / radius * (PI * share(i)).sin();
        let n = patch.feet[i].normal;
        (n - outward[i] * slope).try_normalize().unwrap_or(n)
    };
    let is_rim = |i: usize| i + SPOKES >= patch.feet.len();
    if let Some(volume) = &site.volume {
        let bottom = |i: usize| {
            let depth = 0.5 * (spec.depth + offset) * (1.0 + (PI * share(i)).cos());
            if is_rim(i) { offset } else { offset - depth }
        };
        let mesh = shell::closed(&patch, surface, |_| offset, bottom, normal);
        let roughness = material::roughness_or(spec, site.host.roughness);
        return Some(Made { mesh, angle: None, material: material::gas(&spec.name, volume, roughness) });
    }
    // The rim is below the surface, so that no gap is visible at grazing angles.
    let height = |i: usize| if is_rim(i) { -site.lift } else { offset };
    let (mesh, has_uvs) = patch.mesh(surface, Some(site.below), height, normal);
    Some(Made { mesh, angle: None, material: material::like_surface(site.host, spec, has_uvs) })
}

/// A stain with an irregular outline.
pub(super) fn stain(site: &Site<'_>, stream: &mut Pcg) -> Option<Made> {
    let (spec, surface) = (site.spec, &site.surface);
    let outline = Harmonics::draw(stream, 2, 8, STAIN_WAVES);
    let radius = |angle: f64| spec.length * STAIN_RADIUS * (1.0 + outline.at(angle / TAU)).max(0.3);
    let (patch, _) = rings(site, radius)?;
    let rise = patch.rise(surface).filter(|rise| *rise <= LARGEST_RISE * spec.length)?;
    let (mut mesh, _) = patch.mesh(surface, None, |_| site.lift + rise, |i| patch.feet[i].normal);
    let coverage = |i: usize| {
        let r = share(i);
        let edge = ((1.0 - r) / SOFT).clamp(0.0, 1.0);
        spec.strength * edge * edge * (3.0 - 2.0 * edge) * (MIDDLE + (1.0 - MIDDLE) * r * r)
    };
    mesh.colors = (0..patch.feet.len()).map(|i| Vec3::ONE.extend(coverage(i) as f32)).collect();
    let own = material::own(spec, STAIN_COLOR, STAIN_ROUGHNESS);
    Some(Made { mesh, angle: None, material: material::covering_by_colors(own) })
}
