"""Can a detector of anomalies be trained on `scenes/studies/bracket.toml`? A small experiment on a set in the layout of MVTec AD.

    dunkelfeld dataset scenes/studies/bracket.toml -o out/bracket
    python validation/anomaly.py out/bracket

The detector is PaDiM (Defard et al. 2021) with features of filters instead of those of a network: at each pixel a normal
distribution of the features of all images in `train/good`, and the Mahalanobis distance to it. The features are those of all
captures together: the logarithm of the grey value, smoothed with two widths, and the size of its gradient. The score of an image
is the largest one of its pixels, without the border. Printed are the areas under the receiver operating characteristic, by image
and by pixel, for each kind of defect, and of a single capture in comparison. Intervals are 95 % of a bootstrap over images.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image
from scipy import ndimage, stats

Array = npt.NDArray[Any]

# Standard deviations of the smoothing [pixels], and the largest displacement of the part that the detector shall ignore.
WIDTHS = (0.7, 2.0)
PLAY = 1
# Added to the variance of a feature, so that flat regions do not divide by zero.
LEAST = 1e-3


def features(folder: Path, captures: list[str], name: str) -> Array:
    """Features of an image, (count, height, width); `name` is relative to the tree of a capture."""
    found = []
    for capture in captures:
        grey = np.asarray(Image.open(folder / capture / name), dtype=float)
        for width in WIDTHS:
            smooth = ndimage.gaussian_filter(np.log1p(grey), width)
            found += [smooth, np.hypot(*np.gradient(smooth))]
    return np.array(found)


def model(train: list[Array]) -> tuple[Array, Array]:
    """Mean of the features and the inverse of their covariance at each pixel. The covariance is the mean over neighbours."""
    stack = np.array(train)
    mean = stack.mean(axis=0)
    centred = stack - mean
    count = mean.shape[0]
    covariance = np.einsum("nihw,njhw->hwij", centred, centred) / len(train)
    covariance = ndimage.uniform_filter(covariance, size=(2 * PLAY + 1, 2 * PLAY + 1, 1, 1)) + LEAST * np.eye(count)
    return mean, np.linalg.inv(covariance)


def score(image: Array, mean: Array, inverse: Array) -> Array:
    """Mahalanobis distance at each pixel, smoothed."""
    difference = np.moveaxis(image - mean, 0, -1)
    return ndimage.gaussian_filter(np.sqrt(np.einsum("hwi,hwij,hwj->hw", difference, inverse, difference)), 1.0)


def area(positive: Array, negative: Array) -> float:
    """Area under the receiver operating characteristic (Mann and Whitney 1947)."""
    ranks = stats.rankdata(np.concatenate([positive, negative]))
    u = ranks[: len(positive)].sum() - len(positive) * (len(positive) + 1) / 2
    return float(u / (len(positive) * len(negative)))


def interval(positive: Array, negative: Array) -> tuple[float, float]:
    """95 % of a bootstrap of [`area`] over images."""
    rng = np.random.default_rng(1)
    draws = [area(rng.choice(positive, len(positive)), rng.choice(negative, len(negative))) for _ in range(1000)]
    low, high = np.quantile(draws, [0.025, 0.975])
    return float(low), float(high)


def evaluate(folder: Path, captures: list[str]) -> None:
    first = folder / captures[0]
    train = sorted((first / "train" / "good").glob("*.png"))
    mean, inverse = model([features(folder, captures, f"train/good/{path.name}") for path in train])
    border = np.zeros(mean.shape[1:], dtype=bool)
    border[4:-4, 4:-4] = True
    images: dict[str, list[float]] = {}
    pixels: dict[str, list[Array]] = {}
    for path in sorted((first / "test").glob("*/*.png")):
        kind = path.parent.name
        scores = score(features(folder, captures, f"test/{kind}/{path.name}"), mean, inverse)
        images.setdefault(kind, []).append(float(scores[border].max()))
        if kind != "good":
            mask = np.asarray(Image.open(first / "ground_truth" / kind / f"{path.stem}_mask.png")) > 0
            pixels.setdefault(kind, [np.empty(0), np.empty(0)])
            pixels[kind][0] = np.append(pixels[kind][0], scores[mask & border])
            pixels[kind][1] = np.append(pixels[kind][1], scores[~mask & border][::16])
    good = np.array(images.pop("good"))
    print(f"\n{' + '.join(captures)}: {len(train)} images for training, {len(good)} good ones\n")
    print("| kind | images | by image | 95 % | by pixel |\n|---|---:|---:|---:|---:|")
    for kind, values in sorted(images.items()) + [("all", [v for all_ in images.values() for v in all_])]:
        low, high = interval(np.array(values), good)
        parts = list(pixels.values()) if kind == "all" else [pixels[kind]]
        inside, outside = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
        found = f"{area(np.array(values), good):.3f} | {low:.3f} to {high:.3f} | {area(inside, outside):.3f}"
        print(f"| {kind} | {len(values)} | {found} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", type=Path, help="folder of the set")
    folder = parser.parse_args().set / "mvtec"
    captures = sorted(path.name for path in folder.iterdir() if (path / "train").is_dir())
    for used in [captures, *([capture] for capture in captures)]:
        evaluate(folder, used)


if __name__ == "__main__":
    main()
