"""Noise after equal processor time: Dunkelfeld against Mitsuba 3, in every part of the image.

    python equal_time.py --dunkelfeld ../target/release/dunkelfeld

Both renderers render the shipped inspection scenes and the stations of `stations.py`, in turn, with uniform samples and a
seed of its own for each render. For a pixel, v is the variance of one sample over the renders [e-^2], and s the temporal
variance of an IMX250 at the mean of our renders (EMVA 1288), at an exposure that brings the 99.5 % quantile to 90 % of
saturation. The noise of a renderer is v / s times the processor seconds of one sample in every pixel. The table holds the
noise of Mitsuba over ours, at the median, the mean, the 90 % and the 99 % quantile over the unsaturated pixels: above 1 our
image is cleaner after the same time. The relative mean squared error, v / (mean^2 + (1 % of the mean of the image)^2), is
compared in the same way.

Processor time is user and system time of the process. Reading, building trees, writing files and compiling kernels are left
out: they are measured with renders of one sample. The standard errors come from the jackknife over the renders.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

import mitsuba_scene
import parity_mitsuba
import parity_scene
from readme_table import into_readme
from stations import STATIONS
from time_to_hidden import LEVEL, QUANTILE, Contender, Renders, Sensor, jackknife, mitsuba_renderer, our_renderer

SHIPPED = ("inspection", "inspection-flat", "inspection-open")
# Floor of the relative error, as a share of the mean of the image.
DARK = 0.01


def columns(noise: np.ndarray) -> np.ndarray:
    """Median, mean, 90 % and 99 % quantile over the pixels."""
    return np.array([np.median(noise), noise.mean(), *np.quantile(noise, [0.9, 0.99])])


def compare(ours: Renders, theirs: Renders, sensor: Sensor, per_second: float) -> tuple[np.ndarray, np.ndarray]:
    """Noise times time of theirs over ours, for v / s (4 columns) and the relative error (4 columns), with standard errors."""
    mean = ours.images.mean(axis=0)
    exposure = LEVEL * sensor.saturation / (float(np.quantile(mean, QUANTILE, method="nearest")) * per_second)
    electrons = per_second * exposure
    s = electrons * mean + sensor.dark_variance + sensor.quantisation_variance
    open_ = electrons * mean < sensor.saturation
    relative = mean**2 + (DARK * mean.mean()) ** 2

    def ratios(leave_out: int | None) -> np.ndarray:
        found = []
        for scale, unit in ((s, electrons), (relative, 1.0)):
            noise = [columns((r.variance(unit, leave_out) / scale)[open_]) * r.time for r in (theirs, ours)]
            found.append(noise[0] / noise[1])
        return np.concatenate(found)

    return jackknife(len(ours.images), ratios)


def difference(ours: Renders, theirs: Renders) -> tuple[float, float]:
    """Mean of the image, ours over theirs less one, with its standard error (Welch 1947)."""
    a, b = (r.images.mean(axis=(1, 2)) for r in (ours, theirs))
    error = np.sqrt(a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b))
    return float(a.mean() / b.mean() - 1.0), float(error / b.mean())


def main() -> int:
    """Renders what is missing and prints the table."""
    root = Path(__file__).resolve().parent.parent
    names = [*SHIPPED, *STATIONS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True, help="our renderer")
    parser.add_argument("--size", type=int, default=256, help="width and height in pixels")
    parser.add_argument("--spp", type=int, default=64, help="samples per pixel of a render, a multiple of 4")
    parser.add_argument("--renders", type=int, default=16, help="independent renders of each renderer, at least 8")
    parser.add_argument("--work", type=Path, default=root / "out" / "validation" / "equal-time")
    parser.add_argument("--ours", default="ours", help="name of our renders in the work folder, to compare programs")
    parser.add_argument("--flags", default="", help="further flags of our renders, separated by commas")
    parser.add_argument("--readme", action="store_true", help="write the table into docs/research")
    parser.add_argument("--only", choices=names, nargs="*", default=names)
    arguments = parser.parse_args()
    if arguments.renders < 8 or arguments.spp < 4 or arguments.spp % 4:
        raise SystemExit("--renders must be 8 or more, --spp a multiple of 4")

    import drjit
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    # Mitsuba 3.9.1 with a single thread never comes back from reading an EXR file.
    drjit.set_thread_count(max(2, drjit.thread_count()))
    mi.set_log_level(mi.LogLevel.Error)
    sensor = Sensor.load(root / "crates" / "sensor" / "presets" / "imx250.toml")
    size, spp = arguments.size, arguments.spp
    flags = [flag for flag in arguments.flags.split(",") if flag]
    lines = [
        f"Mitsuba {mi.__version__} (`llvm_ad_rgb`) over ours; {size} x {size} pixels, {arguments.renders} renders of {spp} spp each.",
        "",
        "| scene | v / s: median | mean | 90 % | 99 % | relative error: median | mean | 90 % | 99 %"
        " | M samples/s, Mitsuba | ours | mean of the image |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    everything = []
    for name in arguments.only:
        work = arguments.work / f"{name}-{size}-{spp}"
        work.mkdir(parents=True, exist_ok=True)
        scene: Any
        if name in SHIPPED:
            file = mitsuba_scene.equal_terms(root / "scenes" / "inspection" / f"{name}.glb", 1.0, work / f"{name}.glb")
            scene = mitsuba_scene.load(file, size, size)
        else:
            station, file = STATIONS[name](), work / f"{name}.toml"
            parity_scene.write(station, file, size, size)
            scene = parity_mitsuba.load(station, size, size, rr_depth=5)
        factors: list[float] = []
        render = our_renderer(arguments.dunkelfeld, file, size, sensor.weights, flags, factors)
        theirs = Contender(work / "mitsuba.npz", spp, sensor.weights, mitsuba_renderer(scene))
        ours = Contender(work / f"{arguments.ours}.npz", spp, sensor.weights, render)
        for number in range(arguments.renders):
            theirs.go_on(number)
            ours.go_on(number)
            print(f"{name}: render {number + 1} of {arguments.renders}", file=sys.stderr, flush=True)
        if not factors:
            render(4, 0)
        a, b = ours.renders(arguments.renders), theirs.renders(arguments.renders)
        found, error = compare(a, b, sensor, float(np.mean(factors)))
        everything.append(found)
        shift, spread = difference(a, b)
        cells = " | ".join(f"{value:.2f} ± {e:.2g}" for value, e in zip(found, error))
        speed = [size * size / r.time / 1e6 for r in (b, a)]
        lines.append(f"| {name} | {cells} | {speed[0]:.2f} | {speed[1]:.2f} | {shift:+.2%} ± {spread:.2%} |")
        print(lines[-1], flush=True)
    mean = np.exp(np.log(np.array(everything)).mean(axis=0))
    lines.append(f"| geometric mean | {' | '.join(f'{v:.2f}' for v in mean)} | | | |")
    text = "\n".join(lines) + "\n"
    print(text)
    if arguments.readme:
        into_readme(text, "equal time")
    return 0


if __name__ == "__main__":
    sys.exit(main())
