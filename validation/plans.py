"""The allocations of samples beside uniform samples: noise after the same time, and samples until the noise is hidden.

    python plans.py --dunkelfeld ../target/release/dunkelfeld noise
    python plans.py --dunkelfeld ../target/release/dunkelfeld hidden

`noise` renders every station and inspection scene with each allocation, in turns, and prints v / s times processor time of `uniform` over that
of the allocation: median, mean, 90 % and 99 %. v is the variance of a pixel over the renders, s that of the sensor. `hidden` renders until the
certificate of a render hides 90 % and 99 % of the pixels, and prints the samples per pixel, the geometric mean over seeds, and the ratios of
samples and seconds. Above 1 the allocation is better. Run it alone on the machine.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import parity_scene
from stations import STATIONS
from time_to_hidden import LEVEL, QUANTILE, Sensor, channels

ALLOCATIONS = ("uniform", "sobel", "sensor")
INSPECTION = ("inspection", "inspection-flat", "inspection-open")
# Scene, k, side of the film.
TARGETS = (
    *((name, 20.0, 64) for name in INSPECTION),
    *((name, 2.0, 48) for name in ("all-kinds-of-light", "textured", "many-lights")),
    *((name, 3.0, 96) for name in ("plates", "metals", "grooves")),
)


def job(root: Path, name: str, folder: Path, size: int) -> Path:
    """The job of a scene; that of a station is written to the folder."""
    if name in INSPECTION:
        return root / "scenes" / "inspection" / f"{name}.toml"
    if name not in STATIONS:
        return root / "tests" / "references" / f"{name}.toml"
    parity_scene.write(STATIONS[name](), folder / f"{name}.toml", size, size)
    return folder / f"{name}.toml"


def render(program: Path, scene: Path, folder: Path, size: int, *flags: object) -> tuple[dict, float]:
    """The statistics of a render, and its processor time [s]; its image is `image.exr`."""
    flags += ("--width", size, "--height", size, "--sensor", "imx250", "--progress", "none")
    files = ("--exr", folder / "image.exr", "--stats", folder / "stats.json", "-o", folder / "image.png")
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    command = [str(v) for v in (program, "render", scene, *flags, *files)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(command)}: {done.stderr}")
    return json.loads((folder / "stats.json").read_text()), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def noise(program: Path, root: Path, folder: Path, renders: int, spp: int) -> None:
    """Prints the gain after the same time."""
    sensor, size, gains = Sensor.load(root / "crates" / "camera" / "sensor" / "presets" / "imx250.toml"), 128, {}
    print("| scene | allocation | time | median | mean | 90 % | 99 % |\n|---|---|---:|---:|---:|---:|---:|")
    for name in (*INSPECTION, *STATIONS):
        scene = job(root, name, folder, size)
        made = {a: [] for a in ALLOCATIONS}
        for number in range(renders):
            for allocation, its in made.items():
                _, time = render(program, scene, folder, size, "--spp", spp, "--frame", number, "--allocate", allocation)
                its.append((channels(folder / "image.exr", "R", "G", "B") @ sensor.weights, time))
        mean = np.mean([image for image, _ in made["uniform"]], axis=0)
        electrons = LEVEL * sensor.saturation / np.quantile(mean, QUANTILE)
        variance = mean * electrons + sensor.dark_variance + sensor.quantisation_variance
        judged = mean * electrons < sensor.saturation

        def cost(allocation: str) -> tuple[float, np.ndarray]:
            images, times = zip(*made[allocation])
            ratios = (np.var(images, axis=0, ddof=1) * electrons**2 / variance)[judged]
            time = float(np.median(times))
            return time, time * np.array([np.median(ratios), ratios.mean(), *np.quantile(ratios, [0.9, 0.99])])

        (time, base), others = cost("uniform"), ALLOCATIONS[1:]
        for allocation in others:
            its, noise_times_time = cost(allocation)
            gains.setdefault(allocation, []).append([its / time, *(base / noise_times_time)])
            print(f"| {name} | {allocation} | " + " | ".join(f"{v:.2f}" for v in gains[allocation][-1]) + " |", flush=True)
    for allocation, all_gains in gains.items():
        print(f"| geometric mean | {allocation} | " + " | ".join(f"{v:.2f}" for v in np.exp(np.log(all_gains).mean(0))) + " |")


def hidden(program: Path, root: Path, folder: Path, seeds: int) -> None:
    """Prints the samples until the noise is hidden."""
    print("| scene | share | " + " | ".join(ALLOCATIONS) + " |\n|---|---:|" + "---:|" * len(ALLOCATIONS))
    ratios = {}
    for name, k, size in TARGETS:
        scene = job(root, name, folder, size)
        for share in (90, 99):
            taken = {}
            for allocation in ALLOCATIONS:
                costs = []
                for seed in range(seeds):
                    flags = ("--noise", k, "--share", share, "--seed", seed, "--allocate", allocation)
                    read, _ = render(program, scene, folder, size, *flags)
                    costs.append((read["mean_spp"], read["seconds"]["pilot"] + read["seconds"]["refine"]))
                taken[allocation] = np.exp(np.log(costs).mean(0))
                ratios.setdefault((share, allocation), []).append(taken["uniform"] / taken[allocation])
            print(f"| {name} | {share} % | " + " | ".join(f"{v[0]:.0f}" for v in taken.values()) + " |", flush=True)
    for (share, allocation), its in ratios.items():
        samples, seconds = np.exp(np.log(its).mean(0))
        print(f"{allocation}, {share} %: samples {samples:.2f}, seconds {seconds:.2f} (uniform over it)")


def main() -> int:
    """Prints one of the two tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True, help="our renderer")
    parser.add_argument("table", choices=("noise", "hidden"))
    parser.add_argument("--renders", type=int, default=24)
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    root = Path(__file__).resolve().parent.parent
    with tempfile.TemporaryDirectory() as folder:
        if arguments.table == "noise":
            noise(arguments.dunkelfeld, root, Path(folder), arguments.renders, arguments.spp)
        else:
            hidden(arguments.dunkelfeld, root, Path(folder), arguments.seeds)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
