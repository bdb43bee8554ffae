"""The noise of renders behind a lens: measured over seeds against claimed, and the spectrum of frames of matched noise.

    python validation/lens_noise.py --dunkelfeld target/release/dunkelfeld scenes/inspection/*.toml

prints a row for each job: the measured variance of the pixels over the claimed one; the power of the noise of the render in four
bands of frequencies from zero to the Nyquist frequency, where white noise has 1, in front of the lens and behind it; the share of
the pixels where noise can be matched, and the power of frames of matched noise there, where the camera's own noise has 1.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np
from PIL import Image

mi.set_variant("scalar_rgb")

BANDS = 4
# Those of imx250: variance of a black pixel [e^2], and gain [e/DN].
FLOOR = 2.4**2 + 2.634**2 / 12
GAIN = 2.634


def layers(path: Path) -> dict[str, np.ndarray]:
    """The channels of an EXR by their names."""
    bitmap = mi.Bitmap(str(path))
    pixels = np.array(bitmap).astype(np.float64)
    return {field.name: pixels[..., index] for index, field in enumerate(bitmap.struct_())}


def power(images: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Mean power of the differences of pairs of images, divided by `scale`, in bands from zero to the Nyquist frequency."""
    pairs = (images[0::2] - images[1::2]) / scale / 2**0.5
    spectrum = (np.abs(np.fft.fft2(pairs)) ** 2).mean(axis=0) / pairs[0].size
    height, width = spectrum.shape
    radius = np.maximum(np.abs(np.fft.fftfreq(height))[:, None], np.abs(np.fft.fftfreq(width)))
    band = np.minimum((radius * 2 * BANDS).astype(int), BANDS - 1)
    return np.array([spectrum[band == number].mean() for number in range(BANDS)])


def rendered(
    options: argparse.Namespace, job: Path, folder: Path, flags: list[str], count: int, frame: bool = False
) -> list[dict[str, np.ndarray]]:
    """The layers of renders with different seeds, and their frames [DN] as `frame`."""
    found = []
    for seed in range(1, count + 1):
        exr = folder / "render.exr"
        command = [options.dunkelfeld, "render", job, "--width", options.size, "--height", options.size, "--seed", seed]
        command += ["--spp", options.spp, "--allocate", "uniform", "--exr", exr, "-o", folder / "render.png", *flags]
        command += ["--linear", folder / "frame.tiff"] if frame else []
        subprocess.run([str(word) for word in command], check=True, capture_output=True)
        found.append(layers(exr))
        if frame:
            found[-1]["frame"] = np.array(Image.open(folder / "frame.tiff")).astype(np.float64)
    return found


def row(job: Path, options: argparse.Namespace) -> str:
    """The row of a job."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        text = job.read_text().replace('scene = "', f'scene = "{job.parent.resolve()}/')
        copy = folder / "job.toml"
        copy.write_text(text + f"\n[lens]\nf_number = {options.f_number}\n")
        first = folder / "first.json"
        command = [options.dunkelfeld, "render", copy, "--width", options.size, "--height", options.size, "--spp", 16]
        command += ["--stats", first, "-o", folder / "first.png"]
        subprocess.run([str(word) for word in command], check=True, capture_output=True)
        exposure = json.loads(first.read_text())["sensor"]["exposure_seconds"]
        flags = ["--exposure", f"{exposure}s"]
        plain = rendered(options, copy, folder, flags, options.renders)
        electrons = np.array([image["electrons.Y"] for image in plain])
        # The claim of a render is that of its own mean: v_r = ratio * s, and s = electrons + floor.
        claims = np.mean([image["hidden.Y"] * (image["electrons.Y"] + FLOOR) for image in plain], axis=0)
        measured = electrons.var(axis=0, ddof=1)
        known = np.isfinite(claims)
        front = np.array([image["R"] for image in plain])
        powers = [power(images, images.std(axis=0)) for images in (front, electrons)]
        frames = rendered(options, copy, folder, [*flags, "--exposure-noise", "matched"], options.renders, frame=True)
        held = np.min([image["matched.Y"] for image in frames], axis=0) > 0.0
        values = np.array([np.where(held, image["frame"], 0.0) for image in frames])
        camera = np.sqrt(electrons.mean(axis=0) + FLOOR) / GAIN
        # Of a few pixels there is no spectrum.
        powers.append(power(values, camera) / held.mean() if held.mean() > 0.5 else np.array([]))
        bands = [" ".join(f"{value:.2f}" for value in of) for of in powers]
        whole = measured[known].sum() / claims[known].sum()
        return f"| {job.stem} | {whole:.3f} | {bands[0]} | {bands[1]} | {100 * held.mean():.0f} % | {bands[2]} |"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("jobs", type=Path, nargs="+")
    parser.add_argument("--dunkelfeld", type=Path, required=True)
    parser.add_argument("--f-number", type=float, default=8.0)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--renders", type=int, default=48)
    options = parser.parse_args()
    print("| job | measured over claimed | spectrum in front of the lens | behind | matched in | spectrum of matched frames |")
    print("|---|---|---|---|---|---|")
    for job in options.jobs:
        print(row(job, options), flush=True)


if __name__ == "__main__":
    main()
