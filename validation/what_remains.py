"""Where the noise of our renders comes from that is left: shares of the samples that each kind of object needs.

    python what_remains.py --dunkelfeld ../target/release/dunkelfeld

Renders the inspection scenes uniformly. The layer `hidden.Y` holds v_r / s, the pooled variance of the rendered mean over the sensor's
own; times the samples that is v / s, which is what a pixel needs but for k^2. As every sample costs about the same, the share of a kind
of objects in the sum of v / s is its share of variance times time, if samples go where they are needed. What is neediest, one pixel
in a hundred, decides when a uniform render is hidden.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np


SCENES = ("inspection", "inspection-flat", "inspection-open")
# Objects that are seen, through smooth glass, by how their names begin.
CLASSES = {
    "aluminium": ("rail", "tab"),
    "screw heads": ("screw",),
    "plates": ("shutter", "mount-plate"),
    "base and ribs": ("base", "boss", "rib"),
    "film": ("film",),
    "symbols": ("symbol",),
}


def rows(program: Path, scene: Path, size: int, spp: int) -> list[str]:
    """The rows of a scene."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    with tempfile.TemporaryDirectory() as folder:
        exr, png = Path(folder) / "image.exr", Path(folder) / "image.png"
        flags = ["--allocate", "uniform", "--spp", spp, "--width", size, "--height", size, "--progress", "none"]
        subprocess.run([str(x) for x in (program, "render", scene, *flags, "--exr", exr, "-o", png)], check=True, capture_output=True)
        bitmap = mi.Bitmap(str(exr))
        names = json.loads(bitmap.metadata()["dunkelfeld"])["objects"]
        column = {field.name: k for k, field in enumerate(bitmap.struct_())}
        pixels = np.array(bitmap, dtype=np.float64)
    need, seen = spp * pixels[..., column["hidden.Y"]], pixels[..., column["id.object"]].astype(int)
    known = np.isfinite(need)
    neediest = known & (need >= np.quantile(need[known], 0.99))
    left, result = known.copy(), []
    for name, beginnings in {**CLASSES, "the rest": None}.items():
        numbers = [k for k, n in enumerate(names) if beginnings is not None and n.startswith(beginnings)]
        here = known & np.isin(seen, numbers) if beginnings is not None else left
        left &= ~here
        if here.any():
            result.append(
                f"| {scene.stem} | {name} | {here.sum() / known.sum():.1%} | {need[here].sum() / need[known].sum():.1%}"
                f" | {np.median(need[here]):.3g} | {(here & neediest).sum() / neediest.sum():.0%} |"
            )
    return result


def main() -> int:
    """Prints the table."""
    root = Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True, help="our renderer")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--spp", type=int, default=1024)
    parser.add_argument("--only", choices=SCENES, nargs="*", default=SCENES)
    arguments = parser.parse_args()
    lines = [
        f"{arguments.size} x {arguments.size} pixels, {arguments.spp} spp, IMX250, exposure auto:",
        "",
        "| scene | shows | pixels | share of all v / s | median v / s | of the neediest 1 % |",
        "|---|---|---:|---:|---:|---:|",
    ]
    for name in arguments.only:
        scene = root / "scenes" / "inspection" / f"{name}.toml"
        lines += rows(arguments.dunkelfeld.resolve(), scene, arguments.size, arguments.spp)
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
