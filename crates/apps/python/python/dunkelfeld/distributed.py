"""Data sets and large images on many machines, with Dask (`pip install dunkelfeld[dask]`).

`make` makes the images of a data set, `render` the samples of one image::

    from dask.distributed import Client
    from dunkelfeld import distributed

    client = Client("tcp://scheduler:8786")
    distributed.make("study.toml", "set", client)
    film = distributed.render("job.toml", client, spp=4096, width=4096, height=3000)

Both give the bytes of one machine. Workers may join, be killed or stall at any time. The bytes of an image do not depend
on the worker that makes it, so the first result counts. See `docs/distributed.md`.
"""

from __future__ import annotations

import math
import os
import tempfile
import time as clock
import warnings
from collections import Counter, deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypedDict

from ._attempts import Attempt, Cluster, setting, whole_number
from ._native import Film, InputError, Made, Scene, Study, merge
from ._tasks import file_of, make_image, merge_parts, render_part, shipped

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from ._native import DataSet, Sensor

__all__ = ["MakeSummary", "make", "render"]

_Path: TypeAlias = str | os.PathLike[str]
_Progress: TypeAlias = "Callable[[int, int, float, float | None], object]"

FAN_IN = 8
"""Parts of an image that one task merges."""
PARTS_PER_THREAD = 4
"""Parts of an image for each thread of the cluster: a slow worker delays the end by a fraction of its share."""
SAMPLES_PER_PART = 16
"""Least samples per pixel of a part by default: the transfer and merge of a part take about the time of a few samples."""
WRITERS = 4
"""Threads of the client that write images."""
HELD = 2.0
"""With `shared`, multiples of `patience` after which an image is written although another process has claimed it."""


class MakeSummary(TypedDict):
    """The result of `make`."""

    made: int
    """Images that this call made."""
    finished: int
    """Images of the set that are finished."""
    count: int
    """Images of the set."""
    seconds: float
    """Wall-clock time [s]."""
    repeated: int
    """Attempts beyond the first one of each image: after a death, a stall or a lost result."""
    received: int
    """Size of the files that the client received [bytes]."""
    workers: dict[str, int]
    """Number of images by the address of their worker."""
    failed: list[tuple[int, str]]
    """Index and message of each image whose draws do not fit, as of `Study.run`."""


def make(
    study: Study | _Path,
    folder: _Path,
    client: Any,
    *,
    count: int | None = None,
    indices: Iterable[int] | None = None,
    threads: int = 1,
    time: float | None = None,
    shared: bool = False,
    ship: bool = True,
    files: Iterable[_Path] = (),
    retries: int = 5,
    patience: float = 5.0,
    stall: float = 4.0,
    progress: _Progress | None = None,
) -> MakeSummary:
    """Makes the missing images of a set on the workers of a Dask `client`, and then the files of the whole set.

    The set is that of `Study(study).run(folder)`, byte by byte, with the same warnings. The same call continues after the end of this process.
    Other processes may work on the same folder.

    `count` is the number of images (default: that of the study), and `indices` are the only images to make. `threads` is
    the number of threads of each image; 0 means one per core. `time` [s] is for each image, instead of the budget of the
    job; images then depend on the speed of the workers.

    The workers send the files to this process, which writes them. With `shared` the workers write them: `folder` is then
    on a file system that all of them share. A worker that stalls while it writes is passed over, except for images with a
    budget by time, whose bytes differ from attempt to attempt. The files that image 0 is made from, and `files` beside them, are sent to
    each worker process once. Without `ship` the workers read them by their paths.

    A worker without a sign of life for `patience` [s] counts as stalled. Its images are also given to other workers.
    The same happens to an image that takes `stall` times the median of the others, and at least `patience`. An image may
    fail `retries` times because of its worker.

    `progress` is called with (finished images, all images, elapsed [s], remaining [s] or None).

    An image whose draws do not fit is left out, and is in `failed`. But if the set has no image yet, and it is the first image
    of the call, its error is raised before a folder is made.

    Raises the errors of the study, `SettingError` if a worker has other files or another version of the package, and
    `DunkelfeldError` if an image fails too often or the scheduler is lost.
    """
    chosen = None if indices is None else [whole_number("indices", index) for index in indices]
    count = None if count is None else whole_number("count", count)
    maker = _SetMaker(study, client, threads, progress)
    with (
        Cluster(client, patience, stall, retries, refused=(InputError,)) as cluster,
        shipped(client, maker.study.path, maker.study.hash, maker.loaded.inputs, files, ship) as source,
        ThreadPoolExecutor(WRITERS) as writers,
    ):
        maker.start(folder, count, chosen)
        maker.run(cluster, writers, source, time, shared)
        return maker.finish(cluster.repeated)


class _SetMaker:
    """The images of a set, from their start to their files."""

    def __init__(self, study: Study | _Path, client: Any, threads: int, progress: _Progress | None) -> None:
        self.began = clock.monotonic()
        self.client, self.threads, self.progress = client, whole_number("threads", threads), progress
        self.study = study if isinstance(study, Study) else Study(study)
        # The scene is loaded for the list of its files.
        self.loaded = self.study.worker(threads=threads)
        self.made, self.received = 0, 0
        # Images that another process has claimed: when they are looked at again, and until when. A worker may stall while
        # it writes.
        self.held: list[tuple[float, float, Attempt, Made | None]] = []
        self.failed: list[tuple[int, InputError]] = []
        self.workers: Counter[str] = Counter()

    def start(self, folder: _Path, count: int | None, indices: list[int] | None) -> None:
        self.set: DataSet
        self.set, self.total, missing = self.loaded._start(folder, count, indices)
        for warning in self.loaded.warnings:
            warnings.warn(warning, UserWarning, stacklevel=3)
        self.pending = deque(missing)
        self.finished, self.ended = self.total - len(missing), 0

    def run(self, cluster: Cluster, writers: ThreadPoolExecutor, source: Any, time: float | None, shared: bool) -> None:
        target = str(self.set.path) if shared else None
        self._report()
        while self.finished + len(self.failed) < self.total:
            cluster.watch()
            self._look_at_held(cluster, writers)
            while self.pending and cluster.has_room():
                index = self.pending.popleft()
                if self.set.is_finished(index):
                    self._end()
                else:
                    cluster.start(str(index), "image", make_image, source, index, time, self.threads, target, False)
            event = cluster.wait()
            if event is None:
                continue
            attempt, kind, value = event
            if kind == "finished":
                cluster.fetch(attempt)
            elif kind == "refused":
                # Its draws do not fit.
                cluster.drop(attempt.name)
                self.failed.append((int(attempt.name), value))
            elif kind == "fetched":
                attempt.worker, result, size = value
                image = result if isinstance(result, Made) else None
                self.received += size if image is not None else 0
                wait = math.inf if attempt.call[-1] else HELD * cluster.patience
                self._write(cluster, writers, attempt, image, clock.monotonic() + wait)
            else:
                self._written(cluster, attempt, *value)

    def finish(self, repeated: int) -> MakeSummary:
        finished = self.set.count - len(self.set.missing())
        # Images that cannot be made do not keep the others from use.
        if finished + len(self.failed) >= self.set.count:
            self.set.assemble()
        return MakeSummary(
            made=self.made,
            finished=finished,
            count=self.set.count,
            seconds=clock.monotonic() - self.began,
            repeated=repeated,
            received=self.received,
            workers=dict(self.workers),
            failed=sorted((index, _message(error)) for index, error in self.failed),
        )

    def _write(
        self, cluster: Cluster, writers: ThreadPoolExecutor, attempt: Attempt, image: Made | None, until: float
    ) -> None:
        index = int(attempt.name)

        def work() -> tuple[bool, bool, float, Made | None]:
            is_made = image is not None and self.set.commit(image)
            return is_made, self.set.is_finished(index), until, image

        cluster.follow(attempt, "written", writers.submit(work))

    def _written(
        self, cluster: Cluster, attempt: Attempt, is_made: bool, is_there: bool, until: float, image: Made | None
    ) -> None:
        if is_there:
            self.made += is_made or image is None
            self.workers[attempt.worker] += 1
            cluster.settle(attempt)
            self._end()
        else:
            attempt.is_repeated = True
            self.held.append((clock.monotonic() + 0.5, until, attempt, image))

    def _look_at_held(self, cluster: Cluster, writers: ThreadPoolExecutor) -> None:
        now = clock.monotonic()
        held, self.held = self.held, []
        for due, until, attempt, image in held:
            if not cluster.is_running(attempt.name):
                continue
            if due > now:
                self.held.append((due, until, attempt, image))
            elif image is None and until < now and not self.set.is_finished(int(attempt.name)):
                attempt.call = (*attempt.call[:-1], True)
                cluster.again(attempt)
            else:
                self._write(cluster, writers, attempt, image, until)

    def _end(self) -> None:
        self.finished += 1
        self.ended += 1
        self._report()

    def _report(self) -> None:
        if self.progress is not None:
            elapsed = clock.monotonic() - self.began
            left = self.total - self.finished
            self.progress(self.finished, self.total, elapsed, elapsed / self.ended * left if self.ended else None)


def _message(error: InputError) -> str:
    """The message of an error as in `Study.run`, without the line of the file."""
    return f"{error.file}: {error.place}: {error.problem}\n  help: {error.help}"


def render(
    job: _Path,
    client: Any,
    spp: int,
    *,
    parts: int | None = None,
    width: int | None = None,
    height: int | None = None,
    camera: str | None = None,
    seed: int | None = None,
    frame: int | None = None,
    sensor: Sensor | _Path | None = None,
    exposure: float | str | None = None,
    threads: int = 1,
    ship: bool = True,
    files: Iterable[_Path] = (),
    retries: int = 5,
    patience: float = 5.0,
    stall: float = 4.0,
    progress: _Progress | None = None,
) -> Film:
    """Renders `spp` samples of each pixel of a scene or job file on the workers of a Dask `client`.

    The film is that of `Scene(job).render(samples=(0, spp))`, bit by bit. The samples are divided into `parts` ranges
    (default: 4 for each thread of the cluster, but at least 16 samples per pixel each). The workers merge the parts as a tree, and this process receives the
    whole. `width` to `exposure` are those of `Scene.render`, the other arguments those of `make`. `progress` is called
    with (finished tasks, all tasks, elapsed [s], remaining [s] or None); tasks are parts and merges.

    A part has up to 396 bytes per pixel in memory, and about a third of that on the network.
    """
    began = clock.monotonic()
    spp = whole_number("spp", spp)
    if spp < 1:
        raise setting("spp", f"{spp} is out of range", "pass 1 or more")
    parts = None if parts is None else whole_number("parts", parts)
    if parts is not None and parts < 1:
        raise setting("parts", f"{parts} is out of range", "pass 1 or more")
    given: dict[str, Any] = {"width": width, "height": height, "camera": camera, "seed": seed, "frame": frame}
    given |= {"sensor": sensor, "exposure": exposure}
    options = {name: value for name, value in given.items() if value is not None}
    path = Path(os.path.abspath(job))
    with (
        Cluster(client, patience, stall, retries) as cluster,
        shipped(client, path, "", Scene(path).inputs, files, ship) as source,
    ):
        cluster.watch()
        while parts is None and cluster.threads == 0:
            cluster.wait()
            cluster.watch()
        if parts is None:
            parts = max(1, min(PARTS_PER_THREAD * cluster.threads, spp // SAMPLES_PER_PART))
        nodes = tree(min(spp, parts), spp)

        def report() -> None:
            if progress is not None:
                done, elapsed = sum(node.is_done for node in nodes), clock.monotonic() - began
                progress(done, len(nodes), elapsed, elapsed / done * (len(nodes) - done) if done else None)

        report()
        root = nodes[-1]
        while True:
            cluster.watch()
            _revive_unreachable(cluster, nodes)
            for node in nodes:
                if node.is_done or cluster.is_running(node.name):
                    continue
                if not node.children and cluster.has_room():
                    cluster.start(node.name, "part", render_part, source, node.samples, threads, options)
                elif node.children and all(child.future is not None for child in node.children):
                    futures = [child.future for child in node.children]
                    cluster.start(node.name, "merge", merge_parts, futures, threads)
            event = cluster.wait()
            if event is None:
                continue
            attempt, kind, value = event
            if kind == "fetched":
                data: bytes = value
                break
            node = next(node for node in nodes if node.name == attempt.name)
            if node is root:
                cluster.fetch(attempt)
                continue
            node.future = attempt.future
            cluster.settle(attempt, keep=True)
            for child in node.children:
                child.future, child.is_merged = None, True
            report()
    with tempfile.TemporaryDirectory(prefix="dunkelfeld-") as folder:
        whole = file_of(data, Path(folder), 0)
        del data
        film = merge([whole], threads)
    if progress is not None:
        progress(len(nodes), len(nodes), clock.monotonic() - began, 0.0)
    return film


@dataclass(eq=False)
class Node:
    """A range of samples: a part, or the merge of neighbours."""

    name: str
    samples: tuple[int, int]
    children: list[Node] = field(default_factory=list)
    future: Any = None
    """The result on a worker."""
    is_merged: bool = False
    """Is the result contained in that of the parent? Then it is released."""

    @property
    def is_done(self) -> bool:
        return self.future is not None or self.is_merged

    def revive(self) -> None:
        """The result is to be made again, with all results below that were released."""
        self.future, self.is_merged = None, False
        for child in self.children:
            if child.future is None:
                child.revive()


def tree(parts: int, spp: int) -> list[Node]:
    """All nodes, children before their parents. The last one is the whole."""
    bounds = [spp * i // parts for i in range(parts + 1)]
    level = [Node(f"part-{a}-{b}", (a, b)) for a, b in pairwise(bounds)]
    nodes = list(level)
    while len(level) > 1:
        groups = [level[i : i + FAN_IN] for i in range(0, len(level), FAN_IN)]
        level = []
        for group in groups:
            if len(group) > 1:
                samples = (group[0].samples[0], group[-1].samples[1])
                nodes.append(Node(f"merge-{samples[0]}-{samples[1]}", samples, group))
            level.append(nodes[-1] if len(group) > 1 else group[0])
    return nodes


def _revive_unreachable(cluster: Cluster, nodes: list[Node]) -> None:
    """Results that died with their worker, or that only stalled workers have, are made again."""
    held = [node for node in nodes if node.future is not None]
    # Dask would make results of dead workers again as well, but maybe on a stalled worker.
    lost = [node for node in held if node.future.status != "finished"]
    if cluster.silent and held:
        holders = cluster.client.who_has([node.future for node in held])
        for node in held:
            workers = set(holders.get(node.future.key, ()))
            if workers and workers <= cluster.silent:
                lost.append(node)
    for node in lost:
        node.revive()
        for parent in nodes:
            if node in parent.children:
                cluster.drop(parent.name)
