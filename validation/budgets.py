"""Bias of plans, and seconds beyond the given time limit, on the inspection scenes.

    python budgets.py --dunkelfeld ../target/release/dunkelfeld bias --seeds 64
    python budgets.py --dunkelfeld ../target/release/dunkelfeld overrun --seconds 1 3 10 60

`bias` renders each scene with as many seeds for every allocation and compares the mean of the image (green) with that of `uniform` by
Welch's t (unequal variances); rare light makes these means far from normal in a single image, their mean over many seeds less
so. `overrun` measures the whole command from outside, image and EXR included, and compares it with `--time`: 2 % or 0.2 s more
are allowed. Run it alone on the machine.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

SCENES = ("inspection", "inspection-flat", "inspection-open")
ALLOCATIONS = ("uniform", "sobel", "sensor")
SHARE, LEAST = 0.02, 0.2


def render(program: Path, scene: Path, folder: Path, *flags: str) -> Path:
    """Renders; the folder with `image.exr` and `stats.json`. A flagged render (exit 1) is one, too."""
    files = ["-o", folder / "image.png", "--exr", folder / "image.exr", "--stats", folder / "stats.json"]
    done = subprocess.run([program, "render", scene, *flags, "--progress", "none", *files], capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{scene.name} {' '.join(flags)}: {done.stderr}")
    return folder


def statistics_of(folder: Path) -> dict:
    """The statistics of the render."""
    return json.loads((folder / "stats.json").read_text())


def bias(program: Path, scenes: list[Path], seeds: int, size: int, spp: int) -> None:
    """The table of means."""
    print(f"{size} x {size} pixels, {spp} spp on average, {seeds} seeds each\n")
    print("| scene | allocation | mean over uniform's | standard error | Welch's t |\n|---|---|---:|---:|---:|")
    flags = ["--width", str(size), "--height", str(size), "--spp", str(spp)]
    with tempfile.TemporaryDirectory() as folder:
        for scene in scenes:
            means = {}
            for number, allocation in enumerate(ALLOCATIONS):
                # Seeds of its own for each, so that the means are independent.
                own = (str(1000 * number + k) for k in range(1, seeds + 1))
                all_flags = ([*flags, "--allocate", allocation, "--seed", seed] for seed in own)
                stats = [statistics_of(render(program, scene, Path(folder), *f)) for f in all_flags]
                means[allocation] = np.array([s["mean_radiance"][1] for s in stats])
            base = means["uniform"]
            for allocation in ALLOCATIONS[1:]:
                other = means[allocation]
                error = np.sqrt(base.var(ddof=1) / seeds + other.var(ddof=1) / seeds)
                off = other.mean() - base.mean()
                print(f"| {scene.stem} | {allocation} | {off / base.mean():+.2%} | {error / base.mean():.2%} | {off / error:+.2f} |", flush=True)


def overrun(program: Path, scenes: list[Path], seconds: list[float]) -> None:
    """The table of times."""
    print("| scene | limit, s | took, s | allowed, s | samples per pixel | |\n|---|---:|---:|---:|---:|---|")
    with tempfile.TemporaryDirectory() as folder:
        for scene in scenes:
            for asked in seconds:
                before = time.monotonic()
                render(program, scene, Path(folder), "--time", f"{asked}s")
                took = time.monotonic() - before
                allowed = asked + max(SHARE * asked, LEAST)
                spp = statistics_of(Path(folder))["mean_spp"]
                verdict = "kept" if took <= allowed else "MISSED"
                print(f"| {scene.stem} | {asked:g} | {took:.2f} | {allowed:.2f} | {spp:.1f} | {verdict} |", flush=True)


def main() -> int:
    """Prints a table."""
    root = Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True, help="our renderer")
    parser.add_argument("--only", choices=SCENES, nargs="*", default=SCENES)
    what = parser.add_subparsers(dest="what", required=True)
    of_bias = what.add_parser("bias")
    of_bias.add_argument("--seeds", type=int, default=64)
    of_bias.add_argument("--size", type=int, default=32)
    of_bias.add_argument("--spp", type=int, default=64)
    what.add_parser("overrun").add_argument("--seconds", type=float, nargs="+", default=[1.0, 3.0, 10.0, 60.0])
    arguments = parser.parse_args()
    scenes = [root / "scenes" / "inspection" / f"{name}.toml" for name in arguments.only]
    if arguments.what == "bias":
        bias(arguments.dunkelfeld.resolve(), scenes, arguments.seeds, arguments.size, arguments.spp)
    else:
        overrun(arguments.dunkelfeld.resolve(), scenes, arguments.seconds)
    return 0


if __name__ == "__main__":
    sys.exit(main())
