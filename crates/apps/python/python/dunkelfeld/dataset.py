"""Data sets: studies, the folders that they are made in, and readers for training.

Make a set, and read its images::

    from dunkelfeld.dataset import SetReader, Study

    Study("study.toml").run("set")
    reader = SetReader("set")
    reader[0]["image"]                     # uint8, (height, width) or (height, width, 3), gamma 2.2
    reader[0]["mask"]                      # uint16, (height, width), ids of instances, 0 for none
    reader[0]["annotations"]               # dictionaries with the keys of COCO

A `SetReader` is a map-style data set of PyTorch (`torch.utils.data.DataLoader` takes it) without an import of torch.
`dunkelfeld.distributed.make` makes a set on many machines.
"""

from __future__ import annotations

import io
import json
import operator
import os
import re
import tarfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, SupportsIndex

from ._native import DataSet, Made, Study, StudyWorker, read_image
from ._results import SetSummary, Verified

__all__ = ["DataSet", "Made", "SetReader", "SetSummary", "Study", "StudyWorker", "Verified", "read_image", "webdataset"]

LAYERS = {
    "image": "images",
    "linear": "linear",
    "mask": "masks",
    "semantic": "semantic",
    "coverage": "coverage",
    "depth": "depth",
    "normals": "normals",
}
"""The arrays of an image, and their folders in a set."""


class SetReader:
    """The finished images of a set as a sequence of dictionaries, in the order of their indices.

    `layers` are the names of the arrays to read (default: all that the set has), and `transform` is a function that gets
    the dictionary and returns the item. An item has these keys; arrays that the set does not have are left out:

    - `index`: index of the image in the set
    - `image`: uint8, (height, width) or (height, width, 3), gamma 2.2
    - `linear`: uint16, (height, width), grey values [DN]
    - `mask`: uint16, (height, width), id of the instance, 0 for none
    - `semantic`: uint8, (height, width), id of the category, 0 for none
    - `coverage`: uint16, (height, width), share of the pixel that its instance covers, 65535 for all
    - `depth`: uint16, (height, width), depth along the axis of the camera [0.1 mm], 0 for none
    - `normals`: uint16, (height, width, 3), 32768 + 32767 n in the frame of the camera (x right, y down, z forward)
    - `annotations`: dictionaries with the keys of COCO, `bbox` is left, top, width, height [pixels]
    - `camera`, `poses`: camera matrix [pixels] and poses of the objects [mm]; `camera` is None for a telecentric lens
    - `record`: draws, instances, certificate, and size and hash of each file

    A reader contains the images that are finished when it is opened. It can be pickled.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        layers: Iterable[str] | None = None,
        transform: Callable[[dict[str, Any]], Any] | None = None,
    ) -> None:
        self._set = DataSet(folder)
        self.folder = self._set.path
        self.layers = tuple(LAYERS) if layers is None else tuple(layers)
        unknown = [name for name in self.layers if name not in LAYERS]
        if unknown:
            raise ValueError(f"unknown layer {unknown[0]!r}; the layers are {', '.join(LAYERS)}")
        self.transform = transform
        about = json.loads((self.folder / "set.json").read_text(encoding="utf-8"))
        self.name: str = about["study"]
        self.categories: list[dict[str, Any]] = about["categories"]
        missing = set(self._set.missing())
        self.indices = [index for index in range(self._set.count) if index not in missing]

    def __len__(self) -> int:
        return len(self.indices)

    def __getitem__(self, position: SupportsIndex) -> Any:
        index = self.indices[operator.index(position)]
        record = self._set.record(index)
        item: dict[str, Any] = {"index": index}
        for layer in self.layers:
            name = _file_of(record, LAYERS[layer])
            if name is not None:
                item[layer] = read_image(self.folder / name)
        labels = json.loads((self.folder / f"labels/{index:06}.json").read_text(encoding="utf-8"))
        item.update((key, labels[key]) for key in ("annotations", "camera", "poses"))
        item["record"] = record
        return item if self.transform is None else self.transform(item)

    def __iter__(self) -> Iterator[Any]:
        return (self[position] for position in range(len(self)))

    def __repr__(self) -> str:
        return f"SetReader({self.folder}, {len(self)} images)"


def _file_of(record: dict[str, Any], folder: str) -> str | None:
    return next((name for name in record["files"] if name.startswith(f"{folder}/")), None)


def webdataset(
    folder: str | os.PathLike[str], output: str | os.PathLike[str], images_per_shard: int = 1000
) -> list[Path]:
    """Writes the finished images of a set as shards of WebDataset, tar files in the folder `output`. Returns their paths.

    Shards are named `STUDY-000000.tar` and so on. The key of an image is its index with six digits. Its members are the
    files of the set, unchanged: `KEY.png` or `KEY.jpg` is the image, `KEY.mask.png`, `KEY.linear.tif` and so on are
    arrays, `KEY.json` has the annotations, `KEY.record.json` the record, `KEY.txt` the boxes of YOLO. The same set gives
    the same bytes. A shard appears whole or not at all. Shards of this name with higher numbers, of an earlier call with more
    images or smaller shards, are removed: they would contain images twice.
    """
    if images_per_shard < 1:
        raise ValueError(f"images_per_shard is {images_per_shard}; pass 1 or more")
    reader = SetReader(folder)
    target = Path(output)
    target.mkdir(parents=True, exist_ok=True)
    members = {f"{there}/": f".{layer}" for layer, there in LAYERS.items()} | {"images/": "", "labels/": "", "raw/": ""}
    shards = []
    for number, start in enumerate(range(0, len(reader), images_per_shard)):
        shard = target / f"{Path(reader.name).name}-{number:06}.tar"
        partial = shard.with_name(f".{shard.name}.{os.getpid()}.partial")
        try:
            with tarfile.open(partial, "w", format=tarfile.USTAR_FORMAT) as tar:
                for index in reader.indices[start : start + images_per_shard]:
                    record = f"records/{index:06}.json"
                    names = json.loads((reader.folder / record).read_text(encoding="utf-8"))["files"]
                    for name in sorted(names):
                        place = next((place for place in members if name.startswith(place)), None)
                        if place is not None:
                            _add(tar, f"{index:06}{members[place]}{Path(name).suffix}", reader.folder / name)
                    _add(tar, f"{index:06}.record.json", reader.folder / record)
            partial.replace(shard)
        finally:
            partial.unlink(missing_ok=True)
        shards.append(shard)
    name = re.escape(Path(reader.name).name)
    for file in target.iterdir():
        found = re.fullmatch(rf"{name}-(\d{{6,}})\.tar", file.name)
        if found and int(found[1]) >= len(shards):
            file.unlink()
    return shards


def _add(tar: tarfile.TarFile, name: str, file: Path) -> None:
    content = file.read_bytes()
    # No time and no owner, so that the bytes depend on the set alone.
    entry = tarfile.TarInfo(name)
    entry.size = len(content)
    tar.addfile(entry, io.BytesIO(content))
