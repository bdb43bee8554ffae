"""Images of files as arrays, and the test of means."""

import math

import numpy as np
import OpenEXR
from PIL import Image


def grey_values(path):
    """Grey values of a TIFF, 16 bit."""
    with Image.open(path) as image:
        return np.array(image).astype(np.uint16)


def picture(path):
    """RGB of a PNG, 8 bit."""
    with Image.open(path) as image:
        return np.array(image.convert("RGB"))


def layers(path):
    """The channels of an EXR."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.array(channel.pixels) for name, channel in file.channels().items()}


def write_exr(path, **channels):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {name: np.ascontiguousarray(values) for name, values in channels.items()}).write(str(path))


def mean_and_variance(exr):
    """The mean of the green channel over the image, and the variance of this mean by the noise of the render.

    The samples of pixels are independent, so the variances of the means of the pixels add.
    """
    values, variance = exr["G"].astype(np.float64), exr["variance.G"].astype(np.float64)
    assert np.isfinite(variance).all(), "each pixel needs samples in two batches"
    return values.mean(), variance.sum() / values.size**2


def assert_equal_means(a, b, factor=1.0):
    """The mean of `a` is `factor` times that of `b`: a Z-test with a false-alarm rate of 1e-9 (|z| < 6.1)."""
    (mean_a, variance_a), (mean_b, variance_b) = mean_and_variance(a), mean_and_variance(b)
    z = (mean_a - factor * mean_b) / math.sqrt(variance_a + factor**2 * variance_b)
    assert abs(z) < 6.1, (z, mean_a, mean_b, factor)
    # The test can fail: it would find a difference of a tenth.
    assert 0.1 * mean_a > 6.1 * math.sqrt(variance_a + factor**2 * variance_b), "the noise is too large for the test"
