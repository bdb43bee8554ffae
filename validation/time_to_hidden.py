"""How long until the noise of a render hides beneath the sensor's? Ours and Mitsuba's on the inspection scenes, in one run.

    python time_to_hidden.py --dunkelfeld ../target/release/dunkelfeld

A pixel is *hidden at k* when the variance of its mean is at most k^2 s, where s = mu_e + sigma_d^2 + sigma_q^2 / K^2 is what
the sensor adds (EMVA 1288; sigma_q^2 = 1/12 DN^2). It takes n = v / (k^2 s) samples, where v is the variance of one sample, in
electrons^2. A render is hidden when 99 % of its unsaturated pixels are: *time to hidden* is the 99th percentile of n times the
processor time of one sample in every pixel. All pixels get the same number of samples.

- v is the scatter of independent renders of few samples, times their number: for ours, whose samples are stratified, it is what
  a sample is worth in such a render. It is averaged over 7 x 7 pixels. What none of the renders met is not in it: it is too
  small rather than too large where light is rare.
- Beside a highlight the average is the highlight's, against the sensor's noise of a dark pixel. So there is a second figure: v / s of
  each pixel first, then the average over the unsaturated ones of the 7 x 7. It is smaller, and says what the pixels themselves need.
- s, the saturation and the exposure (99.5 % quantile at 90 % of saturation) are those of the mean of all our renders, for all
  renderers: only their noise and their speed differ.
- From radiance to electrons the sensor's data sheet and the bands of `crates/camera/sensor/src/optics.rs` give the ratio of the channels;
  the factor is that of the EXR files that our program writes (`electrons.Y`), which must be the same in every pixel.
- Both get the scenes without absorption, which Mitsuba's `path` does not know.
- Processor time is that of the process, user and system, which other jobs on the machine disturb less than a clock; the renderers
  take turns, so that what disturbs one disturbs the other. What a render costs whatever its samples (reading, building trees,
  writing; compiling the kernel) is left out.

Behind the sign +- is the standard error by the jackknife over the renders. The second table holds ours against ours
`--without cover-connection`, in the pixels that see the cover's broad faces from the front: variance times time, the same
place by place. Renders are kept in the work folder and used again; delete it to measure anew.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable

import numpy as np

import mitsuba_scene
from readme_table import into_readme

SCENES = ("inspection", "inspection-flat", "inspection-open")
# Share of the sensor's noise that the render's may have.
K = 0.7
# Side of the square that variances are averaged over.
POOL = 7
SHARE = 0.99
QUANTILE, LEVEL = 0.995, 0.9
# Wavelengths of the channels in nm, as in crates/camera/sensor/src/optics.rs.
BANDS = (610.0, 550.0, 465.0)
# Does `electrons.Y` follow from R, G and B as computed here?
LINEAR = 1e-4
EFFECT = "cover-connection"


@dataclass(frozen=True)
class Sensor:
    """What of a data sheet counts here, in electrons."""

    dark_variance: float
    quantisation_variance: float
    saturation: float
    # Response to the three channels, relative to each other.
    weights: np.ndarray

    @staticmethod
    def load(path: Path) -> Sensor:
        """From a preset."""
        sheet = tomllib.loads(path.read_text())
        gain = float(sheet["gain_e_per_dn"])
        wavelengths, efficiencies = np.array(sheet["quantum_efficiency"], dtype=float).T
        # Photons of a joule grow with the wavelength.
        weights = np.interp(BANDS, wavelengths, efficiencies) * np.array(BANDS)
        converter = (2 ** int(sheet["bit_depth"]) - 1 - float(sheet["offset_dn"])) * gain
        saturation = min(float(sheet["full_well_e"]), converter)
        return Sensor(float(sheet["dark_noise_e"]) ** 2, gain**2 / 12.0, saturation, weights / weights.sum())


@dataclass(frozen=True)
class Renders:
    """Independent images (render, row, column) of `spp` samples, in W/(m^2 sr) as the sensor weighs the channels, and the
    processor seconds of one sample in every pixel."""

    images: np.ndarray
    spp: int
    seconds: np.ndarray

    @property
    def time(self) -> float:
        """Of one sample in every pixel. The median: a render that was disturbed does not count."""
        return float(np.median(self.seconds))

    def variance(self, electrons: float, leave_out: int | None = None) -> np.ndarray:
        """Of one sample, in electrons^2; `electrons` per unit of the images."""
        chosen = self.images if leave_out is None else np.delete(self.images, leave_out, axis=0)
        return self.spp * electrons**2 * chosen.var(axis=0, ddof=1)


def pooled(image: np.ndarray, counts: np.ndarray | None = None) -> np.ndarray:
    """The mean over the square around each pixel, as far as it lies in the image, of the pixels that `counts` (all)."""
    counts = np.ones(image.shape, dtype=bool) if counts is None else counts
    reach = POOL // 2
    sums, numbers = np.zeros(image.shape), np.zeros(image.shape)
    padded, inside = (np.pad(x, reach) for x in (np.where(counts, image, 0.0), counts.astype(float)))
    height, width = image.shape
    for y in range(POOL):
        for x in range(POOL):
            sums += padded[y : y + height, x : x + width]
            numbers += inside[y : y + height, x : x + width]
    return sums / np.maximum(numbers, 1.0)


def jackknife(count: int, value: Callable[[int | None], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """A value of all renders and its standard error, from its values with one of them left out (Tukey 1958)."""
    parts = np.array([value(k) for k in range(count)])
    return value(None), np.sqrt((count - 1) / count * ((parts - parts.mean(axis=0)) ** 2).sum(axis=0))


class Contender:
    """A renderer of one scene. `render` gives an image (rows, columns, RGB) and processor seconds for a number of samples."""

    def __init__(self, store: Path, spp: int, weights: np.ndarray, render: Callable[[int, int], tuple[np.ndarray, float]]):
        self.store, self.spp, self.weights, self.render = store, spp, weights, render
        kept = np.load(store) if store.exists() else {"images": [], "seconds": [], "fixed": -1.0, "spp": spp}
        if int(kept["spp"]) != spp:
            raise SystemExit(f"{store} has renders of {int(kept['spp'])} samples, not {spp}: delete it")
        self.images, self.seconds, self.fixed = list(kept["images"]), list(kept["seconds"]), float(kept["fixed"])

    def go_on(self, number: int) -> None:
        """Makes render `number` (from 0) if it is not there."""
        if number < len(self.images):
            return
        if self.fixed < 0.0:
            # Numbers below those of the renders proper; the second has the kernels that the first compiled.
            self.fixed = min(self.render(1, 0)[1], self.render(1, 1)[1])
        image, seconds = self.render(self.spp, 2 + number)
        self.add(image)
        self.seconds.append((seconds - self.fixed) / (self.spp - 1))
        part = self.store.with_suffix(".part.npz")
        np.savez_compressed(part, **self.kept())
        part.replace(self.store)

    def add(self, image: np.ndarray) -> None:
        """Adds an image (rows, columns, RGB)."""
        self.images.append((image @ self.weights).astype(np.float32))

    def kept(self) -> dict[str, Any]:
        """The content of the file."""
        return {"images": np.stack(self.images), "seconds": np.array(self.seconds), "fixed": self.fixed, "spp": self.spp}

    def renders(self, count: int) -> Renders:
        """The first `count`."""
        return Renders(np.stack(self.images[:count]).astype(np.float64), self.spp, np.array(self.seconds[:count]))


def mitsuba_renderer(scene: Any) -> Callable[[int, int], tuple[np.ndarray, float]]:
    """Mitsuba; numbers are seeds."""
    import mitsuba as mi

    def render(spp: int, number: int) -> tuple[np.ndarray, float]:
        start = time.process_time()
        image = np.array(mi.render(scene, spp=spp, seed=number), dtype=np.float64)
        return image, time.process_time() - start

    return render


def channels(path: Path, *names: str) -> np.ndarray:
    """Channels of an EXR, as (row, column, channel)."""
    import mitsuba as mi

    bitmap = mi.Bitmap(str(path))
    column = {field.name: k for k, field in enumerate(bitmap.struct_())}
    return np.array(bitmap, dtype=np.float64)[..., [column[name] for name in names]]


def our_renderer(
    program: Path,
    scene: Path,
    size: int,
    weights: np.ndarray,
    without: list[str],
    factors: list[float],
    allocate: str = "uniform",
) -> Callable[[int, int], tuple[np.ndarray, float]]:
    """Ours; numbers are frames. Notes in `factors` the electrons per unit of weighted radiance and second of exposure."""
    files = {kind: scene.with_suffix(f".{kind}") for kind in ("exr", "json", "png")}

    def render(spp: int, number: int) -> tuple[np.ndarray, float]:
        command: list[Any] = [program, "render", scene, "--allocate", allocate, "--spp", str(spp), "--frame", str(number)]
        command += ["--width", str(size), "--height", str(size), "--sensor", "imx250", "--progress", "none", *without]
        command += ["--exr", files["exr"], "--stats", files["json"], "-o", files["png"]]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, capture_output=True, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode != 0:
            raise SystemExit(f"{scene.name}: {done.stderr}")
        image, electrons = channels(files["exr"], "R", "G", "B"), channels(files["exr"], "electrons.Y")[..., 0]
        weighted = image @ weights
        ratio = electrons[weighted > 0.0] / weighted[weighted > 0.0]
        if ratio.size == 0 or np.ptp(ratio) > LINEAR * ratio.mean():
            raise SystemExit(f"{files['exr']}: electrons.Y is not {weights} times the channels, or the image is black")
        factors.append(float(ratio.mean()) / json.loads(files["json"].read_text())["sensor"]["exposure_seconds"])
        return image, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    return render


def knows(program: Path, effect: str) -> bool:
    """Can our program leave this effect out?"""
    done = subprocess.run([program, "render", "no such scene.glb", "--without", effect], capture_output=True, text=True)
    return "--without" not in done.stderr


def covered(scene: Any, size: int) -> np.ndarray:
    """Pixels whose middle sees a smooth clear surface that faces the camera to 30 degrees: the cover, but for its rim. By
    Mitsuba's rays, because what our layers hold is what lies under the cover."""
    import mitsuba as mi

    y, x = np.mgrid[0:size, 0:size].astype(np.float32)
    places = mi.Point2f((x.ravel() + 0.5) / size, (y.ravel() + 0.5) / size)
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.5, places, mi.Point2f(0.5, 0.5))
    hit = scene.ray_intersect(ray)
    clear = mi.has_flag(hit.bsdf(ray).flags(), mi.BSDFFlags.DeltaTransmission) & hit.is_valid()
    facing = np.abs(np.einsum("ij,ij->j", np.array(hit.n), np.array(ray.d)))
    return (np.array(clear) & (facing > np.cos(np.radians(30.0)))).reshape(size, size)


def hidden(renders: Renders, electrons: float, noise: np.ndarray, judged: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples until half and until 99 % of the judged pixels are hidden, and those of 99 % with v / s averaged instead of v;
    with standard errors."""

    def samples(leave_out: int | None) -> np.ndarray:
        variance = renders.variance(electrons, leave_out)
        needed = (pooled(variance) / (K**2 * noise))[judged]
        own = pooled(variance / (K**2 * noise), judged)[judged]
        return np.array([*np.quantile(needed, [0.5, SHARE]), np.quantile(own, SHARE)])

    return jackknife(len(renders.images), samples)


def scene_rows(name: str, contenders: dict[str, Contender], count: int, sensor: Sensor, per_second: float) -> list[str]:
    """The rows of a scene: whole image, ours last, so that the others can be compared with it."""
    renders = {who: contender.renders(count) for who, contender in contenders.items()}
    mean = renders["ours"].images.mean(axis=0)
    exposure = LEVEL * sensor.saturation / (float(np.quantile(mean, QUANTILE, method="nearest")) * per_second)
    electrons = per_second * exposure
    noise = electrons * mean + sensor.dark_variance + sensor.quantisation_variance
    judged = electrons * mean < sensor.saturation
    found = {who: hidden(r, electrons, noise, judged) for who, r in renders.items()}
    ours = found["ours"][0] * renders["ours"].time
    rows = []
    for who, r in renders.items():
        (half, most, own), (_, error, own_error) = found[who]
        ratios = [f"{value * r.time / base:.3g}" if who != "ours" else "" for value, base in zip((most, own), ours[1:])]
        rows.append(
            f"| {name} | {who} | {1e3 * r.time:.0f} | {half:.3g} | {most:.3g} +- {error:.2g} | {most * r.time:.3g} | {ratios[0]}"
            f" | {own:.3g} +- {own_error:.2g} | {own * r.time:.3g} | {ratios[1]} |"
        )
    return rows


def cover_row(name: str, with_: Renders, without: Renders, mask: np.ndarray) -> str:
    """The row of a cover: variance times time without the connection over that with it."""
    seconds = without.time / with_.time

    def ratios(leave_out: int | None) -> np.ndarray:
        share = pooled(without.variance(1.0, leave_out), mask)[mask] / pooled(with_.variance(1.0, leave_out), mask)[mask]
        return seconds * np.quantile(share, [0.5, 0.1, 0.9])

    (median, low, high), (error, _, _) = jackknife(len(with_.images), ratios)
    # Render by render: both take the same random numbers.
    shift = with_.images[:, mask].mean(axis=1) - without.images[:, mask].mean(axis=1)
    difference, spread = np.array([shift.mean(), shift.std(ddof=1) / np.sqrt(len(shift))]) / without.images[:, mask].mean()
    return (
        f"| {name} | {mask.sum()} | {seconds:.2f} | {median:.3g} +- {error:.2g} | {low:.3g} | {high:.3g}"
        f" | {difference:+.2%} +- {spread:.2%} |"
    )


def main() -> int:
    """Renders what is missing and prints both tables."""
    root = Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True, help="our renderer")
    parser.add_argument("--size", type=int, default=512, help="width and height in pixels")
    parser.add_argument("--spp", type=int, default=64, help="samples per pixel of a render, a multiple of 4")
    parser.add_argument("--renders", type=int, default=8, help="independent renders of each renderer, at least 8")
    parser.add_argument("--work", type=Path, default=root / "out" / "validation" / "hidden")
    parser.add_argument("--readme", action="store_true", help="write the tables into docs/research")
    parser.add_argument("--only", choices=SCENES, nargs="*", default=SCENES)
    arguments = parser.parse_args()
    if arguments.renders < 8 or arguments.spp < 4 or arguments.spp % 4:
        raise SystemExit("--renders must be 8 or more, --spp a multiple of 4")

    import drjit
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    # Mitsuba 3.9.1 with a single thread never comes back from reading an EXR file.
    drjit.set_thread_count(max(2, drjit.thread_count()))
    mi.set_log_level(mi.LogLevel.Error)
    sensor = Sensor.load(root / "crates" / "camera" / "sensor" / "presets" / "imx250.toml")
    connects = knows(arguments.dunkelfeld, EFFECT)
    images, covers = [], []
    for name in arguments.only:
        size, spp = arguments.size, arguments.spp
        work = arguments.work / f"{name}-{size}"
        work.mkdir(parents=True, exist_ok=True)
        file = mitsuba_scene.equal_terms(root / "scenes" / "inspection" / f"{name}.glb", 1.0, work / f"{name}.glb")
        scene = mitsuba_scene.load(file, size, size)
        factors: list[float] = []
        job = mitsuba_scene.job(file)
        ours = lambda *flags: our_renderer(arguments.dunkelfeld, job, size, sensor.weights, list(flags), factors)
        contender = lambda who, render: Contender(work / f"{who}.npz", spp, sensor.weights, render)
        contenders = {"Mitsuba": contender("mitsuba", mitsuba_renderer(scene))}
        mask = covered(scene, size)
        if connects and mask.any():
            contenders["ours, no connection"] = contender("ours-without", ours("--without", EFFECT))
        contenders["ours"] = contender("ours", ours())
        for number in range(arguments.renders):
            for who, one in contenders.items():
                print(f"{name}: render {number + 1} of {arguments.renders}, {who}", file=sys.stderr, flush=True)
                one.go_on(number)
        if not factors:
            ours()(4, 0)
        images += scene_rows(name, contenders, arguments.renders, sensor, float(np.mean(factors)))
        if "ours, no connection" in contenders:
            both = [contenders[who].renders(arguments.renders) for who in ("ours", "ours, no connection")]
            covers.append(cover_row(name, *both, mask))
    lines = [
        f"Mitsuba {mi.__version__} (`llvm_ad_rgb`); {arguments.size} x {arguments.size} pixels, {arguments.renders} renders of"
        f" {arguments.spp} spp each; IMX250, exposure auto, k = {K:g}.",
        "",
        "| scene | renderer | ms per sample of every pixel | samples, half hidden | samples, 99 % hidden | processor seconds"
        " | times ours | v / s averaged: samples | processor seconds | times ours |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|",
        *images,
    ]
    if covers:
        lines += ["", "Without the connection through the cover, over with it:", ""]
        lines += ["| scene | covered pixels | time | variance x time, median | 10 % | 90 % | mean, with over without |"]
        lines += ["|---|---:|---:|---:|---:|---:|---:|", *covers]
    elif not connects:
        lines += ["", f"This program has no effect named {EFFECT}: nothing to compare under the covers."]
    text = "\n".join(lines) + "\n"
    print(text)
    if arguments.readme:
        into_readme(text, "time to hidden")
    return 0


if __name__ == "__main__":
    sys.exit(main())
