"""Does the noise of the training images matter for a detector of defects? A small experiment.

    python validation/detector.py -o out/detector            # all images
    python validation/detector.py -o out/detector --quick    # few images, to test the chain

The script renders training scenes with 64 samples per pixel, and makes five training sets of them. Scenes, defects, labels
and samples are the same in all sets; only the noise differs:

- `matched`: frames of the sensor, `exposure_noise = "matched"`;
- `render`: the render without a sensor's noise, with the exposure of the sensor;
- `denoised`: the same after the built-in denoiser;
- `render + camera`: the render with all of the sensor's noise in addition (`plain`);
- `denoised + camera`: the denoised render with all of the sensor's noise.

The tests are camera frames of other scenes, rendered with 4096 samples per pixel and exposed with the sensor's noise. All
images are pictures of 8 bits, gamma 2.2. Two detectors classify pixels: a multilayer perceptron on patches, and gradient
boosting on filter responses. Each is trained with several seeds, which are the same for all sets.

Metrics: average precision of pixels; share of defects that are found at a false-alarm rate of 1e-3 of the pixels, with the
threshold from the test images, and with the threshold that has this rate on validation images of the training set's own
noise; and the false-alarm rate at the latter. Intervals are quantiles of a bootstrap over test scenes, the same
resamples for all sets; a metric is the mean over seeds. Renders are kept in the folder and used again.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import OpenEXR
from PIL import Image
from scipy import ndimage
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPClassifier

Array = npt.NDArray[Any]

ROOT = Path(__file__).resolve().parent.parent
SIDE = 64
# Exposure times of the sensor [ms]. The samples of the converged renders are linear grey values at the longest.
EXPOSURES = (0.03, 0.3)
# Figures of the IMX250: saturation capacity [e-], gain [e-/DN], and dark noise with that of rounding [e-].
FULL, GAIN, DARK = 10700.0, 2.634, float(np.hypot(2.4, 2.634 / 12**0.5))
BLACK, WHITE = 32, 4095
SETS = ("matched", "render", "denoised", "render + camera", "denoised + camera")
# Limits of the contrast-to-noise ratio of the defects that count. Fainter ones are neither positive nor negative.
FAINT, CLEAR = 0.5, 5.0
ALARMS = 1e-3
# A pixel is positive if a defect covers this share of its samples.
COVERED = 0.25
PATCH = 11
STUDY = """\
scene = "none"
[study]
name = "detector"
seed = {seed}
[study.images]
linear = "png"
[study.labels]
coverage = 4
coco = "none"
[[study.defect]]
kind = "stain"
on = "part"
facing = [0, 1, 0]
count = {{ integer = [2, 5] }}
length = {{ log_uniform = ["0.7mm", "3mm"] }}
strength = {{ log_uniform = [0.08, 0.6] }}
[[study.defect]]
kind = "scratch"
on = "part"
facing = [0, 1, 0]
count = {{ integer = [0, 2] }}
length = {{ log_uniform = ["1.5mm", "8mm"] }}
width = {{ log_uniform = ["200um", "400um"] }}
depth = {{ log_uniform = ["20um", "100um"] }}
[[study.defect]]
kind = "dust"
on = "part"
facing = [0, 1, 0]
count = {{ integer = [0, 3] }}
length = {{ log_uniform = ["150um", "500um"] }}
[[camera]]
name = "camera"
look_at = [0, "1mm", 0]
working_distance = "200mm"
direction = [0, 1, 0]
vertical_fov = "4.6deg"
[[object]]
name = "part"
kind = "box"
size = ["17mm", "2mm", "17mm"]
material = "plastic"
[[object]]
name = "wall"
kind = "box"
size = ["30mm", "6mm", "2mm"]
translate = [0, "3mm", {{ uniform = ["-10mm", "-6mm"] }}]
material = "plastic"
[[object]]
name = "pin"
kind = "cylinder"
diameter = {{ uniform = ["2mm", "3mm"] }}
height = "2mm"
translate = [{{ uniform = ["-7mm", "7mm"] }}, "2mm", {{ uniform = ["-6mm", "7mm"] }}]
material = "plastic"
[[object]]
name = "print"
kind = "box"
size = [{{ uniform = ["1.5mm", "4mm"] }}, "20um", {{ uniform = ["0.5mm", "1.5mm"] }}]
translate = [{{ uniform = ["-6mm", "6mm"] }}, "1.01mm", {{ uniform = ["-5mm", "7mm"] }}]
material = "ink"
[[material]]
name = "plastic"
new = true
base_color = {{ uniform = [0.3, 0.5] }}
roughness = {{ uniform = [0.4, 0.55] }}
[[material]]
name = "ink"
new = true
base_color = {{ uniform = [0.05, 0.25] }}
roughness = 0.6
[[light]]
name = "bar"
kind = "bar"
target = [0, "1mm", 0]
width = "200mm"
height = "60mm"
distance = "60mm"
elevation = "35deg"
azimuth = {{ uniform = ["-60deg", "60deg"] }}
power = "4W"
[film]
width = 64
height = 64
[budget]
spp = {spp}
[allocate]
strategy = "uniform"
[sensor]
model = "{model}"
exposure = "{exposure}ms"
exposure_noise = "{noise}"
[denoise]
method = "{denoise}"
"""
# A sensor with the picture of an IMX250 and practically no noise: 10 000 times the electrons at the same radiance.
IDEAL = """\
name = "ideal"
source = "the IMX250 with 100 times the pixel pitch and no dark noise"
bit_depth = 16
pixel_pitch_um = 345
quantum_efficiency = [[545, 0.70], [610, 0.70], [650, 0.6]]
full_well_e = 1.07e8
dark_noise_e = 0
gain_e_per_dn = 1632.7
offset_dn = 0
"""


@dataclass(frozen=True)
class Scenes:
    """Scenes without camera noise: images as shares of the saturation at the longest exposure, [image, row, column]."""

    mean: Array
    denoised: Array
    masks: Array
    coverage: Array

    def labels(self, exposure: float) -> tuple[Array, list[list[tuple[Array, float]]]]:
        """Labels of the pixels, 1 defect, 0 none, -1 not counted; and per image the defects: pixels and CNR.

        The CNR is that of docs/datasets.md: the mean over the mask less the mean of a ring from 2 to 5 pixels away, over
        the temporal noise of a pixel of the sensor in the ring.
        """
        label = np.zeros(self.masks.shape, np.int8)
        found: list[list[tuple[Array, float]]] = []
        for k, mask in enumerate(self.masks):
            electrons = self.mean[k] * FULL * exposure / EXPOSURES[-1]
            near = ndimage.binary_dilation(mask > 0, iterations=2)
            label[k][near] = -1
            row = []
            for number in np.unique(mask[mask > 0]):
                own = mask == number
                inner, outer = (ndimage.distance_transform_edt(~own) < r for r in (2, 5.5))
                ring = outer & ~inner & (mask == 0)
                solid = own & (self.coverage[k] >= COVERED)
                if ring.sum() < 8 or not solid.any():
                    continue
                around = electrons[ring].mean()
                contrast = abs(np.average(electrons[own], weights=self.coverage[k][own]) - around)
                cnr = float(contrast / np.sqrt(around + DARK**2))
                if cnr >= FAINT:
                    label[k][solid] = 1
                row.append((solid, cnr))
            found.append(row)
        return label, found


def grey(path: Path) -> Array:
    """An image file as an array."""
    return np.asarray(Image.open(path))


def run(command: list[Any]) -> None:
    """Runs the program; exit code 1 is a result with a flag."""
    code = subprocess.run([str(c) for c in command], check=False, stdout=subprocess.DEVNULL).returncode
    if code not in (0, 1):
        raise SystemExit(f"exit code {code}: {' '.join(str(c) for c in command)}")


def data_set(args: argparse.Namespace, name: str, count: int, **keys: Any) -> Path:
    """The folder of a data set, made or continued."""
    home: Path = args.output
    study, folder = home / f"{name}.toml", home / name
    study.write_text(STUDY.format(**keys))
    command = [args.program, "dataset", study, "-o", folder, "--count", count, "--jobs", args.jobs, "--threads", 1]
    run([*command, "--progress", "none"])
    return folder


def scenes(folder: Path, count: int) -> Scenes:
    """The images and labels of a set of the ideal sensor."""

    def stack(kind: str) -> Array:
        return np.stack([grey(folder / kind / f"{k:06}.png") for k in range(count)]).astype(np.float64)

    return Scenes(
        stack("linear") / 65535, (stack("images") / 255) ** 2.2, stack("masks").astype(int), stack("coverage") / 65535
    )


def picture(share: Array) -> Array:
    """The 8-bit picture of shares of the saturation, as the program writes it."""
    return np.floor(255 * np.clip(share, 0, 1) ** (1 / 2.2) + 0.5)


def expose(args: argparse.Namespace, share: Array, exposure: float, frames: int, seed: int) -> Array:
    """Pictures of camera frames, [frame, image, row, column], of shares of the saturation at the longest exposure."""
    folder = args.output / "exposed"
    folder.mkdir(exist_ok=True)

    def frame(image: Array, time: float, kind: str, number: int) -> list[Path]:
        source = folder / "in.exr"
        triple = np.repeat(image[..., None], 3, -1).astype(np.float32)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"RGB": triple}).write(str(source))
        command = [
            args.program,
            "expose",
            source,
            "--sensor",
            "imx250",
            "--exposure",
            f"{time}ms",
            kind,
            folder / "x.png",
        ]
        for old in folder.glob("x*.png"):
            old.unlink()
        run([*command, "--frames", number, "--seed", seed, "--threads", args.jobs, "--progress", "none"])
        return sorted(folder.glob("x*.png"))

    # Electrons of radiance 10 W/(m2 sr) at the longest exposure, from a flat image.
    flat = grey(frame(np.full((512, 512), 10.0), EXPOSURES[-1], "--linear", 1)[0])
    unit = (flat.astype(float).mean() - BLACK) * GAIN / 10
    paths = frame(share.reshape(-1, SIDE) * FULL / unit, exposure, "-o", frames)
    return np.stack([grey(path).reshape(share.shape) for path in paths]).astype(np.float64)


def filters(images: Array) -> Array:
    """Features of each pixel for gradient boosting, [image, row, column, feature]."""
    features = [images]
    one = (0, 1, 1)
    smooth = [ndimage.gaussian_filter(images, np.multiply(one, s)) for s in (0.7, 1.2, 2.0, 3.5, 6.0)]
    features += smooth + [a - b for k, a in enumerate(smooth) for b in smooth[k + 1 :]]
    features += [images - ndimage.median_filter(images, (1, 7, 7))]
    for size in (5, 11):
        mean = ndimage.uniform_filter(images, (1, size, size))
        features.append(np.sqrt(np.maximum(ndimage.uniform_filter(images**2, (1, size, size)) - mean**2, 0)))
    for s in (1.0, 1.8):
        xx, yy, xy = (
            ndimage.gaussian_filter(images, np.multiply(one, s), order=o) for o in ((0, 0, 2), (0, 2, 0), (0, 1, 1))
        )
        root = np.sqrt((xx - yy) ** 2 / 4 + xy**2)
        features += [(xx + yy) / 2 + root, (xx + yy) / 2 - root]
        features.append(ndimage.gaussian_gradient_magnitude(images, np.multiply(one, s)))
    return np.stack(features, -1).astype(np.float32)


def patches(images: Array) -> Array:
    """The patch around each pixel less its mean, and that mean, [image, row, column, PATCH^2 + 1], scaled to about 1."""
    half = PATCH // 2
    wide = np.pad(images, ((0, 0), (half, half), (half, half)), mode="reflect").astype(np.float32)
    view = np.lib.stride_tricks.sliding_window_view(wide, (PATCH, PATCH), axis=(1, 2))
    flat = view.reshape(*images.shape, -1)
    mean = flat.mean(-1, keepdims=True)
    # Fixed factors, the same for all sets: camera noise is 1 to 2 grey values in both exposures.
    return np.concatenate([np.clip((flat - mean) / 3, -8, 8), (mean - 100) / 50], -1)


def features(kind: str, images: Array, chosen: Array) -> Array:
    """The features of chosen pixels for a kind of detector, [pixel, feature]. Both are [image, row, column]."""
    make = patches if kind == "perceptron" else filters
    parts = [slice(k, k + 16) for k in range(0, len(images), 16)]
    return np.concatenate([make(images[part])[chosen[part]] for part in parts])


class Detector:
    """A detector of one kind, trained on the pixels of labelled images."""

    def __init__(self, kind: str, seed: int, rows: Array, label: Array, limit: int) -> None:
        """`rows` are features, [pixel, feature]; `label` is 1 for defects and 0 for none. `limit` is that of positives."""
        draw = np.random.default_rng(seed)
        yes, no = (np.flatnonzero(label == v) for v in (1, 0))
        # All positives up to a limit, and three times as many negatives.
        yes = draw.permutation(yes)[:limit]
        chosen = draw.permutation(np.concatenate([yes, draw.permutation(no)[: 3 * len(yes)]]))
        if kind == "perceptron":
            self.model: Any = MLPClassifier((64, 32), batch_size=256, max_iter=15, random_state=seed, tol=0, alpha=1e-3)
        else:
            self.model = HistGradientBoostingClassifier(
                max_iter=120, learning_rate=0.1, max_leaf_nodes=15, early_stopping=False, random_state=seed
            )
        with warnings.catch_warnings():
            # The number of passes is fixed.
            warnings.simplefilter("ignore", ConvergenceWarning)
            self.model.fit(rows[chosen], label[chosen])

    def scores(self, rows: Array) -> Array:
        """Log odds of a defect at each pixel."""
        p = np.clip(self.model.predict_proba(rows)[:, 1].astype(np.float64), 1e-12, 1 - 1e-12)
        odds: Array = np.log(p / (1 - p))
        return odds


@dataclass
class Counts:
    """Histograms of scores over bins that fall, [scene, bin]; and what lies above the threshold of validation, [scene]."""

    positives: Array
    negatives: Array
    defects: Array
    alarms: Array
    hits: Array

    def metrics(self, weights: Array) -> Array:
        """Metrics for multiplicities of the scenes, [resample, scene]: [resample, metric]."""
        yes, no, defects = (np.cumsum(weights @ h, 1) for h in (self.positives, self.negatives, self.defects))
        precision = yes / np.maximum(yes + no, 1)
        gain = np.diff(yes, axis=1, prepend=0) / yes[:, -1:]
        rate = no / no[:, -1:]
        share = defects / defects[:, -1:]
        recall = np.array([np.interp(ALARMS, r, s) for r, s in zip(rate, share)])
        own = weights @ self.hits / defects[:, -1]
        alarms = weights @ self.alarms / no[:, -1]
        return np.stack([(precision * gain).sum(1), recall, own, alarms], 1)


METRICS = ("average precision", "recall", "recall, own threshold", "false alarms, own threshold")


@dataclass(frozen=True)
class Trial:
    """The pixels of camera frames that count, for one kind of detector: frame by frame in the order of `label >= 0`."""

    rows: list[Array]
    label: Array
    defects: list[list[Array]]


def trial(kind: str, frames: Array, test: Scenes, exposure: float) -> Trial:
    """The trial of one exposure. Defects that are too clear count neither as positive pixels nor as defects."""
    label, found = test.labels(exposure)
    for one, row in zip(label, found):
        for solid, _ in (d for d in row if d[1] > CLEAR):
            one[solid] = -1
        for solid, _ in (d for d in row if FAINT <= d[1] <= CLEAR):
            one[solid] = 1
    defects = [[solid for solid, cnr in row if FAINT <= cnr <= CLEAR] for row in found]
    return Trial([features(kind, frame, label >= 0) for frame in frames], label, defects)


def count(detector: Detector, test: Trial, threshold: float) -> Counts:
    """The histograms of a detector."""
    scores = np.full((len(test.rows), *test.label.shape), -np.inf)
    for score, rows in zip(scores, test.rows):
        score[test.label >= 0] = detector.scores(rows)
    flat = np.sort(scores[:, test.label >= 0].ravel())
    edges = np.unique(flat[((1 - np.geomspace(1e-6, 1, 1500)) * (len(flat) - 1)).astype(int)])

    def histogram(values: Array) -> Array:
        # The first bin has the highest scores.
        bins = np.searchsorted(edges, values, side="right")
        return np.bincount(len(edges) - bins, minlength=len(edges) + 1)

    def per_scene(value: int) -> Array:
        return np.stack([histogram(scores[:, k][:, one == value].ravel()) for k, one in enumerate(test.label)])

    best = [
        np.array([score[solid].max() for score in scores[:, k] for solid in row]) for k, row in enumerate(test.defects)
    ]
    alarms = np.array([(scores[:, k][:, one == 0] > threshold).sum() for k, one in enumerate(test.label)])
    hits = np.array([(b > threshold).sum() for b in best])
    return Counts(per_scene(1), per_scene(0), np.stack([histogram(b) for b in best]), alarms, hits)


def training_sets(args: argparse.Namespace, train: Scenes, exposure: float, folder: Path) -> dict[str, Array]:
    """Pictures of the training scenes with each kind of noise."""
    factor = exposure / EXPOSURES[-1]
    matched = np.stack([grey(folder / "images" / f"{k:06}.png") for k in range(args.train)]).astype(np.float64)
    return {
        "matched": matched,
        "render": picture(train.mean * factor),
        "denoised": picture(train.denoised * factor),
        "render + camera": expose(args, train.mean, exposure, 1, 101)[0],
        "denoised + camera": expose(args, train.denoised, exposure, 1, 102)[0],
    }


def certificates(folder: Path, count: int) -> tuple[float, float]:
    """Median over images of the certificate's median (variance of the render over that of the sensor) and matched share."""
    records = [json.loads((folder / "records" / f"{k:06}.json").read_text()) for k in range(count)]
    return float(np.median([r["certificate"]["median"] for r in records])), float(
        np.mean([r["matched"] if r["matched"] is not None else np.nan for r in records])
    )


def plot(rows: list[dict[str, Any]], path: Path) -> None:
    """Writes the metrics with their intervals."""
    cases = list(dict.fromkeys((r["detector"], r["exposure"]) for r in rows))
    figure, axes = plt.subplots(len(METRICS), 1, figsize=(9, 11), sharex=True)
    for m, axis in enumerate(axes):
        for s, name in enumerate(SETS):
            chosen = [next(r for r in rows if (r["detector"], r["exposure"], r["set"]) == (*c, name)) for c in cases]
            mean = np.array([r["mean"][m] for r in chosen])
            low, high = np.array([r["interval"][m] for r in chosen]).T
            at = np.arange(len(cases)) + (s - 2) * 0.12
            axis.errorbar(at, mean, np.abs([mean - low, high - mean]), fmt="o", capsize=3, label=name)
        axis.set_ylabel(METRICS[m])
        axis.grid(alpha=0.3)
    axes[-1].set_yscale("log")
    axes[-1].axhline(ALARMS, color="black", linewidth=0.8)
    axes[-1].set_xticks(np.arange(len(cases)), [f"{d}\n{e} ms" for d, e in cases])
    axes[0].legend(ncols=3, fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=120)


def sheet(sets: dict[float, dict[str, Array]], frames: dict[float, Array], path: Path) -> None:
    """Writes one training scene with each noise and one test frame, for each exposure, with the same stretch in a row."""
    figure, axes = plt.subplots(len(EXPOSURES), len(SETS) + 1, figsize=(13, 2.4 * len(EXPOSURES)))
    for row, exposure in zip(axes, EXPOSURES):
        top = np.percentile(frames[exposure][0, :4], 99.8)
        panels = [(name, sets[exposure][name][0]) for name in SETS] + [("test frame", frames[exposure][0, 0])]
        for axis, (name, image) in zip(row, panels):
            axis.imshow(image, cmap="gray", vmin=0, vmax=top, interpolation="nearest")
            axis.set_title(f"{name}, {exposure} ms", fontsize=8)
            axis.axis("off")
    figure.tight_layout()
    figure.savefig(path, dpi=120)


def report(rows: list[dict[str, Any]]) -> None:
    """Prints the table."""
    print("\n| detector | exposure [ms] | training set | " + " | ".join(METRICS) + " |")
    print("|---|--:|---|" + "--:|" * len(METRICS))
    for r in rows:
        cells = []
        for m, (low, high) in enumerate(r["interval"]):
            digits = "{:.2g}" if m == 3 else "{:.3f}"
            cells.append(f"{digits} ({digits} to {digits})".format(r["mean"][m], low, high))
        print(f"| {r['detector']} | {r['exposure']} | {r['set']} | " + " | ".join(cells) + " |")
    print("\nDifference of `matched` to the other sets, with the 95 % interval of the paired bootstrap; * excludes 0.")
    print("\n| detector | exposure [ms] | `matched` less | " + " | ".join(METRICS) + " |")
    print("|---|--:|---|" + "--:|" * len(METRICS))
    for r in (r for r in rows if r["set"] != SETS[0]):
        cells = []
        for m, (low, high) in enumerate(r["difference interval"]):
            digits = "{:+.2g}" if m == 3 else "{:+.3f}"
            star = "*" if low * high > 0 else ""
            cells.append(f"{digits} ({digits} to {digits}){star}".format(r["difference"][m], low, high))
        print(f"| {r['detector']} | {r['exposure']} | {r['set']} | " + " | ".join(cells) + " |")
    print("\nStandard deviation of a metric over training seeds, largest over sets: ", end="")
    print(", ".join(f"{name} {max(r['seed deviation'][m] for r in rows):.2g}" for m, name in enumerate(METRICS)))


def arguments() -> argparse.Namespace:
    """The flags."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of renders, plot and results.json")
    parser.add_argument("--program", type=Path, default=ROOT / "target/release/dunkelfeld")
    parser.add_argument("--quick", action="store_true", help="few images and samples, one seed")
    parser.add_argument("--train", type=int, help="training scenes; a fifth of them is for validation [200]")
    parser.add_argument("--test", type=int, help="test scenes [48]")
    parser.add_argument("--spp", type=int, help="samples per pixel of the test scenes [4096]")
    parser.add_argument("--seeds", type=int, help="training runs of each detector [5]")
    parser.add_argument("--frames", type=int, default=4, help="camera frames of a test scene [%(default)s]")
    parser.add_argument("--resamples", type=int, default=2000, help="of the bootstrap [%(default)s]")
    parser.add_argument("--jobs", type=int, default=2, help="images at the same time [%(default)s]")
    args = parser.parse_args()
    sizes = (16, 6, 256, 1) if args.quick else (200, 48, 4096, 5)
    for name, size in zip(("train", "test", "spp", "seeds"), sizes):
        setattr(args, name, getattr(args, name) or size)
    args.program = args.program.resolve()
    return args


def main() -> None:
    """Renders, trains, tests, prints."""
    args = arguments()
    args.output.mkdir(parents=True, exist_ok=True)
    (args.output / "ideal.toml").write_text(IDEAL)
    ideal = {"model": "ideal.toml", "exposure": EXPOSURES[-1], "noise": "plain"}
    home = data_set(args, "train-ideal", args.train, seed=1, spp=64, denoise="builtin", **ideal)
    train = scenes(home, args.train)
    folders = {}
    for exposure in EXPOSURES:
        keys = {"model": "imx250", "exposure": exposure, "noise": "matched", "denoise": "off"}
        folders[exposure] = data_set(args, f"train-matched-{exposure}", args.train, seed=1, spp=64, **keys)
        for kind in ("masks", "coverage"):
            for k in range(args.train):
                a, b = ((f / kind / f"{k:06}.png").read_bytes() for f in (home, folders[exposure]))
                if a != b:
                    raise SystemExit(f"{kind} of image {k} differ between the training sets")
    far = data_set(args, "test-ideal", args.test, seed=2, spp=args.spp, denoise="off", **ideal)
    test = scenes(far, args.test)

    print(f"{args.train} training scenes, {args.test} test scenes of {args.spp} spp, {args.seeds} seeds")
    print("\n| exposure [ms] | electrons | render/camera variance, training | matched | variance, test | defects |")
    print("|--:|--:|--:|--:|--:|--:|")
    sets, frames = {}, {}
    for exposure in EXPOSURES:
        sets[exposure] = training_sets(args, train, exposure, folders[exposure])
        frames[exposure] = expose(args, test.mean, exposure, args.frames, 7)
        ratio, share = certificates(folders[exposure], args.train)
        # The ideal sensor has 10 000 times the electrons, and nearly only shot noise.
        factor = exposure / EXPOSURES[-1]
        electrons = float(np.median(test.mean)) * FULL * factor
        rest = certificates(far, args.test)[0] * 1e-4 * factor * electrons / (electrons + DARK**2)
        number = sum(FAINT <= cnr <= CLEAR for row in test.labels(exposure)[1] for _, cnr in row)
        print(f"| {exposure} | {electrons:.0f} | {ratio:.2f} | {share:.2f} | {rest:.4f} | {number} |")
    sheet(sets, frames, args.output / "sheet.png")

    cut = args.train - args.train // 5
    draw = np.random.default_rng(3)
    weights = draw.multinomial(args.test, np.full(args.test, 1 / args.test), args.resamples).astype(np.float64)
    weights = np.concatenate([np.ones((1, args.test)), weights])
    results: list[dict[str, Any]] = []
    start = time.monotonic()
    for kind in ("perceptron", "boosting"):
        for exposure in EXPOSURES:
            labels = train.labels(exposure)[0]
            used, kept = labels[:cut] >= 0, labels[cut:] == 0
            target = labels[:cut][used]
            test_pixels = trial(kind, frames[exposure], test, exposure)
            base: Array | None = None
            for name in SETS:
                images = sets[exposure][name]
                rows = features(kind, images[:cut], used)
                clean = features(kind, images[cut:], kept)
                runs = []
                for seed in range(args.seeds):
                    detector = Detector(kind, seed, rows, target, 3000 if args.quick else 15000)
                    threshold = float(np.quantile(detector.scores(clean), 1 - ALARMS))
                    counts = count(detector, test_pixels, threshold)
                    runs.append(counts.metrics(weights))
                mean = np.mean(runs, 0)
                base = mean if base is None else base
                results.append(
                    {
                        "detector": kind,
                        "exposure": exposure,
                        "set": name,
                        "mean": mean[0].tolist(),
                        "interval": np.quantile(mean[1:], (0.025, 0.975), axis=0).T.tolist(),
                        "difference": (base - mean)[0].tolist(),
                        "difference interval": np.quantile((base - mean)[1:], (0.025, 0.975), axis=0).T.tolist(),
                        "seed deviation": np.std([r[0] for r in runs], 0, ddof=1 if args.seeds > 1 else 0).tolist(),
                    }
                )
                print(f"<!-- {kind}, {exposure} ms, {name}: {time.monotonic() - start:.0f} s -->", flush=True)
                (args.output / "results.json").write_text(json.dumps(results, indent=1))
    report(results)
    plot(results, args.output / "detector.png")


if __name__ == "__main__":
    main()
