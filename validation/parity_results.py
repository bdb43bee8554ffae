"""The results of `parity.py`, kept case by case in `parity.csv`, so that some cases can be rendered again and the table be
written for all.

A row belongs to a case as it is described now: it bears the digest of the scene and of the number of samples, and a row
whose case has changed since is not shown but asked for again.
"""

from __future__ import annotations

import csv
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Iterable

from statistics_of_images import Comparison, verdict


@dataclass(frozen=True)
class Result:
    """A row: what `Comparison` found, in shares of one."""

    case: str
    key: str
    spp: int
    places: int
    share: float
    difference: float
    error: float
    worst_z: float
    rms_z: float

    @property
    def verdict(self) -> str:
        """`pass`, `FAILS` or `not converged`."""
        return verdict(self.share, self.difference, self.error)


def result(case: str, key: str, spp: int, found: Comparison) -> Result:
    """The row of a case, rounded as it is kept: a verdict is the same before and after."""
    numbers = {name: round(getattr(found, name), 6) for name in ("share", "difference", "error")}
    scores = {name: round(getattr(found, name), 2) for name in ("worst_z", "rms_z")}
    return Result(case, key, spp, found.places, **numbers, **scores)


def read(path: Path) -> dict[str, Result]:
    """All rows by the names of their cases; none if there is no file yet."""
    if not path.exists():
        return {}
    kinds = {"case": str, "key": str, "spp": int, "places": int}
    with path.open(newline="") as file:
        rows = [Result(**{name: kinds.get(name, float)(text) for name, text in row.items()}) for row in csv.DictReader(file)]
    return {row.case: row for row in rows}


def write(path: Path, rows: Iterable[Result]) -> None:
    """Rows in the order given."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Result)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)


def merged(
    old: dict[str, Result], new: Iterable[Result], wanted: dict[str, tuple[str, int]]
) -> tuple[list[Result], list[str]]:
    """The stored results of the cases in `wanted` (by name: digest and samples per pixel), in their order, and the names of those
    that nothing is known of: never rendered, or changed since."""
    known = {**old, **{row.case: row for row in new}}
    current = [known[name] for name, is_now in wanted.items() if name in known and (known[name].key, known[name].spp) == is_now]
    return current, [name for name in wanted if name not in {row.case for row in current}]
