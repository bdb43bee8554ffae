"""Keywords that are keys of a job. Made by tests/facade/keys.rs."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Literal, TypedDict

if TYPE_CHECKING:
    from ._native import Sensor


class RenderKeys(TypedDict, total=False):
    """Keywords of a render."""

    width: int | None
    height: int | None
    time: float | str | None
    spp: float | None
    noise: float | None
    share: float | None
    memory: int | str | None
    strategy: Literal["uniform", "sobel", "sensor"] | None
    sensor: Sensor | str | os.PathLike[str] | None
    exposure: float | str | None
    exposure_noise: Literal["plain", "matched"] | None
    vignetting: Literal["none", "cos4"] | None
    denoise: Literal["off", "auto", "oidn", "builtin"] | None
    oidn: str | os.PathLike[str] | None
    seed: int | None
    frame: int | None


class StudyKeys(TypedDict, total=False):
    """Keywords of a study."""

    width: int | None
    height: int | None
    memory: int | str | None
    sensor: Sensor | str | os.PathLike[str] | None
    exposure: float | str | None
    seed: int | None


class ImageKeys(TypedDict, total=False):
    """Keywords of the exposure of an image."""

    memory: int | str | None
    exposure_noise: Literal["plain", "matched"] | None
    f_number: float | None
    transmission: float | None
    magnification: float | None
    psf: str | os.PathLike[str] | None
    glare: float | None
    focal_length: float | str | None
    vignetting: Literal["none", "cos4"] | None
    seed: int | None
    frame: int | None


class FilmKeys(TypedDict, total=False):
    """Keywords of the exposure of a film."""

    exposure_noise: Literal["plain", "matched"] | None
    seed: int | None
    frame: int | None
