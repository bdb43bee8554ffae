"""Are two images the same but for noise? Welch's (1947) test, pixel by pixel and for the mean.

Both images come as independent batches, so that each pixel's mean has a variance with known degrees of freedom. With a few
dozen batches the ratio of a difference to its standard error is not yet normal; Student's distribution knows by how much,
and a Z-score here is the normal deviate of the same probability.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

# A family of pixels may fail by chance at this rate.
FAMILY_RATE = 0.01
# Images pass if this share of their pixels does, and if their means agree to this.
PASS_SHARE = 0.9975
MEAN_BAR = 0.003
# A mean with a larger standard error cannot prove 0.3 %.
ERROR_BAR = 0.0015
# A place is judged by itself if both images know it to this, one standard error: light that is never negative then comes from
# as much as 400 equal events, and the means of its batches are close to normal.
KNOWN = 0.05
# Both renderers add and shade in single precision: what two values without noise may differ by, in relative terms.
ROUNDING = 2e-5


@dataclass(frozen=True)
class Estimate:
    """Batches of images: (batch, row, column, channel)."""

    batches: np.ndarray
    spp: int

    @property
    def mean(self) -> np.ndarray:
        """Per pixel and channel."""
        return self.batches.mean(axis=0)

    @property
    def variance(self) -> np.ndarray:
        """Of the mean, per pixel and channel."""
        return self.batches.var(axis=0, ddof=1) / len(self.batches)

    def image_mean(self) -> tuple[float, float]:
        """Mean over pixels and channels with its variance, from the scatter of the batches' means."""
        means = self.batches.mean(axis=(1, 2, 3))
        return float(means.mean()), float(means.var(ddof=1) / len(means))

    def halved(self) -> Estimate:
        """At half the resolution: the mean over two by two pixels is what a pixel twice as wide sees."""
        b, h, w, c = self.batches.shape
        return Estimate(self.batches.reshape(b, h // 2, 2, w // 2, 2, c).mean(axis=(2, 4)), 4 * self.spp)


@dataclass(frozen=True)
class Comparison:
    """The outcome of one case."""

    # Pixels, or larger squares where samples are too few, and the share of the pixels that pass.
    places: int
    share: float
    # Relative difference of the means and its standard error.
    difference: float
    error: float
    worst_z: float
    # Root mean square of all scores: 1 if the images differ by noise alone.
    rms_z: float
    # Score per pixel, of the worst channel, with its sign.
    map: np.ndarray


def verdict(share: float, difference: float, error: float) -> str:
    """`pass`, `FAILS`, or `not converged` where noise could hide a failure."""
    if share < PASS_SHARE or abs(difference) > max(MEAN_BAR, 3.0 * error):
        return "FAILS"
    good = abs(difference) <= MEAN_BAR and error <= ERROR_BAR and share >= PASS_SHARE
    return "pass" if good else "not converged"


def sidak(rate: float, count: int) -> float:
    """The rate for each of `count` tests so that any of them fails with probability `rate` (Sidak 1967)."""
    return -np.expm1(np.log1p(-rate) / count)


def two_sided_t(t: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """P(|T| > |t|) for Student's T: the regularised incomplete beta function I_x(freedom / 2, 1 / 2) at
    x = freedom / (freedom + t^2), by its continued fraction (Abramowitz and Stegun 1964, 26.5.8)."""
    a, b = 0.5 * np.asarray(freedom, dtype=float), 0.5
    x = freedom / (freedom + np.square(t))
    swap = x > (a + 1.0) / (a + b + 2.0)
    p, q, y = np.where(swap, b, a), np.where(swap, a, b), np.where(swap, 1.0 - x, x)
    log_beta = _log_gamma(p) + _log_gamma(q) - _log_gamma(p + q)
    with np.errstate(divide="ignore", under="ignore"):
        front = np.exp(p * np.log(y) + q * np.log1p(-y) - log_beta) / p
    # Modified Lentz (Thompson and Barnett 1986).
    c = np.ones_like(y)
    d = 1.0 / (1.0 - (p + q) * y / (p + 1.0))
    h = d.copy()
    for m in range(1, 200):
        for numerator in (
            m * (q - m) * y / ((p + 2 * m - 1.0) * (p + 2 * m)),
            -(p + m) * (p + q + m) * y / ((p + 2 * m) * (p + 2 * m + 1.0)),
        ):
            d = 1.0 / (1.0 + numerator * d)
            c = 1.0 + numerator / c
            h *= d * c
    tail = front * h
    return np.where(swap, 1.0 - tail, tail)


def _log_gamma(x: np.ndarray) -> np.ndarray:
    """Stirling's series after shifting the argument by 8: good to 1e-14."""
    shift = sum(np.log(x + k) for k in range(8))
    z = x + 8.0
    series = 1.0 / (12 * z) - 1.0 / (360 * z**3) + 1.0 / (1260 * z**5) - 1.0 / (1680 * z**7)
    return (z - 0.5) * np.log(z) - z + 0.5 * np.log(2.0 * np.pi) + series - shift


def places(a: Estimate, b: Estimate) -> np.ndarray:
    """Where the images are judged: a number for each pixel, the same for all pixels of a place.

    A pixel that either image does not know to `KNOWN` in all channels is judged together with the square of two by two
    pixels that it lies in (squares lie side by side), and if that is not known, with one of four by four, and so on. Where
    rare samples hold the light, a pixel whose batches missed them has a small variance along with a small mean, and its
    score proves nothing; what its neighbours met keeps it from being judged without them."""
    height, width = a.batches.shape[1:3]
    pixels = np.arange(height * width).reshape(height, width)
    labels = pixels.copy()
    unknown = ~(_known(a, 1) & _known(b, 1))
    size = 1
    while unknown.any() and height % (2 * size) == 0 and width % (2 * size) == 0:
        size *= 2
        first = pixels[::size, ::size]
        mixed = unknown.reshape(height // size, size, width // size, size).any(axis=(1, 3))
        spread = lambda values: values.repeat(size, axis=0).repeat(size, axis=1)
        labels = np.where(spread(mixed), spread(first), labels)
        unknown = spread(mixed & ~(_known(a, size) & _known(b, size)))
    return np.unique(labels, return_inverse=True)[1].reshape(height, width)


def _known(image: Estimate, size: int) -> np.ndarray:
    """Which squares of an image have means that are known to `KNOWN` in all channels?"""
    b, h, w, c = image.batches.shape
    means = image.batches.reshape(b, h // size, size, w // size, size, c).mean(axis=(2, 4))
    return (means.std(axis=0, ddof=1) <= KNOWN * np.sqrt(b) * means.mean(axis=0)).all(axis=-1)


def averaged(image: Estimate, labels: np.ndarray) -> Estimate:
    """Every pixel with the mean of its place."""
    b, h, w, c = image.batches.shape
    flat, place = image.batches.reshape(b, h * w, c), labels.ravel()
    sums = np.zeros((b, place.max() + 1, c))
    np.add.at(sums, (slice(None), place), flat)
    means = sums / np.bincount(place)[None, :, None]
    return Estimate(means[:, place].reshape(b, h, w, c), image.spp)


def compare(a: Estimate, b: Estimate) -> Comparison:
    """Tests two images of one scene against each other, place by place. A pixel passes if all channels of its place do at
    the level 1 - (1 - FAMILY_RATE)^(1 / (3 pixels))."""
    labels = places(a, b)
    (ma, ea), (mb, eb) = a.image_mean(), b.image_mean()
    a, b = averaged(a, labels), averaged(b, labels)
    va, vb = a.variance, b.variance
    rounding = ROUNDING * np.maximum(a.mean, b.mean)
    error = np.sqrt(va + vb + rounding**2)
    difference = a.mean - b.mean
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.where(difference == 0.0, 0.0, difference / error)
        freedom = (va + vb) ** 2 / (va**2 / (len(a.batches) - 1) + vb**2 / (len(b.batches) - 1))
    # Where noise is below rounding, the error is practically exact.
    freedom = np.where(np.isfinite(freedom) & (va + vb > rounding**2), freedom, 1e6)
    p = two_sided_t(t, freedom)
    pixels = t[..., 0].size
    failed = (p < sidak(FAMILY_RATE, 3 * pixels)).any(axis=-1)
    normal = NormalDist()
    to_z = np.vectorize(lambda q: -normal.inv_cdf(max(float(q), 1e-300) / 2.0))
    worst = np.argmin(p, axis=-1)[..., None]
    scores = np.copysign(to_z(np.take_along_axis(p, worst, -1)[..., 0]), np.take_along_axis(t, worst, -1)[..., 0])
    return Comparison(
        places=int(labels.max()) + 1,
        share=1.0 - float(failed.mean()),
        difference=(ma - mb) / mb,
        error=float(np.sqrt(ea + eb + (ROUNDING * mb) ** 2)) / mb,
        worst_z=float(scores.flat[np.argmax(np.abs(scores))]),
        rms_z=float(np.sqrt(np.mean(t**2 * (freedom - 2.0) / freedom))),
        map=scores,
    )
