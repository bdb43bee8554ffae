"""Noise after equal processor time: Dunkelfeld against Mitsuba 3 and Cycles, in every part of the image.

    python equal_time.py --dunkelfeld ../target/release/dunkelfeld --cycles-python cycles/bin/python

All renderers render the shipped inspection scenes and the stations of `stations.py`, in turn, with a seed of its own for each
render. Ours takes `--spp` uniform samples. The number of samples of a peer takes about the same processor time: Mitsuba's is a
product of two almost equal numbers, that of Cycles a power of two, since their samplers are stratified best so. A fourth
contender is ours with the samples of the sample plan (`--allocate sensor`), at the same mean number of samples.

For a pixel, v is the variance of a render over the renders [e-^2], and s the temporal variance of an IMX250 at the mean of
our renders (EMVA 1288), at an exposure that brings the 99.5 % quantile to 90 % of saturation. The noise of a renderer is v / s
times the processor seconds of a render. The tables hold the noise of a peer over ours, and our uniform noise over that of the
plan, at the median, the mean, the 90 % and the 99 % quantile over the unsaturated pixels: above 1 our image, or that of the
plan, is cleaner after the same time. The relative mean squared error, v / (mean^2 + (1 % of the mean of the image)^2), is
compared in the same way.

Denoised: Open Image Denoise filters every render with one albedo and one normal layer, which are those of a render of ours. The
error of a denoised render is its squared difference to the mean of the other raw renders of the same renderer, less the
variance of that mean. It is averaged over the renders, divided by the same denominator, and multiplied by the time. So neither
the noise of the reference nor a difference of the materials counts.

Processor time is user and system time of the process. Reading, building trees, writing files and compiling kernels are left
out: they are measured with renders of one sample. The standard errors come from the jackknife over the renders.

Renders are kept in the work folder and used again. A run that was ended continues where it was.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Iterable, NamedTuple

import numpy as np

import mitsuba_scene
import parity_mitsuba
import parity_scene
from cycles_process import SETTINGS, Cycles
from equal_time_picture import STATISTICS, Panel, draw
from open_image_denoise import Denoiser, packaged_library
from readme_table import into_readme
from stations import STATIONS
from time_to_hidden import LEVEL, QUANTILE, Contender, Renders, Sensor, channels, jackknife, mitsuba_renderer, our_renderer

SHIPPED = ("inspection", "inspection-flat", "inspection-open")
PEERS = {"mitsuba": "Mitsuba", "cycles": "Cycles"}
PLAN = "plan"
# Floor of the relative error, as a share of the mean of the image.
DARK = 0.01
MEASURES = {"v / s": "v / s", "relative": "relative error", "denoised": "relative error, denoised"}
# Samples per pixel of the albedo and the normals, with a frame number that no render has.
FEATURE_SPP, FEATURE_FRAME = 64, 100_000
# The number of our renders whose time is that of the peers.
TIMED = 3
# Vertices before the roulette of Mitsuba (`rr_depth`) and of Cycles (`min_light_bounces`), and the scenes where another number has
# less noise after the same time, in the geometric mean of all raw columns. docs/research/equal-time.md has the measurements.
ROULETTE = (5, 3)
ROULETTES = {name: (2, 0) for name in SHIPPED} | {
    "glass": (8, 3),
    "leds": (3, 3),
    "flat-cover": (16, 0),
    "moulded-cover": (32, 16),
    "dome": (16, 16),
}

Render = Callable[[int, int], tuple[np.ndarray, float]]
Filter = Callable[[np.ndarray], np.ndarray]


class Racer(Contender):
    """A renderer of one scene whose renders are also denoised."""

    def __init__(self, store: Path, spp: int, weights: np.ndarray, render: Render, denoise: Filter):
        super().__init__(store, spp, weights, render)
        self.denoise = denoise
        self.denoised = list(np.load(store)["denoised"]) if store.exists() else []

    def add(self, image: np.ndarray) -> None:
        super().add(image)
        self.denoised.append((self.denoise(image) @ self.weights).astype(np.float32))

    def kept(self) -> dict[str, Any]:
        return super().kept() | {"denoised": np.stack(self.denoised)}


def affordable(store: Path, render: Render, seconds: float, possible: Callable[[float], int]) -> int:
    """Samples per pixel that take `seconds` of processor time; those of earlier renders if there are any. `possible` gives
    the number that the renderer can take, close to another one."""
    if store.exists():
        return int(np.load(store)["spp"])

    def time(spp: int) -> float:
        # The first render of a number of samples may compile kernels.
        return min(render(spp, number)[1] for number in (0, 1))

    fixed, spp = time(1), possible(16)
    while (taken := time(spp) - fixed) < 0.6 * seconds:
        spp = possible(2 * spp)
    return max(2, possible(spp * seconds / taken))


def grid(spp: float) -> int:
    """The largest number up to `spp` that Mitsuba's `multijitter` can divide into rows and columns of almost equal count."""
    side = max(1, math.isqrt(int(spp)))
    return side * (int(spp) // side)


def power_of_two(spp: float) -> int:
    """The closest one by its ratio: the sequence of Cycles is stratified at powers of two."""
    return 1 << round(math.log2(max(spp, 1.0)))


def columns(noise: np.ndarray) -> np.ndarray:
    """Median, mean, 90 % and 99 % quantile over the pixels."""
    return np.array([np.median(noise), noise.mean(), *np.quantile(noise, [0.9, 0.99])])


def filtered_error(raw: np.ndarray, denoised: np.ndarray) -> np.ndarray:
    """Mean squared error of denoised images (render, row, column), against the means of the other raw ones."""
    n = len(raw)
    references = (raw.sum(axis=0) - raw) / (n - 1)
    # The mean of the variances without one render is that of all.
    error: np.ndarray = ((denoised - references) ** 2).mean(axis=0) - raw.var(axis=0, ddof=1) / (n - 1)
    return error


@dataclass(frozen=True)
class Result:
    """All renders of a renderer: raw with their times, and denoised (render, row, column)."""

    raw: Renders
    denoised: np.ndarray

    @property
    def time(self) -> float:
        """Processor seconds of a render, without its fixed part."""
        return self.raw.time * self.raw.spp


@dataclass(frozen=True)
class Scale:
    """The denominators of a scene, pixel by pixel, and electrons per unit of the images."""

    sensor: np.ndarray
    relative: np.ndarray
    unsaturated: np.ndarray
    electrons: float

    @staticmethod
    def of(mean: np.ndarray, sensor: Sensor, per_second: float) -> Scale:
        """From the mean of our renders; `per_second` electrons per unit and second of exposure."""
        exposure = LEVEL * sensor.saturation / (float(np.quantile(mean, QUANTILE, method="nearest")) * per_second)
        electrons = per_second * exposure
        noise = electrons * mean + sensor.dark_variance + sensor.quantisation_variance
        return Scale(noise, mean**2 + (DARK * mean.mean()) ** 2, electrons * mean < sensor.saturation, electrons)


def compare(ours: Result, theirs: Result, scale: Scale) -> tuple[np.ndarray, np.ndarray]:
    """Theirs over ours, four columns for each of `MEASURES`, with standard errors."""

    def ratios(leave_out: int | None) -> np.ndarray:
        found = []
        for denominator, unit in ((scale.sensor, scale.electrons), (scale.relative, 1.0)):
            variances = ((r, r.raw.variance(unit, leave_out)) for r in (theirs, ours))
            noise = [columns((v / denominator)[scale.unsaturated]) * r.raw.time for r, v in variances]
            found.append(noise[0] / noise[1])
        chosen = [k for k in range(len(ours.denoised)) if k != leave_out]
        error = [filtered_error(r.raw.images[chosen], r.denoised[chosen]) for r in (theirs, ours)]
        noise = [columns((e / scale.relative)[scale.unsaturated]) * r.time for e, r in zip(error, (theirs, ours))]
        found.append(noise[0] / noise[1])
        return np.concatenate(found)

    return jackknife(len(ours.denoised), ratios)


def difference(ours: Renders, theirs: Renders) -> tuple[float, float]:
    """Mean of the image, ours over theirs less one, with its standard error (Welch 1947)."""
    a, b = (r.images.mean(axis=(1, 2)) for r in (ours, theirs))
    error = np.sqrt(a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b))
    return float(a.mean() / b.mean() - 1.0), float(error / b.mean())


def features(store: Path, render: Render, image: Path, factors: list[float]) -> tuple[np.ndarray, np.ndarray, float]:
    """Albedo, normals, and the electrons per unit of weighted radiance and second of exposure, of a render of ours."""
    if not store.exists():
        factors.clear()
        render(FEATURE_SPP, FEATURE_FRAME)
        albedo = channels(image, "albedo.R", "albedo.G", "albedo.B")
        normal = channels(image, "normal.X", "normal.Y", "normal.Z")
        np.savez_compressed(store, albedo=albedo.astype(np.float32), normal=normal.astype(np.float32), per_second=factors[0])
    kept = np.load(store)
    return kept["albedo"], kept["normal"], float(kept["per_second"])


@dataclass(frozen=True)
class Race:
    """The results of a scene, by the names of the contenders: `ours`, `PLAN` and the peers."""

    name: str
    scale: Scale
    results: dict[str, Result]


def race(name: str, arguments: argparse.Namespace, sensor: Sensor, denoiser: Denoiser, cycles: Cycles | None) -> Race:
    """Makes the renders of a scene that are missing."""
    root = Path(__file__).resolve().parent.parent
    size, spp, weights = arguments.size, arguments.spp, sensor.weights
    work = arguments.work / f"{name}-{size}-{spp}"
    work.mkdir(parents=True, exist_ok=True)
    rr_depth, min_bounces = ROULETTES.get(name, ROULETTE)
    scene: Any
    if name in SHIPPED:
        file = mitsuba_scene.equal_terms(root / "scenes" / "inspection" / f"{name}.glb", 1.0, work / f"{name}.glb")
        scene = mitsuba_scene.load(file, size, size, rr_depth=rr_depth, sampler="multijitter")
        source = {"scene": str(file)}
    else:
        station, file = STATIONS[name](), work / f"{name}.toml"
        parity_scene.write(station, file, size, size)
        scene = parity_mitsuba.load(station, size, size, rr_depth=rr_depth, sampler="multijitter")
        source = {"station": name}
    factors: list[float] = []
    flags = [flag for flag in arguments.flags.split(",") if flag]
    job = mitsuba_scene.job(file) if name in SHIPPED else file
    render = our_renderer(arguments.dunkelfeld, job, size, weights, flags, factors)
    planned = our_renderer(arguments.dunkelfeld, job, size, weights, flags, factors, allocate="sensor")
    albedo, normal, per_second = features(work / "features.npz", render, file.with_suffix(".exr"), factors)
    denoise = lambda image: denoiser(image, albedo, normal)

    def denoise_parts(image: np.ndarray) -> np.ndarray:
        """First light and the rest apart, of the render that was made last: as `--denoise oidn` does."""
        first = channels(file.with_suffix(".exr"), "first_light.R", "first_light.G", "first_light.B").astype(np.float32)
        return denoise(first) + denoise(np.maximum(image - first, 0.0))

    racers = {"ours": Racer(work / f"{arguments.ours}.npz", spp, weights, render, denoise_parts)}
    for number in range(TIMED):
        racers["ours"].go_on(number)
    seconds = float(np.median(racers["ours"].seconds[:TIMED])) * spp
    racers[PLAN] = Racer(work / f"{arguments.ours}-{PLAN}.npz", spp, weights, planned, denoise_parts)
    for peer in arguments.peers:
        store = work / f"{peer}.npz"
        if peer == "mitsuba":
            theirs: Render = mitsuba_renderer(scene)
            possible: Callable[[float], int] = grid
        else:
            assert cycles is not None
            settings = SETTINGS | {"min_light_bounces": min_bounces}
            theirs, possible = cycles.renderer(source, size, settings), power_of_two
        racers[peer] = Racer(store, affordable(store, theirs, seconds, possible), weights, theirs, denoise)
    for number in range(arguments.renders):
        for racer in racers.values():
            racer.go_on(number)
        print(f"{name}: render {number + 1} of {arguments.renders}", file=sys.stderr, flush=True)
    results = {
        who: Result(racer.renders(arguments.renders), np.stack(racer.denoised[: arguments.renders]).astype(np.float64))
        for who, racer in racers.items()
    }
    return Race(name, Scale.of(results["ours"].raw.images.mean(axis=0), sensor, per_second), results)


def speed_row(one: Race, peers: Iterable[str]) -> str:
    """Samples per second, times and means."""
    ours = one.results["ours"]
    cells = [f"{ours.raw.images[0].size / ours.raw.time / 1e6:.2f}", f"{ours.time:.1f}"]
    for who in (PLAN, *peers):
        r = one.results[who]
        shift, error = difference(ours.raw, r.raw)
        if who != PLAN:
            cells += [str(r.raw.spp), f"{r.raw.images[0].size / r.raw.time / 1e6:.2f}"]
        cells += [f"{r.time / ours.time:.2f}", f"{shift:+.2%} ± {error:.2%}"]
    return f"| {one.name} | {' | '.join(cells)} |"


class Gain(NamedTuple):
    """A row of `equal_time.csv`: noise of the second over that of the first, and its standard error."""

    measure: str
    scene: str
    pair: str
    quantile: str
    gain: str
    error: str


def tables(races: list[Race], arguments: argparse.Namespace, versions: dict[str, str]) -> tuple[str, list[Gain], list[list[Panel]]]:
    """The tables of the page, all gains, and the panels of the picture: a row for each pair, a column for each measure."""
    pairs = {who: (f"{PEERS[who]} over ours", "ours", who) for who in arguments.peers}
    pairs[PLAN] = ("uniform over plan", PLAN, "ours")
    found = {
        (one.name, who): compare(one.results[a], one.results[b], one.scale) for one in races for who, (_, a, b) in pairs.items()
    }
    names = ", ".join(versions[who] for who in arguments.peers)
    quantities = " | ".join(f"{label}: median | mean | 90 % | 99 %" for label, _, _ in pairs.values())
    rule = "---:|" * (4 * len(pairs))
    lines = [
        f"{names + '; ' if names else ''}{arguments.size} x {arguments.size} pixels, {arguments.renders} renders; {arguments.spp}"
        " samples per pixel of ours, the samples of the same processor time of the peers. Above 1 ours, or the plan, is cleaner.",
        "",
        "Geometric means over the scenes:",
        "",
        f"| measure | {quantities} |",
        f"|---|{rule}",
    ]
    gains: list[Gain] = []
    panels: list[list[Panel]] = [[] for _ in pairs]
    for m, title in enumerate(MEASURES.values()):
        part = slice(4 * m, 4 * m + 4)
        for one in races:
            for who, (label, _, _) in pairs.items():
                value, error = (x[part] for x in found[one.name, who])
                gains += [
                    Gain(title, one.name, label, quantile, f"{v:.2f}", f"{e:.2g}")
                    for quantile, v, e in zip(STATISTICS, value, error)
                    if v > 0.0
                ]
        middle = []
        for k, (who, (label, _, _)) in enumerate(pairs.items()):
            of_scenes = {one.name: found[one.name, who][0][part] for one in races}
            values = np.array(list(of_scenes.values()))
            middle += [f"{np.exp(np.log(v).mean()):.2f}" if (v > 0.0).all() else "-" for v in values.T]
            panels[k].append(Panel(f"{label}: {title}", "plan" if who == PLAN else "ours", of_scenes))
        lines.append(f"| {title} | {' | '.join(middle)} |")
    return "\n".join(lines) + "\n", gains, panels


def speeds(races: list[Race], peers: list[str]) -> str:
    """The table of times and means."""
    head = ["M samples/s, ours", "s of a render", "time, plan", "mean, ours over plan"]
    for who in peers:
        peer = PEERS[who]
        head += [f"{peer}: samples", "M samples/s", "time over ours", f"mean, ours over {peer}"]
    lines = [f"| scene | {' | '.join(head)} |", "|---|" + "---:|" * len(head)]
    return "\n".join([*lines, *(speed_row(one, peers) for one in races)]) + "\n"


def main() -> int:
    """Renders what is missing, prints the tables."""
    root = Path(__file__).resolve().parent.parent
    names = [*SHIPPED, *STATIONS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True, help="our renderer")
    parser.add_argument("--peers", choices=PEERS, nargs="*", default=list(PEERS), help="the other renderers")
    parser.add_argument("--cycles-python", default=sys.executable, help="Python with the package bpy [this one]")
    parser.add_argument("--oidn", type=Path, help="library of Open Image Denoise [that of the package oidn]")
    parser.add_argument("--size", type=int, default=192, help="width and height in pixels [%(default)s]")
    parser.add_argument("--spp", type=int, default=32, help="samples per pixel of ours, a multiple of 4 [%(default)s]")
    parser.add_argument("--renders", type=int, default=16, help="independent renders of each renderer, at least 8 [%(default)s]")
    parser.add_argument("--work", type=Path, default=root / "out" / "validation" / "equal-time")
    parser.add_argument("--ours", default="ours", help="name of our renders in the work folder, to compare programs")
    parser.add_argument("--flags", default="", help="further flags of our renders, separated by commas")
    parser.add_argument("--picture", type=Path, help="file of the picture [docs/research/equal-time.png with --readme]")
    parser.add_argument("--readme", action="store_true", help="write equal_time.csv, and tables and picture into docs/research")
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
    sensor = Sensor.load(root / "crates" / "camera" / "sensor" / "presets" / "imx250.toml")
    denoiser = Denoiser(arguments.oidn or packaged_library())
    cycles = Cycles(arguments.cycles_python, arguments.work / "cycles.exr") if "cycles" in arguments.peers else None
    versions = {"mitsuba": f"Mitsuba {mi.__version__} (`llvm_ad_rgb`)"}
    if cycles is not None:
        versions["cycles"] = f"Cycles of Blender {cycles.version}"
    races = []
    for name in arguments.only:
        races.append(race(name, arguments, sensor, denoiser, cycles))
        print(speed_row(races[-1], arguments.peers), file=sys.stderr, flush=True)
    if cycles is not None:
        cycles.close()
    text, gains, panels = tables(races, arguments, versions)
    print(f"{text}\n{speeds(races, arguments.peers)}")
    picture = root / "docs" / "research" / "equal-time.png" if arguments.readme else arguments.picture
    if picture is not None:
        draw(panels, picture)
    if arguments.readme:
        with Path(__file__).with_name("equal_time.csv").open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(Gain._fields)
            writer.writerows(gains)
        into_readme(f"{text}\n![Gains of each scene: {', '.join(STATISTICS)}](equal-time.png)\n", "equal time")
    return 0


if __name__ == "__main__":
    sys.exit(main())
