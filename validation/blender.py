"""Scenes of Blender, exported with the add-on: Cycles against Dunkelfeld, object by object.

    python blender.py --dunkelfeld ../target/release/dunkelfeld --blender-python cycles/bin/python --readme

`blender_scenes.py` builds, exports and renders each scene, with the Python of `requirements-cycles.txt`. Both renderers take
batches of different seeds; the scatter of the means gives the standard errors. The pixels of an object are those in which
Cycles renders it without the blur of the lens. An object passes if its mean radiance agrees within 2 %, and if the standard error of the
difference is at most 0.5 %. Renders are stored in `out/validation/blender` and used again; delete the files of a scene to
render it anew.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from readme_table import into_readme

SCENES = ("areas", "point-and-spot", "sun", "emission", "hdr", "glass", "depth-of-field", "orthographic")
BAR = 0.02
ERROR_BAR = 0.005
# An object with fewer pixels is not compared.
PIXELS = 12


@dataclass(frozen=True)
class Row:
    """An object of a scene: mean radiance over pixels and channels [W/(m2 sr)], and the relative difference."""

    scene: str
    object: str
    pixels: int
    cycles: float
    dunkelfeld: float
    difference: float
    error: float

    @property
    def verdict(self) -> str:
        """`pass`, `FAILS`, or `not converged` where noise could hide a failure."""
        if abs(self.difference) > BAR + 3.0 * self.error:
            return "FAILS"
        return "pass" if abs(self.difference) <= BAR and self.error <= ERROR_BAR else "not converged"


def image(file: Path) -> np.ndarray:
    """Mean radiance: (row, column, channel)."""
    import mitsuba as mi

    bitmap = mi.Bitmap(str(file))
    column = {field.name: k for k, field in enumerate(bitmap.struct_())}
    return np.array(bitmap, dtype=np.float64)[..., [column[c] for c in "RGB"]]


def ours(program: Path, job: Path, spp: int, batches: int, threads: int) -> list[Path]:
    """Renders the batches that are missing."""
    files = [job.with_name(f"{job.stem}-ours-{batch}.exr") for batch in range(batches)]
    for batch, file in enumerate(files):
        if file.exists():
            continue
        flags = ["--allocate", "uniform", "--spp", spp, "--seed", batch + 1, "--progress", "none", "--threads", threads]
        command = [program, "render", job, "--sensor", "none", *flags, "--exr", file, "-o", file.with_suffix(".png")]
        done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1) or not file.exists():
            raise SystemExit(f"{' '.join(map(str, command))}\n{done.stderr}")
    return files


def compared(scene: str, names: list[str], numbers: np.ndarray, cycles: np.ndarray, own: np.ndarray) -> list[Row]:
    """The rows of a scene. `numbers`: of the object of each pixel, 0 for the world; `cycles` and `own`: (batch, row, column,
    channel)."""
    rows = []
    for number, name in enumerate(["world", *names]):
        here = numbers == number
        if here.sum() < PIXELS:
            continue
        theirs, mine = (batches[:, here].mean(axis=(1, 2)) for batches in (cycles, own))
        error = np.sqrt(theirs.var(ddof=1) / len(theirs) + mine.var(ddof=1) / len(mine)) / theirs.mean()
        found = (float(theirs.mean()), float(mine.mean()), float(mine.mean() / theirs.mean() - 1.0), float(error))
        rows.append(Row(scene, name, int(here.sum()), *(round(x, 6) for x in found)))
    return rows


def summary(rows: list[Row], version: str) -> str:
    """A row for each scene; the background is in a column of its own."""
    lines = [
        f"Cycles of Blender {version}; the difference of the mean radiance over the pixels of an object, that of the worst object:",
        "",
        "| scene | objects within 2 % | largest difference | its standard error | background |",
        "|---|---:|---:|---:|---:|",
    ]
    for scene in dict.fromkeys(row.scene for row in rows):
        here = [row for row in rows if row.scene == scene and row.object != "world"]
        behind = [f"{row.difference:+.2%}" for row in rows if row.scene == scene and row.object == "world"]
        worst = max(here, key=lambda row: abs(row.difference))
        passed = sum(row.verdict == "pass" for row in here)
        largest = f"{worst.difference:+.2%} ({worst.object}) | {worst.error:.2%}"
        lines.append(f"| `{scene}` | {passed} of {len(here)} | {largest} | {''.join(behind) or 'hidden'} |")
    return "\n".join(lines) + "\n"


def table(rows: list[Row], version: str) -> str:
    """A row for each object."""
    things = [row for row in rows if row.object != "world"]
    passed = sum(row.verdict == "pass" for row in things)
    behind = [row for row in rows if row.object == "world"]
    lines = [
        (
            f"Cycles of Blender {version}. {passed} of {len(things)} objects pass; their largest difference is"
            f" {max(abs(row.difference) for row in things):.2%}, their largest standard error {max(row.error for row in things):.2%}."
            f" {sum(row.verdict == 'pass' for row in behind)} of {len(behind)} backgrounds (`world`) pass."
        ),
        "",
        "| scene | object | pixels | Cycles | Dunkelfeld | difference | standard error | result |",
        "|---|---|---:|---:|---:|---:|---:|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row.scene} | {row.object} | {row.pixels} | {row.cycles:.4g} | {row.dunkelfeld:.4g}"
            f" | {row.difference:+.2%} | {row.error:.2%} | {row.verdict} |"
        )
    return "\n".join(lines) + "\n"


def worker(arguments: argparse.Namespace, scene: str, spp: int, batches: int) -> dict[str, Any]:
    """Builds, exports and renders a scene, if that is not done. Gives the facts that `blender_scenes.py` prints."""
    said = arguments.work / f"{scene}.json"
    if not said.exists():
        flags = ["--spp", spp, "--batches", batches, "--threads", arguments.threads]
        script = Path(__file__).with_name("blender_scenes.py")
        command = [str(part) for part in (arguments.blender_python, script, scene, arguments.work, *flags)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise SystemExit(done.stderr)
        said.write_text(done.stdout)
    facts: dict[str, Any] = json.loads(said.read_text())
    return facts


def picture(arguments: argparse.Namespace, file: Path) -> None:
    """Cycles beside the image of a camera, both in grey with gamma 2.2 and the same mean."""
    from PIL import Image

    worker(arguments, "bench", 256, 1)
    job, png = arguments.work / "bench.toml", arguments.work / "bench-camera.png"
    flags = ["--sensor", "imx250", "--time", "20s", "--threads", max(arguments.threads, 1), "--progress", "none"]
    command = [str(part) for part in (arguments.dunkelfeld.resolve(), "render", job, *flags, "-o", png)]
    subprocess.run(command, check=True, capture_output=True)
    camera = np.array(Image.open(png).convert("L"), dtype=np.float64) / 255.0
    theirs = image(arguments.work / "bench-0.exr").mean(axis=-1)
    low, high = 0.0, 1e6
    for _ in range(60):
        # The scale that gives the same mean after clipping.
        scale = 0.5 * (low + high)
        is_dark = np.clip(scale * theirs, 0.0, 1.0).mean() < (camera**2.2).mean()
        low, high = (scale, high) if is_dark else (low, scale)
    left = np.clip(scale * theirs, 0.0, 1.0) ** (1.0 / 2.2)
    gap = np.ones((left.shape[0], 8))
    pixels = np.rint(255.0 * np.hstack([left, gap, camera])).astype(np.uint8)
    Image.fromarray(pixels, "L").save(file, optimize=True)


def main() -> int:
    """Renders, prints and stores the table."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    root = Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True, help="our renderer")
    parser.add_argument("--blender-python", required=True, help="a Python with the packages of requirements-cycles.txt")
    parser.add_argument("--only", choices=SCENES, nargs="*", default=SCENES)
    parser.add_argument("--spp", type=int, default=512, help="samples per pixel of a batch of Cycles")
    parser.add_argument("--own-spp", type=int, default=128, help="samples per pixel of a batch of Dunkelfeld")
    parser.add_argument("--batches", type=int, default=8)
    parser.add_argument("--threads", type=int, default=0, help="0: all")
    parser.add_argument("--work", type=Path, default=root / "out" / "validation" / "blender")
    parser.add_argument(
        "--readme", action="store_true", help="write blender.csv, and the table into docs/blender.md"
    )
    parser.add_argument("--picture", action="store_true", help="write docs/blender.png")
    arguments = parser.parse_args()
    rows, version = [], ""
    for scene in arguments.only:
        facts = worker(arguments, scene, arguments.spp, arguments.batches)
        version = facts["version"]
        numbers = np.rint(image(arguments.work / f"{scene}-objects.exr")[..., 0]).astype(int)
        cycles = np.stack([image(arguments.work / f"{scene}-{batch}.exr") for batch in range(arguments.batches)])
        job = arguments.work / f"{scene}.toml"
        files = ours(arguments.dunkelfeld.resolve(), job, arguments.own_spp, arguments.batches, arguments.threads)
        found = compared(scene, facts["objects"], numbers, cycles, np.stack([image(file) for file in files]))
        print(table(found, version), flush=True)
        rows += found
    if arguments.picture:
        picture(arguments, root / "docs" / "blender.png")
    if arguments.readme:
        with Path(__file__).with_name("blender.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
            writer.writeheader()
            writer.writerows(asdict(row) for row in rows)
        into_readme(summary(rows, version), "blender by scene")
    return 0 if all(row.verdict == "pass" for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
