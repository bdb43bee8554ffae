"""Inspection stations for `equal_time.py`, written for both renderers by `parity_scene.py` and `parity_mitsuba.py`.

Each station has wide plates around a dark panel, area lights at grazing angles, and a camera above. The stations are
generated here and used for no other purpose: no constant of the renderer was chosen with them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Callable

import numpy as np

from parity_scene import Camera, Material, Scene, Shape, ball, box, quad

ALUMINIUM = Material(base_color=(0.86, 0.87, 0.88), metallic=1.0, roughness=0.35)
BLACK_PLATE = Material(base_color=(0.03, 0.03, 0.03), roughness=0.5)
PANEL = Material(base_color=(0.02, 0.02, 0.022), roughness=0.3)
SYMBOL = Material(base_color=(0.7, 0.7, 0.68), roughness=0.6)
PMMA = Material(kind="dielectric", base_color=(1.0, 1.0, 1.0), roughness=0.0, eta=1.49)
LIGHT = Material(kind="black", radiance=(40.0, 40.0, 40.0))
CAMERA = Camera(eye=(0.06, 0.9, 0.22), target=(0.0, 0.0, 0.0), yfov=math.radians(33.0))


def lights(material: str = "light") -> list[Shape]:
    """Four bars of 240 mm x 15 mm, 70 mm above the base, that are tilted toward the panel."""
    shapes = []
    for k in range(4):
        turn = 0.5 * math.pi * k
        along = np.array([math.cos(turn), 0.0, -math.sin(turn)])
        inward = np.array([-math.sin(turn), 0.0, -math.cos(turn)])
        up = np.array([0.0, 1.0, 0.0])
        # The front of a bar faces inward and down.
        across = -0.015 * (math.cos(0.5) * up + math.sin(0.5) * inward)
        corner = -0.17 * inward + 0.07 * up - 0.12 * along
        shapes.append(quad(f"bar-{k}", material, tuple(corner), tuple(0.24 * along), tuple(across)))
        normal = np.cross(0.24 * along, across)
        assert normal @ inward > 0.0 and normal[1] < 0.0
    return shapes


def base() -> tuple[list[Shape], dict[str, Material]]:
    """Aluminium profiles at the left and the right, black plates in front and behind, a base plate, a panel with symbols."""
    shapes = [
        box("base", "black", (0.0, -0.01, 0.0), (0.9, 0.02, 0.9)),
        box("left", "aluminium", (-0.27, 0.03, 0.0), (0.14, 0.06, 0.6)),
        box("right", "aluminium", (0.27, 0.03, 0.0), (0.14, 0.06, 0.6)),
        box("front", "black", (0.0, 0.02, 0.27), (0.4, 0.04, 0.12)),
        box("behind", "black", (0.0, 0.02, -0.27), (0.4, 0.04, 0.12)),
        box("panel", "panel", (0.0, 0.004, 0.0), (0.2, 0.008, 0.2)),
    ]
    for k in range(5):
        shapes.append(box(f"symbol-{k}", "symbol", (-0.07 + 0.035 * k, 0.0083, 0.03), (0.018, 0.0005, 0.03), 0.3 * k))
    materials = {"black": BLACK_PLATE, "aluminium": ALUMINIUM, "panel": PANEL, "symbol": SYMBOL, "light": LIGHT}
    return shapes, materials


def plates() -> Scene:
    """No more than the base."""
    shapes, materials = base()
    return Scene("plates", shapes + lights(), materials, camera=CAMERA)


def grooves() -> Scene:
    """A panel of matt metal with 24 V-shaped grooves, 2 mm deep."""
    shapes, materials = base()
    points, triangles = [], []
    for k in range(49):
        x, y = -0.096 + 0.004 * k, 0.0105 if k % 2 == 0 else 0.0085
        points += [(x, y, 0.096), (x, y, -0.096)]
        if k:
            a = 2 * (k - 1)
            triangles += [(a, a + 2, a + 3), (a, a + 3, a + 1)]
    shapes.append(Shape("grooves", np.array(points), np.array(triangles), "matt"))
    materials["matt"] = replace(ALUMINIUM, base_color=(0.5, 0.5, 0.52), roughness=0.6)
    return Scene("grooves", shapes + lights(), materials, camera=CAMERA)


def metals() -> Scene:
    """A brushed bar, a matt bar and a polished ball on the panel."""
    shapes, materials = base()
    # Texture coordinates define the direction of the brush. Without them each renderer chooses its own.
    corners = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    brushed = box("brushed", "brushed", (-0.05, 0.018, -0.03), (0.05, 0.02, 0.1), 0.4)
    shapes += [
        replace(brushed, uvs=np.tile(corners, (6, 1))),
        box("matt", "matt", (0.05, 0.018, -0.03), (0.05, 0.02, 0.1), -0.3),
        ball("ball", "polished", (0.0, 0.028, 0.06), 0.02, smooth=True, rounds=4),
    ]
    materials |= {
        "brushed": replace(ALUMINIUM, roughness=0.3, anisotropic=0.8),
        "matt": replace(ALUMINIUM, base_color=(0.6, 0.58, 0.55), roughness=0.7),
        "polished": replace(ALUMINIUM, roughness=0.12),
    }
    return Scene("metals", shapes + lights(), materials, camera=CAMERA)


def plastics() -> Scene:
    """Coloured and black plastic parts."""
    shapes, materials = base()
    shapes += [
        box("red", "red", (-0.05, 0.028, -0.04), (0.06, 0.04, 0.06), 0.5),
        box("glossy", "glossy", (0.05, 0.028, -0.04), (0.06, 0.04, 0.06), -0.2),
        ball("ball", "white", (0.0, 0.033, 0.06), 0.025, smooth=True, rounds=4),
    ]
    materials |= {
        "red": Material(base_color=(0.6, 0.05, 0.04), roughness=0.4),
        "glossy": Material(base_color=(0.04, 0.04, 0.04), roughness=0.15),
        "white": Material(base_color=(0.8, 0.8, 0.78), roughness=0.5),
    }
    return Scene("plastics", shapes + lights(), materials, camera=CAMERA)


def glass() -> Scene:
    """A ball and a block of glass on the panel."""
    shapes, materials = base()
    shapes += [
        ball("ball", "glass", (-0.05, 0.0335, 0.0), 0.025, smooth=True, rounds=4),
        box("block", "glass", (0.05, 0.0235, -0.02), (0.05, 0.03, 0.05), 0.4),
    ]
    materials["glass"] = replace(PMMA, eta=1.52)
    return Scene("glass", shapes + lights(), materials, camera=CAMERA)


def cover(height: Callable[[np.ndarray, np.ndarray], np.ndarray], cells: int) -> Shape:
    """A closed sheet of 240 mm x 240 mm, 12 mm above the panel, 3 mm thick, with `height` added to its upper face."""
    t = np.linspace(-0.12, 0.12, cells + 1)
    x, z = np.meshgrid(t, t, indexing="ij")
    side = cells + 1
    top = np.stack([x, 0.023 + height(x, z), z], axis=-1).reshape(-1, 3)
    bottom = np.stack([x, np.full_like(x, 0.02), z], axis=-1).reshape(-1, 3)
    step = 1e-5
    slope_x = (height(x + step, z) - height(x - step, z)) / (2 * step)
    slope_z = (height(x, z + step) - height(x, z - step)) / (2 * step)
    up = np.stack([-slope_x, np.ones_like(x), -slope_z], axis=-1).reshape(-1, 3)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    i, k = (a.ravel() for a in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    a, b, c, d = i * side + k, (i + 1) * side + k, (i + 1) * side + k + 1, i * side + k + 1
    faces = np.concatenate([np.stack([a, d, c], axis=1), np.stack([a, c, b], axis=1)])
    positions, normals, triangles = [top, bottom], [up, np.tile([0.0, -1.0, 0.0], (len(bottom), 1))], [faces, faces[:, ::-1] + len(top)]
    count = 2 * len(top)
    # The rim: four sides with flat normals.
    edge = np.arange(side)
    rims = [(edge * side, (0.0, 0.0, -1.0)), (edge * side + cells, (0.0, 0.0, 1.0)), (edge, (-1.0, 0.0, 0.0)), (cells * side + edge, (1.0, 0.0, 0.0))]
    for line, normal in rims:
        ring = np.concatenate([top[line], bottom[line]])
        n = len(line)
        j = np.arange(n - 1)
        quads = np.concatenate([np.stack([j, j + 1, j + n + 1], axis=1), np.stack([j, j + n + 1, j + n], axis=1)])
        first = np.cross(ring[quads[0, 1]] - ring[quads[0, 0]], ring[quads[0, 2]] - ring[quads[0, 0]])
        quads = quads if first @ np.array(normal) > 0.0 else quads[:, ::-1]
        positions.append(ring)
        normals.append(np.tile(normal, (2 * n, 1)))
        triangles.append(quads + count)
        count += 2 * n
    return Shape("cover", np.concatenate(positions), np.concatenate(triangles), "pmma", np.concatenate(normals))


def flat_cover() -> Scene:
    """The panel under a flat sheet of PMMA."""
    shapes, materials = base()
    shapes.append(cover(lambda x, z: 0.0 * x, 1))
    materials["pmma"] = PMMA
    return Scene("flat-cover", shapes + lights(), materials, camera=CAMERA)


def moulded_cover() -> Scene:
    """The panel under a sheet whose upper face is wavy: 0.3 mm at a wavelength of 60 mm."""
    shapes, materials = base()
    wave = 2.0 * math.pi / 0.06
    shapes.append(cover(lambda x, z: 0.0003 * np.sin(wave * x) * np.sin(wave * z), 96))
    materials["pmma"] = PMMA
    return Scene("moulded-cover", shapes + lights(), materials, camera=CAMERA)


def leds() -> Scene:
    """A ring of 60 LEDs of 3 mm x 3 mm instead of the bars."""
    shapes, materials = base()
    for k in range(60):
        turn = 2.0 * math.pi * (k + 0.5) / 60
        outward = np.array([math.sin(turn), 0.0, math.cos(turn)])
        along = np.array([math.cos(turn), 0.0, -math.sin(turn)])
        corner = 0.19 * outward + np.array([0.0, 0.08, 0.0])
        across = -0.8 * np.array([0.0, 1.0, 0.0]) + 0.6 * outward
        shapes.append(quad(f"led-{k}", "led", tuple(corner), tuple(0.003 * along), tuple(0.003 * across)))
    materials["led"] = Material(kind="black", radiance=(900.0, 900.0, 900.0))
    del materials["light"]
    return Scene("leds", shapes, materials, camera=CAMERA)


def dome() -> Scene:
    """A white dome with an opening for the camera, lit from below by the bars, which face upward here."""
    shapes, materials = base()
    rings, spokes, radius = 16, 48, 0.34
    angle = np.linspace(math.radians(24.0), math.radians(90.0), rings + 1)
    turn = 2.0 * math.pi * np.arange(spokes) / spokes
    points = [
        (radius * math.sin(a) * math.sin(t), 0.06 + radius * math.cos(a), radius * math.sin(a) * math.cos(t)) for a in angle for t in turn
    ]
    triangles = []
    for r in range(rings):
        for s in range(spokes):
            a, b = r * spokes + s, r * spokes + (s + 1) % spokes
            c, d = a + spokes, b + spokes
            # Fronts face the middle.
            triangles += [(a, b, d), (a, d, c)]
    shapes.append(Shape("dome", np.array(points), np.array(triangles), "white"))
    for k in range(4):
        t = 0.5 * math.pi * k
        along, outward = np.array([math.cos(t), 0.0, -math.sin(t)]), np.array([math.sin(t), 0.0, math.cos(t)])
        corner = 0.26 * outward + np.array([0.0, 0.065, 0.0]) - 0.1 * along
        shapes.append(quad(f"bar-{k}", "light", tuple(corner), tuple(0.015 * outward), tuple(0.2 * along)))
    materials["white"] = Material(base_color=(0.85, 0.85, 0.85), roughness=0.9)
    camera = replace(CAMERA, eye=(0.0, 0.9, 0.03), yfov=math.radians(20.0))
    return Scene("dome", shapes, materials, camera=camera)


STATIONS: dict[str, Callable[[], Scene]] = {
    "plates": plates,
    "grooves": grooves,
    "metals": metals,
    "plastics": plastics,
    "glass": glass,
    "flat-cover": flat_cover,
    "moulded-cover": moulded_cover,
    "leds": leds,
    "dome": dome,
}
