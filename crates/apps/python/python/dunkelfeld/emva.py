"""EMVA 1288: data sets of simulated cameras, and the analysis of data sets of any camera.

The options are those of `dunkelfeld emva`. Ctrl-C and an exception of `progress` end the work; then nothing is written.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from . import _native

if TYPE_CHECKING:
    from collections.abc import Callable
    from os import PathLike
    from typing import Literal, TypeAlias

    from ._native import Sensor
    from ._results import EmvaAnalysis, EmvaDataset

    Path: TypeAlias = str | PathLike[str]
    Progress: TypeAlias = Callable[[str, float, float, float | None], object]

__all__ = ["analyse", "dataset"]


def dataset(
    sensor: Sensor | Path,
    output: Path,
    *,
    levels: int | None = None,
    size: tuple[int, int] | None = None,
    wavelength: float | str | None = None,
    spatial: int | None = None,
    vary: Literal["exposure", "irradiance"] | None = None,
    exposure: float | None = None,
    bit_depth: int | None = None,
    color: Literal["red", "green", "blue"] | None = None,
    seed: int | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> EmvaDataset:
    """Takes the frames of an EMVA 1288 measurement with a simulated camera, and writes them as a data set.

    `output` is a folder that does not exist or is empty: it gets the descriptor `emva.txt`, frames as PNG, and
    `truth.json`. `levels` (default 50) are pairs of frames from dark to saturation; `size` is width and height [pixels]
    (640, 480); `wavelength` is in metres, or a text such as "545nm" (that of the highest quantum efficiency); `spatial` is the number of frames of
    each of the two stacks (16); `vary` is the quantity that changes from level to level ("exposure"); `exposure` is the
    longest exposure time [s] (0.1); `color` selects the pixels of a sensor with colour filters.

    Returns a dictionary: `descriptor` and `truth` (paths), `frames` (their number), `figures` (the content of
    `truth.json`; its `quantities` are the figures of the model by their symbols).

    Raises `SettingError` for a value out of range, `InputError` for an unknown sensor and for a folder that is not
    empty, `OutputError` for a file that cannot be written.
    """
    return _native.emva_dataset(
        sensor,
        output,
        levels=levels,
        size=size,
        wavelength=wavelength,
        spatial=spatial,
        vary=vary,
        exposure=exposure,
        bit_depth=bit_depth,
        color=color,
        seed=seed,
        threads=threads,
        progress=progress,
    )


def analyse(
    input: Path,
    *,
    release: Literal["4.0", "3.1"] = "4.0",
    general: bool = False,
    pixel_pitch: float | str | None = None,
    wavelength: float | str | None = None,
    sensor: Path | None = None,
    maps: bool = False,
    json: Path | None = None,
    html: Path | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> EmvaAnalysis:
    """Analyses a data set by EMVA 1288. `input` is the path of its descriptor.

    `release` of the standard defines saturation; `general` selects the module for cameras that are not linear;
    `pixel_pitch`, in metres or a text such as "3.45um", gives figures per area. `sensor` is the path of the sensor file to write, a TOML file; it needs
    `pixel_pitch` and `wavelength`, and `maps=True` writes maps of the pixels beside it. `json` and `html` are the paths of files with all results and of the
    report; without them no file is written.

    Returns a dictionary: `quantities` (by symbol: dictionaries with `value`, `standard_error`, `unit`, `name` and
    `section`; a value that is not finite is None), `notes` (differences from the standard), `figures` (all results and
    the numbers of the plots, as in the file `json`), `sensor` (the sensor file and its maps), `json` and `html` (paths or None).

    Raises `InputError` for a data set that cannot be analysed, `SettingError` for a value out of range, `OutputError`
    for a file that cannot be written.
    """
    return _native.emva_analyse(
        input,
        release=release,
        general=general,
        pixel_pitch=pixel_pitch,
        wavelength=wavelength,
        sensor=sensor,
        maps=maps,
        json=json,
        html=html,
        threads=threads,
        progress=progress,
    )
