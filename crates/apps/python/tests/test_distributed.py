"""Data sets and images on a cluster of processes, some of which are killed and stopped."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import dunkelfeld as df
import numpy as np
import pytest
from dunkelfeld.dataset import DataSet, Study
from test_dataset import STUDY, assert_same, files

dask = pytest.importorskip("distributed")

from dunkelfeld import distributed
from dunkelfeld.distributed import tree

IMAGES = 24
JOB = """
scene = "none"
[film]
width = 48
height = 32
[sensor]
exposure = "20ms"
[camera]
look_at = [0, 0, 0]
position = [0, 0.3, 0.4]
[environment]
radiance = 1
[[object]]
name = "ball"
kind = "sphere"
diameter = "100mm"
[[material]]
name = "ball"
roughness = 0.3
metallic = 1
"""
SPLIT = """
[study]
job = "../job.toml"
[[study.label]]
category = "ball"
objects = "ball"
[camera]
position = [{ uniform = ["-5mm", "5mm"] }, 0.3, 0.4]
[budget]
spp = 4
"""


class Cluster:
    """A scheduler and workers without a nanny: a worker that is killed does not come back."""

    def __init__(self, folder: Path, workers: int) -> None:
        self.folder = folder
        folder.mkdir()
        self.log = (folder / "log.txt").open("w")
        self.file = folder / "scheduler.json"
        port = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
        self.scheduler = self.process("dask_scheduler", *port)
        self.workers = [self.worker() for _ in range(workers)]
        self.client = dask.Client(scheduler_file=str(self.file), timeout=30)
        self.client.wait_for_workers(workers, timeout=60)

    def process(self, program: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{program}", "--scheduler-file", str(self.file), *options]
        return subprocess.Popen(command, stdout=self.log, stderr=self.log, cwd=self.folder)

    def worker(self) -> subprocess.Popen[bytes]:
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(self.folder)]
        return self.process("dask_worker", *options)

    def harm(self, kill_at: int, stop_at: int) -> Callable[..., None]:
        """A progress function that kills a worker and stops another one."""

        def progress(finished: int, *_: object) -> None:
            if finished == kill_at:
                self.workers[0].send_signal(signal.SIGKILL)
            if finished == stop_at:
                self.workers[1].send_signal(signal.SIGSTOP)

        return progress

    def end(self) -> None:
        self.client.close(timeout=5)
        for process in [*self.workers, self.scheduler]:
            process.kill()
            process.wait()
        self.log.close()


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[int], Cluster]]:
    started: list[Cluster] = []

    def begin(workers: int) -> Cluster:
        started.append(Cluster(tmp_path / "cluster", workers))
        return started[-1]

    yield begin
    for cluster in started:
        cluster.end()


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    path = tmp_path_factory.mktemp("study") / "study.toml"
    path.write_text(STUDY)
    return Study(path)


@pytest.fixture(scope="module")
def alone(study: Study) -> Path:
    """The set of one process."""
    study.run(study.path.parent / "alone", count=IMAGES)
    return study.path.parent / "alone"


def test_a_set_survives_a_killed_and_a_stalled_worker(
    study: Study, alone: Path, tmp_path: Path, start: Callable[[int], Cluster]
) -> None:
    cluster = start(4)
    harm = cluster.harm(kill_at=3, stop_at=6)
    summary = distributed.make(study, tmp_path / "set", cluster.client, count=IMAGES, patience=1.0, progress=harm)
    assert_same(alone, tmp_path / "set")
    assert summary["made"] == summary["finished"] == summary["count"] == IMAGES
    assert summary["repeated"] >= 1 and sum(summary["workers"].values()) == IMAGES and len(summary["workers"]) >= 3
    sizes = [len(data) for name, data in files(tmp_path / "set").items() if "/" in name and "records/" not in name]
    assert summary["received"] == sum(sizes)
    assert cluster.workers[0].poll() is not None and cluster.workers[1].poll() is None
    assert DataSet(tmp_path / "set").verify()["is_whole"]


def test_an_image_survives_a_killed_and_a_stalled_worker(tmp_path: Path, start: Callable[[int], Cluster]) -> None:
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    options: dict[str, Any] = {"seed": 5, "camera": None, "sensor": df.Sensor("imx174")}
    whole = df.Scene(path).render(samples=(0, 50), **options)
    cluster = start(4)
    seen: list[int] = []
    harm = cluster.harm(kill_at=4, stop_at=8)

    def progress(finished: int, *rest: object) -> None:
        seen.append(finished)
        harm(finished)

    film = distributed.render(path, cluster.client, 50, parts=20, patience=1.0, progress=progress, **options)
    assert cluster.workers[0].poll() is not None and cluster.workers[1].poll() is None
    for name in ["mean", "variance", "spp", "object_ids", "depth", "normal", "albedo"]:
        assert np.array_equal(getattr(film, name), getattr(whole, name)), name
    assert np.array_equal(film.expose(frames=2), whole.expose(frames=2)) and film.stats["samples"] == 50 * 48 * 32
    film.save(tmp_path / "a.film")
    whole.save(tmp_path / "b.film")
    assert (tmp_path / "a.film").read_bytes() == (tmp_path / "b.film").read_bytes()
    # 20 parts, 3 merges of them, and one of these.
    assert seen[0] == 0 and seen[-1] == 24


def test_one_cluster_continues_shares_ships_and_refuses(
    study: Study, alone: Path, tmp_path: Path, start: Callable[[int], Cluster]
) -> None:
    cluster = start(3)
    client = cluster.client

    # The call ends early, as if its process died. The next one continues, and the workers write.
    def enough(finished: int, *_: object) -> None:
        if finished == 7:
            raise LookupError

    with pytest.raises(LookupError):
        distributed.make(study, tmp_path / "set", client, count=IMAGES, progress=enough)
    there = IMAGES - len(DataSet(tmp_path / "set").missing())
    assert 7 <= there < IMAGES
    some = distributed.make(study, tmp_path / "set", client, count=IMAGES, indices=[20, 23])
    assert some["finished"] >= there and DataSet(tmp_path / "set").is_finished(23)
    rest = distributed.make(study.path, tmp_path / "set", client, count=IMAGES, shared=True)
    assert (rest["finished"], rest["received"]) == (IMAGES, 0)
    assert_same(alone, tmp_path / "set")
    again = distributed.make(study, tmp_path / "set", client, count=IMAGES)
    assert (again["made"], again["repeated"], again["workers"]) == (0, 0, {})

    # The study is two files, which nobody can read after the start.
    folder = tmp_path / "two"
    (folder / "studies").mkdir(parents=True)
    (folder / "job.toml").write_text(JOB)
    (folder / "studies/study.toml").write_text(SPLIT)
    split = Study(folder / "studies/study.toml")
    split.run(tmp_path / "split", count=4)

    def hide(finished: int, *_: object) -> None:
        if finished == 0:
            folder.rename(tmp_path / "hidden")

    distributed.make(split, tmp_path / "split-again", client, count=4, progress=hide)
    assert_same(tmp_path / "split", tmp_path / "split-again")

    # Errors of the study are those of one process. A worker must have the files of the client.
    bad = tmp_path / "bad.toml"
    bad.write_text(STUDY.replace('size = ["90mm", 0, "90mm"]', 'size = ["20mm", 0, "20mm"]'))
    with pytest.raises(df.InputError, match="finds no place") as caught:
        distributed.make(bad, tmp_path / "bad", client, ship=False)
    assert caught.value.help and caught.value.file == str(bad)
    with pytest.raises(df.InputError, match="finds no place") as shipped:
        distributed.make(bad, tmp_path / "bad-shipped", client)
    assert shipped.value.file == str(bad) and str(bad) in str(shipped.value)
    # Image 2 has no place for its blocks. It is left out, as by one process, with the same message.
    partial = tmp_path / "some.toml"
    partial.write_text(
        STUDY.replace(
            'size = ["90mm", 0, "90mm"]', 'size = [{ sequence = ["90mm", "90mm", "20mm", "90mm"] }, 0, "90mm"]'
        )
    )
    expected = Study(partial).run(tmp_path / "some", count=4, jobs=1)
    summary = distributed.make(partial, tmp_path / "some-shipped", client, count=4)
    assert (summary["made"], summary["finished"]) == (3, 3)
    assert summary["failed"] == expected["failed"] and [index for index, _ in summary["failed"]] == [2]
    assert_same(tmp_path / "some", tmp_path / "some-shipped")
    # Without the first image nothing is made, also if later images fit.
    late = tmp_path / "late.toml"
    late.write_text(STUDY.replace('size = ["90mm", 0, "90mm"]', 'size = [{ sequence = ["20mm", "90mm"] }, 0, "90mm"]'))
    for shared in (False, True):
        with pytest.raises(df.InputError, match="image 0: ") as first:
            distributed.make(late, tmp_path / "late", client, count=4, shared=shared)
        assert "finds no place" in (first.value.problem or "")
        assert not (tmp_path / "late").exists()
    summary = distributed.make(late, tmp_path / "late", client, count=4, indices=[1, 2, 3])
    assert [index for index, _ in summary["failed"]] == [2] and summary["made"] == 2
    changed = tmp_path / "changed.toml"
    changed.write_text(STUDY)
    before = Study(changed)
    changed.write_text(STUDY.replace("seed = 3", "seed = 4"))
    with pytest.raises(df.SettingError, match="other files") as refused:
        distributed.make(before, tmp_path / "changed", client, ship=False)
    assert refused.value.help
    calls: list[tuple[Callable[[], object], str]] = [
        (lambda: distributed.make(study, tmp_path / "x", client, indices=[5]), "no image 5"),
        (lambda: distributed.make(study, tmp_path / "x", client, indices=[-1]), "out of range"),
        (lambda: distributed.make(study, tmp_path / "x", client, indices=[1.9]), "indices: 1.9 is not a whole"),  # type: ignore[list-item]
        (lambda: distributed.make(study, tmp_path / "x", client, indices=["0"]), "indices: '0' is not a whole"),  # type: ignore[list-item]
        (lambda: distributed.make(study, tmp_path / "x", client, retries=1.5), "retries: 1.5 is not a whole"),  # type: ignore[arg-type]
        (lambda: distributed.make(study, tmp_path / "x", client, count=2.5), "count: 2.5 is not a whole"),  # type: ignore[arg-type]
        (lambda: distributed.make(study, tmp_path / "x", client, threads=-1), "threads: -1 is out of range"),
        (lambda: distributed.make(study, tmp_path / "x", client, retries=-1), "retries"),
        (lambda: distributed.make(study, tmp_path / "x", client, patience=0.0), "patience"),
        (lambda: distributed.make(study, tmp_path / "x", client, stall=0.5), "stall"),
        (lambda: distributed.make(study, tmp_path / "x", client, files=[tmp_path / "no"]), "no file"),
        (lambda: distributed.render(folder / "job.toml", client, 0), "spp"),
        (lambda: distributed.render(folder / "job.toml", client, 2.5), "spp: 2.5 is not a whole number"),  # type: ignore[arg-type]
        (lambda: distributed.render(folder / "job.toml", client, 4, parts=0), "parts"),
    ]
    for call, says in calls:
        with pytest.raises(df.SettingError, match=says) as wrong:
            call()
        assert wrong.value.help and wrong.value.problem
        assert not (tmp_path / "x").exists()
    # Nothing remains on the cluster.
    deadline = time.monotonic() + 10
    while client.who_has() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not client.who_has()


@pytest.mark.parametrize(("parts", "spp"), [(1, 1), (2, 2), (8, 100), (9, 9), (20, 50), (65, 1000), (600, 4096)])
def test_a_tree_has_each_sample_once(parts: int, spp: int) -> None:
    nodes = tree(parts, spp)
    leaves = sorted(node.samples for node in nodes if not node.children)
    assert len(leaves) == parts and leaves[0][0] == 0 and leaves[-1][1] == spp
    assert all(a[1] == b[0] and a[0] < a[1] for a, b in pairwise(leaves))
    for i, node in enumerate(nodes):
        assert all(child in nodes[:i] for child in node.children) and len(node.children) != 1
        if node.children:
            assert node.samples == (node.children[0].samples[0], node.children[-1].samples[1])
    assert nodes[-1].samples == (0, spp) and len({node.name for node in nodes}) == len(nodes)
