"""Copies of scenes, sensors and films, and requests for more memory than there is."""

import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import dunkelfeld as df
import numpy as np
import pytest

JOB = 'scene = "none"\n[film]\nwidth = 8\nheight = 8\n[budget]\nspp = 4\n[environment]\nradiance = 1\n'


def test_copies_of_relative_paths_work_in_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, job: dict[str, Any]
) -> None:
    (tmp_path / "job.toml").write_text(JOB + '[sensor]\nmodel = "own.toml"\n')
    other = tmp_path / "other"
    other.mkdir()
    presets = Path(__file__).parents[2] / "sensor" / "presets"
    (tmp_path / "own.toml").write_text((presets / "imx174.toml").read_text())
    monkeypatch.chdir(tmp_path)
    made = [df.Scene("job.toml"), df.Scene.from_job(JOB + '[sensor]\nmodel = "own.toml"\n')]
    made[0].set_overrides(seed=4)
    sensors = [df.Sensor("own.toml"), df.Sensor("imx174")]
    films = [scene.render() for scene in made]
    data = pickle.dumps((made, sensors))
    monkeypatch.chdir(other)
    scenes, copies = pickle.loads(data)
    for film, scene in zip(films, scenes, strict=True):
        again = scene.render()
        assert np.array_equal(again.mean, film.mean) and np.array_equal(again.expose(), film.expose())
        assert np.array_equal(film.expose(copies[0], exposure=1e-4), film.expose(copies[1], exposure=1e-4))
    assert repr(copies[1]) == repr(sensors[1])
    # Another process, in another folder.
    program = "import pickle, sys; pickle.loads(sys.stdin.buffer.read())[0][0].render()"
    subprocess.run([sys.executable, "-c", program], input=data, check=True, env=os.environ)


def test_a_copy_of_a_film_has_all_of_it(job: dict[str, Any]) -> None:
    film = df.Scene.from_job(job).render()
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        copy = pickle.loads(pickle.dumps(film, protocol))
        assert copy.stats == film.stats and copy.stats["samples"] == 8 * 16 * 24
        assert copy.material_names == film.material_names == ["ball", "floor"]
        assert np.array_equal(copy.mean, film.mean) and not copy.interrupted
    steps = df.Scene.from_job(job).render_steps(time=100)
    for _ in steps:
        break
    assert pickle.loads(pickle.dumps(steps.film)).interrupted


@pytest.mark.parametrize("frames", [10**9, 2**32 - 1])
def test_too_many_frames_are_refused_before_they_are_allocated(frames: int, job: dict[str, Any]) -> None:
    film = df.Scene.from_job(job).render()
    with pytest.raises((df.OutOfMemoryError, df.SettingError)) as caught:
        film.expose(frames=frames)
    assert caught.value.help and "fewer frames" in caught.value.help
    with pytest.raises(OverflowError):
        film.expose(frames=10**10)


@pytest.mark.parametrize("threads", [1025, 10**6, 2**63])
def test_too_many_threads_are_refused(threads: int, job: dict[str, Any]) -> None:
    with pytest.raises(df.SettingError, match="1024"):
        df.Scene.from_job(job).render(threads=threads)
    with pytest.raises(df.SettingError, match="1024"):
        df.merge(["a.film"], threads=threads)
