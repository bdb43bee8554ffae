"""Noise of the lamps of a job against emitting meshes of the same shape and power, in whole renders.

A lamp is one light with a surface. Its light samples should have the noise of an area light. Each case renders a plate with
three boxes once under a lamp of `[[light]] kind`, and once under a mesh of triangles that emit, with as many uniform samples.
The table has the variance of the lamp over that of the mesh, as median and mean over the pixels, the standard error of both
by the jackknife over the renders, and the ratio of the means of the images with Welch's z.

    pip install ./crates/apps/python numpy
    python validation/lamps.py
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import dunkelfeld

HEIGHT = 0.15
POWER = 2.0
TURNS = 96


def mesh(path, triangles):
    """An OBJ file of triangles [m], shape (n, 3, 3), whose front is counter-clockwise."""
    lines = ["o lamp"]
    for corners in triangles:
        lines += ["v " + " ".join(repr(float(v)) for v in corner) for corner in corners]
    lines += [f"f {3 * i + 1} {3 * i + 2} {3 * i + 3}" for i in range(len(triangles))]
    path.write_text("\n".join(lines) + "\n")


def quads(a, b, c, d):
    """Two triangles for each of the quads, shape (n, 3) a corner."""
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def circle(radius, y, centre=(0.0, 0.0), turns=TURNS):
    """The corners of a polygon with the area of the circle, in the plane of this height, and the corners after them."""
    angle = 2 * np.pi * np.arange(turns) / turns
    radius = radius * np.sqrt(2 * np.pi / turns / np.sin(2 * np.pi / turns))
    corners = np.stack(
        [centre[0] + radius * np.cos(angle), np.full(turns, y), centre[1] + radius * np.sin(angle)], axis=1
    )
    return corners, np.roll(corners, -1, axis=0)


def disc(radius, centre=(0.0, 0.0), turns=TURNS, height=HEIGHT):
    """A disc that faces down."""
    corners, after = circle(radius, height, centre, turns)
    middle = np.broadcast_to([centre[0], height, centre[1]], corners.shape)
    return np.stack([middle, corners, after], axis=1)


def annulus(outer, inner):
    """An annulus that faces down."""
    (a, b), (d, c) = circle(outer, HEIGHT), circle(inner, HEIGHT)
    return quads(a, b, c, d)


def rectangle(width, depth):
    """A rectangle that faces down."""
    x, z = width / 2, depth / 2
    corners = [[x, HEIGHT, -z], [x, HEIGHT, z], [-x, HEIGHT, z], [-x, HEIGHT, -z]]
    return quads(*(np.array([corner]) for corner in corners))


def dome(radius, opening, base):
    """A hemisphere that shines inward, with an opening at the top. `base` is the height of its rim [m]."""
    first = np.arcsin(opening / 2 / radius)
    angles = np.linspace(first, np.pi / 2, 25)
    rings = [circle(radius * np.sin(a), base + radius * np.cos(a)) for a in angles]
    return np.concatenate([quads(a, d, c, b) for (a, b), (d, c) in zip(rings[:-1], rings[1:], strict=True)])


def leds(columns, spacing, diameter):
    """Discs on a grid that face down, in front of a plate at the height of the lamp."""
    height = HEIGHT - 0.05 * diameter
    places = (np.arange(columns) - (columns - 1) / 2) * spacing
    return np.concatenate([disc(diameter / 2, (x, z), 24, height) for x in places for z in places])


def cases():
    """Name, keys of the lamp, triangles of the mesh."""
    down = f'position = [0, {HEIGHT}, 0]\ntarget = [0, 0, 0]\nup = [0, 0, 1]\npower = "{POWER}W"\n'
    yield "panel", f'kind = "panel"\nwidth = "100mm"\nheight = "100mm"\n{down}', rectangle(0.1, 0.1)
    yield "bar", f'kind = "bar"\nwidth = "160mm"\nheight = "16mm"\n{down}', rectangle(0.16, 0.016)
    yield "round panel", f'kind = "panel"\ndiameter = "100mm"\n{down}', disc(0.05)
    ring = 'kind = "ring"\ndiameter = "120mm"\ninner_diameter = "90mm"\n'
    yield "ring", f"{ring}{down}", annulus(0.06, 0.045)
    grid = 'kind = "panel"\nwidth = "100mm"\nheight = "100mm"\nleds = [5, 5]\nled_diameter = "8mm"\n'
    yield "panel of 25 LEDs", f"{grid}{down}", leds(5, 0.02, 0.008)
    place = 'position = [0, 0.01, 0]\ntarget = [0, 0, 0]\nup = [0, 0, 1]\n'
    yield (
        "dome",
        f'kind = "dome"\ndiameter = "160mm"\nopening = "40mm"\n{place}power = "{POWER}W"\n',
        dome(0.08, 0.04, 0.01),
    )


JOB = """
scene = {scene}
camera = {{ look_at = [0, 0, 0], position = {camera}, vertical_fov = "{fov}deg" }}
film = {{ width = {size}, height = {size} }}
sensor = {{ model = "none" }}
allocate = {{ strategy = "uniform" }}
[[object]]
name = "plate"
kind = "box"
size = ["120mm", "4mm", "120mm"]
translate = [0, "-2mm", 0]
[[object]]
name = "part"
kind = "box"
size = ["12mm", "10mm", "30mm"]
translate = [0, "5mm", 0]
grid = {{ count = [3, 1, 1], step = ["25mm", "1mm", "1mm"] }}
[[material]]
name = "plate"
base_color = 0.6
roughness = 0.4
[[material]]
name = "part"
metallic = 1
roughness = 0.25
"""

BLACK = """
[[material]]
name = "black"
new = true
base_color = 0.04
roughness = 1
specular = 0
"""


def images(job, seeds, spp):
    """The luminance of one render for each seed, shape (renders, height, width)."""
    scene = dunkelfeld.Scene.from_job(job) if isinstance(job, str) else dunkelfeld.Scene(job)
    return np.stack([scene.render(spp=spp, seed=seed).mean.mean(axis=2) for seed in seeds]).astype(np.float64)


def ratios(lamp, mesh):
    """Median and mean over the pixels of the variances, lamp over mesh."""
    a, b = lamp.var(axis=0, ddof=1), mesh.var(axis=0, ddof=1)
    return np.array([np.median(a) / np.median(b), a.mean() / b.mean()])


def jackknife(lamp, mesh):
    """Standard errors of the ratios."""
    n = len(lamp)
    without = np.array([ratios(np.delete(lamp, i, axis=0), np.delete(mesh, i, axis=0)) for i in range(n)])
    return np.sqrt((n - 1) / n * ((without - without.mean(axis=0)) ** 2).sum(axis=0))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--renders", type=int, default=24)
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--size", type=int, default=96)
    arguments = parser.parse_args()
    print("| lamp | triangles of the mesh | variance, lamp over mesh: median | mean | means, lamp over mesh | z |")
    print("|---|---:|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as folder:
        for name, keys, triangles in cases():
            mesh(Path(folder) / "lamp.obj", triangles)
            # Beside the lamp; through the opening of a dome.
            camera, fov = ("[0, 0.3, 0.002]", 8) if name == "dome" else ("[0.25, 0.14, 0.05]", 20)
            values = {"size": arguments.size, "camera": camera, "fov": fov}
            with_lamp = JOB.format(scene='"none"', **values) + f"[[light]]\n{keys}"
            with_mesh = JOB.format(scene='"lamp.obj"', **values)
            # The body of a lamp reflects 4 % diffusely, and LEDs have a black plate behind them.
            with_mesh += BLACK + '[[object]]\nname = "lamp"\nmaterial = "black"\n'
            if "LED" in name:
                with_mesh += '[[object]]\nname = "back"\nkind = "box"\nsize = ["100mm", "1mm", "100mm"]\n'
                with_mesh += f'translate = [0, {HEIGHT + 0.0005}, 0]\nmaterial = "black"\n'
            with_mesh += f'[[light]]\nname = "lamp"\npower = "{POWER}W"\n'
            path = Path(folder) / "mesh.toml"
            path.write_text(with_mesh)
            a = images(with_lamp, range(arguments.renders), arguments.spp)
            b = images(path, range(1000, 1000 + arguments.renders), arguments.spp)
            found, errors = ratios(a, b), jackknife(a, b)
            means = [image.mean(axis=(1, 2)) for image in (a, b)]
            spread = np.sqrt(sum(m.var(ddof=1) / len(m) for m in means))
            z = (means[0].mean() - means[1].mean()) / spread
            cells = " | ".join(f"{value:.2f} ± {error:.2f}" for value, error in zip(found, errors, strict=True))
            ratio = means[0].mean() / means[1].mean()
            print(f"| {name} | {len(triangles)} | {cells} | {ratio:.4f} | {z:+.1f} |", flush=True)


if __name__ == "__main__":
    main()
