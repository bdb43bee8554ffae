"""Renders one of our scenes with Mitsuba for viewing and for a reference of the speed.

    python render_mitsuba.py ../scenes/inspection/inspection-open.glb --spp 256 -o open.png
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np


def to_8_bit(image: np.ndarray) -> np.ndarray:
    """The paper's 8-bit image, gamma 2.2, exposed so that the 99.5 % quantile comes to 90 % of saturation."""
    exposed = 0.9 * image / max(float(np.quantile(image, 0.995)), 1e-30)
    return np.round(255.0 * np.clip(exposed, 0.0, 1.0) ** (1.0 / 2.2)).astype(np.uint8)


def main() -> None:
    """Parses the arguments, renders in chunks, prints samples per second, writes a PNG."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--chunk", type=int, default=64, help="samples per pixel and kernel launch")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--without", nargs="*", default=[], metavar="NODE", help="nodes to leave out")
    parser.add_argument("--shrink", type=int, default=1, help="average blocks of this many pixels for the PNG")
    arguments = parser.parse_args()

    import mitsuba as mi
    from PIL import Image

    mi.set_variant(arguments.variant)
    import mitsuba_scene

    scene = mitsuba_scene.load(
        arguments.scene, arguments.size, arguments.size, without=frozenset(arguments.without)
    )
    np.array(mi.render(scene, spp=1, seed=0))  # compiles the kernel
    chunk = min(arguments.chunk, arguments.spp)
    chunks = -(-arguments.spp // chunk)
    start = time.perf_counter()
    total = sum(np.array(mi.render(scene, spp=chunk, seed=1 + k), dtype=np.float64) for k in range(chunks))
    seconds = time.perf_counter() - start
    samples = chunks * chunk * arguments.size**2
    print(f"{samples / seconds / 1e6:.2f} M samples/s ({chunks * chunk} spp in {seconds:.1f} s, {arguments.variant})")

    image = total / chunks
    side = arguments.size // arguments.shrink
    image = image.reshape(side, arguments.shrink, side, arguments.shrink, 3).mean(axis=(1, 3))
    Image.fromarray(to_8_bit(image)).save(arguments.output)


if __name__ == "__main__":
    main()
