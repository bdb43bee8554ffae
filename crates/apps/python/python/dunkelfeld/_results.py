"""Types of the dictionaries that studies return."""

from __future__ import annotations

from typing import Any, TypedDict

__all__ = [
    "EmvaAnalysis",
    "EmvaDataset",
    "ExposedFiles",
    "SetSummary",
    "Study",
    "TracedConnection",
    "TracedSample",
    "TracedScattering",
    "TracedVertex",
    "Verified",
]


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
    price: dict[str, Any] | None
    """The price of the whole set: `measured` and `count` (images), `images_per_hour`, `levels`. None if no image was made."""


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


class ExposedFiles(TypedDict):
    """The result of `expose_exr_files`."""

    files: list[str]
    """The files in their order."""
    frames: int
    """Number of written frames."""
    exposure: float
    """Exposure time [s]."""
    no_light: bool
    """Is the image so dark that no automatic exposure exists?"""
    saturated: float
    """Share of the pixels that are saturated."""
    matched: float | None
    """Share of the pixels where matched exposure can hold; None for plain noise."""
    invalid: int
    """Pixels whose radiance was negative or not a number (they count as black) or infinite (they saturate)."""
    invalid_variances: int
    """Pixels whose variance was negative or not a number."""


class TracedConnection(TypedDict):
    """A connection to a light through a cover."""

    chain: str
    """The events at the interfaces, from the vertex to the light."""
    cover: int
    """Index of the cover in the list of the scene."""
    probability: float
    """Probability with which the chain was chosen."""
    rays: int
    """Rays that were traced through the cover."""
    has_converged: bool
    """Did the solver find the chain?"""
    mis_weight: float
    """Weight by the power heuristic; 0 where no light comes through."""
    contribution: list[float]
    """Radiance that was added [W/(m2 sr)]."""


class TracedScattering(TypedDict):
    """A sampled direction."""

    direction: list[float]
    """Unit vector in world space."""
    lobe: str
    """The lobe, as in "delta transmission"; "phase function" in a medium."""
    pdf: float | None
    """Density [1/sr]; of a delta lobe its probability."""
    weight: list[float]
    """Scattered radiance over the density."""


class TracedVertex(TypedDict):
    """A vertex of `Scene.trace_sample`."""

    before: int | None
    """Index of the vertex before it; None for the first. Where the path was split, several have the same."""
    material: str | None
    """Name of the material; None where the ray left the scene."""
    position: list[float] | None
    """Position in world space [m]; None where the ray left the scene."""
    left_toward: list[float] | None
    """Direction in which the ray left the scene."""
    in_medium: bool
    """Is the vertex inside a medium, not on a surface?"""
    throughput: list[float]
    """Throughput of the path before the vertex."""
    emitted: list[float]
    """Emission that was added [W/(m2 sr)]."""
    direct: list[float]
    """Light of next-event estimation that was added [W/(m2 sr)]."""
    connections: list[TracedConnection]
    """Attempted connections through covers."""
    scattered: TracedScattering | None
    """The direction in which the path continued; None where it ended."""


class TracedSample(TypedDict):
    """The result of `Scene.trace_sample`."""

    radiance: list[float | None]
    """Radiance of the sample [W/(m2 sr)], linear Rec. 709; None where it is not finite."""
    is_valid: bool
    """Is it finite, not negative, and in the range of a film?"""
    vertices: list[TracedVertex]
    """The vertices in order, starting at the camera."""
