"""Renders the jobs of docs/recipes.md and docs/examples.md and the bracket of the README, and writes pictures, seconds and levels k.

    python example_pictures.py --dunkelfeld ../target/release/dunkelfeld [NAME...]

Seconds are those of two cores: processor time over two. Renders go to `out/validation/examples`.
"""

import argparse
import json
import re
import resource
import subprocess
import sys
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
JOBS = ROOT / "examples" / "jobs"
PAGE = ROOT / "docs" / "examples"
OUT = ROOT / "out" / "validation" / "examples"


def run(program: Path, *arguments: str | Path) -> float:
    """Runs a command and returns its processor time [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([program, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(*arguments, f"exit code {done.returncode}", flush=True)
    if done.returncode != 0:
        sys.exit(done.stdout + done.stderr)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def recipes(program: Path) -> None:
    page = (ROOT / "docs" / "recipes.md").read_text()
    base = (JOBS / "recipes.toml").read_text().replace('"part.glb"', f'"{JOBS / "part.glb"}"')
    found = re.findall(r"^### (.+?)\n\n```toml\n(.*?)```", page, re.MULTILINE | re.DOTALL)
    sheet = Image.new("RGB", (5 * 258 - 2, 3 * 258 - 2), "white")
    for k, (name, block) in enumerate(found):
        stem = OUT / name.lower().replace(" ", "-")
        stem.with_suffix(".toml").write_text(base + block)
        if not stem.with_suffix(".png").exists():
            clear = ["--spp", "112", "--denoise", "off"] if "transmission = 1" in block else []
            run(program, "render", stem.with_suffix(".toml"), "-o", stem.with_suffix(".png"), *clear)
        sheet.paste(Image.open(stem.with_suffix(".png")).convert("RGB"), (k % 5 * 258, k // 5 * 258))
    sheet.save(ROOT / "docs" / "recipes.png", optimize=True)


def save(picture: Image.Image, path: Path) -> None:
    """Writes a PNG with 64 colours, which is small."""
    picture.convert("RGB").quantize(64).save(path, "PNG", optimize=True)
    print(path.name, path.stat().st_size, "bytes")


def example(program: Path, name: str) -> None:
    """The picture of a job; its seconds and its k."""
    picture, stats = OUT / f"{name}.png", OUT / f"{name}.json"
    job, exr = JOBS / f"{name}.toml", OUT / f"{name}.exr"
    seconds = run(program, "render", job, "-o", picture, "--stats", stats, "--exr", exr) / 2
    save(Image.open(picture), PAGE / f"{name}.png")
    k = json.loads(stats.read_text())["certificate"]["hidden_at"]
    print(f"{name}: {seconds:.0f} s, k = {k:.2f}")


def expose(program: Path) -> None:
    """A frame of the EXR of `dome`."""
    run(program, "expose", OUT / "dome.exr", "--sensor", "imx174", "--exposure", "60us", "-o", OUT / "expose.png")
    save(Image.open(OUT / "expose.png"), PAGE / "expose.png")


def defects(program: Path) -> None:
    """The first image of the set of `defects.toml`."""
    seconds = run(program, "dataset", JOBS / "defects.toml", "-o", OUT / "defects", "--count", "4") / 2
    save(Image.open(OUT / "defects" / "images" / "000000.png"), PAGE / "defects.png")
    print(f"defects: {seconds:.0f} s")


def bracket(program: Path) -> None:
    """Four lightings of four brackets with defects, for the README: the first images of the study, without those for training."""
    study = (ROOT / "scenes" / "studies" / "bracket.toml").read_text()
    study = re.sub(r"^(train|pairs|layout) = .*$", "", study, flags=re.MULTILINE).replace(
        "bracket.glb", f"{ROOT}/scenes/studies/bracket.glb"
    )
    (OUT / "bracket.toml").write_text(study)
    run(program, "dataset", OUT / "bracket.toml", "-o", OUT / "bracket", "--count", "6")
    captures, images = ["right", "rear", "left", "front"], [0, 1, 2, 5]
    grey = [Image.open(OUT / "bracket" / "images" / f"{i:06}-{c}.png").convert("L") for i in images for c in captures]
    box = (4, 40, 302, 216)
    width, height = box[2] - box[0], box[3] - box[1]
    sheet = Image.new("L", (4 * (width + 2) - 2, 4 * (height + 2) - 2), 255)
    for k, picture in enumerate(grey):
        sheet.paste(picture.crop(box), (k % 4 * (width + 2), k // 4 * (height + 2)))
    sheet.quantize(64).save(ROOT / "docs" / "bracket.png", optimize=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, default=ROOT / "target" / "release" / "dunkelfeld")
    parser.add_argument("only", nargs="*", help="recipes, bracket, expose, or names of jobs; by default all")
    options = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    others = {"recipes": recipes, "expose": expose, "defects": defects, "bracket": bracket}
    jobs = sorted(job.stem for job in JOBS.glob("*.toml") if job.stem not in others)
    for name in options.only or [*jobs, *others]:
        if name in others:
            others[name](options.dunkelfeld)
        else:
            example(options.dunkelfeld, name)


if __name__ == "__main__":
    main()
