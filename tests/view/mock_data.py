"""The scene and the camera of the synthetic view."""

import numpy as np

SENSORS = [
    {
        "name": "imx250",
        "label": "as in the job (imx250)",
        "bits": 12,
        "colour": False,
        "saturation": 10500,
        "dark_noise": 2.3,
        "pixel": 3.45,
        "temperature": 35.0,
    },
    {
        "name": "imx250-8bit",
        "label": "imx250-8bit",
        "bits": 8,
        "colour": False,
        "saturation": 10500,
        "dark_noise": 2.3,
        "pixel": 3.45,
        "temperature": 35.0,
    },
    {
        "name": "imx264-colour",
        "label": "imx264-colour",
        "bits": 8,
        "colour": True,
        "saturation": 10600,
        "dark_noise": 2.4,
        "pixel": 3.45,
        "temperature": 35.0,
    },
    {
        "name": "ccd-icx285",
        "label": "ccd-icx285",
        "bits": 12,
        "colour": False,
        "saturation": 18000,
        "dark_noise": 8.1,
        "pixel": 6.45,
        "temperature": 25.0,
    },
]
LIGHTS = [("ring light", "area", "0.25 W"), ("bar left", "area", "0.1 W"), ("room", "environment", "2 W/m²")]
MATERIALS = [
    {"name": "anodised aluminium", "roughness": 0.35, "metallic": 1.0, "color": [0.52, 0.52, 0.55]},
    {"name": "PMMA cover <clear>", "roughness": 0.02, "metallic": None, "color": [0.9, 0.92, 0.95]},
    {"name": "solder mask", "roughness": 0.45, "metallic": 0.0, "color": [0.02, 0.18, 0.06]},
    {"name": "label paper", "roughness": None, "metallic": None, "color": None},
]
EFFECTS = [
    ("covers", "light through covers", True),
    ("finite-aperture", "finite aperture", True),
    ("scattering", "scattering", False),
    ("every-light", "every light", True),
]
CAMERA_KEYS = {
    "sensor",
    "exposure",
    "gain",
    "temperature",
    "black_level",
    "noise",
    "device",
    "denoise",
    "vignetting",
    "f_number",
    "glare",
    "lights",
}
JOB_CAMERA = {
    "sensor": "imx250",
    "exposure": None,
    "gain": 1.0,
    "temperature": None,
    "black_level": None,
    "noise": "matched",
    "device": 1,
    "denoise": "off",
    "vignetting": True,
    "f_number": None,
    "glare": None,
    "lights": None,
}
RANGES = {
    "exposure": [1e-5, 1.0],
    "gain": [0.1, 16.0],
    "temperature": [-20, 80],
    "f_number": [0.5, 1000],
    "glare": [0, 0.5],
}
# Colours of a Bayer pattern, by row and column.
BAYER = [["red", "green"], ["green", "blue"]]
# The most samples per pixel of a view, and those of its pilot.
MAX_SPP, PILOT = 65536, 32
MAPS = {"ratio", "samples", "recent", "first_light", "render_sigma", "camera_sigma"}
K_START = 3.4  # k99 after one second


def make_scene(width, height):
    """Radiance of a lit panel with screws, a slot and a scratch; ids of the objects; noise shape."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    u, v = x / width - 0.5, y / height - 0.5
    aspect = height / width
    light = 0.75 * np.exp(-((u - 0.12) ** 2 + (v * aspect + 0.06) ** 2) / 0.14) + 0.06
    radiance = light * (0.5 + 0.02 * np.sin(y * 0.9))
    objects = np.ones((height, width), np.int32)
    noise = 0.4 + 0.3 * np.abs(u)
    frame = (np.abs(u) > 0.44) | (np.abs(v) > 0.43)
    radiance[frame], objects[frame], noise[frame] = light[frame] * 0.08, 0, 0.5
    for cx, cy in [(-0.36, -0.34), (0.36, -0.34), (-0.36, 0.34), (0.36, 0.34)]:
        d = np.hypot(u - cx, (v - cy) * aspect)
        screw = d < 0.035
        radiance[screw] = light[screw] * (0.55 + 0.4 * np.cos(d[screw] * 260) ** 2)
        slot = screw & (np.abs((u - cx) - (v - cy) * aspect) < 0.007)
        radiance[slot] = 0.02
        objects[screw], noise[screw] = 2, 1.3
    cover = (np.abs(u - 0.05) < 0.17) & (np.abs(v) < 0.2)
    radiance[cover] = radiance[cover] * 0.55 + 0.05 * np.exp(-(((u - 0.1) / 0.03) ** 2))[cover]
    objects[cover], noise[cover] = 3, 1.0
    edge = cover & ((np.abs(np.abs(u - 0.05) - 0.17) < 0.006) | (np.abs(np.abs(v) - 0.2) < 0.008))
    radiance[edge] *= 2.1
    noise[edge] = 2.0
    scratch = (np.abs(v - 0.32 - 0.3 * u) < 0.003) & (np.abs(u) < 0.3)
    radiance[scratch] *= 1.5
    caustic = 0.25 * np.exp(-((u + 0.25) ** 2 + (v * aspect - 0.1) ** 2) / 0.0015)
    radiance += caustic
    noise += 4 * caustic
    return radiance, objects, noise
