"""Data sets from Python: the files of the program, single images, readers and their formats."""

import json
import os
import pickle
import signal
import subprocess
import sys
import tarfile
import threading
from pathlib import Path
from typing import Any, cast

import dunkelfeld as df
import numpy as np
import pytest
from dunkelfeld.dataset import DataSet, SetReader, Study, read_image, webdataset

PROGRAM = os.environ["DUNKELFELD"]
STUDY = """
scene = "none"
[study]
name = "blocks"
count = 5
seed = 3
[study.draw]
supply = { uniform = [0.8, 1.2] }
[study.images]
linear = "tiff"
raw = true
[study.labels]
semantic = true
coverage = 2
depth = true
normals = true
yolo = true
bop = true
[[study.label]]
category = "block"
objects = "block *"
[[study.label]]
category = "ball"
objects = ["ball"]
[[study.place]]
objects = "block *"
center = [0, 0, 0]
size = ["90mm", 0, "90mm"]
turn = "360deg"
clearance = "1mm"
[camera]
name = "above"
position = [{ uniform = ["-5mm", "5mm"] }, "300mm", "1mm"]
look_at = [0, 0, 0]
vertical_fov = "25deg"
[film]
width = 64
height = 48
[budget]
spp = 8
[sensor]
exposure = "20ms"
[[object]]
name = "plate"
kind = "box"
size = ["120mm", "2mm", "120mm"]
translate = [0, "-1mm", 0]
[[object]]
name = "block 1"
kind = "box"
size = ["12mm", "6mm", "12mm"]
translate = [0, "3mm", 0]
[[object]]
name = "block 2"
kind = "box"
size = ["10mm", "8mm", "20mm"]
translate = [0, "4mm", 0]
[[object]]
name = "ball"
kind = "sphere"
diameter = { log_uniform = ["6mm", "12mm"] }
translate = ["40mm", "12mm", "30mm"]
[[light]]
name = "panel"
kind = "panel"
width = "100mm"
position = ["150mm", "200mm", 0]
target = [0, 0, 0]
power = { expression = "1.5 * supply", unit = "W" }
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    path = tmp_path_factory.mktemp("study") / "study.toml"
    path.write_text(STUDY)
    return Study(path)


@pytest.fixture(scope="module")
def folder(study: Study) -> Path:
    """A finished set. Tests do not change it."""
    folder = study.path.parent / "set"
    study.run(folder, jobs=2)
    return folder


def files(folder: Path) -> dict[str, bytes]:
    """All files of a set but the times, which differ from run to run."""
    found = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    times = ("costs/", "report.html")
    return {name: path.read_bytes() for name, path in found.items() if not name.startswith(times)}


def assert_same(a: Path, b: Path) -> None:
    a_files, b_files = files(a), files(b)
    assert a_files.keys() == b_files.keys()
    assert [name for name in a_files if a_files[name] != b_files[name]] == []


def test_a_set_is_that_of_the_program(study: Study, folder: Path, tmp_path: Path) -> None:
    subprocess.run([PROGRAM, "dataset", study.path, "-o", tmp_path / "set"], check=True, capture_output=True)
    assert_same(folder, tmp_path / "set")
    assert (study.name, study.count, len(study.hash)) == ("blocks", 5, 32)
    assert study.hash == json.loads((folder / "set.json").read_text())["study_hash"]


def test_a_run_reports_and_continues(study: Study, folder: Path, tmp_path: Path) -> None:
    seen: list[Any] = []
    first = study.run(tmp_path / "set", indices=[3, 1], jobs=1, threads=2, progress=lambda *state: seen.append(state))
    assert (first["made"], first["finished"], first["count"]) == (2, 2, 5)
    assert first["price"] is not None and (first["price"]["measured"], first["price"]["count"]) == (2, 5)
    assert [state[:2] for state in seen] == [(0, 2), (1, 2), (2, 2)] and seen[-1][2] > 0
    assert DataSet(tmp_path / "set").missing() == [0, 2, 4]
    second = study.run(tmp_path / "set")
    assert (second["made"], second["finished"]) == (3, 5) and second["seconds"] > 0
    assert_same(folder, tmp_path / "set")


def test_a_time_is_for_the_whole_set(study: Study, tmp_path: Path) -> None:
    summary = study.run(tmp_path / "set", count=12, time=5.0)
    assert (summary["finished"], summary["made"]) == (12, 12)
    # With the budget of the job each image would have as many samples.
    records = sorted((tmp_path / "set" / "records").glob("*.json"))
    assert any(json.loads(record.read_text())["samples"] != 8 * 64 * 48 for record in records)


def test_single_images_make_the_same_set(study: Study, folder: Path, tmp_path: Path) -> None:
    worker = study.worker(threads=1)
    assert worker.inputs == [study.path]
    data = worker.open(tmp_path / "set")
    for index in [4, 0, 2, 1, 3]:
        made = pickle.loads(pickle.dumps(worker.make(index)))
        assert made.index == index == made.record["index"] and made.cost["total"] > 0
        assert {name: len(content) for name, content in made.files.items()} == {
            name: entry["bytes"] for name, entry in made.record["files"].items()
        }
        assert not data.is_finished(index) and data.commit(made) and data.is_finished(index)
        assert not data.commit(made)
        assert data.record(index) == made.record
    data.assemble()
    assert_same(folder, tmp_path / "set")
    found = pickle.loads(pickle.dumps(data)).verify()
    assert found["is_whole"] and found["finished"] == 5 and found["annotations"] > 5 and found["faults"] == []
    (data.path / "masks/000002.png").unlink()
    found = data.verify()
    assert not found["is_whole"] and "masks/000002.png" in found["faults"][0]


def test_a_study_can_be_copied_to_another_folder(study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(study.path.parent)
    relative = Study("study.toml")
    monkeypatch.chdir(tmp_path)
    copy = pickle.loads(pickle.dumps(relative))
    assert copy.hash == study.hash and copy.path == study.path
    assert copy.worker().make(1).files == study.worker(threads=2).make(1).files


def test_damaged_copies_are_refused(study: Study, tmp_path: Path) -> None:
    worker = study.worker()
    data = worker.open(tmp_path / "set", count=2)
    made = worker.make(0)
    kind, (record, contents, cost) = cast(Any, made).__reduce__()
    name = "images/000000.png"
    changed = [contents | {name: contents[name] + b" "}, {n: c for n, c in contents.items() if n != name}]
    for other in changed:
        with pytest.raises(df.SettingError, match="differ from its record") as caught:
            data.commit(kind(record, other, cost))
        assert caught.value.help
    outside = record.replace(name, "../outside.png")
    with pytest.raises(df.InputError, match="leads out of the set"):
        data.commit(kind(outside, {n.replace(name, "../outside.png"): c for n, c in contents.items()}, cost))
    with pytest.raises(df.SettingError, match="broken"):
        kind("{}", contents, cost)
    with pytest.raises(df.SettingError, match="no image 2"):
        data.commit(worker.make(2))
    assert data.missing() == [0, 1] and not (tmp_path / "outside.png").exists()


def test_a_stalled_process_holds_an_image_until_it_is_written_by_force(study: Study, tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    worker = study.worker()
    data = worker.open(tmp_path / "set", count=2)
    made = worker.make(1)
    assert not worker.is_timed
    # The lock of a process that writes, and does not go on.
    lock = tmp_path / "set/records/000001.json.lock"
    lock.write_text("lock file of dunkelfeld\nprocess 1 has held it\n")
    with lock.open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert not data.commit(made) and data.missing() == [0, 1]
        assert data.commit(made, force=True) and data.missing() == [0]
        assert not data.commit(made, force=True)
    worker.make(0, time=0.2)
    assert worker.is_timed


def test_a_reader_has_the_arrays_of_the_files(study: Study, folder: Path) -> None:
    reader = SetReader(folder)
    assert len(reader) == 5 == len(list(reader)) and reader.indices == [0, 1, 2, 3, 4]
    assert [c["name"] for c in reader.categories] == ["block", "ball"]
    item = pickle.loads(pickle.dumps(reader))[np.int64(3)]
    shapes = {name: (value.shape, value.dtype.name) for name, value in item.items() if isinstance(value, np.ndarray)}
    gray = (48, 64)
    assert shapes == {
        "image": (gray, "uint8"),
        "linear": (gray, "uint16"),
        "mask": (gray, "uint16"),
        "semantic": (gray, "uint8"),
        "coverage": (gray, "uint16"),
        "depth": (gray, "uint16"),
        "normals": ((*gray, 3), "uint16"),
    }
    raw = np.fromfile(folder / "raw/000003.raw", dtype="<u2").reshape(gray)
    assert np.array_equal(item["linear"], raw) and 0 < raw.max() < 4096
    assert item["index"] == 3 == item["record"]["index"] and len(item["poses"]) == 3
    assert np.array(item["camera"]["k"]).size == 9
    instances = {entry["id"]: entry for entry in item["record"]["instances"]}
    assert {i: int((item["mask"] == i).sum()) for i in instances} == {i: e["area"] for i, e in instances.items()}
    for annotation in item["annotations"]:
        rows, columns = np.nonzero(item["mask"] == annotation["instance"])
        left, top, width, height = annotation["bbox"]
        assert (rows.min(), rows.max(), columns.min(), columns.max()) == (top, top + height - 1, left, left + width - 1)
        assert (item["semantic"][rows, columns] == annotation["category_id"]).all()
    # The camera is 300 mm above the plate.
    assert abs(np.median(item["depth"][item["mask"] == 0]) - 3000) < 30


def test_a_reader_selects_and_transforms(folder: Path, tmp_path: Path, study: Study) -> None:
    pairs = SetReader(folder, layers=["image", "mask"], transform=lambda item: (item["image"] / 255, item["mask"]))
    image, mask = pairs[-1]
    assert image.dtype == np.float64 and mask.shape == image.shape
    assert "depth" not in SetReader(folder, layers=["mask"])[0]
    with pytest.raises(IndexError):
        pairs[5]
    with pytest.raises(ValueError, match="unknown layer 'masks'.*image"):
        SetReader(folder, layers=["masks"])
    # A set in work: the reader has what is finished.
    study.run(tmp_path / "part", indices=[4, 2])
    assert SetReader(tmp_path / "part").indices == [2, 4]
    with pytest.raises(df.InputError, match=r"set\.json"):
        SetReader(tmp_path)


def test_shards_hold_the_files_and_are_the_same_again(folder: Path, tmp_path: Path) -> None:
    shards = webdataset(folder, tmp_path / "a", images_per_shard=2)
    assert [shard.name for shard in shards] == ["blocks-000000.tar", "blocks-000001.tar", "blocks-000002.tar"]
    again = webdataset(folder, tmp_path / "b", images_per_shard=2)
    assert [a.read_bytes() == b.read_bytes() for a, b in zip(shards, again, strict=True)] == [True] * 3
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == [shard.name for shard in shards]
    members = {}
    for shard in shards:
        with tarfile.open(shard) as tar:
            members.update({entry.name: cast(Any, tar.extractfile(entry)).read() for entry in tar})
    endings = ["coverage.png", "depth.png", "json", "linear.tif", "mask.png", "normals.png", "png", "raw"]
    endings += ["record.json", "semantic.png", "txt"]
    assert sorted(members) == [f"{i:06}.{ending}" for i in range(5) for ending in endings]
    assert members["000004.png"] == (folder / "images/000004.png").read_bytes()
    assert members["000004.mask.png"] == (folder / "masks/000004.png").read_bytes()
    assert members["000004.json"] == (folder / "labels/000004.json").read_bytes()
    with pytest.raises(ValueError, match="images_per_shard"):
        webdataset(folder, tmp_path / "c", images_per_shard=0)
    # Larger shards of the same set leave none of the smaller ones, and no other file is touched.
    (tmp_path / "b" / "blocks-other-000009.tar").write_bytes(b"")
    larger = webdataset(folder, tmp_path / "b", images_per_shard=5)
    names = sorted(file.name for file in (tmp_path / "b").iterdir())
    assert names == ["blocks-000000.tar", "blocks-other-000009.tar"] and [s.name for s in larger] == names[:1]


def test_webdataset_reads_the_shards(folder: Path, tmp_path: Path) -> None:
    wds = pytest.importorskip("webdataset")
    shards = webdataset(folder, tmp_path, images_per_shard=3)
    rows = list(wds.WebDataset([str(shard) for shard in shards], shardshuffle=False))
    assert [row["__key__"] for row in rows] == [f"{i:06}" for i in range(5)]
    assert rows[1]["png"] == (folder / "images/000001.png").read_bytes()
    assert json.loads(rows[1]["record.json"])["index"] == 1


def test_pycocotools_has_the_masks_of_the_set(folder: Path) -> None:
    coco = pytest.importorskip("pycocotools.coco").COCO(str(folder / "coco.json"))
    reader = SetReader(folder)
    assert sorted(coco.getImgIds()) == reader.indices
    seen = 0
    for item in reader:
        for annotation in coco.loadAnns(coco.getAnnIds(item["index"])):
            assert np.array_equal(coco.annToMask(annotation), item["mask"] == annotation["instance"])
            seen += 1
    assert seen == sum(len(item["annotations"]) for item in reader) > 5


def test_pycocotools_scores_the_key_points(study: Study, tmp_path: Path) -> None:
    tools = pytest.importorskip("pycocotools.coco")
    evaluation = pytest.importorskip("pycocotools.cocoeval")
    points = """keypoints = [
        { name = "centre", at = [0, 0, 0] }, { name = "edge", at = ["5mm", 0, 0] }, { name = "top", at = [0, "3mm", 0] }]
    skeleton = [[1, 2], [1, 3]]
    """
    text = study.path.read_text().replace("yolo = true", "yolo = false")
    path = tmp_path / "study.toml"
    path.write_text(
        text.replace('objects = "block *"\n[[study.label]]', f'objects = "block *"\n{points}[[study.label]]')
    )
    folder = tmp_path / "set"
    Study(path).run(folder)
    coco = tools.COCO(str(folder / "coco.json"))
    block, ball = coco.loadCats(coco.getCatIds())
    assert block["keypoints"] == ["centre", "edge", "top"] and block["skeleton"] == [[1, 2], [1, 3]]
    assert "keypoints" not in ball
    found = []
    for annotation in coco.loadAnns(coco.getAnnIds(catIds=[block["id"]])):
        places = np.array(annotation["keypoints"]).reshape(3, 3)
        assert annotation["num_keypoints"] == (places[:, 2] > 0).sum()
        # The centre of a block is inside of it, and the middle of block 1 is hidden under its upper side.
        assert set(places[:, 2]) <= {0, 1, 2} and places[0, 2] < 2
        left, top, width, height = annotation["bbox"]
        if places[0, 2] and left > 0 and top > 0 and left + width < 64 and top + height < 48:
            assert left - 1 < places[0, 0] < left + width + 1 and top - 1 < places[0, 1] < top + height + 1
        found.append({
            "image_id": annotation["image_id"], "category_id": block["id"], "keypoints": annotation["keypoints"],
            "score": 1.0,
        })  # fmt: skip
    assert len(found) >= 5
    score = evaluation.COCOeval(coco, coco.loadRes(found), "keypoints")
    score.params.catIds, score.params.kpt_oks_sigmas = [block["id"]], np.full(3, 0.05)
    # The areas of this small film are below those of people.
    score.params.areaRng, score.params.areaRngLbl = [[0, 1e10]] * 3, ["all", "medium", "large"]
    score.evaluate()
    score.accumulate()
    score.summarize()
    assert score.stats[0] == pytest.approx(1.0)


def test_hugging_face_takes_the_items(folder: Path, tmp_path: Path) -> None:
    datasets = pytest.importorskip("datasets")

    def rows() -> Any:
        for item in SetReader(folder, layers=["image", "mask"]):
            boxes = [annotation["bbox"] for annotation in item["annotations"]]
            labels = [annotation["category_id"] for annotation in item["annotations"]]
            yield {"image": item["image"], "mask": item["mask"], "boxes": boxes, "labels": labels}

    made = datasets.Dataset.from_generator(rows, cache_dir=str(tmp_path)).with_format("numpy")
    assert len(made) == 5 and np.array_equal(made[2]["mask"], SetReader(folder)[2]["mask"])


def test_images_of_other_programs_are_read(tmp_path: Path) -> None:
    pillow = pytest.importorskip("PIL.Image")
    values = np.arange(5 * 7 * 3, dtype=np.uint8).reshape(5, 7, 3)
    pillow.fromarray(values).save(tmp_path / "a.png")
    assert np.array_equal(read_image(tmp_path / "a.png"), values)
    pillow.fromarray(np.dstack([values, values[..., :1]])).save(tmp_path / "b.png")
    assert read_image(tmp_path / "b.png").shape == (5, 7, 4)
    pillow.fromarray(values[..., 0]).save(tmp_path / "c.png")
    assert np.array_equal(read_image(tmp_path / "c.png"), values[..., 0])
    (tmp_path / "d.png").write_text("no image")
    for name in ["d.png", "e.png"]:
        with pytest.raises(df.InputError, match=name) as caught:
            read_image(tmp_path / name)
        assert caught.value.help


BAD: list[tuple[Any, type[BaseException], str]] = [
    (lambda s, o: Study(o / "no.toml"), df.InputError, "no.toml"),
    (lambda s, o: DataSet(o), df.InputError, "set.json"),
    (lambda s, o: s.run(o, count=0), df.SettingError, "count"),
    (lambda s, o: s.run(o, indices=[5]), df.SettingError, "no image 5"),
    (lambda s, o: s.run(o, indices=[-1]), df.SettingError, "indices: [-1] is out of range"),
    (lambda s, o: s.run(o, threads=-1), df.SettingError, "threads: -1 is out of range"),
    (lambda s, o: s.run(o, jobs=99999), df.SettingError, "jobs: 99999 is out of range"),
    (lambda s, o: s.worker().make(-1), df.SettingError, "index: -1 is out of range"),
    (lambda s, o: df.Scene("no.toml", threads=-1), df.SettingError, "threads: -1 is out of range"),
    (lambda s, o: s.run(o, jobs=0), df.SettingError, "jobs"),
    (lambda s, o: s.run(o, jobs=10**6), df.SettingError, "jobs"),
    (lambda s, o: s.run(o, threads=10**6), df.SettingError, "threads"),
    (lambda s, o: s.run(o, time=0.0), df.SettingError, "time"),
    (lambda s, o: s.run(o, time=float("nan")), df.SettingError, "time"),
    (lambda s, o: s.run(s.path.parent), df.OutputError, "holds"),
    (lambda s, o: s.open(s.path.parent), df.OutputError, "holds"),
    (lambda s, o: s.open(o, count=2_000_000), df.SettingError, "count"),
    (lambda s, o: s.worker(threads=10**6), df.SettingError, "threads"),
    (lambda s, o: s.worker().make(0, time=-1.0), df.SettingError, "time"),
]


@pytest.mark.parametrize(("call", "kind", "says"), BAD)
def test_bad_input_is_an_exception_with_help(
    call: Any, kind: type[BaseException], says: str, study: Study, tmp_path: Path
) -> None:
    with pytest.raises(kind) as caught:
        call(study, tmp_path / "out")
    assert says in str(caught.value), str(caught.value)
    if isinstance(caught.value, df.DunkelfeldError):
        assert caught.value.help and caught.value.problem
    assert not (tmp_path / "out" / "records").exists()


def test_an_error_of_an_image_names_the_study(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace('size = ["90mm", 0, "90mm"]', 'size = ["20mm", 0, "20mm"]'))
    with pytest.raises(df.InputError, match="finds no place") as caught:
        Study(path).worker().make(0)
    assert caught.value.file == str(path)
    copy = pickle.loads(pickle.dumps(caught.value))
    assert copy.help == caught.value.help and copy.file == caught.value.file and str(copy) == str(caught.value)


def test_an_exception_of_progress_ends_a_run(study: Study, folder: Path, tmp_path: Path) -> None:
    def fail(finished: int, *_: object) -> None:
        if finished == 2:
            raise LookupError("enough")

    with pytest.raises(LookupError):
        study.run(tmp_path / "set", jobs=1, progress=fail)
    assert len(DataSet(tmp_path / "set").missing()) == 3
    study.run(tmp_path / "set")
    assert_same(folder, tmp_path / "set")


def test_ctrl_c_keeps_the_finished_images(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace("spp = 8", "spp = 2000"))
    study = Study(path)
    for call in [lambda: study.run(tmp_path / "set", jobs=1), lambda: study.worker().make(0)]:
        timer = threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            cast(Any, call)()
        timer.join()
    assert len(DataSet(tmp_path / "set").missing()) >= 4


def test_threads_share_a_worker(study: Study, folder: Path) -> None:
    worker, made = study.worker(), {}
    threads = [threading.Thread(target=lambda i=i: made.update({i: worker.make(i).files})) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(made) == [0, 1, 2, 3]
    assert all((folder / name).read_bytes() == data for contents in made.values() for name, data in contents.items())


def test_nothing_imports_dask_or_torch() -> None:
    program = (
        "import sys, dunkelfeld, dunkelfeld.distributed; sys.exit('torch' in sys.modules or 'dask' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
