"""Compares the three inspection scenes between Dunkelfeld and Mitsuba 3, region by region.

    python compare_inspection.py --dunkelfeld ../target/release/dunkelfeld --spp 256 --mitsuba-spp 1024

Both renderers say how sure they are: ours writes the variance of each pixel's mean into its EXR, Mitsuba is run in chunks
with different seeds and the scatter between them gives the same. A region's mean then has a known standard error, and the
difference of two means a Z-score. A row fails if the means of the green channel differ by more than 1 % and by more than
three standard errors; it counts as not converged while the standard error is above a third of a percent. The Z-score
of the worst channel is shown beside it: 1 % of bias can hide behind noise, but not behind |Z| > 5.

Results of either renderer are kept in the work folder and used again if they are there.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import mitsuba_scene

SCENES = ("inspection", "inspection-flat", "inspection-open")
SIZE = 512
BAR = 0.01


@dataclass(frozen=True)
class Region:
    """A flat part of the scene: a rectangle in plan at a height, in millimetres of the scene's frame."""

    name: str
    x: tuple[float, float]
    z: tuple[float, float]
    y: float


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
    Region("symbol power, coverage 1", (-21.5, -20.5), (-20.2, -15.8), 0.0),
    Region("symbol airflow, coverage 0.4", (-22.8, -19.2), (-2.8, -1.0), 0.0),
    Region("symbol drop, coverage 0.25", (-2.0, 2.0), (14.6, 18.4), 0.0),
)


@dataclass
class Result:
    """An image (rows, columns, RGB) and the variance of each pixel's mean."""

    mean: np.ndarray
    variance: np.ndarray

    def over(self, box: tuple[slice, slice]) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard error of each channel over a box; pixels are independent."""
        pixels = self.mean[box].reshape(-1, 3)
        variances = self.variance[box].reshape(-1, 3)
        return pixels.mean(axis=0), np.sqrt(variances.sum(axis=0)) / len(pixels)


def pixel_box(region: Region, camera: mitsuba_scene.Camera) -> tuple[slice, slice]:
    """The largest upright box of pixels inside the region's image (rows, columns)."""
    corners = np.array([[x, region.y, z, 1e3] for z in region.z for x in region.x]) / 1e3
    seen = corners @ np.linalg.inv(camera.to_world).T
    focal = 0.5 * SIZE / np.tan(0.5 * camera.yfov)
    columns = (0.5 * SIZE + focal * seen[:, 0] / -seen[:, 2]).reshape(2, 2)
    rows = (0.5 * SIZE - focal * seen[:, 1] / -seen[:, 2]).reshape(2, 2)
    left, right = np.ceil(columns[:, 0].max()), np.floor(columns[:, 1].min())
    top, bottom = np.ceil(rows[0].max()), np.floor(rows[1].min())
    if not (0 <= left < right <= SIZE and 0 <= top < bottom <= SIZE):
        raise ValueError(f"{region.name} is not in the image")
    return slice(int(top), int(bottom)), slice(int(left), int(right))


def render_mitsuba(scene_file: Path, store: Path, spp: int, chunks: int) -> Result:
    """Renders in chunks, or reads what an earlier run stored."""
    if not store.exists():
        import mitsuba as mi

        scene = mitsuba_scene.load(scene_file, SIZE, SIZE)
        total = np.zeros((SIZE, SIZE, 3))
        squares = np.zeros_like(total)
        for k in range(chunks):
            image = np.array(mi.render(scene, spp=spp // chunks, seed=1 + k), dtype=np.float64)
            total += image
            squares += image * image
            print(f"\r{scene_file.name}: chunk {k + 1} of {chunks}", end="", file=sys.stderr)
        print(file=sys.stderr)
        mean = total / chunks
        variance = np.maximum(squares / chunks - mean * mean, 0.0) / (chunks - 1)
        np.savez_compressed(store, mean=mean, variance=variance)
    stored = np.load(store)
    return Result(stored["mean"], stored["variance"])


def render_ours(dunkelfeld: Path | None, job: Path, store: Path, spp: int) -> Result:
    """Runs our renderer if there is no EXR yet, and reads the EXR."""
    import mitsuba as mi

    if not store.exists():
        if dunkelfeld is None:
            raise SystemExit(f"{store} is missing; name the renderer with --dunkelfeld")
        # Uniform allocation: a plan made from the samples it weighs would bias the comparison of small regions.
        rules = ["--allocate", "uniform", "--spp", str(spp), "--time", "24h", "--sensor", "none"]
        picture = store.with_suffix(".png")
        subprocess.run(
            [dunkelfeld, "render", job, *rules, "--exr", store, "-o", picture], check=True
        )
    bitmap = mi.Bitmap(str(store))
    pixels = np.array(bitmap, dtype=np.float64)
    column = {field.name: k for k, field in enumerate(bitmap.struct_())}
    mean = pixels[..., [column[c] for c in ("R", "G", "B")]]
    return Result(mean, pixels[..., [column[f"variance.{c}"] for c in "RGB"]])


def table(scene: str, ours: Result, theirs: Result, camera: mitsuba_scene.Camera) -> tuple[str, int]:
    """A Markdown table of all regions and the number of rows that fail."""
    lines = [
        f"### {scene}",
        "",
        "| region | pixels | ours (G) | Mitsuba (G) | difference | standard error | worst Z | |",
        "|---|---:|---:|---:|---:|---:|---:|---|",
    ]
    failures = 0
    for region in REGIONS:
        box = pixel_box(region, camera)
        (a, error_a), (b, error_b) = ours.over(box), theirs.over(box)
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
        count = ours.mean[box].shape[0] * ours.mean[box].shape[1]
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
    parser.add_argument("--spp", type=int, default=256, help="our samples per pixel")
    parser.add_argument("--mitsuba-spp", type=int, default=1024)
    parser.add_argument("--chunks", type=int, default=32, help="parts of the Mitsuba render, each with its own seed")
    parser.add_argument("--work", type=Path, default=root / "out" / "validation")
    parser.add_argument("--only", choices=SCENES, nargs="*", default=SCENES)
    arguments = parser.parse_args()

    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    arguments.work.mkdir(parents=True, exist_ok=True)
    print(f"Mitsuba {mi.__version__}, {arguments.mitsuba_spp} spp; Dunkelfeld {arguments.spp} spp; {SIZE} x {SIZE}\n")
    failures = 0
    for name in arguments.only:
        folder = root / "scenes" / "inspection"
        scene_file = folder / f"{name}.glb"
        theirs = render_mitsuba(
            scene_file, arguments.work / f"{name}.mitsuba.npz", arguments.mitsuba_spp, arguments.chunks
        )
        ours = render_ours(
            arguments.dunkelfeld, folder / f"{name}.toml", arguments.work / f"{name}.exr", arguments.spp
        )
        text, failed = table(name, ours, theirs, mitsuba_scene.Glb(scene_file).camera())
        print(text)
        failures += failed
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
