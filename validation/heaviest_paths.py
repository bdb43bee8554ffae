"""The paths of the heaviest samples in the noisiest pixels of the stations of `stations.py`.

Each station renders in a live view, which knows the heaviest sample of each pixel. Of the pixels around the 99 % quantile of
the noise over that of the sensor, the paths of these samples are grouped by their surfaces and events. The table has the most
frequent groups, with the median share of the pixel that the sample carries.

    DUNKELFELD=../target/release/dunkelfeld python heaviest_paths.py --only glass leds
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "view"))

import parity_scene
from program import Refused, View
from stations import STATIONS


def name(vertex: dict) -> str:
    """The surface and the event of a vertex, without the number of an object."""
    surface = (vertex["object"] or "").rstrip("0123456789-")
    return f"{surface} {vertex['event']}".strip()


def brightest(vertices: list[dict]) -> list[dict]:
    """The path to the vertex that adds most light. A sample may be split into several paths."""
    last: int | None = max(range(len(vertices)), key=lambda number: vertices[number]["luminance"])
    found = []
    while last is not None:
        found.append(vertices[last])
        last = vertices[last]["before"]
    return found[::-1]


def groups(view, camera, pixels: int, seed: int) -> tuple[Counter, dict[str, list[float]], int]:
    """Counts of the groups, and for each the shares of the samples."""
    _, ratio = view.picture("map", {"camera": camera, "map": "ratio", "effect": None})
    low, high = np.nanquantile(ratio, [0.98, 0.999])
    rows, columns = np.nonzero((ratio >= low) & (ratio <= high))
    chosen = np.random.default_rng(seed).choice(len(rows), min(pixels, len(rows)), replace=False)
    counts: Counter = Counter()
    shares = defaultdict(list)
    for y, x in zip(rows[chosen], columns[chosen], strict=True):
        try:
            path = view.post("path", {"x": int(x), "y": int(y), "index": None})
        except Refused:
            # The noise of a pixel is estimated with its neighbours, so that it may have no light itself.
            counts["no light in the pixel"] += 1
            shares["no light in the pixel"].append(0.0)
            continue
        probe = view.post("probe", {"camera": camera, "frame": 0, "x": int(x), "y": int(y)})
        group = " > ".join(name(vertex) for vertex in brightest(path["vertices"]))
        counts[group] += 1
        radiance = np.dot(probe["radiance"], [0.2126, 0.7152, 0.0722])
        shares[group].append(path["luminance"] / max(radiance * probe["samples"], 1e-30))
    return counts, shares, len(chosen)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--spp", type=float, default=64)
    parser.add_argument("--pixels", type=int, default=200)
    parser.add_argument("--groups", type=int, default=6)
    arguments = parser.parse_args()
    print("| station | share of the pixels | median share of the sample | path |")
    print("|---|---:|---:|---|")
    for station, make in STATIONS.items():
        if arguments.only and station not in arguments.only:
            continue
        with tempfile.TemporaryDirectory() as folder:
            job = Path(folder) / f"{station}.toml"
            parity_scene.write(make(), job, arguments.size, arguments.size)
            text = job.read_text().replace('model = "none"', 'model = "imx250"\n\n[allocate]\nstrategy = "uniform"')
            job.write_text(text)
            view = View(job, folder=folder)
            try:
                view.wait_for_film(arguments.spp)
                view.pause()
                camera = view.camera()
                counts, shares, total = groups(view, camera, arguments.pixels, 1)
                for group, count in counts.most_common(arguments.groups):
                    print(
                        f"| {station} | {100 * count / total:.0f} % | {np.median(shares[group]):.2f} | {group} |",
                        flush=True,
                    )
            finally:
                view.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
