"""The moulded cover alone under a sky that is 1 everywhere: clear and without absorption, it must be invisible.

    python furnace.py --dunkelfeld ../target/release/dunkelfeld

Whatever a renderer shows beside 1 is light that it loses or makes. With the faces' own normals nothing is lost. With interpolated
ones, which lean away from the faces at the rounded rim, light is refracted toward a side on which it is not, and what becomes
of it is each renderer's choice. Prints for both the mean, the least and the greatest pixel, and the pixels off by more than
1 %; exits with 1 if ours is off by 1e-5 anywhere with flat faces, or by 1e-3 in the mean with interpolated normals.
"""

from __future__ import annotations

import argparse
import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

import mitsuba_scene

SIZE, SPP, MATERIAL = 64, 256, "pmma"


def only(material: str, path: Path) -> None:
    """Takes everything out of a scene that is made of something else."""
    glb = mitsuba_scene.Glb(path)
    made_of = lambda mesh: {glb.json["materials"][p["material"]]["name"] for p in glb.json["meshes"][mesh]["primitives"]}
    for node in glb.json["nodes"]:
        if "mesh" in node and made_of(node["mesh"]) != {material}:
            del node["mesh"]
    text = json.dumps(glb.json).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(glb.binary)
    header = struct.pack("<4sIII4s", b"glTF", 2, size, len(text), b"JSON")
    path.write_bytes(header + text + struct.pack("<I4s", len(glb.binary), b"BIN\0") + glb.binary)


def ours(program: Path, scene: Path) -> np.ndarray:
    """Our green channel."""
    import mitsuba as mi

    job, exr = scene.with_suffix(".toml"), scene.with_suffix(".exr")
    rules = f'scene = "{scene.name}"\ncamera = "camera"\n[sensor]\nmodel = "none"\n[render]\nprincipled = "mitsuba"\n[environment]\nradiance = 1.0\n'
    job.write_text(rules)
    size = ["--width", str(SIZE), "--height", str(SIZE), "--spp", str(SPP), "--allocate", "uniform", "--progress", "none"]
    files = ["--exr", exr, "-o", scene.with_suffix(".png")]
    subprocess.run([program, "render", job, *size, *files], check=True, stdout=sys.stderr)
    bitmap = mi.Bitmap(str(exr))
    names = [field.name for field in bitmap.struct_()]
    return np.array(bitmap, dtype=np.float64)[..., names.index("G")]


def theirs(file: Path) -> np.ndarray:
    """Mitsuba's."""
    import mitsuba as mi

    glb = mitsuba_scene.Glb(file)
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": -1, "rr_depth": 16},
        "sensor": mitsuba_scene._sensor(glb.camera(), SIZE, SIZE),
        "sky": {"type": "constant", "radiance": 1.0},
    }
    for number, placed in enumerate(glb.placed()):
        scene[f"shape-{number}"] = mitsuba_scene._shape(placed, mi.load_dict(mitsuba_scene.bsdf(placed.material)))
    return np.array(mi.render(mi.load_dict(scene), spp=SPP), dtype=np.float64)[..., 1]


def main() -> int:
    """Prints the table."""
    root = Path(__file__).resolve().parent.parent
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dunkelfeld", type=Path, required=True, help="our renderer")
    parser.add_argument("--work", type=Path, default=root / "out" / "validation" / "furnace")
    arguments = parser.parse_args()

    import drjit
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    # Mitsuba 3.9.1 with a single thread never comes back from reading an EXR file.
    drjit.set_thread_count(max(2, drjit.thread_count()))
    arguments.work.mkdir(parents=True, exist_ok=True)
    print("| normals | renderer | mean | least | greatest | pixels off by 1 % |\n|---|---|---:|---:|---:|---:|")
    wrong = False
    for normals, faceted in (("interpolated", False), ("of the faces", True)):
        file = arguments.work / f"{'faceted' if faceted else 'smooth'}.glb"
        mitsuba_scene.equal_terms(root / "scenes" / "inspection" / "inspection.glb", 1.0, file, faceted)
        only(MATERIAL, file)
        for who, image in (("ours", ours(arguments.dunkelfeld, file)), ("Mitsuba", theirs(file))):
            off = np.abs(image - 1.0)
            row = f"{image.mean():.5f} | {image.min():.3f} | {image.max():.3f} | {(off > 0.01).sum()} of {image.size}"
            print(f"| {normals} | {who} | {row} |")
            if who == "ours":
                wrong |= off.max() > 1e-5 if faceted else abs(image.mean() - 1.0) > 1e-3
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
