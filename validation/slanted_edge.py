"""The MTF of a lens from the image of a slanted edge (ISO 12233), against the closed form of diffraction and pixel.

    python validation/slanted_edge.py --dunkelfeld target/release/dunkelfeld

renders a luminous plate whose edge is tilted by 5 degrees, and prints the table of docs/lens.md: for each frequency and f-number
the closed form and the measured MTF. The noise is the difference of the two halves of the rows. It ends with exit code 1 if a measured
value differs by more than 0.01 from the closed form.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

# Pixels of imx250, and light of one wavelength [um].
PITCH = 3.45
WAVELENGTH = 0.55
WIDTH, HEIGHT = 256, 256
# Rows and columns around the middle of the film that are measured. The kernel of the lens has a reach of 32 pixels. Over 80 rows
# the edge moves by 7 pixels, so that the middles of pixels have even distances from it.
ROWS, COLUMNS = 160, 192
TILT = 5.0
# Bins of the edge spread function per pixel.
BINS = 4
LIMIT = 0.01


def render(options: argparse.Namespace, f_number: float, folder: Path) -> np.ndarray:
    """Expected electrons of the image."""
    # The edge of the plate passes through the middle of the image.
    cosine, sine = (function(np.radians(TILT)) / 2 for function in (np.cos, np.sin))
    job = folder / "job.toml"
    job.write_text(f"""scene = "none"
[camera]
position = [0, 1, 0]
look_at = [0, 0, 0]
vertical_fov = "1deg"
[[object]]
name = "plate"
kind = "plane"
size = [1, 1]
rotate = [0, "{TILT}deg", 0]
translate = [{cosine}, 0, {-sine}]
[[light]]
name = "plate"
radiance = 1
wavelength = "{WAVELENGTH}um"
[sensor]
model = "imx250"
[lens]
f_number = {f_number}
""")
    command = [options.dunkelfeld, "render", job, "--width", WIDTH, "--height", HEIGHT, "--spp", options.spp]
    command += ["--allocate", "uniform", "--exr", folder / "edge.exr", "-o", folder / "edge.png"]
    subprocess.run([str(word) for word in command], check=True, capture_output=True)
    bitmap = mi.Bitmap(str(folder / "edge.exr"))
    channel = [field.name for field in bitmap.struct_()].index("electrons.Y")
    image = np.array(bitmap)[..., channel].astype(np.float64)
    top, left = (HEIGHT - ROWS) // 2, (WIDTH - COLUMNS) // 2
    return image[top : top + ROWS, left : left + COLUMNS]


def measured(image: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """The MTF along the normal of the edge at frequencies [cycles per pixel], by the method of ISO 12233."""
    rows = np.arange(len(image))
    slopes = np.diff(image, axis=1)
    centres = (slopes * (np.arange(COLUMNS - 1) + 0.5)).sum(axis=1) / slopes.sum(axis=1)
    slope, offset = np.polyfit(rows, centres, 1)
    distance = (np.arange(COLUMNS) - (slope * rows + offset)[:, None]) * np.cos(np.arctan(slope))
    bins = np.floor(distance * BINS).astype(int)
    # Whole bins on both sides of the edge, as far as all rows have pixels there.
    reach = int(min(-bins[:, 0].max(), bins[:, -1].min())) - 1
    kept = (bins >= -reach) & (bins < reach)
    number = np.bincount(bins[kept] + reach)
    edge, place = (np.bincount(bins[kept] + reach, values[kept]) / number for values in (image, distance))
    line, middle = np.diff(edge), (place[1:] + place[:-1]) / 2
    transform = np.abs(np.exp(-2j * np.pi * frequencies[:, None] * middle) @ line) / line.sum()
    # The difference of two bins and the width of a bin are boxes of a quarter of a pixel each.
    return transform / np.sinc(frequencies / BINS) ** 2


def closed_form(f_number: float, frequencies: np.ndarray) -> np.ndarray:
    """The MTF of diffraction and of a square pixel along the normal of the edge."""
    x = np.minimum(frequencies * f_number * WAVELENGTH / PITCH, 1.0)
    lens = 2 / np.pi * (np.arccos(x) - x * np.sqrt(1 - x * x))
    tilt = np.radians(TILT)
    return lens * np.sinc(frequencies * np.cos(tilt)) * np.sinc(frequencies * np.sin(tilt))


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True)
    parser.add_argument("--f-numbers", type=float, nargs="+", default=[2.8, 8.0, 16.0])
    parser.add_argument("--spp", type=int, default=1024)
    options = parser.parse_args()
    frequencies = np.arange(1, 11) / 20
    with tempfile.TemporaryDirectory() as folder:
        images = [render(options, f_number, Path(folder)) for f_number in options.f_numbers]
    pairs = [(closed_form(n, frequencies), measured(image, frequencies)) for n, image in zip(options.f_numbers, images)]
    print("| cycles per pixel |" + "".join(f" f/{n:g} closed form | measured |" for n in options.f_numbers))
    print("|---|" + "---|---|" * len(pairs))
    for row, frequency in enumerate(frequencies):
        print(f"| {frequency:.2f} |" + "".join(f" {a[row]:.3f} | {b[row]:.3f} |" for a, b in pairs))
    errors = [np.abs(a - b).max() for a, b in pairs]
    halves = [[measured(half, frequencies) for half in np.split(image, 2)] for image in images]
    noise = [np.sqrt(np.mean((a - b) ** 2)) / 2 for a, b in halves]
    for n, error, of_noise in zip(options.f_numbers, errors, noise):
        print(f"f/{n:g}: largest difference {error:.4f}, standard error by noise {of_noise:.4f}")
    raise SystemExit(int(max(errors) > LIMIT))


if __name__ == "__main__":
    main()
