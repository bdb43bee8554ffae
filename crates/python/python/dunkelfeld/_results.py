"""Types of the dictionaries that studies return."""

from __future__ import annotations

from typing import Any, TypedDict

__all__ = ["EmvaAnalysis", "EmvaDataset", "Study"]


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
