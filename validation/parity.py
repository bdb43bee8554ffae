"""Renders the cases of `parity_cases.py` with Dunkelfeld and with Mitsuba 3 and compares them pixel by pixel.

    python parity.py --dunkelfeld ../target/release/dunkelfeld --readme --write-references

Both render every case in batches with different seeds, whose scatter gives the variance of each pixel's mean; what is tested
is described in `statistics_of_images.py`. Batches are kept in the work folder under a key made from the case itself, and
used again if nothing about the case has changed.
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
import parity_scene
from statistics_of_images import FAMILY_RATE, PASS_SHARE, Comparison, Estimate, compare, sidak

SIZE = 32
BATCHES = 32


def key(case: parity_cases.Case) -> str:
    """A digest of everything about a scene and its samples."""
    digest = hashlib.sha256()

    def add(value: Any) -> None:
        if isinstance(value, np.ndarray):
            digest.update(str(value.shape).encode() + value.tobytes())
        elif dataclasses.is_dataclass(value):
            for field in dataclasses.fields(value):
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
    add((case.spp, SIZE, BATCHES))
    return digest.hexdigest()[:12]


def seed(case: parity_cases.Case, batch: int) -> int:
    """The seed of a batch; every case has its own, so that the cases' errors are independent of each other."""
    return BATCHES * (1 + zlib.crc32(case.name.encode()) % 10_000_000) + batch


def stored(path: Path, spp: int, render: Callable[[int], np.ndarray]) -> Estimate:
    """The batches in a file, rendered if they are not there; `render` gets the number of the batch."""
    if not path.exists():
        np.savez_compressed(path, batches=np.stack([render(k) for k in range(BATCHES)]).astype(np.float32))
    return Estimate(np.load(path)["batches"].astype(np.float64), spp)


def equal_terms(file: parity_cases.File, work: Path) -> Path:
    """A copy of a shipped scene that both can render."""
    return mitsuba_scene.equal_terms(file.path, file.zoom, work / file.path.name)


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
        return np.array(mi.render(scene[0], spp=case.spp // BATCHES, seed=seed(case, k)))

    return stored(path, case.spp, batch)


def render_ours(case: parity_cases.Case, program: Path, work: Path, path: Path) -> Estimate:
    """Our batches."""
    import mitsuba as mi

    if isinstance(case.scene, parity_cases.File):
        scene = equal_terms(case.scene, work)
    else:
        scene = work / f"{case.name}.toml"
        parity_scene.write(case.scene, scene, SIZE, SIZE)
    exr, png = work / f"{case.name}.exr", work / f"{case.name}.png"

    def batch(k: int) -> np.ndarray:
        rules = ["--allocate", "uniform", "--spp", str(case.spp // BATCHES), "--seed", str(seed(case, k))]
        rules += ["--width", str(SIZE), "--height", str(SIZE), "--sensor", "none", "--progress", "none"]
        done = subprocess.run([program, "render", scene, *rules, "--exr", exr, "-o", png], capture_output=True, text=True)
        if done.returncode != 0 or (k == 0 and done.stderr):
            print(f"{case.name}: {done.stderr}", file=sys.stderr)
        done.check_returncode()
        bitmap = mi.Bitmap(str(exr))
        column = {field.name: i for i, field in enumerate(bitmap.struct_())}
        return np.array(bitmap)[..., [column[c] for c in "RGB"]]

    return stored(path, case.spp, batch)


def table(results: list[tuple[parity_cases.Case, Comparison]]) -> str:
    """Markdown, a row per case."""
    lines = [
        "| group | case | spp | pixels | pass | mean difference | standard error | worst Z | rms Z | |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---|",
    ]
    for case, c in results:
        lines.append(
            f"| {case.group} | {case.name} | {case.spp} | {c.pixels} | {c.share:.2%} | {c.difference:+.3%}"
            f" | {c.error:.3%} | {c.worst_z:+.1f} | {c.rms_z:.2f} | {c.verdict} |"
        )
    verdicts = [c.verdict for _, c in results]
    counts = ", ".join(f"{verdicts.count(v)} {v}" for v in ("pass", "not converged", "FAILS"))
    worst = max(results, key=lambda r: abs(r[1].difference))
    summary = f"{len(results)} cases: {counts}. Largest difference of a mean: {worst[1].difference:+.3%} ({worst[0].name})."
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


def into_readme(text: str, readme: Path) -> None:
    """Replaces what stands between the marks."""
    old = readme.read_text()
    marks = r"(<!-- parity table -->\n).*?(<!-- end of parity table -->)"
    new, count = re.subn(marks, lambda m: f"{m[1]}\n{text}\n{m[2]}", old, flags=re.DOTALL)
    if count != 1:
        raise SystemExit(f"{readme}: the marks of the parity table are missing")
    readme.write_text(new)


def save_maps(case: parity_cases.Case, ours: Estimate, theirs: Estimate, c: Comparison, path: Path) -> None:
    """Ours, theirs and the scores side by side, enlarged, to look at."""
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
    parser.add_argument("--only", nargs="*", metavar="CASE", help="regular expressions that match names of cases or groups")
    parser.add_argument("--again", action="store_true", help="render ours anew")
    parser.add_argument("--maps", action="store_true", help="write pictures of both and of the scores to the work folder")
    parser.add_argument("--readme", action="store_true", help="put the table into README.md")
    parser.add_argument("--write-references", action="store_true", help="write tests/references")
    arguments = parser.parse_args()

    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    work = arguments.work
    work.mkdir(parents=True, exist_ok=True)
    cases = parity_cases.all_cases()
    if arguments.only is not None:
        chosen = re.compile("|".join(f"(?:{pattern})" for pattern in arguments.only))
        cases = [c for c in cases if chosen.fullmatch(c.name) or chosen.fullmatch(c.group)]
    references = root / "tests" / "references"
    if arguments.write_references:
        references.mkdir(exist_ok=True)
        kept = [case for case in cases if isinstance(case.scene, parity_scene.Scene)]
        (references / "cases.txt").write_text("".join(f"{case.name} {4 * case.spp}\n" for case in kept))
    results = []
    for case in cases:
        theirs = render_mitsuba(case, work, work / f"{case.name}.{key(case)}.mitsuba.npz")
        own = work / f"{case.name}.{key(case)}.ours.npz"
        if arguments.again:
            own.unlink(missing_ok=True)
        ours = render_ours(case, arguments.dunkelfeld, work, own)
        found = compare(ours, theirs)
        results.append((case, found))
        print(
            f"{case.name:32} {found.share:8.2%} {found.difference:+9.3%} +- {found.error:.3%}"
            f"  worst Z {found.worst_z:+5.1f}  rms {found.rms_z:.2f}  {found.verdict}",
            file=sys.stderr,
            flush=True,
        )
        if arguments.maps or found.verdict == "FAILS":
            save_maps(case, ours, theirs, found, work / f"{case.name}.map.png")
        if arguments.write_references and isinstance(case.scene, parity_scene.Scene):
            write_reference(case, theirs, references)
    level = sidak(FAMILY_RATE, 3 * SIZE * SIZE)
    text = (
        f"Mitsuba {mi.__version__} (`llvm_ad_rgb`), {SIZE} x {SIZE} pixels, {BATCHES} batches each; level per pixel and channel"
        f" {level:.2e}, bar {PASS_SHARE:.2%} of the pixels.\n\n{table(results)}"
    )
    print(text)
    if arguments.readme:
        into_readme(text, Path(__file__).with_name("README.md"))
    return 1 if any(found.verdict == "FAILS" for _, found in results) else 0


if __name__ == "__main__":
    sys.exit(main())
