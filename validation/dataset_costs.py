"""Costs of the labels and files of a data set: seconds and bytes per megapixel.

    python validation/dataset_costs.py [PROGRAM] [IMAGES]

The first row is a set of pictures without labels; the others are differences to it. The scene is the shipped panel, on one thread. Run
it alone on the machine.
"""

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SIDE = 512
BASE = {"masks": "false", "coco": '"none"'}
ROWS = [
    ("picture as PNG, no labels", {}, {}),
    ("picture as JPEG", {"picture": '"jpeg"'}, {}),
    ("linear, PNG", {"linear": '"png"'}, {}),
    ("linear, TIFF", {"linear": '"tiff"'}, {}),
    ("raw", {"raw": "true"}, {}),
    ("masks", {}, {"masks": "true"}),
    ("semantic", {}, {"semantic": "true"}),
    ("coverage = 4", {}, {"coverage": "4"}),
    ("depth", {}, {"depth": "true"}),
    ("normals", {}, {"normals": "true"}),
    ("COCO, run lengths", {}, {"coco": '"rle"'}),
    ("COCO, polygons", {}, {"coco": '"polygon"'}),
    ("YOLO", {}, {"yolo": "true"}),
    ("BOP", {}, {"bop": "true"}),
]


def study(images: dict[str, str], labels: dict[str, str]) -> str:
    """The text of a study with some files."""
    job = ROOT / "scenes/inspection/inspection.toml"

    def table(keys: dict[str, str]) -> str:
        return "".join(f"{key} = {value}\n" for key, value in keys.items())

    return (
        f'[study]\njob = "{job}"\nname = "costs"\n[study.images]\n{table(images)}[study.labels]\n{table(BASE | labels)}'
        '[[study.label]]\ncategory = "symbol"\nobjects = "symbol-*"\n[[study.label]]\ncategory = "screw"\nobjects = "screw-*"\n'
        f'[film]\nwidth = {SIDE}\nheight = {SIDE}\n[budget]\nspp = 1\n[allocate]\nstrategy = "uniform"\n'
        '[sensor]\nexposure = "6ms"\n'
    )


def run(program: str, text: str, count: int) -> tuple[float, float, float]:
    """Median seconds of the labels and of the files of an image, and the bytes of an image."""
    with tempfile.TemporaryDirectory() as folder:
        file, home = Path(folder) / "study.toml", Path(folder) / "set"
        file.write_text(text)
        command = [
            program,
            "dataset",
            str(file),
            "-o",
            str(home),
            "--count",
            str(count),
            "--jobs",
            "1",
            "--threads",
            "1",
        ]
        subprocess.run([*command, "--progress", "none"], check=True, stdout=subprocess.DEVNULL)
        costs = [json.loads(path.read_text()) for path in sorted((home / "costs").iterdir())]
        sizes = [path.stat().st_size for path in home.glob("*/*") if path.parent.name not in ("costs", "records")]
        label, write = (statistics.median(cost[stage] for cost in costs) for stage in ("label", "write"))
        return label, write, sum(sizes) / count


def main() -> None:
    """Prints the table."""
    program = sys.argv[1] if len(sys.argv) > 1 else str(ROOT / "target/release/dunkelfeld")
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 3
    megapixels = SIDE * SIDE * 1e-6
    base = run(program, study({}, {}), count)
    print("| files | labels [s/MP] | files [s/MP] | kB/MP |\n|---|---|---|---|")
    for name, images, labels in ROWS:
        found = run(program, study(images, labels), count)
        label, write, size = (a - (b if images or labels else 0) for a, b in zip(found, base))
        print(
            f"| {name} | {label / megapixels:.3f} | {write / megapixels:.3f} | {size / megapixels / 1000:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
