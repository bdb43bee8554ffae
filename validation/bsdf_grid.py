"""Writes the table of Mitsuba's BSDF values that `cargo test -p dunkelfeld-bsdf --test it mitsuba` holds ours to.

    python bsdf_grid.py > ../crates/engine/bsdf/tests/it/mitsuba/table.txt      # the table that is kept
    python bsdf_grid.py --mixes 3000 --seed 7 > big.txt               # a thorough one:
    DUNKELFELD_MITSUBA_TABLE=$PWD/big.txt cargo test -p dunkelfeld-bsdf --test it mitsuba

Every parameter of `principled` is swept alone, on plastic, metal or glass as it has an effect there; then come random mixes
of all parameters, `roughdielectric` over index and slope, what smooth `dielectric` and `thindielectric` reflect, and rough
sheets. Mitsuba has no rough sheet of ours: its `principledthin` lets no light bounce between the faces and is smoother for what
passes than for what it reflects. But its facets are ours. So a value here is that of `principledthin`, asked with the
roughness that makes its slope the wanted one on the side in question, times what `thindielectric` and `dielectric` say
of a facet at that angle: the share of a sheet over the share of a single face. Lines:

    pair  wo.xyz wi.xyz                          directions, numbered in order; wo is the camera's side (Mitsuba's si.wi)
    principled  name=value ... : r g b ...       values at all pairs, in order; parameters that are absent are Mitsuba's defaults
    roughdielectric  eta=.. alpha=.. : v ...     one value per pair: it is grey
    dielectric  eta=.. : R ...                   reflected share, one for the wo of each pair
    thindielectric  eta=.. : R ...
    roughthin  eta=.. alpha=.. : v ...           one value per pair: it is grey

Values include the cosine of wi. Mitsuba computes in f32 (PyPI has no other variant), and so do we.
"""

import argparse

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
CONTEXT = mi.BSDFContext()


def direction(theta, phi):
    """A unit vector in f32, by polar angle and azimuth in degrees."""
    t, p = np.radians(theta), np.radians(phi)
    v = np.array([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)])
    return v.astype(np.float32)


def pairs():
    """Near and far from the mirror direction, retro, grazing, in and out of the plane, and through the surface both ways."""
    found = []
    for theta, phi in [(5, 20), (48, 70), (80, 200)]:
        for dtheta, dphi in [(2, 183), (-12, 170), (0, 5)]:
            found.append((direction(theta, phi), direction(abs(theta + dtheta), phi + dphi)))
        found.append((direction(theta, phi), direction(86, phi + 100)))
        # Straight on, and bent the way that glass bends.
        found.append((direction(theta, phi), direction(180 - theta, phi + 180)))
        found.append((direction(theta, phi), direction(180 - 0.6 * theta, phi + 174)))
    found.append((direction(150, 40), direction(145, 215)))
    found.append((direction(150, 40), direction(45, 225)))
    found.append((direction(112, 10), direction(115, 185)))
    found.append((direction(112, 10), direction(70, 160)))
    return found


def sweeps():
    plastic = dict(base_color=(0.6, 0.3, 0.1))
    metal = dict(plastic, metallic=1.0, roughness=0.4)
    glass = dict(plastic, spec_trans=1.0, roughness=0.4)
    cloth = dict(plastic, sheen=1.0)
    coated = dict(plastic, clearcoat=1.0)

    def sweep(name, values, *bases):
        return [dict(base, **{name: v}) for base in bases for v in values]

    return [
        *sweep("base_color", [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.8, 0.1, 0.02)], plastic, metal, glass),
        *sweep("metallic", [0.25, 0.5, 0.75, 1.0], plastic),
        *sweep("metallic", [0.5], glass),
        *sweep("roughness", [0.1, 0.2, 0.35, 0.7, 1.0], plastic, metal, glass),
        *sweep("anisotropic", [0.3, 0.6, 1.0], plastic, metal, glass),
        *sweep("eta", [0.7, 1.05, 1.33, 1.8, 2.4], plastic, glass),
        *sweep("specular", [0.1, 0.5, 1.0], plastic, glass),
        *sweep("spec_tint", [0.5, 1.0], plastic, glass),
        *sweep("spec_trans", [0.25, 0.5, 0.75], plastic),
        *sweep("sheen", [0.3, 1.0], plastic),
        *sweep("sheen_tint", [0.5, 1.0], cloth),
        *sweep("clearcoat", [0.3, 1.0], plastic),
        *sweep("clearcoat_gloss", [0.5, 0.9, 1.0], coated),
    ]


def mix(rng):
    def maybe(p):
        """Zero, one, or something between: corners of the parameter space are visited on purpose."""
        return round(float(rng.choice([1.0, rng.uniform(), rng.uniform()])), 3) if rng.random() < p else 0.0

    return dict(
        base_color=tuple(round(float(x), 3) for x in rng.uniform(0, 1, 3)),
        metallic=maybe(0.5),
        roughness=round(float(rng.choice([rng.uniform(0.1, 1), 1.0])), 3),
        anisotropic=maybe(0.5),
        eta=round(float(rng.uniform(1.1, 2.5)), 3),
        spec_tint=maybe(0.4),
        spec_trans=maybe(0.6),
        sheen=maybe(0.4),
        sheen_tint=maybe(0.4),
        clearcoat=maybe(0.4),
        clearcoat_gloss=maybe(0.5),
    )


def interaction(wo):
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*map(float, wo))
    return si


def load(kind, parameters):
    plugin = {k: {"type": "rgb", "value": list(v)} if k == "base_color" else v for k, v in parameters.items()}
    return mi.load_dict({"type": kind, **plugin})


def line(kind, parameters, numbers):
    text = lambda v: ",".join(f"{x:g}" for x in v) if isinstance(v, tuple) else f"{v:g}"
    print(kind, *(f"{k}={text(v)}" for k, v in parameters.items()), ":", *(f"{x:.6g}" for x in numbers))


def evaluate(bsdf, wo, wi):
    return np.array(bsdf.eval(CONTEXT, interaction(wo), mi.Vector3f(*map(float, wi))))


def reflected_share(bsdf, wo):
    """Smooth boundaries choose reflection with the probability of what it carries."""
    for u in [0.0, 0.999999]:
        sample, _ = bsdf.sample(CONTEXT, interaction(wo), u, mi.Point2f(0.5, 0.5))
        if np.array(sample.wo)[2] * wo[2] > 0:
            return float(sample.pdf)
    return 0.0


def rough_sheet(eta, alpha, wo, wi):
    """A sheet whose facets have slope `alpha`, both faces and all reflections between them as one surface."""
    # Both sides are alike; `principledthin` answers for its front.
    side = np.sign(wo[2])
    wo, wi = wo * [1, 1, side], wi * [1, 1, side]
    reflects = wi[2] > 0
    # Its slope is the square of the roughness, which for light that passes is scaled (Burley 2015).
    roughness = np.sqrt(alpha) / (1.0 if reflects else 0.65 * eta - 0.35)
    assert 0.0 < roughness <= 1.0, f"principledthin has no slope {alpha} at index {eta}"
    white = dict(base_color=(1.0, 1.0, 1.0), spec_trans=1.0, diff_trans=0.0, flatness=0.0, eta=eta, roughness=float(roughness))
    value = evaluate(load("principledthin", white), wo, wi)[0]
    half = wo + wi * [1, 1, 1 if reflects else -1]
    cosine = min(float(wo @ half / np.linalg.norm(half)), 1.0)
    seen = np.array([np.sqrt(1.0 - cosine**2), 0.0, cosine])
    index = dict(int_ior=eta, ext_ior=1.0)
    sheet, face = (reflected_share(load(kind, index), seen) for kind in ("thindielectric", "dielectric"))
    return value * (sheet / face if reflects else (1.0 - sheet) / (1.0 - face))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--mixes", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    directions = pairs()

    print(f"# Mitsuba {mi.__version__}, {mi.variant()}; made by validation/bsdf_grid.py, which explains the lines.")
    for wo, wi in directions:
        print("pair", *(f"{x:.9g}" for x in (*wo, *wi)))
    for p in sweeps() + [mix(rng) for _ in range(arguments.mixes)]:
        bsdf = load("principled", p)
        line("principled", p, np.concatenate([evaluate(bsdf, wo, wi) for wo, wi in directions]))
    for eta in [1.05, 1.33, 1.5, 2.4, 0.8, 0.6]:
        for alpha in [0.03, 0.2, 0.7]:
            bsdf = load("roughdielectric", dict(distribution="ggx", alpha=alpha, int_ior=eta, ext_ior=1.0))
            values = [evaluate(bsdf, wo, wi) for wo, wi in directions]
            line("roughdielectric", dict(eta=eta, alpha=alpha), [v[0] for v in values])
    for eta, alpha in [(1.33, 0.05), (1.5, 0.1), (1.5, 0.3), (2.0, 0.5), (2.4, 0.9)]:
        line("roughthin", dict(eta=eta, alpha=alpha), [rough_sheet(eta, alpha, wo, wi) for wo, wi in directions])
    for kind in ["dielectric", "thindielectric"]:
        for eta in [1.05, 1.49, 2.4, 0.7]:
            bsdf = load(kind, dict(int_ior=eta, ext_ior=1.0))
            line(kind, dict(eta=eta), [reflected_share(bsdf, wo) for wo, _ in directions])


if __name__ == "__main__":
    main()
