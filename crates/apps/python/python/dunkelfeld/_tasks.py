"""Functions that workers of Dask run, and the files that they need."""

from __future__ import annotations

import ctypes
import hashlib
import os
import sys
import tempfile
import threading
import zlib
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ._attempts import dask, setting
from ._native import DataSet, DunkelfeldError, Made, Scene, Study, StudyWorker, __version__, merge

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

__all__ = ["Source", "file_of", "make_image", "merge_parts", "render_part", "shipped"]

_Path: TypeAlias = str | os.PathLike[str]


@dataclass(frozen=True)
class Source:
    """A study or a job, for workers."""

    path: str
    """The path on the client; with `variable` the path below the folder of the sent files."""
    fingerprint: str
    """Hash of the version, of the study, and of the contents of all files."""
    variable: str | None
    """Name of the variable of Dask that has the files."""
    places: tuple[str, str] = ("", "")
    """The path on the client as it was given, and the folder of the sent files there."""


@contextmanager
def shipped(
    client: Any, path: Path, hash: str, inputs: list[Path], files: Iterable[_Path], ship: bool
) -> Iterator[Source]:
    """The source of a study or job for the workers. The scheduler holds the sent files until the end."""
    fingerprint = _fingerprint(hash, inputs)
    if not ship:
        yield Source(str(path), fingerprint, None)
        return
    names = [os.path.abspath(name) for name in inputs if name.is_file()]
    for name in map(os.path.abspath, files):
        if not os.path.isfile(name):
            raise setting("files", f"{name} is no file", "pass paths of files")
        names.append(name)
    # All files are at their places relative to each other.
    root = os.path.commonpath([os.path.dirname(name) for name in (*names, os.path.abspath(path))])
    content = {Path(os.path.relpath(name, root)).as_posix(): Path(name).read_bytes() for name in names}
    # A worker fetches the files from the scheduler itself, so that no other worker can delay it.
    variable = dask().Variable(f"dunkelfeld-{fingerprint}-{os.urandom(4).hex()}", client=client)
    variable.set(content)
    try:
        below = Path(os.path.relpath(path, root)).as_posix()
        yield Source(below, fingerprint, variable.name, (str(path), root))
    finally:
        variable.delete()


def _fingerprint(hash: str, inputs: Iterable[Path]) -> str:
    """A hash of contents: neither the paths nor the order of the files have an effect."""
    files = set()
    for path in inputs:
        if path.is_file():
            digest = hashlib.blake2b()
            with path.open("rb") as file:
                while block := file.read(1 << 20):
                    digest.update(block)
            files.add(digest.digest())
    whole = hashlib.blake2b(f"{__version__} {hash}".encode(), digest_size=16)
    for one in sorted(files):
        whole.update(one)
    return whole.hexdigest()


_lock = threading.Lock()
# Folders of sent files, and loaded scenes that no task uses, by fingerprint (and threads). A process keeps both.
_folders: dict[str, Path] = {}
_idle: dict[tuple[str, int], list[Any]] = {}


def _path_of(source: Source) -> Path:
    """The path of the study or job on this worker. The first task of the process unpacks the sent files."""
    if source.variable is None:
        return Path(source.path)
    with _lock:
        folder = _folders.get(source.fingerprint)
        if folder is None:
            # The time limit is for a variable that does not exist: the call that needs this task has ended.
            content = dask().Variable(source.variable, client=dask().get_client()).get(timeout=10)
            folder = Path(tempfile.mkdtemp(prefix="dunkelfeld-", dir=dask().get_worker().local_directory))
            for name, data in content.items():
                place = folder / name
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(data)
            _folders[source.fingerprint] = folder
    return folder / source.path


@contextmanager
def _named(source: Source) -> Iterator[None]:
    """Errors name the files of the client instead of the copies on this worker."""
    try:
        yield
    except DunkelfeldError as error:
        folder = _folders.get(source.fingerprint)
        if folder is None or source.variable is None:
            raise
        given, root = source.places

        def original(text: str) -> str:
            return text.replace(str(folder / source.path), given).replace(str(folder), root)

        error.args = tuple(original(part) if isinstance(part, str) else part for part in error.args)
        for name in ("file", "place", "problem", "help"):
            text = getattr(error, name, None)
            if text is not None:
                setattr(error, name, original(str(text)))
        raise


def _keep_freed_memory() -> None:
    """Lets the C library keep memory that a scene frees: the next scene takes it again.

    Dask starts its workers with `MALLOC_TRIM_THRESHOLD_=65536`, so that the library returns freed memory at once. A change
    of the scene then takes half as long again, for page faults.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        # The parameters M_TRIM_THRESHOLD and M_MMAP_THRESHOLD (mallopt(3)), with the largest values that the library
        # itself chooses.
        mallopt(-1, 64 << 20)
        mallopt(-3, 32 << 20)


def _opened(source: Source, threads: int, is_study: bool) -> StudyWorker | Scene:
    _keep_freed_memory()
    path = _path_of(source)
    opened: StudyWorker | Scene
    if is_study:
        study = Study(path)
        hash, opened = study.hash, study.worker(threads)
    else:
        hash, opened = "", Scene(path, threads=threads)
    if _fingerprint(hash, opened.inputs) != source.fingerprint:
        problem = f"a worker has dunkelfeld {__version__} and other files than the client, or another version"
        raise setting(
            "files", problem, "install one version everywhere; without `ship`, copy the files to all machines"
        )
    return opened


@contextmanager
def _borrowed(source: Source, threads: int, is_study: bool) -> Iterator[Any]:
    """A loaded scene for one task. A process loads one for each task that runs at the same time, and keeps them."""
    key = (source.fingerprint, threads)
    with _lock:
        # Scenes of other studies would fill the memory.
        for other in [other for other in _idle if other != key]:
            del _idle[other]
        idle = _idle.setdefault(key, [])
        opened = idle.pop() if idle else None
    if opened is None:
        opened = _opened(source, threads, is_study)
    yield opened
    # After an error the scene is dropped.
    with _lock:
        _idle.setdefault(key, []).append(opened)


@contextmanager
def _folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="dunkelfeld-", dir=dask().get_worker().local_directory) as folder:
        yield Path(folder)


def make_image(
    source: Source, index: int, time: float | None, threads: int, folder: str | None, force: bool
) -> tuple[str, Made | bool, int]:
    """Makes an image: the address of the worker, the image or (with `folder`) whether it was written, its size [bytes].

    With `force` it is written also if another process has claimed it, unless its bytes depend on the speed of the machine.
    """
    with _named(source), _borrowed(source, threads, is_study=True) as worker:
        made = worker.make(index, time)
        is_forced = force and not worker.is_timed
    size = sum(entry["bytes"] for entry in made.record["files"].values())
    address: str = dask().get_worker().address
    return address, made if folder is None else DataSet(folder).commit(made, force=is_forced), size


def render_part(source: Source, samples: tuple[int, int], threads: int, options: dict[str, Any]) -> bytes:
    """Renders a range of samples: a checkpoint, compressed."""
    with _named(source), _borrowed(source, threads, is_study=False) as scene, _folder() as folder:
        path = folder / "part.film"
        scene.render(samples=samples, threads=threads, checkpoint=path, **options)
        return zlib.compress(path.read_bytes(), 1)


def merge_parts(parts: list[bytes], threads: int) -> bytes:
    """Merges neighbouring ranges: a checkpoint, compressed."""
    with _folder() as folder:
        whole = folder / "whole.film"
        merge([file_of(part, folder, i) for i, part in enumerate(parts)], threads, checkpoint=whole)
        return zlib.compress(whole.read_bytes(), 1)


def file_of(part: bytes, folder: Path, number: int) -> Path:
    """Writes a compressed checkpoint into a file."""
    path = folder / f"{number}.film"
    path.write_bytes(zlib.decompress(part))
    return path
