//! Round patches: dents and stains.

use super::draw::Harmonics;
use super::material;
use super::patch::Patch;
use super::shapes;
use super::shell;
use super::site::{Made, Site};
use super::spec::{Dent, Stain};
use super::surface::{LocalSurface, SurfaceHit};
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
/// Smallest cosine between the normal in the middle of a patch and those of its other points: 30 degrees.
const LEAST_COSINE: f64 = 0.866;
/// Smallest cosine between the normals of neighbouring points: 12 degrees. A sharper edge is no smooth surface.
const LEAST_SMOOTH: f64 = 0.978;
/// Largest slope of a dent that is made of shading normals. Steeper ones are hollows: from here on a patch of rough metal,
/// seen at 20 degrees in light from everywhere, is darker than its surroundings by more than the noise of a camera.
const LARGEST_SHADED_SLOPE: f64 = 0.15;
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

/// A middle point and rings around it on the surface. The radius \[m\] is a function of the angle \[rad\]. With each point, the
/// unit direction away from the middle. `None` if the surface ends within the radius, or is not smooth there.
fn rings(surface: &LocalSurface<'_>, middle: SurfaceHit, radius: impl Fn(f64) -> f64) -> Option<(Patch, Vec<DVec3>)> {
    let mut spokes = Vec::with_capacity(SPOKES);
    for j in 0..SPOKES {
        let angle = TAU * j as f64 / SPOKES as f64;
        let mut foot = Footing { hit: middle, along: tangent_at(middle.normal, angle) };
        let mut points = Vec::with_capacity(RINGS);
        for _ in 0..RINGS {
            foot = foot.step(surface, radius(angle) / RINGS as f64, 0.0)?;
            points.push(foot);
        }
        spokes.push(points);
    }
    let ordered = (0..RINGS).flat_map(|k| spokes.iter().map(move |s| s[k]));
    let first = Footing { hit: middle, along: DVec3::ZERO };
    let all: Vec<Footing> = [first].into_iter().chain(ordered).collect();
    let patch = Patch::disk(all.iter().map(|f| f.hit).collect(), SPOKES);
    let cosine = |a: u32, b: u32| patch.feet[a as usize].normal.dot(patch.feet[b as usize].normal);
    let is_smooth = |[a, b, c]: &[u32; 3]| {
        cosine(0, *b) >= LEAST_COSINE
            && [cosine(*a, *b), cosine(*b, *c), cosine(*c, *a)].iter().all(|v| *v >= LEAST_SMOOTH)
    };
    if !patch.triangles.iter().all(is_smooth) {
        return None;
    }
    Some((patch, all.iter().map(|f| f.along).collect()))
}

/// Distance from the middle over the radius, of a point of a patch. Points after the last ring are on the rim.
fn share(i: usize) -> f64 {
    if i == 0 { 0.0 } else { ((1 + (i - 1) / SPOKES) as f64 / RINGS as f64).min(1.0) }
}

/// The largest slope of a dent.
fn steepest(dent: &Dent) -> f64 {
    PI * dent.depth.0 / dent.length.0
}

/// The unit normal at a point of a dent with this largest slope.
fn tilted(patch: &Patch, outward: &[DVec3], i: usize, steepest: f64) -> DVec3 {
    let n = patch.feet[i].normal;
    let outward = outward.get(i).copied().unwrap_or_default();
    (n - outward * (steepest * (PI * share(i)).sin())).try_normalize().unwrap_or(n)
}

/// A dent with the depth `d (1 + cos(pi r / R)) / 2` at the distance r from its middle.
pub(super) fn dent(site: &Site<'_>, dent: &Dent) -> Option<Made> {
    let (surface, depth) = (&site.surface, dent.depth.0);
    let radius = 0.5 * dent.length.0;
    let is_shaded = steepest(dent) <= LARGEST_SHADED_SLOPE && !site.host.is_of_object();
    let rings = rings(surface, site.foot, |_| radius).filter(|_| is_shaded || site.volume.is_some());
    let Some((patch, outward)) = rings else {
        return if site.volume.is_none() { shapes::dent(site, dent) } else { None };
    };
    let normal = |i: usize| tilted(&patch, &outward, i, steepest(dent));
    let rise = patch.rise(surface).filter(|rise| *rise <= LARGEST_RISE * dent.length.0)?;
    let offset = site.lift + rise;
    let is_rim = |i: usize| i + SPOKES >= patch.feet.len();
    if let Some(volume) = &site.volume {
        let bottom = |i: usize| {
            let depth = 0.5 * (depth + offset) * (1.0 + (PI * share(i)).cos());
            if is_rim(i) { offset } else { offset - depth }
        };
        let mesh = shell::closed(&patch, surface, |_| offset, bottom, normal);
        return Some(Made::new(mesh, None, material::gas(&site.finish, volume, site.host.roughness.factor)));
    }
    // The rim is below the surface, so that no gap is visible at grazing angles.
    let height = |i: usize| if is_rim(i) { -site.lift } else { offset };
    let (mesh, has_uvs) = patch.mesh(surface, Some(site.below), height, normal);
    Some(Made::new(mesh, None, material::like_surface(site.host, &site.finish, has_uvs)))
}

/// A stain with an irregular outline.
pub(super) fn stain(site: &Site<'_>, stain: &Stain, stream: &mut Pcg) -> Option<Made> {
    let (surface, length, strength) = (&site.surface, stain.length.0, stain.strength.map_or(1.0, |s| s.0));
    let outline = Harmonics::draw(stream, 2, 8, STAIN_WAVES);
    let radius = |angle: f64| length * STAIN_RADIUS * (1.0 + outline.at(angle / TAU)).max(0.3);
    let (patch, _) = rings(surface, site.foot, radius)?;
    let rise = patch.rise(surface).filter(|rise| *rise <= LARGEST_RISE * length)?;
    let (mut mesh, _) = patch.mesh(surface, None, |_| site.lift + rise, |i| patch.feet[i].normal);
    let coverage = |i: usize| {
        let r = share(i);
        let edge = ((1.0 - r) / SOFT).clamp(0.0, 1.0);
        strength * edge * edge * (3.0 - 2.0 * edge) * (MIDDLE + (1.0 - MIDDLE) * r * r)
    };
    mesh.colors = (0..patch.feet.len()).map(|i| Vec3::ONE.extend(coverage(i) as f32)).collect();
    let own = material::own(&site.finish, STAIN_COLOR, STAIN_ROUGHNESS);
    Some(Made::new(mesh, None, material::covering_by_colors(own)))
}
