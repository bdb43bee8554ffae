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
    presets = Path(__file__).parents[3] / "camera" / "sensor" / "presets"
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
    limited = pickle.loads(pickle.dumps(df.Scene.from_job(job).render(memory="300MB")))
    with pytest.raises(df.OutOfMemoryError, match="300 MB"):
        limited.expose(frames=10**6)
    steps = df.Scene.from_job(job).render_steps(time=100)
    for _ in steps:
        break
    assert pickle.loads(pickle.dumps(steps.film)).interrupted


def test_a_film_of_a_file_writes_the_same_files(job: dict[str, Any], tmp_path: Path) -> None:
    film = df.Scene.from_job(job).render(denoise="builtin")
    film.save(tmp_path / "a.film")
    loaded = df.Film.load(tmp_path / "a.film")
    assert loaded.material_names == ["ball", "floor"]
    for name, of in (("made", film), ("loaded", loaded)):
        of.save_files(image=tmp_path / f"{name}.png", exr=tmp_path / f"{name}.exr")
    for end in ("png", "exr"):
        assert (tmp_path / f"made.{end}").read_bytes() == (tmp_path / f"loaded.{end}").read_bytes(), end
    plain = df.Scene.from_job(job).render()
    plain.save_image(tmp_path / "plain.png")
    assert (tmp_path / "plain.png").read_bytes() != (tmp_path / "loaded.png").read_bytes()


# A view of one number, whose copy would need gigabytes. The last numbers are sides [pixels] and the bytes of a pixel.
VAST = """
import resource, sys
import dunkelfeld as df, numpy as np
side, channels = int(sys.argv[2]), int(sys.argv[3])
image = np.broadcast_to(np.dtype(sys.argv[4]).type(1), (side, side) + (channels,) * (channels > 1))
small = np.ones((4, 4, 3), np.float32)
resource.setrlimit(resource.RLIMIT_AS, (3_000_000_000, 3_000_000_000))
try:
    eval(sys.argv[1])
except (df.OutOfMemoryError, df.SettingError) as error:
    assert error.help, error
    print(type(error).__name__)
"""


@pytest.mark.parametrize(
    ("call", "side", "channels", "kind", "error"),
    [
        ("df.expose_radiance(image)", 33000, 3, "f4", "SettingError"),
        ("df.expose_radiance(image)", 14000, 3, "f8", "SettingError"),
        ("df.expose_radiance(image, memory='100MB')", 8000, 3, "f8", "OutOfMemoryError"),
        ("df.denoise_radiance(image, memory='100MB')", 8000, 3, "f4", "OutOfMemoryError"),
        ("df.denoise_radiance(small, variance=image)", 40000, 3, "f4", "SettingError"),
        ("df.denoise_radiance(small, depth=image)", 40000, 1, "f8", "SettingError"),
        ("df.Scene.from_job('scene = \"none\"').render(replay=image)", 60000, 1, "u4", "SettingError"),
        ("df.Scene.from_job('scene = \"none\"').render(replay=image)", 60000, 1, "i8", "SettingError"),
    ],
)
def test_vast_images_are_refused_before_they_are_copied(
    call: str, side: int, channels: int, kind: str, error: str
) -> None:
    arguments = [sys.executable, "-c", VAST, call, str(side), str(channels), kind]
    done = subprocess.run(arguments, check=False, capture_output=True, text=True, env=os.environ)
    assert done.stdout.strip() == error, done.stderr


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
