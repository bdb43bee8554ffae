"""Dunkelfeld: a CPU path tracer with a built-in EMVA 1288 camera sensor.

Open a scene or a job, render it, and read the arrays::

    import dunkelfeld

    scene = dunkelfeld.Scene("station.toml")
    film = scene.render(spp=64, width=512, height=512)
    film.mean                              # float32, (height, width, 3), W/(m2 sr), linear Rec. 709
    film.expose("imx250", frames=10)       # uint16, (10, height, width), grey values [DN]

Arrays are row-major with row 0 at the top. Errors are subclasses of `DunkelfeldError` with the attributes `file`,
`place`, `problem` and `help`.
"""

from . import _pickle as _pickle
from . import dataset, emva
from ._job import (
    Camera,
    CameraKeys,
    LensKeys,
    Light,
    LightKeys,
    Material,
    MaterialKeys,
    Object,
    ObjectKeys,
)
from ._keys import FilmKeys, ImageKeys, RenderKeys, StudyKeys
from ._native import (
    NO_ID,
    DunkelfeldError,
    Film,
    InputError,
    Interrupted,
    NoiseMap,
    OutOfMemoryError,
    OutputError,
    Scene,
    SceneError,
    Sensor,
    SensorError,
    SettingError,
    __version__,
    bench,
    denoise_exr,
    denoise_radiance,
    expose_exr,
    expose_exr_files,
    expose_radiance,
    init_job,
    merge,
    ptc,
    sensors,
    station_job,
    stations,
)
from ._results import (
    EmvaAnalysis,
    EmvaDataset,
    ExposedFiles,
    Study,
    TracedConnection,
    TracedSample,
    TracedScattering,
    TracedVertex,
)
from ._steps import RenderStep, RenderSteps

__all__ = [
    "NO_ID",
    "Camera",
    "CameraKeys",
    "DunkelfeldError",
    "EmvaAnalysis",
    "EmvaDataset",
    "ExposedFiles",
    "Film",
    "FilmKeys",
    "ImageKeys",
    "InputError",
    "Interrupted",
    "LensKeys",
    "Light",
    "LightKeys",
    "Material",
    "MaterialKeys",
    "NoiseMap",
    "Object",
    "ObjectKeys",
    "OutOfMemoryError",
    "OutputError",
    "RenderKeys",
    "RenderStep",
    "RenderSteps",
    "Scene",
    "SceneError",
    "Sensor",
    "SensorError",
    "SettingError",
    "Study",
    "StudyKeys",
    "TracedConnection",
    "TracedSample",
    "TracedScattering",
    "TracedVertex",
    "__version__",
    "bench",
    "dataset",
    "denoise_exr",
    "denoise_radiance",
    "emva",
    "expose_exr",
    "expose_exr_files",
    "expose_radiance",
    "init_job",
    "merge",
    "ptc",
    "sensors",
    "station_job",
    "stations",
]
