"""Compares the three inspection scenes between Dunkelfeld and Mitsuba 3, region by region.

    python compare_inspection.py --dunkelfeld ../target/release/dunkelfeld --spp 4096 --mitsuba-spp 4096

Both renderers say how sure they are: ours writes the variance of each pixel's mean into its EXR, Mitsuba is run in chunks
with different seeds and the scatter between them gives the same. A region's mean then has a known standard error, and the
difference of two means a Z-score. A row fails if the means of the green channel differ by more than 1 % and by more than
three standard errors; it counts as not converged while the standard error is above a third of a percent. The Z-score
of the worst channel is shown beside it: 1 % of bias can hide behind noise, but not behind |Z| > 5.

Results of either renderer are kept in the work folder and used again if they are there, whatever their sample count.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import mitsuba_scene

SCENES = ("inspection", "inspection-flat", "inspection-open")
BAR = 0.01
# Regions of which the image shows less are left out.
MIN_PIXELS = 8


@dataclass(frozen=True)
class Region:
    """A flat part of the scene: a rectangle in plan at a height, in millimetres of the scene's frame, and perhaps its mirror
    image at x = 0."""

    name: str
    x: tuple[float, float]
    z: tuple[float, float]
    y: float
    mirrored: bool = False

    def rectangles(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        """The rectangles (x, z)."""
        left, right = self.x
        return [(self.x, self.z)] + ([((-right, -left), self.z)] if self.mirrored else [])


# Taken from the drawings in xtask/src/scenes; what lies under the cover moves by a fraction of a millimetre when seen
# through it, which the margins allow for.
REGIONS = (
    Region("aluminium tab", (-43.0, -31.0), (-47.4, -43.8), -5.0),
    Region("aluminium rail", (-20.0, 20.0), (43.2, 47.5), -8.0),
    Region("mount plate", (-54.0, -50.2), (-20.0, 20.0), -8.0),
    Region("shutter (black plate)", (-47.9, -46.0), (-20.0, 20.0), -8.0),
    Region("base, flange", (-44.2, -41.0), (-15.0, 15.0), -4.0),
    Region("base, ledge", (-20.0, 20.0), (25.2, 26.8), 0.94),
    Region("film, left", (-14.0, -7.2), (-20.0, 20.0), 0.0),
    Region("film, right", (7.2, 14.0), (-20.0, 20.0), 0.0),
    Region("film, both sides", (7.2, 14.0), (-20.0, 20.0), 0.0, mirrored=True),
    Region("symbol power, coverage 1", (-21.5, -20.5), (-20.2, -15.8), 0.0),
    Region("symbol airflow, coverage 0.4", (-22.8, -19.2), (-2.8, -1.0), 0.0),
    Region("symbol drop, coverage 0.25", (-2.0, 2.0), (14.6, 18.4), 0.0),
)


@dataclass
class Result:
    """An image (rows, columns, RGB), the variance of each pixel's mean, and how it came about."""

    mean: np.ndarray
    variance: np.ndarray
    spp: float
    # Per second of processor time, all threads together: less a matter of what else the machine does than wall clock.
    samples_per_second: float

    def over(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard error of each channel over a mask of pixels, which are independent."""
        return self.mean[pixels].mean(axis=0), np.sqrt(self.variance[pixels].sum(axis=0)) / pixels.sum()


def pixels_of(region: Region, camera: mitsuba_scene.Camera, size: int) -> np.ndarray:
    """The pixels (rows, columns) that lie within the region as a whole; the image may cut it off."""
    mask = np.zeros((size, size), dtype=bool)
    focal = 0.5 * size / np.tan(0.5 * camera.yfov)
    for x, z in region.rectangles():
        corners = np.array([[a, region.y, b, 1e3] for b in z for a in x]) / 1e3
        seen = corners @ np.linalg.inv(camera.to_world).T
        columns = (0.5 * size + focal * seen[:, 0] / -seen[:, 2]).reshape(2, 2)
        rows = (0.5 * size - focal * seen[:, 1] / -seen[:, 2]).reshape(2, 2)
        left, right = np.ceil(columns[:, 0].max()), np.floor(columns[:, 1].min())
        top, bottom = np.ceil(rows[0].max()), np.floor(rows[1].min())
        left, right, top, bottom = (int(np.clip(edge, 0, size)) for edge in (left, right, top, bottom))
        mask[top:bottom, left:right] = True
    return mask


def render_mitsuba(scene_file: Path, store: Path, size: int, spp: int, chunks: int) -> Result:
    """Renders in chunks, or reads what an earlier run stored."""
    if not store.exists():
        import mitsuba as mi

        scene = mitsuba_scene.load(scene_file, size, size)
        np.array(mi.render(scene, spp=1, seed=0))  # compiles the kernel, which the speed leaves out
        total = np.zeros((size, size, 3))
        squares = np.zeros_like(total)
        start = time.process_time()
        for k in range(chunks):
            image = np.array(mi.render(scene, spp=spp // chunks, seed=1 + k), dtype=np.float64)
            total += image
            squares += image * image
            print(f"\r{scene_file.name}: chunk {k + 1} of {chunks}", end="", file=sys.stderr)
        seconds = time.process_time() - start
        print(file=sys.stderr)
        mean = total / chunks
        variance = np.maximum(squares / chunks - mean * mean, 0.0) / (chunks - 1)
        spp = spp // chunks * chunks
        speed = spp * size * size / seconds
        np.savez_compressed(store, mean=mean, variance=variance, spp=spp, speed=speed)
    stored = np.load(store)
    return Result(stored["mean"], stored["variance"], float(stored["spp"]), float(stored["speed"]))


def render_ours(dunkelfeld: Path | None, scene_file: Path, store: Path, size: int, spp: int) -> Result:
    """Runs our renderer if there is no EXR yet, and reads the EXR and the statistics beside it."""
    import mitsuba as mi

    statistics = store.with_suffix(".json")
    if not store.exists():
        if dunkelfeld is None:
            raise SystemExit(f"{store} is missing; name the renderer with --dunkelfeld")
        # Uniform allocation: a plan made from the samples it weighs would bias the comparison of small regions.
        rules = ["--allocate", "uniform", "--spp", str(spp), "--sensor", "none"]
        shape = ["--width", str(size), "--height", str(size)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        files = ["--exr", store, "--stats", statistics, "-o", store.with_suffix(".png")]
        job = mitsuba_scene.job(scene_file)
        subprocess.run([dunkelfeld, "render", job, *rules, *shape, *files], check=True, stdout=sys.stderr)
        facts = json.loads(statistics.read_text())
        facts["processor_seconds"] = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        statistics.write_text(json.dumps(facts))
    bitmap = mi.Bitmap(str(store))
    pixels = np.array(bitmap, dtype=np.float64)
    column = {field.name: k for k, field in enumerate(bitmap.struct_())}
    mean = pixels[..., [column[c] for c in ("R", "G", "B")]]
    variance = pixels[..., [column[f"variance.{c}"] for c in "RGB"]]
    facts = json.loads(statistics.read_text())
    return Result(mean, variance, facts["mean_spp"], facts["samples"] / facts["processor_seconds"])


def table(scene: str, ours: Result, theirs: Result, camera: mitsuba_scene.Camera) -> tuple[str, int]:
    """A Markdown table of all regions and the number of rows that fail."""
    size = ours.mean.shape[0]
    if theirs.mean.shape != ours.mean.shape:
        raise SystemExit(f"{scene}: the stored images differ in size; delete one of them")
    lines = [
        f"### {scene}",
        "",
        f"{size} x {size}; ours {ours.spp:.0f} spp, {ours.samples_per_second / 1e6:.2f} M samples per processor second;"
        f" Mitsuba {theirs.spp:.0f} spp, {theirs.samples_per_second / 1e6:.2f} M; ratio"
        f" {ours.samples_per_second / theirs.samples_per_second:.1f}",
        "",
        "| region | pixels | ours (G) | Mitsuba (G) | difference | standard error | worst Z | |",
        "|---|---:|---:|---:|---:|---:|---:|---|",
    ]
    failures = 0
    for region in REGIONS:
        pixels = pixels_of(region, camera, size)
        count = int(pixels.sum())
        if count < MIN_PIXELS:
            continue
        (a, error_a), (b, error_b) = ours.over(pixels), theirs.over(pixels)
        error = np.hypot(error_a, error_b)
        difference = (a - b)[1] / b[1]
        relative_error = error[1] / b[1]
        scores = (a - b) / np.maximum(error, 1e-30)
        z = scores[np.argmax(np.abs(scores))]
        if abs(difference) > max(BAR, 3.0 * relative_error):
            verdict, failures = "FAILS", failures + 1
        elif relative_error > BAR / 3.0:
            verdict = "not converged"
        else:
            verdict = "pass"
        lines.append(
            f"| {region.name} | {count} | {a[1]:.5f} | {b[1]:.5f} | {difference:+.2%} | {relative_error:.2%}"
            f" | {z:+.1f} | {verdict} |"
        )
    return "\n".join(lines) + "\n", failures


def main() -> int:
    """Renders what is missing and prints the tables; 1 if any row fails."""
    root = Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, help="our renderer; not needed if the EXR files are there")
    parser.add_argument("--size", type=int, default=256, help="width and height in pixels; the regions scale with it")
    parser.add_argument("--zoom", type=float, default=1.0, help="2 sees the part without the station around it")
    parser.add_argument("--spp", type=int, default=1024, help="our samples per pixel")
    parser.add_argument("--mitsuba-spp", type=int, default=1024)
    parser.add_argument("--chunks", type=int, default=64, help="parts of the Mitsuba render, each with its own seed")
    parser.add_argument("--work", type=Path, default=root / "out" / "validation")
    parser.add_argument("--only", choices=SCENES, nargs="*", default=SCENES)
    arguments = parser.parse_args()

    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    arguments.work.mkdir(parents=True, exist_ok=True)
    print(f"Mitsuba {mi.__version__} (llvm_ad_rgb)\n")
    failures = 0
    for name in arguments.only:
        folder = root / "scenes" / "inspection"
        size = arguments.size
        stem = f"{name}-{size}-zoom{arguments.zoom:g}"
        store = arguments.work / f"{stem}.exr"
        scene_file = mitsuba_scene.equal_terms(
            folder / f"{name}.glb", arguments.zoom, arguments.work / f"{stem}.glb"
        )
        theirs = render_mitsuba(
            scene_file, arguments.work / f"{stem}.npz", size, arguments.mitsuba_spp, arguments.chunks
        )
        ours = render_ours(arguments.dunkelfeld, scene_file, store, size, arguments.spp)
        text, failed = table(name, ours, theirs, mitsuba_scene.Glb(scene_file).camera())
        print(text)
        failures += failed
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
