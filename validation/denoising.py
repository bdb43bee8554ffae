"""Measures what denoisers are worth: error against a converged reference, for renders of several sample counts.

    python denoising.py --dunkelfeld ../target/release/dunkelfeld --oidn 1.4.3=/path/libOpenImageDenoise.so.1.4.3 \\
        --oidn 2.3.3=/path/libOpenImageDenoise.so.2

Renders the three inspection scenes with the same number of samples in each pixel, has `dunkelfeld denoise` work on each
render, and prints a table. The reference is rendered four times as wide and high, from another seed: a pixel is a box, so
the mean of 4 x 4 pixels is what the pixel of the smaller image sees, with 16 times the samples.

MSE is the mean over pixels and channels of the squared difference to the reference, less the variance that the reference
states of itself (it is independent of what is measured, so this is the error against the truth, without bias). relMSE
weighs each pixel by 1 / (reference^2 + 0.01). FLIP is NVIDIA's (Andersson et al. 2020), for images of high dynamic range.
What is kept in the work folder is used again.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import flip_evaluator
import numpy as np
import OpenEXR
from PIL import Image

SCENES = ("inspection", "inspection-flat", "inspection-open")
LADDER = (16, 64, 256, 1024, 4096)
# The reference is this many times as wide and as high.
FINER = 4


@dataclass(frozen=True)
class Reference:
    """A converged image and the variance of its pixels, [height, width, 3]."""

    mean: np.ndarray
    variance: np.ndarray

    def errors(self, image: np.ndarray) -> tuple[float, float]:
        """MSE and relMSE of an image, without the reference's own variance."""
        square = (image.astype(np.float64) - self.mean) ** 2 - self.variance
        return float(square.mean()), float((square / (self.mean**2 + 1e-2)).mean())

    def flip(self, image: np.ndarray) -> float:
        """Mean HDR-FLIP error."""
        return float(flip_evaluator.evaluate(self.mean.astype(np.float32), image.astype(np.float32), "HDR")[1])


def layers(path: Path, *prefixes: str) -> np.ndarray:
    """The RGB of the first of these layers that an EXR has, as [height, width, 3]."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        for prefix in prefixes:
            if prefix + "R" in channels:
                return np.stack([np.asarray(channels[prefix + c].pixels, np.float32) for c in "RGB"], -1)
    raise SystemExit(f"{path} has none of the layers {prefixes}")


def render(args: argparse.Namespace, scene: str, size: int, spp: int, seed: int) -> Path:
    """The EXR of a render, made unless it is there."""
    path = args.work / f"{scene}-{size}-{spp}-{seed}.exr"
    if not path.exists():
        job = args.scenes / f"{scene}.toml"
        command = [args.dunkelfeld, "render", job, "--width", size, "--height", size, "--spp", spp, "--seed", seed]
        command += ["--allocate", "uniform", "--exr", path, "-o", path.with_suffix(".png"), "--progress", "none"]
        # Exit code 1: rendered, but flagged. Pixels that one sample dominates are what this is about.
        code = subprocess.run([str(c) for c in command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
        if code not in (0, 1):
            raise SystemExit(f"the render of {path} ended with exit code {code}")
    return path


def reference(args: argparse.Namespace, scene: str, size: int) -> Reference:
    """The mean of the reference renders of a scene, reduced to a size."""
    total, spread, samples = 0.0, 0.0, 0
    for seed in args.reference_seeds:
        path = render(args, scene, FINER * args.size, args.reference_spp, seed)
        mean, variance = (layers(path, p).astype(np.float64) for p in ("", "variance."))
        while mean.shape[0] > size:
            mean, variance = halved(mean), halved(variance) / 4
        total, spread, samples = total + mean, spread + variance, samples + 1
    return Reference(total / samples, spread / samples**2)


def halved(image: np.ndarray) -> np.ndarray:
    """The mean of each 2 x 2 pixels."""
    return (image[::2, ::2] + image[1::2, ::2] + image[::2, 1::2] + image[1::2, 1::2]) / 4


def denoised(args: argparse.Namespace, source: Path, denoiser: str, library: str | None) -> tuple[np.ndarray, float]:
    """What `dunkelfeld denoise` makes of an EXR, and the seconds that the command takes, files included."""
    out = args.work / "denoised.exr"
    command = [args.dunkelfeld, "denoise", source, "-o", out, "--denoise", denoiser]
    command += ["--oidn", library] if library else []
    start = time.perf_counter()
    subprocess.run([str(c) for c in command], check=True, stdout=subprocess.DEVNULL)
    return layers(out, "denoised.", ""), time.perf_counter() - start


def picture(images: list[np.ndarray], crop: tuple[slice, slice], zoom: int, path: Path) -> None:
    """Images side by side as PNG, gamma 2.2, each pixel enlarged."""
    row = np.concatenate([image[crop] for image in images], 1)
    eight = (np.clip(row * 1.2, 0, 1) ** (1 / 2.2) * 255 + 0.5).astype(np.uint8)
    Image.fromarray(eight.repeat(zoom, 0).repeat(zoom, 1)).quantize(256, kmeans=4).save(path, optimize=True)


def main(run=denoised) -> None:
    """Prints the table; `run` is what denoises."""
    here = Path(__file__).resolve().parent
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dunkelfeld", type=Path, default=here / "../target/release/dunkelfeld")
    parser.add_argument("--scenes", type=Path, default=here / "../scenes/inspection")
    parser.add_argument("--work", type=Path, default=here / "out/denoising")
    parser.add_argument("--oidn", action="append", default=[], metavar="NAME=LIBRARY", help="may be repeated")
    parser.add_argument("--only", nargs="+", default=SCENES, help="scenes")
    parser.add_argument("--size", type=int, default=128, help="width and height [%(default)s]")
    parser.add_argument("--at", type=int, nargs="+", help="sizes to measure, up to that of the reference [that of --size]")
    parser.add_argument("--spp", type=int, nargs="+", default=LADDER)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--reference-spp", type=int, default=256, help="at four times the size [%(default)s]")
    parser.add_argument("--reference-seeds", type=int, nargs="+", default=[11, 12, 13, 14])
    parser.add_argument("--pictures", type=Path, help="folder for pictures: render, denoisers in the order of the table, reference")
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    if args.pictures:
        args.pictures.mkdir(parents=True, exist_ok=True)
    denoisers = {"built-in": ("builtin", None)}
    denoisers |= {f"OIDN {n}": ("oidn", library) for n, library in (o.split("=", 1) for o in args.oidn)}

    print("| scene | pixels | spp | denoiser | MSE | gain | relMSE | gain | FLIP | s |\n|---|---|---|---|---|---|---|---|---|---|")
    worst = float("inf")
    for scene in args.only:
        for size in args.at or [args.size]:
            truth = reference(args, scene, size)
            for spp in args.spp:
                source = render(args, scene, size, spp, args.seed)
                image = layers(source, "")
                before = truth.errors(image)
                row = f"| {scene} | {size}² | {spp} |"
                print(f"{row} none | {before[0]:.2e} | 1 | {before[1]:.2e} | 1 | {truth.flip(image):.3f} | |")
                shown = [image]
                for name, (kind, library) in denoisers.items():
                    image, seconds = run(args, source, kind, library)
                    after = truth.errors(image)
                    gains = [b / a for a, b in zip(after, before)]
                    cells = [f"{after[0]:.2e}", f"{gains[0]:.2f}", f"{after[1]:.2e}", f"{gains[1]:.2f}"]
                    print(f"{row} {name} | {' | '.join(cells)} | {truth.flip(image):.3f} | {seconds:.2f} |", flush=True)
                    shown.append(image)
                    if kind == "builtin":
                        worst = min(worst, gains[0])
                if args.pictures:
                    whole = (slice(None), slice(None))
                    picture(shown + [truth.mean], whole, max(1, 256 // size), args.pictures / f"denoising-{scene}-{spp}.png")
    if worst < 1 / 1.05:
        print(f"the built-in filter makes an image worse: {worst:.3f}", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
