"""Types of the dictionaries that studies return."""

from __future__ import annotations

from typing import Any, TypedDict

__all__ = ["EmvaAnalysis", "EmvaDataset", "Forecast", "SetSummary", "Study", "Verified"]


class Study(TypedDict):
    """The result of `bench` and `ptc`."""

    folder: str
    """The folder of the report."""
    report: str | None
    """The page of the report; None if there are too few renders for one."""
    files: list[str]
    """All files of the report, the page first."""
    findings: list[str]
    """The findings, as sentences."""
    figures: dict[str, list[dict[str, Any]]]
    """The rows of the tables by their name, with the keys of the CSV; None where a number is unknown."""
    finished: int
    """Number of finished renders."""
    renders: int
    """Number of all renders."""
    invalid_samples: int
    """Samples that were not finite, negative or out of range."""


class EmvaDataset(TypedDict):
    """The result of `emva.dataset`."""

    descriptor: str
    """Path of the descriptor."""
    truth: str
    """Path of `truth.json`."""
    frames: int
    """Number of frames."""
    figures: dict[str, Any]
    """The content of `truth.json`."""


class EmvaAnalysis(TypedDict):
    """The result of `emva.analyse`."""

    quantities: dict[str, dict[str, Any]]
    """By symbol: dictionaries with `value`, `standard_error`, `unit`, `name` and `section`."""
    notes: list[str]
    """Differences of the data set from the standard."""
    figures: dict[str, Any]
    """All results, and the numbers of the plots."""
    json: str | None
    """Path of the file with the results."""
    html: str | None
    """Path of the report."""


class Forecast(TypedDict):
    """The forecast of a run with a time."""

    images: int
    """Number of test images: 3, or 1 with less than 12 missing images."""
    seconds: float
    """Seconds for the samples of an image."""
    levels: list[float]
    """For each measured image with a sensor, the k at which 99 % of its unsaturated pixels are hidden."""


class SetSummary(TypedDict):
    """The result of `Study.run`."""

    made: int
    """Images that this run made."""
    finished: int
    """Images of the set that are finished."""
    count: int
    """Images of the set."""
    seconds: float
    """Wall-clock time [s]."""
    failed: list[tuple[int, str]]
    """Index and message of each image whose draws do not fit."""
    forecast: Forecast | None
    """None without `time`, and if no test image was made."""


class Verified(TypedDict):
    """The result of `DataSet.verify`."""

    is_whole: bool
    """Are all images finished, and without a fault?"""
    count: int
    """Images of the set."""
    finished: int
    """Images that are finished."""
    files: int
    """Files that were compared with their hashes."""
    annotations: int
    """Annotations that were compared with the masks."""
    faults: list[str]
    """The first faults, with their files."""
    more: int
    """Number of faults that are not listed."""
