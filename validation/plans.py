"""How many samples, and seconds, does each allocation take until the noise hides beneath the sensor's?

    python plans.py --dunkelfeld ../target/release/dunkelfeld --noise 0.7 --only inspection-open

Renders each scene with `--allocate sensor --noise K` to its end. Its film says what every pixel needs: `hidden.Y` is the certified variance of
the mean over the sensor's own, v_r / s; times the samples taken that is v / s, and n = v / (k^2 s) samples hide the pixel. A render is hidden
when 99 % of its unsaturated pixels are. An allocation that gives a pixel the part w of the average (`spp.Y` over its mean) takes the 99 % quantile
of n / w on average. All allocations are judged by the needs of that one film. Of the others a render of a part of the samples tells w;
for `variance` that means a smaller pilot than it would have. The column *certified* is what the render with `sensor` took in fact, by its own
certificate, which decided when it ended; the last one is the pilot's forecast over that.

Seconds are samples times those of a sample in the render of that allocation. Run it alone on the machine if they matter.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np

SCENES = ("inspection", "inspection-flat", "inspection-open")
OTHERS = ("uniform", "sobel", "variance")
SHARE = 0.99


def render(program: Path, scene: Path, folder: Path, *flags: object) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict]:
    """Samples per pixel, v_r / s, electrons, and statistics."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    exr, stats = folder / "image.exr", folder / "stats.json"
    files = ["-o", folder / "image.png", "--exr", exr, "--stats", stats, "--progress", "none"]
    done = subprocess.run([str(x) for x in (program, "render", scene, *flags, *files)], capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{scene.name} {' '.join(flags)}: {done.stderr}")
    bitmap = mi.Bitmap(str(exr))
    column = {field.name: k for k, field in enumerate(bitmap.struct_())}
    layers = np.array(bitmap, dtype=np.float64)
    return *(layers[..., column[name]] for name in ("spp.Y", "hidden.Y", "electrons.Y")), json.loads(stats.read_text())


def main() -> int:
    """Prints the table."""
    root = Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True, help="our renderer")
    parser.add_argument("--only", choices=SCENES, nargs="*", default=SCENES)
    parser.add_argument("--noise", type=float, default=0.7, help="k")
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", type=float, default=0.125, help="samples of the other allocations, of those of `sensor`")
    arguments = parser.parse_args()
    k = arguments.noise
    print(f"{arguments.size} x {arguments.size} pixels, k = {k:g}, seed {arguments.seed}\n")
    print("| scene | allocation | samples per pixel | over `sensor` | seconds | over `sensor` | certified | forecast |")
    print("|---|---|---:|---:|---:|---:|---:|---:|")
    for name in arguments.only:
        scene = root / "scenes" / "inspection" / f"{name}.toml"
        size = ["--width", arguments.size, "--height", arguments.size, "--seed", arguments.seed]
        with tempfile.TemporaryDirectory() as folder:
            counts, hidden, electrons, stats = render(arguments.dunkelfeld, scene, Path(folder), *size, "--allocate", "sensor", "--noise", k)
            # Saturated pixels do not count. The statistics contain their number.
            judged = np.ones(hidden.size, dtype=bool)
            judged[np.argsort(electrons, axis=None)[hidden.size - stats["certificate"]["saturated"] :]] = False
            judged = judged.reshape(hidden.shape)
            needs = (hidden * counts)[judged] / (k * k)
            spp = stats["mean_spp"]
            lines = (line["samples"] / stats["samples"] for line in stats["forecast"] if line["k"] == k and line["samples"])
            foretold = next(lines, np.nan)

            def taken(counts: np.ndarray) -> float:
                return float(np.quantile(needs / (counts / counts.mean())[judged], SHARE))

            def seconds(stats: dict) -> float:
                return (stats["seconds"]["pilot"] + stats["seconds"]["refine"]) / stats["mean_spp"]

            base, pace = taken(counts), seconds(stats)
            print(f"| {name} | sensor | {base:.4g} | 1 | {base * pace:.3g} | 1 | {spp:.4g} | {foretold:.2f} |")
            for other in OTHERS:
                flags = ["--allocate", other, "--spp", max(64, round(arguments.part * spp))]
                counts, _, _, stats = render(arguments.dunkelfeld, scene, Path(folder), *size, *flags)
                n, t = taken(counts), seconds(stats)
                print(f"| {name} | {other} | {n:.4g} | {n / base:.2f} | {n * t:.3g} | {n * t / (base * pace):.2f} | | |", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
