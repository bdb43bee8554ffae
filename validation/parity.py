"""Renders the cases of `parity_cases.py` with Dunkelfeld and with Mitsuba 3 and compares them pixel by pixel.

    python parity.py --dunkelfeld ../target/release/dunkelfeld --readme --write-references

Both render every case in batches with different seeds, whose scatter gives the variance of each pixel's mean; what is tested
is described in `statistics_of_images.py`. Batches are kept in the work folder under a key made from the case itself, and
used again if nothing about the case has changed. What was found is kept in `parity.csv`, case by case: with `--only`, the
table has the other cases as they were.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import re
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any, Callable

import numpy as np

import mitsuba_scene
import parity_cases
import parity_mitsuba
import parity_results
import parity_scene
from parity_results import Result
from readme_table import into_readme
from statistics_of_images import FAMILY_RATE, PASS_SHARE, Comparison, Estimate, compare, sidak

SIZE = 32


def key(case: parity_cases.Case) -> str:
    """A digest of everything about a scene and the samples of a batch, but not of how many batches there are."""
    digest = hashlib.sha256()

    def add(value: Any) -> None:
        if isinstance(value, np.ndarray):
            digest.update(str(value.shape).encode() + value.tobytes())
        elif dataclasses.is_dataclass(value):
            for field in dataclasses.fields(value):
                # What has its default is left out, so that a new field changes nothing for the cases that do not use it.
                if not is_default(field, getattr(value, field.name)):
                    add(field.name)
                    add(getattr(value, field.name))
        elif isinstance(value, dict):
            for name in sorted(value):
                add(name)
                add(value[name])
        elif isinstance(value, Path):
            digest.update(value.read_bytes())
        elif isinstance(value, (list, tuple)):
            for item in value:
                add(item)
        else:
            digest.update(repr(value).encode() + b";")

    add(case.scene)
    add((case.batch_spp, SIZE))
    return digest.hexdigest()[:12]


def is_default(field: dataclasses.Field[Any], value: Any) -> bool:
    """Does a field have its default value?"""
    factory = field.default_factory
    default = field.default if factory is dataclasses.MISSING else factory()
    return type(value) is type(default) and not isinstance(value, np.ndarray) and value == default


def seed(case: parity_cases.Case, batch: int) -> int:
    """The seed of a batch, below 2^32; every case has its own, so that the cases' errors are independent of each other."""
    group, member = divmod(batch, parity_cases.BATCHES)
    assert group < 8, f"{case.name}: seeds are for {8 * parity_cases.BATCHES} batches at most"
    return parity_cases.BATCHES * (1 + zlib.crc32(case.name.encode()) % 10_000_000) + member + (group << 29)


def stored(path: Path, case: parity_cases.Case, render: Callable[[int], np.ndarray]) -> Estimate:
    """The batches in a file; `render` gets the number of each that is not there. A run that was stopped goes on where it
    was, and a case that was given more batches keeps those it has."""
    images = list(np.load(path)["batches"]) if path.exists() else []
    for k in range(len(images), case.batches):
        images.append(render(k).astype(np.float32))
        part = path.with_suffix(".part.npz")
        np.savez_compressed(part, batches=np.stack(images))
        part.replace(path)
    return Estimate(np.stack(images[: case.batches]).astype(np.float64), case.spp)


def equal_terms(file: parity_cases.File, work: Path) -> Path:
    """A copy of a shipped scene that both can render."""
    name = f"{file.path.stem}-faceted.glb" if file.faceted else file.path.name
    return mitsuba_scene.equal_terms(file.path, file.zoom, work / name, file.faceted)


def render_mitsuba(case: parity_cases.Case, work: Path, path: Path) -> Estimate:
    """Mitsuba's batches."""
    import mitsuba as mi

    scene: list[Any] = []

    def batch(k: int) -> np.ndarray:
        if not scene:
            if isinstance(case.scene, parity_cases.File):
                scene.append(mitsuba_scene.load(equal_terms(case.scene, work), SIZE, SIZE))
            else:
                scene.append(parity_mitsuba.load(case.scene, SIZE, SIZE))
        return np.array(mi.render(scene[0], spp=case.batch_spp, seed=seed(case, k)))

    return stored(path, case, batch)


def render_ours(case: parity_cases.Case, program: Path, work: Path, path: Path) -> Estimate:
    """Our batches."""
    import mitsuba as mi

    if isinstance(case.scene, parity_cases.File):
        scene = mitsuba_scene.job(equal_terms(case.scene, work))
    else:
        scene = work / f"{case.name}.toml"
        parity_scene.write(case.scene, scene, SIZE, SIZE)
    exr, png = work / f"{case.name}.exr", work / f"{case.name}.png"

    def batch(k: int) -> np.ndarray:
        rules = ["--allocate", "uniform", "--spp", str(case.batch_spp), "--seed", str(seed(case, k))]
        rules += ["--width", str(SIZE), "--height", str(SIZE), "--sensor", "none", "--progress", "none"]
        done = subprocess.run([program, "render", scene, *rules, "--exr", exr, "-o", png], capture_output=True, text=True)
        if done.returncode != 0 or (k == 0 and done.stderr):
            print(f"{case.name}: {done.stderr}", file=sys.stderr)
        done.check_returncode()
        bitmap = mi.Bitmap(str(exr))
        column = {field.name: i for i, field in enumerate(bitmap.struct_())}
        return np.array(bitmap)[..., [column[c] for c in "RGB"]]

    return stored(path, case, batch)


def table(results: list[Result], groups: dict[str, str]) -> str:
    """Markdown, a row per group; `groups` are those of the cases. `parity.csv` has the cases."""
    lines = [
        "| group | cases | pass | largest mean difference | its standard error | worst Z | largest rms Z |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for group in dict.fromkeys(groups[r.case] for r in results):
        here = [r for r in results if groups[r.case] == group]
        top = max(here, key=lambda r: abs(r.difference))
        worst_z = max((r.worst_z for r in here), key=abs)
        lines.append(
            f"| {group} | {len(here)} | {sum(r.verdict == 'pass' for r in here)} | {top.difference:+.3%} ({top.case})"
            f" | {top.error:.3%} | {worst_z:+.1f} | {max(r.rms_z for r in here):.2f} |"
        )
    verdicts = [r.verdict for r in results]
    counts = ", ".join(f"{verdicts.count(v)} {v}" for v in ("pass", "not converged", "FAILS"))
    worst = max(results, key=lambda r: abs(r.difference))
    summary = f"{len(results)} cases: {counts}. Largest difference of a mean: {worst.difference:+.3%} ({worst.case})."
    return "\n".join(lines) + f"\n\n{summary}\n"


def write_reference(case: parity_cases.Case, theirs: Estimate, folder: Path) -> None:
    """Mitsuba's image at half the resolution with its standard errors, and our input, for `cargo test`."""
    import mitsuba as mi

    half = theirs.halved()
    size = SIZE // 2
    parity_scene.write(case.scene, folder / f"{case.name}.toml", size, size)
    channels = [*"RGB", *(f"error.{c}" for c in "RGB")]
    # Half precision: an error keeps its digits where a variance would not.
    pixels = np.concatenate([half.mean, np.sqrt(half.variance)], axis=-1).astype(np.float16)
    mi.Bitmap(pixels, channel_names=channels).write(str(folder / f"{case.name}.exr"))


def list_references(cases: list[parity_cases.Case], folder: Path) -> None:
    """Writes the names of all cases that have a picture, with Mitsuba's samples per pixel of it."""
    kept = [case for case in cases if (folder / f"{case.name}.exr").exists()]
    (folder / "cases.txt").write_text("".join(f"{case.name} {4 * case.spp}\n" for case in kept))


def save_maps(case: parity_cases.Case, ours: Estimate, theirs: Estimate, c: Comparison, path: Path) -> None:
    """Ours, theirs and the scores side by side, enlarged, for viewing."""
    from PIL import Image

    white = max(float(np.quantile(theirs.mean, 0.98)), 1e-9)
    tone = lambda image: np.clip(image / white, 0.0, 1.0) ** (1.0 / 2.2)
    red, blue = np.clip(c.map / 5.0, 0.0, 1.0), np.clip(-c.map / 5.0, 0.0, 1.0)
    scores = np.stack([1.0 - blue, 1.0 - red - blue, 1.0 - red], axis=-1)
    strip = np.concatenate([tone(ours.mean), tone(theirs.mean), scores], axis=1)
    picture = Image.fromarray(np.round(255.0 * np.clip(strip, 0.0, 1.0)).astype(np.uint8))
    picture.resize((picture.width * 6, picture.height * 6), Image.Resampling.NEAREST).save(path)


def main() -> int:
    """Renders what is missing, prints the table; 1 if any case fails."""
    root = Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True, help="our renderer")
    parser.add_argument("--work", type=Path, default=root / "out" / "validation" / "parity")
    parser.add_argument("--only", nargs="*", metavar="CASE", help="regular expressions that match names of cases, or group/name")
    parser.add_argument("--again", action="store_true", help="render ours anew")
    parser.add_argument("--maps", action="store_true", help="write pictures of both and of the scores to the work folder")
    parser.add_argument("--readme", action="store_true", help="write the tables into docs/research")
    parser.add_argument("--write-references", action="store_true", help="write tests/references")
    arguments = parser.parse_args()

    import drjit
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    # Mitsuba 3.9.1 with a single thread never comes back from reading an EXR file.
    drjit.set_thread_count(max(2, drjit.thread_count()))
    mi.set_log_level(mi.LogLevel.Error)
    work = arguments.work
    work.mkdir(parents=True, exist_ok=True)
    everything = cases = parity_cases.all_cases()
    if arguments.only is not None:
        chosen = re.compile("|".join(f"(?:{pattern})" for pattern in arguments.only))
        cases = [c for c in cases if chosen.fullmatch(c.name) or chosen.fullmatch(f"{c.group}/{c.name}")]
    references = root / "tests" / "references"
    references.mkdir(exist_ok=True)
    results: list[Result] = []
    for case in cases:
        theirs = render_mitsuba(case, work, work / f"{case.name}.{key(case)}.mitsuba.npz")
        own = work / f"{case.name}.{key(case)}.ours.npz"
        if arguments.again:
            own.unlink(missing_ok=True)
        ours = render_ours(case, arguments.dunkelfeld, work, own)
        found = compare(ours, theirs)
        results.append(parity_results.result(case.name, key(case), case.spp, found))
        print(
            f"{case.name:32} {found.share:8.2%} {found.difference:+9.3%} +- {found.error:.3%}"
            f"  worst Z {found.worst_z:+5.1f}  rms {found.rms_z:.2f}  {results[-1].verdict}",
            file=sys.stderr,
            flush=True,
        )
        if arguments.maps or results[-1].verdict == "FAILS":
            save_maps(case, ours, theirs, found, work / f"{case.name}.map.png")
        if arguments.write_references and isinstance(case.scene, parity_scene.Scene):
            write_reference(case, theirs, references)
    if arguments.write_references:
        list_references(everything, references)
    groups = {case.name: case.group for case in everything}
    if arguments.readme:
        kept = Path(__file__).with_name("parity.csv")
        wanted = {case.name: (key(case), case.spp) for case in everything}
        results, missing = parity_results.merged(parity_results.read(kept), results, wanted)
        parity_results.write(kept, results)
        if missing:
            print(f"not in the table, because never rendered as they are now: {', '.join(missing)}", file=sys.stderr)
    level = sidak(FAMILY_RATE, 3 * SIZE * SIZE)
    standard = parity_cases.BATCHES
    text = (
        f"Mitsuba {mi.__version__} (`llvm_ad_rgb`), {SIZE} x {SIZE} pixels, at least {standard} batches each; level per"
        f" pixel and channel {level:.2e}, bar {PASS_SHARE:.2%} of the pixels.\n\n{table(results, groups)}"
    )
    print(text)
    if arguments.readme:
        into_readme(text, "parity table")
    return 1 if any(row.verdict == "FAILS" for row in results) else 0


if __name__ == "__main__":
    sys.exit(main())
