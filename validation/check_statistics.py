"""Error rates of the test of `statistics_of_images.py` where rare samples carry the light: a simulation without a renderer.

    python check_statistics.py

Pixels of the covered film as both renderers see them at 2048 samples in 32 batches: a little smooth light, and events, few and
bright for one renderer, more and dimmer for the other, with the same mean; a fifth of the image has a thousand times as many. Prints
how many of the images would fail, judged pixel by pixel and by places, when there is no difference, and how many when one renderer
loses some of the light that is rare; at 16 times the samples too. Exits with 1 if equal images fail oftener than the family rate
allows, or a loss of a fifth at 16 times the samples goes unseen.
"""

from __future__ import annotations

import sys

import numpy as np

import statistics_of_images
from statistics_of_images import FAMILY_RATE, PASS_SHARE, Estimate, compare

SIZE, BATCHES, IMAGES = 32, 32, 40
# Events of a pixel at 2048 samples and the share of the light that they carry, about as in renders of `inspection`: roulette
# makes ours as bright as the lights (20 W/(m^2 sr)) and as rare, Mitsuba's are 3 W/(m^2 sr).
EVENTS, SHARE = {"ours": 2.9, "Mitsuba": 20.0}, 0.96


def image(rng: np.random.Generator, events: float, samples: float, loss: float) -> Estimate:
    """Batches of a grey image of mean 1, with `samples` times 2048 samples per pixel."""
    shape = (BATCHES, SIZE, SIZE)
    # Some pixels are met oftener than others, by a gamma distribution of shape 2, the same for both renderers.
    often = np.random.default_rng(7).gamma(2.0, 0.5, shape[1:])
    per_batch = np.full(shape, events * samples / BATCHES) * often
    rare = np.ones(shape[1:])
    per_batch[..., : SIZE // 5] *= 1e3
    rare[:, : SIZE // 5] = 0.0
    met = rng.poisson(per_batch) / per_batch
    smooth = 1.0 + 0.5 * rng.standard_normal(shape) / np.sqrt(samples)
    batches = (1.0 - loss * rare) * (SHARE * met + (1.0 - SHARE) * smooth)
    return Estimate(np.repeat(batches[..., None], 3, axis=-1), round(2048 * samples))


def failures(rng: np.random.Generator, samples: float, loss: float, known: float) -> int:
    """Of `IMAGES` pairs, how many have too many pixels that fail; `known` as `statistics_of_images.KNOWN`."""
    kept, statistics_of_images.KNOWN = statistics_of_images.KNOWN, known
    pairs = ((image(rng, EVENTS["ours"], samples, loss), image(rng, EVENTS["Mitsuba"], samples, 0.0)) for _ in range(IMAGES))
    count = sum(compare(*pair).share < PASS_SHARE for pair in pairs)
    statistics_of_images.KNOWN = kept
    return count


def main() -> int:
    """Prints the table; 1 if a rate is too large."""
    rng = np.random.default_rng(1)
    print("| samples | light lost | fail, pixel by pixel | fail, by places |\n|---:|---:|---:|---:|")
    broken = False
    for samples in (1.0, 16.0):
        for loss in (0.0, 0.1, 0.2):
            alone = failures(rng, samples, loss, np.inf)
            together = failures(rng, samples, loss, statistics_of_images.KNOWN)
            print(f"| {2048 * samples:.0f} | {loss:.0%} | {alone} of {IMAGES} | {together} of {IMAGES} |")
            # More than one of so few at a rate of 1 % each would happen once in sixteen runs, more than two once in a hundred.
            broken |= loss == 0.0 and together > max(2.0, 3.0 * FAMILY_RATE * IMAGES)
            broken |= samples > 1.0 and loss > 0.1 and together < IMAGES
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
