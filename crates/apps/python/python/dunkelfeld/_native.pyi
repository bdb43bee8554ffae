"""Types of the native module."""

import os
import pathlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

from ._keys import FilmKeys, ImageKeys, RenderKeys, StudyKeys
from ._results import EmvaAnalysis, EmvaDataset, ExposedFiles, SetSummary, TracedSample, Verified
from ._results import Study as _StudyResult
from ._steps import RenderSteps

__version__: str
NO_ID: int

_Path: TypeAlias = str | os.PathLike[str]
_Job: TypeAlias = str | Mapping[str, Any]
_Progress: TypeAlias = Callable[[str, float, float, float | None], object]

_Strategy: TypeAlias = Literal["uniform", "sobel", "sensor"]
_Denoiser: TypeAlias = Literal["off", "auto", "oidn", "builtin"]
_Extras: TypeAlias = tuple[str, bool, list[tuple[pathlib.Path, str]], pathlib.Path | None, int | None]

class DunkelfeldError(Exception):
    file: str | None
    place: str | None
    problem: str | None
    help: str | None

class InputError(DunkelfeldError): ...
class SettingError(DunkelfeldError): ...
class SceneError(DunkelfeldError): ...
class SensorError(DunkelfeldError): ...
class OutputError(DunkelfeldError): ...
class OutOfMemoryError(DunkelfeldError): ...

class Interrupted(KeyboardInterrupt):
    film: Film
    films: dict[str, Film]

@final
class Sensor:
    def __new__(cls, name: _Path) -> Sensor: ...
    @property
    def name(self) -> str: ...
    @property
    def bit_depth(self) -> int: ...
    @property
    def pixel_pitch(self) -> float: ...
    @property
    def resolution(self) -> tuple[int, int] | None: ...
    @property
    def saturation(self) -> float: ...
    @property
    def is_color(self) -> bool: ...
    def data_sheet(self) -> dict[str, Any]: ...

@final
class Film:
    @property
    def shape(self) -> tuple[int, int]: ...
    @property
    def mean(self) -> NDArray[np.float32]: ...
    @property
    def variance(self) -> NDArray[np.float32]: ...
    @property
    def spp(self) -> NDArray[np.uint32]: ...
    @property
    def plan(self) -> NDArray[np.uint32]: ...
    @property
    def object_ids(self) -> NDArray[np.uint32]: ...
    @property
    def material_ids(self) -> NDArray[np.uint32]: ...
    @property
    def object_names(self) -> list[str]: ...
    @property
    def material_names(self) -> list[str]: ...
    @property
    def depth(self) -> NDArray[np.float32]: ...
    @property
    def normal(self) -> NDArray[np.float32]: ...
    @property
    def albedo(self) -> NDArray[np.float32]: ...
    @property
    def first_light(self) -> NDArray[np.float32]: ...
    @property
    def rest(self) -> NDArray[np.float32]: ...
    @property
    def stats(self) -> dict[str, Any]: ...
    @property
    def interrupted(self) -> bool: ...
    def expose(
        self,
        sensor: Sensor | _Path | None = None,
        exposure: float | str | None = None,
        frames: int = 1,
        **keys: Unpack[FilmKeys],
    ) -> NDArray[np.uint16]: ...
    def picture(
        self,
        sensor: Sensor | _Path | None = None,
        exposure: float | str | None = None,
        **keys: Unpack[FilmKeys],
    ) -> NDArray[np.uint8]: ...
    def certificate(self, k: float = 1.0) -> dict[str, Any]: ...
    def noise_map(self, k: float = 1.0) -> NoiseMap: ...
    def denoise(
        self, method: Literal["auto", "oidn", "builtin"] = "auto", *, oidn: _Path | None = None
    ) -> NDArray[np.float32]: ...
    def save(self, path: _Path) -> None: ...
    def save_files(
        self,
        *,
        image: _Path | None = None,
        linear: _Path | None = None,
        exr: _Path | None = None,
        stats: _Path | None = None,
        plan: _Path | None = None,
    ) -> None: ...
    def save_image(self, path: _Path) -> None: ...
    def save_linear(self, path: _Path) -> None: ...
    def save_exr(self, path: _Path) -> None: ...
    def save_plan(self, path: _Path) -> None: ...
    def save_stats(self, path: _Path) -> None: ...
    @staticmethod
    def load(path: _Path) -> Film: ...
    def _repr_png_(self) -> bytes: ...
    def _extras(self) -> _Extras: ...
    @staticmethod
    def _restore(path: _Path, extras: _Extras) -> Film: ...

@final
class NoiseMap:
    @property
    def ratios(self) -> NDArray[np.float32]: ...
    @property
    def picture(self) -> NDArray[np.uint8]: ...
    @property
    def k(self) -> float: ...
    @property
    def hidden(self) -> float: ...
    @property
    def range(self) -> tuple[float, float]: ...
    @staticmethod
    def _restore(ratios: NDArray[np.float32], k: float, hidden: float) -> NoiseMap: ...
    def _repr_png_(self) -> bytes: ...
    def _repr_html_(self) -> str: ...

@final
class Scene:
    def __new__(cls, path: _Path, *, without: str | Sequence[str] | None = None, threads: int = 0) -> Scene: ...
    @staticmethod
    def from_job(
        job: _Job, folder: _Path | None = None, *, without: str | Sequence[str] | None = None, threads: int = 0
    ) -> Scene: ...
    def set_overrides(self, overrides: _Job | None = None, /, **keys: Any) -> None: ...
    def render(
        self,
        *,
        camera: str | None = None,
        threads: int | None = None,
        samples: tuple[int, int] | None = None,
        replay: Film | _Path | NDArray[np.uint32] | NDArray[np.int64] | None = None,
        checkpoint: _Path | None = None,
        checkpoint_every: float | None = None,
        progress: _Progress | None = None,
        **keys: Unpack[RenderKeys],
    ) -> Film: ...
    def render_captures(
        self,
        *,
        camera: str | None = None,
        threads: int | None = None,
        replay: Film | _Path | NDArray[np.uint32] | NDArray[np.int64] | None = None,
        progress: _Progress | None = None,
        **keys: Unpack[RenderKeys],
    ) -> dict[str, Film]: ...
    def render_steps(
        self,
        *,
        camera: str | None = None,
        threads: int | None = None,
        samples: tuple[int, int] | None = None,
        replay: Film | _Path | NDArray[np.uint32] | NDArray[np.int64] | None = None,
        checkpoint: _Path | None = None,
        checkpoint_every: float | None = None,
        **keys: Unpack[RenderKeys],
    ) -> RenderSteps: ...
    def trace_sample(
        self, x: int, y: int, sample: int, *, camera: str | None = None, **keys: Unpack[RenderKeys]
    ) -> TracedSample: ...
    def inspect(self) -> dict[str, Any]: ...
    @property
    def cameras(self) -> list[str]: ...
    @property
    def objects(self) -> list[str]: ...
    @property
    def materials(self) -> list[str]: ...
    @property
    def effects(self) -> list[str]: ...
    @property
    def without(self) -> list[str]: ...
    @property
    def hazards(self) -> list[str]: ...
    @property
    def inputs(self) -> list[pathlib.Path]: ...
    def _repr_html_(self) -> str: ...

@final
class Study:
    def __new__(cls, path: _Path) -> Study: ...
    @property
    def name(self) -> str: ...
    @property
    def count(self) -> int: ...
    @property
    def hash(self) -> str: ...
    @property
    def path(self) -> pathlib.Path: ...
    def run(
        self,
        folder: _Path,
        *,
        count: int | None = None,
        indices: Sequence[int] | None = None,
        jobs: int | None = None,
        threads: int | None = None,
        time: float | None = None,
        progress: Callable[[int, int, float, float | None], object] | None = None,
    ) -> SetSummary: ...
    def worker(self, threads: int = 1) -> StudyWorker: ...
    def open(self, folder: _Path, count: int | None = None) -> DataSet: ...

@final
class StudyWorker:
    def make(self, index: int, time: float | None = None) -> Made: ...
    def _start(
        self, folder: _Path, count: int | None, indices: Sequence[int] | None
    ) -> tuple[DataSet, int, list[int]]: ...
    def open(self, folder: _Path, count: int | None = None) -> DataSet: ...
    @property
    def is_timed(self) -> bool: ...
    @property
    def inputs(self) -> list[pathlib.Path]: ...
    @property
    def warnings(self) -> list[str]: ...

@final
class Made:
    @property
    def index(self) -> int: ...
    @property
    def record(self) -> dict[str, Any]: ...
    @property
    def files(self) -> dict[str, bytes]: ...
    @property
    def cost(self) -> dict[str, float]: ...
    @staticmethod
    def _restore(record: str, files: dict[str, bytes], cost: str) -> Made: ...

@final
class DataSet:
    def __new__(cls, folder: _Path) -> DataSet: ...
    @property
    def path(self) -> pathlib.Path: ...
    @property
    def count(self) -> int: ...
    def missing(self) -> list[int]: ...
    def is_finished(self, index: int) -> bool: ...
    def record(self, index: int) -> dict[str, Any]: ...
    def commit(self, made: Made, *, force: bool = False) -> bool: ...
    def assemble(self) -> None: ...
    def verify(self) -> Verified: ...

def sensors() -> list[str]: ...
def run_command(arguments: Sequence[str]) -> int: ...
def merge(
    paths: Sequence[_Path], threads: int = 0, *, checkpoint: _Path | None = None, memory: int | str | None = None
) -> Film: ...
def init_job(path: _Path, station: str | None = None, *, folder: _Path | None = None) -> str: ...
def stations() -> list[str]: ...
def station_job(name: str) -> str: ...
def expose_exr(
    path: _Path,
    sensor: Sensor | _Path | None = None,
    exposure: float | str | None = None,
    frames: int = 1,
    *,
    layer: str | None = None,
    threads: int | None = None,
    **keys: Unpack[ImageKeys],
) -> NDArray[np.uint16]: ...
def expose_exr_files(
    path: _Path,
    image: _Path | None = None,
    linear: _Path | None = None,
    *,
    sensor: Sensor | _Path | None = None,
    exposure: float | str | None = None,
    frames: int = 1,
    layer: str | None = None,
    threads: int | None = None,
    progress: _Progress | None = None,
    **keys: Unpack[ImageKeys],
) -> ExposedFiles: ...
def expose_radiance(
    radiance: ArrayLike,
    sensor: Sensor | _Path | None = None,
    exposure: float | str | None = None,
    frames: int = 1,
    *,
    threads: int | None = None,
    **keys: Unpack[ImageKeys],
) -> NDArray[np.uint16]: ...
def denoise_exr(
    path: _Path,
    output: _Path | None = None,
    *,
    denoise: _Denoiser | None = None,
    oidn: _Path | None = None,
    memory: int | str | None = None,
    threads: int | None = None,
    progress: _Progress | None = None,
) -> NDArray[np.float32]: ...
def denoise_radiance(
    radiance: ArrayLike,
    *,
    variance: ArrayLike | None = None,
    first_light: ArrayLike | None = None,
    albedo: ArrayLike | None = None,
    normal: ArrayLike | None = None,
    depth: ArrayLike | None = None,
    denoise: _Denoiser | None = None,
    oidn: _Path | None = None,
    memory: int | str | None = None,
    threads: int | None = None,
    progress: _Progress | None = None,
) -> NDArray[np.float32]: ...
def read_image(path: _Path) -> NDArray[Any]: ...
def job_keys(table: str) -> list[str]: ...
def check_job_keys(table: str, keys: list[str], required: list[str]) -> None: ...
def bench(
    input: Scene | _Path,
    output: _Path | None = None,
    *,
    quick: bool = False,
    restart: bool = False,
    spp: Sequence[int] | None = None,
    seeds: int | None = None,
    strategies: _Strategy | Sequence[_Strategy] | None = None,
    noise: Sequence[float] | None = None,
    effects: str | Sequence[str] | None = None,
    denoise: _Denoiser | Sequence[_Denoiser] | None = None,
    oidn: _Path | None = None,
    effect_spp: int | None = None,
    reference_spp: int | None = None,
    camera: str | None = None,
    threads: int | None = None,
    progress: _Progress | None = None,
    **keys: Unpack[StudyKeys],
) -> _StudyResult: ...
def ptc(
    input: Scene | _Path | Sequence[_Path],
    output: _Path | None = None,
    *,
    restart: bool = False,
    frames: int | None = None,
    spp: Sequence[int] | None = None,
    denoise: _Denoiser | None = None,
    oidn: _Path | None = None,
    edges: float | None = None,
    pictures_only: bool = False,
    dark: float | None = None,
    saturation: float | None = None,
    camera: str | None = None,
    threads: int | None = None,
    progress: _Progress | None = None,
    **keys: Unpack[StudyKeys],
) -> _StudyResult: ...
def emva_dataset(
    sensor: Sensor | _Path,
    output: _Path,
    *,
    levels: int | None = None,
    size: tuple[int, int] | None = None,
    wavelength: float | str | None = None,
    spatial: int | None = None,
    vary: str | None = None,
    exposure: float | None = None,
    bit_depth: int | None = None,
    color: str | None = None,
    seed: int | None = None,
    threads: int | None = None,
    progress: _Progress | None = None,
) -> EmvaDataset: ...
def emva_analyse(
    input: _Path,
    *,
    release: str = "4.0",
    general: bool = False,
    pixel_pitch: float | str | None = None,
    wavelength: float | str | None = None,
    sensor: _Path | None = None,
    maps: bool = False,
    json: _Path | None = None,
    html: _Path | None = None,
    threads: int | None = None,
    progress: _Progress | None = None,
) -> EmvaAnalysis: ...
