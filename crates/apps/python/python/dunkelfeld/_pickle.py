"""Copies of films: `pickle`, `copy` and other processes."""

import copyreg
import os
import tempfile
from typing import Any

from ._native import Film


def _film_of(data: bytes, extras: Any) -> Film:
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "a.film")
        with open(path, "wb") as file:
            file.write(data)
        return Film._restore(path, extras)


def _reduce_film(film: Film) -> tuple[object, tuple[object, ...]]:
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "a.film")
        film.save(path)
        with open(path, "rb") as file:
            return _film_of, (file.read(), film._extras())


copyreg.pickle(Film, _reduce_film)  # type: ignore[arg-type]
