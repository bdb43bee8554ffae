"""Entries of a job as classes, against the reader of jobs and its page."""

import copy
import pickle
import re
import runpy
from pathlib import Path
from typing import Any, cast

import dunkelfeld as df
import numpy as np
import pytest
from dunkelfeld import _native

PAGE = Path(__file__).parents[4] / "docs" / "job-file.md"
CLASSES: dict[str, tuple[Any, Any, str]] = {
    "camera": (df.Camera, df.CameraKeys, "## `[camera]`"),
    "lens": (None, df.LensKeys, "## `[lens]`"),
    "light": (df.Light, df.LightKeys, "## `[[light]]`"),
    "material": (df.Material, df.MaterialKeys, "## `[[material]]`"),
    "object": (df.Object, df.ObjectKeys, "## `[[object]]`"),
}


@pytest.mark.parametrize("table", CLASSES)
def test_keys_are_those_of_the_reader_and_of_the_page(table: str) -> None:
    cls, typed, title = CLASSES[table]
    keys = set(_native.job_keys(table))
    assert keys == typed.__required_keys__ | typed.__optional_keys__
    section = PAGE.read_text().split(f"\n{title}\n")[1].split("\n## ")[0]
    assert keys == set(re.findall(r"^\| `([^`]+)` \|", section, re.MULTILINE))
    if cls is not None:
        assert set(typed.__required_keys__) == set(cls._required)
        for key in typed.__required_keys__:
            with pytest.raises(df.InputError, match=f"the key `{key}` is missing"):
                df.Scene.from_job({"scene": "none", table: [{}]})


@pytest.mark.parametrize("cls", [df.Camera, df.Light, df.Material, df.Object])
def test_an_unknown_key_names_the_valid_ones(cls: Any) -> None:
    name = {"name": "a"}
    for keys in ({"nmae": "a"}, {"with space": 1}, {"": 1}):
        with pytest.raises(df.SettingError) as caught:
            cls(**name, **keys)
        assert caught.value.help and all(key in caught.value.help for key in _native.job_keys(cls._table))
    with pytest.raises(df.SettingError, match='did you mean "name"'):
        cls(**name, nmae=1)
    with pytest.raises(TypeError):
        cls("a")
    for table in ("scene", ""):
        with pytest.raises(df.SettingError, match="table"):
            _native.check_job_keys(table, [], [])


def test_a_material_and_an_object_need_a_name() -> None:
    for cls in (df.Material, df.Object):
        with pytest.raises(df.SettingError, match="name"):
            cast(Any, cls)()


def test_entries_are_dictionaries() -> None:
    lamp = df.Light(kind="ring", diameter="80mm", power=2)
    assert lamp == {"kind": "ring", "diameter": "80mm", "power": 2} and isinstance(lamp, dict)
    assert repr(lamp) == "Light(kind='ring', diameter='80mm', power=2)"
    assert eval(repr(lamp), {"Light": df.Light}) == lamp
    for other in (copy.deepcopy(lamp), pickle.loads(pickle.dumps(lamp))):
        assert other == lamp and type(other) is df.Light


def test_entries_are_parts_of_jobs_and_overrides(job: dict[str, Any]) -> None:
    translate = np.array([0.01, 0, 0])
    ball = df.Object(name="ball", kind="sphere", diameter="100mm", material="red", translate=translate)
    floor = df.Object(name="floor", kind="plane", size=["500mm", "500mm"], translate=[0, "-60mm", 0])
    red = df.Material(name="red", new=True, base_color=[0.8, 0.1, 0.1])
    camera = df.Camera(look_at=[0, 0, 0], position=[0, 0.3, 0.4], lens={"f_number": 2.8})
    whole = dict(job, object=[ball, floor], material=[red], camera=camera)
    scene = df.Scene.from_job(whole)
    assert "red" in scene.materials
    first = scene.render().mean
    lamp = df.Light(kind="point", name="lamp", position=[0, 1, 0], power="5W")
    scene.set_overrides(light=[lamp], material=[df.Material(name="floor", base_color=0.1)])
    by_keywords = scene.render().mean
    scene.set_overrides({"light": [lamp]}, material=[df.Material(name="floor", base_color=0.1)])
    assert np.array_equal(scene.render().mean, by_keywords) and not np.array_equal(by_keywords, first)
    scene.set_overrides()
    assert np.array_equal(scene.render().mean, first)


def test_overrides_are_given_once(job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    with pytest.raises(df.SettingError, match="once"):
        scene.set_overrides({"seed": 1}, seed=2)
    with pytest.raises(df.SettingError, match="dictionary"):
        scene.set_overrides("seed = 1", frame=2)
    with pytest.raises(df.InputError, match="sede"):
        scene.set_overrides(sede=1)


def test_whole_numbers_beyond_64_bits_with_sign_are_errors_in_a_job(job: dict[str, Any]) -> None:
    for seed in (2**63, 2**64 - 1, 2**64, -(2**63) - 1):
        with pytest.raises(df.SettingError, match="9223372036854775807") as caught:
            df.Scene.from_job(dict(job, seed=seed))
        assert caught.value.place == "seed" and "`render`" in str(caught.value.help)
    scene = df.Scene.from_job(dict(job, seed=2**63 - 1))
    large = scene.render(seed=2**64 - 1)
    assert large.stats["seed"] == 2**64 - 1 or not np.array_equal(large.mean, scene.render().mean)


def test_the_example_of_the_page_is_a_scene(tmp_path: Path) -> None:
    text = (PAGE.parent / "python.md").read_text().split("## Entries of a job")[1]
    example = text.split("```python\n")[1].split("```")[0]
    (tmp_path / "example.py").write_text(example)
    film = runpy.run_path(str(tmp_path / "example.py"))["scene"].render(spp=4, width=16, height=16)
    assert "part" in film.object_names and film.mean.max() > 0
