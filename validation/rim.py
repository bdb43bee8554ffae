"""The front of the moulded cover's rim, with interpolated normals and with so many flat facets that there is nothing to interpolate.

    python rim.py --dunkelfeld ../target/release/dunkelfeld

Interpolated normals stand for a smooth surface. So do facets if they are small: each triangle of the cover is cut into 16, whose
corners lie on the cubic patch that its corners and their normals define (PN triangles: Vlachos, Peters, Boyd, Mitchell 2001). A renderer
that treats interpolated normals well shows the same light either way. Prints the mean of the row of `inspection`, seen
with 32 x 32 pixels, that shows the rim's front, with standard errors from the scatter of renders.
"""

from __future__ import annotations

import argparse
import subprocess
from pathlib import Path
from typing import Callable

import numpy as np

import mitsuba_scene

SIZE, ROW, COLUMNS = 32, 24, slice(7, 25)
MATERIAL, DIVISIONS = "pmma", 4


def patch(p: np.ndarray, n: np.ndarray, divisions: int) -> np.ndarray:
    """Triangles (triangle, corner, xyz) on the cubic patches of corners `p` with unit normals `n`."""

    def edge(i: int, j: int) -> np.ndarray:
        height = ((p[:, j] - p[:, i]) * n[:, i]).sum(axis=-1, keepdims=True)
        return (2.0 * p[:, i] + p[:, j] - height * n[:, i]) / 3.0

    b210, b120, b021, b012, b102, b201 = edge(0, 1), edge(1, 0), edge(1, 2), edge(2, 1), edge(2, 0), edge(0, 2)
    mean = (b210 + b120 + b021 + b012 + b102 + b201) / 6.0
    b111 = mean + (mean - p.mean(axis=1)) / 2.0

    def at(i: int, j: int) -> np.ndarray:
        v, w = i / divisions, j / divisions
        u = 1.0 - (i + j) / divisions
        corners = u**3 * p[:, 0] + v**3 * p[:, 1] + w**3 * p[:, 2]
        first = u * u * v * b210 + u * v * v * b120 + v * v * w * b021 + v * w * w * b012
        return corners + 3.0 * (first + u * w * w * b102 + u * u * w * b201) + 6.0 * u * v * w * b111

    found = []
    for i in range(divisions):
        for j in range(divisions - i):
            found.append([at(i, j), at(i + 1, j), at(i, j + 1)])
            if i + j < divisions - 1:
                found.append([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
    return np.concatenate([np.stack(corners, axis=1) for corners in found])


def divided(glb: mitsuba_scene.Glb, primitive: dict) -> np.ndarray | None:
    """The cover's triangles, divided; nothing for what is not the cover."""
    if glb.json["materials"][primitive["material"]]["name"] != MATERIAL:
        return None
    indices = glb.accessor(primitive["indices"]).reshape(-1, 3)
    corners, normals = (glb.accessor(primitive["attributes"][a])[indices].astype(float) for a in ("POSITION", "NORMAL"))
    triangles = patch(corners, normals / np.linalg.norm(normals, axis=-1, keepdims=True), DIVISIONS)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    return triangles[area > 1e-16]


def report(normals: str, who: str, render: Callable[[int], np.ndarray], renders: int) -> None:
    """A row of the table."""
    means = np.array([render(1 + k)[ROW, COLUMNS].mean() for k in range(renders)])
    error = means.std(ddof=1) / np.sqrt(renders)
    print(f"| {normals} | {who} | {means.mean():.4f} +- {error:.4f} |", flush=True)


def main() -> None:
    """Prints the table."""
    root = Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True, help="our renderer")
    parser.add_argument("--spp", type=int, default=512, help="of each render")
    parser.add_argument("--renders", type=int, default=8)
    parser.add_argument("--work", type=Path, default=root / "out" / "validation" / "rim")
    arguments = parser.parse_args()

    import drjit
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    # Mitsuba 3.9.1 with a single thread never comes back from reading an EXR file.
    drjit.set_thread_count(max(2, drjit.thread_count()))
    arguments.work.mkdir(parents=True, exist_ok=True)
    shipped = root / "scenes" / "inspection" / "inspection.glb"
    print("| rim | renderer | row |\n|---|---|---:|")
    for normals, options in (("interpolated normals", {}), ("flat facets, 16 each", {"faceted": True, "cut": divided})):
        file = mitsuba_scene.equal_terms(shipped, 1.0, arguments.work / f"{len(options)}.glb", **options)
        scene = mitsuba_scene.load(file, SIZE, SIZE)
        report(normals, "Mitsuba", lambda seed: np.array(mi.render(scene, spp=arguments.spp, seed=seed)), arguments.renders)

        def ours(seed: int) -> np.ndarray:
            exr, png = file.with_suffix(".exr"), file.with_suffix(".png")
            rules = ["--allocate", "uniform", "--spp", str(arguments.spp), "--seed", str(seed), "--sensor", "none"]
            size = ["--width", str(SIZE), "--height", str(SIZE), "--progress", "none"]
            command = [arguments.dunkelfeld, "render", mitsuba_scene.job(file), *rules, *size, "--exr", exr, "-o", png]
            subprocess.run(command, check=True, capture_output=True)
            bitmap = mi.Bitmap(str(exr))
            names = [field.name for field in bitmap.struct_()]
            return np.array(bitmap)[..., [names.index(c) for c in "RGB"]]

        report(normals, "ours", ours, arguments.renders)


if __name__ == "__main__":
    main()
