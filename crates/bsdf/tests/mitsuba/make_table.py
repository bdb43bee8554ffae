"""Writes table.txt: values of Mitsuba's BSDFs that the Rust code is tested against.

Needs mitsuba==3.9.1 and numpy==2 from PyPI; not needed by `cargo test`. Usage: make_table.py ROWS SEED > table.txt

A row holds: kind; then base_color.rgb metallic roughness anisotropic eta spec_tint spec_trans sheen sheen_tint
clearcoat clearcoat_gloss (principled) or eta alpha (roughdielectric), each padded to 13 columns with zeros; wo.xyz; wi.xyz;
eval.rgb. Directions follow this project: wo is the camera side (Mitsuba's si.wi). Values include the cosine of wi.
"""

import sys

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
ROWS, SEED = int(sys.argv[1]), int(sys.argv[2])
rng = np.random.default_rng(SEED)


def sphere():
    z, phi = rng.uniform(-1, 1), rng.uniform(0, 2 * np.pi)
    r = np.sqrt(1 - z * z)
    return np.array([r * np.cos(phi), r * np.sin(phi), z])


def maybe(p):
    """Zero, one, or something between: corners of the parameter space are visited on purpose."""
    if rng.random() > p:
        return 0.0
    return round(float(rng.choice([1.0, rng.uniform(), rng.uniform()])), 3)


def principled():
    base = [round(float(x), 3) for x in rng.uniform(0, 1, 3)]
    p = dict(
        metallic=maybe(0.4),
        roughness=round(float(rng.choice([rng.uniform(0.08, 1), rng.uniform(0.2, 1), 1.0])), 3),
        anisotropic=maybe(0.4),
        eta=round(float(rng.choice([1.5, rng.uniform(1.1, 2.5)])), 3),
        spec_tint=maybe(0.3),
        spec_trans=maybe(0.5),
        sheen=maybe(0.3),
        sheen_tint=maybe(0.3),
        clearcoat=maybe(0.3),
        clearcoat_gloss=round(0.9 * maybe(0.5), 3),  # at 1 the cancellation in f32 there exceeds the tolerance
    )
    bsdf = mi.load_dict({"type": "principled", "base_color": {"type": "rgb", "value": base}, **p})
    return bsdf, base + list(p.values())


def rough_dielectric():
    eta = round(float(rng.choice([rng.uniform(1.1, 2.5), 1 / rng.uniform(1.1, 2.5)])), 4)
    alpha = round(float(rng.uniform(0.01, 0.9)), 3)
    bsdf = mi.load_dict({"type": "roughdielectric", "distribution": "ggx", "alpha": alpha, "int_ior": eta, "ext_ior": 1.0})
    return bsdf, [eta, alpha] + [0.0] * 11


print("# Mitsuba", mi.__version__, "scalar_rgb, made by make_table.py; columns are explained there.")
ctx = mi.BSDFContext()
count = 0
while count < ROWS:
    kind = "principled" if rng.random() < 0.8 else "roughdielectric"
    bsdf, params = principled() if kind == "principled" else rough_dielectric()
    wo = sphere()
    if rng.random() < 0.7:
        wo[2] = abs(wo[2])
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*wo)
    if rng.random() < 0.7:
        bs, _ = bsdf.sample(ctx, si, float(rng.random()), mi.Point2f(*rng.random(2)))
        wi = np.array(bs.wo)
        if not np.isfinite(wi).all() or np.linalg.norm(wi) < 0.5:
            continue
    else:
        wi = sphere()
    value = np.array(bsdf.eval(ctx, si, mi.Vector3f(*wi)))
    if not value.any() and rng.random() < 0.9:
        continue
    numbers = [f"{x:g}" for x in params] + [f"{x:.9g}" for x in (*wo, *wi)] + [f"{x:.6g}" for x in value]
    print(kind[0], *numbers)
    count += 1
