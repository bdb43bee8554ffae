"""The package against the command line, its own arrays, and bad input.

The variable `DUNKELFELD` is the path of the program. `.ci/run` runs the tests in an environment of their own.
"""

import json
import os
import pickle
import signal
import struct
import subprocess
import sys
import threading
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import dunkelfeld as df
import numpy as np
import pytest

PROGRAM = os.environ["DUNKELFELD"]


def toml(job: dict[str, Any]) -> str:
    """The job as TOML: JSON is valid for the values used here, except for tables."""
    lines = [f"{k} = {json.dumps(v)}" for k, v in job.items() if not isinstance(v, dict | list)]
    tables = {k: v for k, v in job.items() if isinstance(v, dict)}
    lines += [f"[{k}]\n" + "\n".join(f"{a} = {json.dumps(b)}" for a, b in v.items()) for k, v in tables.items()]
    for entry in job["object"]:
        lines.append("[[object]]\n" + "\n".join(f"{a} = {json.dumps(b)}" for a, b in entry.items()))
    return "\n".join(lines) + "\n"


def read_png(path: Path) -> np.ndarray[Any, np.dtype[Any]]:
    """A grey PNG of 8 or 16 bits."""
    data = path.read_bytes()[8:]
    chunks, size, depth = b"", (0, 0), 8
    while data:
        (length,) = struct.unpack(">I", data[:4])
        kind, body = data[4:8], data[8 : 8 + length]
        if kind == b"IHDR":
            size, depth = struct.unpack(">II", body[:8]), body[8]
        if kind == b"IDAT":
            chunks += body
        data = data[12 + length :]
    rows, step = zlib.decompress(chunks), size[0] * depth // 8
    image = np.zeros((size[1], step), np.uint8)
    for y in range(size[1]):
        filter_type, row = rows[y * (step + 1)], rows[y * (step + 1) + 1 : (y + 1) * (step + 1)]
        assert filter_type in (0, 2)
        image[y] = np.frombuffer(row, np.uint8)
        if filter_type == 2 and y > 0:
            image[y] += image[y - 1]
    return image if depth == 8 else image.view(">u2").astype(np.uint16)


def test_the_bits_are_those_of_the_program(tmp_path: Path, job: dict[str, Any]) -> None:
    path = tmp_path / "job.toml"
    path.write_text(toml(job))
    command = [PROGRAM, "render", str(path), "--seed", "7", "-o", str(tmp_path / "a.png")]
    subprocess.run([*command, "--linear", str(tmp_path / "a-raw.png")], check=True, capture_output=True)
    for scene in (df.Scene(path), df.Scene.from_job(job), df.Scene.from_job(toml(job), folder=tmp_path)):
        film = scene.render(seed=7)
        assert np.array_equal(film.picture(), read_png(tmp_path / "a.png"))
        assert np.array_equal(film.expose()[0], read_png(tmp_path / "a-raw.png"))


def test_arrays_have_their_shapes_and_values(job: dict[str, Any]) -> None:
    film = df.Scene.from_job(job).render()
    for name, shape, dtype in [
        ("mean", (16, 24, 3), np.float32),
        ("variance", (16, 24, 3), np.float32),
        ("normal", (16, 24, 3), np.float32),
        ("albedo", (16, 24, 3), np.float32),
        ("first_light", (16, 24, 3), np.float32),
        ("rest", (16, 24, 3), np.float32),
        ("depth", (16, 24), np.float32),
        ("spp", (16, 24), np.uint32),
        ("object_ids", (16, 24), np.uint32),
        ("material_ids", (16, 24), np.uint32),
    ]:
        array = getattr(film, name)
        assert array.shape == shape and array.dtype == dtype and array.flags.c_contiguous and array.flags.writeable, (
            name
        )
    assert film.shape == (16, 24) and (film.spp == 8).all() and film.stats["samples"] == 8 * 16 * 24
    assert film.object_names[film.object_ids[8, 12]] == "ball"
    assert 0.3 < film.depth[8, 12] < 0.5 and np.isclose(np.linalg.norm(film.normal[8, 12]), 1.0, atol=0.05)
    frames = film.expose("imx174", exposure=1e-4, frames=3)
    assert frames.shape == (3, 16, 24) and frames.dtype == np.uint16
    assert not np.array_equal(frames[0], frames[1])
    assert np.array_equal(frames[1], film.expose(df.Sensor("imx174"), exposure=1e-4, frame=1)[0])
    assert film.expose("imx174", exposure=2e-4).mean() > frames.mean()
    certificate = film.certificate(k=2.0)
    assert certificate["k"] == 2.0 and 0.0 <= certificate["hidden"] <= 1.0 and certificate["ratios"].shape == (16, 24)
    assert film.denoise("builtin").shape == (16, 24, 3)
    assert film._repr_png_().startswith(b"\x89PNG")
    assert df.Scene.from_job(job).render(sensor="none").picture().shape == (16, 24, 3)


def test_a_sensor_file_is_a_path(tmp_path: Path, job: dict[str, Any]) -> None:
    path = tmp_path / "small.toml"
    path.write_text(
        'name = "small"\nsource = "made up"\nbit_depth = 10\npixel_pitch_um = 3\nfull_well_e = 9000\ndark_noise_e = 2\n'
        "gain_e_per_dn = 9\noffset_dn = 10\nquantum_efficiency = [[400, 0.4], [550, 0.7], [850, 0.2]]\n"
    )
    film = df.Scene.from_job(job).render(sensor=path)
    assert df.Sensor(path).bit_depth == 10 and film.stats["sensor"]["name"] == "small"
    assert np.array_equal(film.expose(path), film.expose())
    error = df.DunkelfeldError("of a program")
    assert error.file is None and error.help is None


def test_another_sensor_keeps_the_exposure(job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(dict(job, sensor={"exposure": "40us"}))
    film = scene.render()
    assert np.array_equal(film.expose("imx174"), film.expose("imx174", exposure=40e-6))
    other = scene.render(sensor="imx174").stats["sensor"]
    assert np.isclose(other["exposure_seconds"], 40e-6) and "IMX174" in other["name"]


def test_overrides_change_the_scene_and_are_replaced(job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    before = scene.render().mean
    translate = np.array([0.02, 0.0, np.float32(0.01)])
    scene.set_overrides({"object": [{"name": "ball", "translate": translate}], "film": {"width": np.int64(20)}})
    moved = scene.render()
    assert moved.shape == (16, 20)
    fresh = dict(job, film={"width": 20, "height": 16})
    fresh["object"] = [*job["object"], {"name": "ball", "translate": translate.tolist()}]
    assert np.array_equal(moved.mean, df.Scene.from_job(fresh).render().mean)
    scene.set_overrides('[[object]]\nname = "ball"\nvisible = false\n')
    assert scene.objects == ["floor"]
    scene.set_overrides({})
    assert np.array_equal(scene.render().mean, before)


def test_films_are_saved_copied_and_merged(tmp_path: Path, job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    scene.set_overrides({"film": {"width": 12}})
    film = scene.render()
    film.save(tmp_path / "a.film")
    for copy in (df.Film.load(tmp_path / "a.film"), pickle.loads(pickle.dumps(film))):
        assert np.array_equal(copy.mean, film.mean) and np.array_equal(copy.expose(), film.expose())
        assert copy.object_names == film.object_names
    again = pickle.loads(pickle.dumps(scene))
    assert np.array_equal(again.render().mean, film.mean)
    assert pickle.loads(pickle.dumps(df.Sensor("imx174"))).name == df.Sensor("imx174").name
    path = tmp_path / "job.toml"
    path.write_text(toml(job))
    for i, samples in enumerate(["0..4", "4..8"]):
        part = ["--samples", samples, "--checkpoint", str(tmp_path / f"{i}.film"), "-o", str(tmp_path / "x.png")]
        subprocess.run([PROGRAM, "render", str(path), *part], check=True, capture_output=True)
    merged = df.merge([tmp_path / "0.film", tmp_path / "1.film"])
    assert np.array_equal(merged.mean, df.Scene(path).render(strategy="uniform").mean)


@pytest.mark.parametrize(
    ("make", "kind", "says"),
    [
        (lambda job: df.Scene("missing.glb"), df.InputError, "missing.glb"),
        (lambda job: df.Scene.from_job("scene = 3"), df.InputError, "scene"),
        (lambda job: df.Scene.from_job(cast(Any, ["scene"])), df.SettingError, "list"),
        (lambda job: df.Scene.from_job(cast(Any, {1: 2})), df.SettingError, "key"),
        (lambda job: df.Scene.from_job({"scene": object()}), df.SettingError, "object"),
        (lambda job: df.Scene.from_job({"scene": 2**70}), df.SettingError, "64 bits"),
        (
            lambda job: df.Scene.from_job(job).set_overrides({"environment": {"radiance": float("nan")}}),
            df.SettingError,
            "radiance",
        ),
        (lambda job: df.Scene.from_job(job).set_overrides({"object": [{"name": "lid"}]}), df.InputError, "lid"),
        (lambda job: df.Scene.from_job(job).render(spp=-1), df.SettingError, "spp"),
        (lambda job: df.Scene.from_job(job).render(spp=float("nan")), df.SettingError, "spp"),
        (lambda job: df.Scene.from_job(job).render(width=0), df.SettingError, "width"),
        (lambda job: df.Scene.from_job(job).render(camera="left"), df.SettingError, "left"),
        (lambda job: df.Scene.from_job(job).render(strategy=cast(Any, "best")), df.SettingError, "best"),
        (lambda job: df.Scene.from_job(job).render(exposure=-1.0), df.SettingError, "exposure"),
        (lambda job: df.Scene.from_job(job).render().expose(frames=0), df.SettingError, "frames"),
        (lambda job: df.Scene.from_job(job).render().expose(exposure_noise=cast(Any, "loud")), df.SettingError, "loud"),
        (lambda job: df.Scene.from_job(job).render().certificate(k=float("nan")), df.SettingError, "k"),
        (lambda job: df.Sensor("imx999"), df.InputError, "imx999"),
        (lambda job: df.merge([]), df.SettingError, "parts"),
        (lambda job: df.Film.load(__file__), df.InputError, "checkpoint"),
    ],
)
def test_bad_input_is_an_exception_with_help(make: Any, kind: type[df.DunkelfeldError], says: str, job: Any) -> None:
    with pytest.raises(kind) as caught:
        make(job)
    assert isinstance(caught.value, df.DunkelfeldError) and says in str(caught.value), str(caught.value)
    assert caught.value.help and caught.value.problem


def test_progress_is_reported_and_its_exception_ends_the_render(job: dict[str, Any]) -> None:
    scene, seen = df.Scene.from_job(job), []
    # Reports come ten times a second at most, so that a short render has none of its rounds.
    scene.render(time=1.5, progress=lambda *state: seen.append(state))
    assert "refine" in {stage for stage, *_ in seen} and all(0 <= fraction <= 1 for _, fraction, *_ in seen)

    def fail(stage: str, *_: object) -> None:
        raise ValueError(stage)

    with pytest.raises(ValueError):
        scene.render(spp=1e6, progress=fail)


def test_captures_are_films_by_name(job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    with pytest.raises(df.SettingError, match="no captures"):
        scene.render_captures()
    scene.set_overrides(capture=[{"name": "all"}, {"name": "half", "lights": {"environment": 0.5}, "exposure": "2ms"}])
    films = scene.render_captures(sensor="imx250", exposure=0.001)
    assert list(films) == ["all", "half"]
    assert np.array_equal(films["all"].mean, scene.render().mean)
    assert np.allclose(films["half"].mean, 0.5 * films["all"].mean, rtol=1e-6)
    assert films["half"].stats["capture"] == "half" and films["half"].stats["sensor"]["exposure_seconds"] == 0.001
    with pytest.raises(TypeError):
        scene.render_captures(**cast(Any, {"samples": (0, 4)}))


def test_a_progress_function_cannot_wait_for_its_own_scene(job: dict[str, Any]) -> None:
    scene, other = df.Scene.from_job(job), df.Scene.from_job(job)
    caught: list[str] = []

    def use(*_: object) -> None:
        assert other.objects == ["ball", "floor"]
        for use_it in (lambda: scene.objects, scene.render, scene.inspect, lambda: scene.set_overrides({})):
            try:
                use_it()
            except df.SettingError as e:
                caught.append(str(e))

    scene.render(progress=use)
    assert len(caught) >= 4 and len(caught) % 4 == 0 and "progress function" in caught[0]


def test_ctrl_c_keeps_the_film(job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(df.Interrupted) as caught:
        scene.render(time=120)
    assert caught.value.film.interrupted and caught.value.film.spp.sum() > 0
    assert scene.render().spp.sum() == 8 * 16 * 24, "the scene is as before"


def test_threads_share_a_scene_and_the_interpreter_runs_meanwhile(job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    expected, films, ticks = scene.render().mean, [], 0
    threads = [threading.Thread(target=lambda: films.append(scene.render().mean)) for _ in range(4)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        ticks += 1
        time.sleep(0.001)
    assert len(films) == 4 and all(np.array_equal(film, expected) for film in films)


def values_of(scene: df.Scene) -> list[np.ndarray[Any, Any]]:
    """Results of all work on threads."""
    film = scene.render()
    return [film.mean, film.expose()[0], film.picture(), film.denoise("builtin"), film.noise_map().ratios]


def test_a_forked_process_renders(job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    expected = values_of(scene)
    child = os.fork()
    if child == 0:
        same = [np.array_equal(a, b, equal_nan=True) for a, b in zip(values_of(scene), expected, strict=True)]
        os._exit(0 if all(same) else 1)
    for _ in range(600):
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            assert status == 0
            return
        time.sleep(0.1)
    os.kill(child, signal.SIGKILL)
    pytest.fail("the child does not end")


MANY_RENDERS = """
import json, os, sys
from pathlib import Path
import dunkelfeld as df

scene = df.Scene.from_job(json.loads(sys.argv[1]))

def render(count):
    for i in range(count):
        # The tree of a changed scene has some megabytes.
        if i % 8 == 0:
            scene.set_overrides({"object": [{"name": "ball", "translate": [0.0001 * i, 0, 0]}]})
        scene.render(spp=1, width=8, height=8).expose(frames=1)
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

render(100)
before = render(100)
print(render(800) - before)
"""


def test_a_thousand_renders_keep_their_memory(job: dict[str, Any]) -> None:
    # With an arena for each thread, glibc keeps up to 15 MB of freed memory in pieces; with one, that are given back, 2 MB.
    memory = {"MALLOC_ARENA_MAX": "1", "MALLOC_TRIM_THRESHOLD_": "100000", "MALLOC_MMAP_THRESHOLD_": "65536"}
    command = [sys.executable, "-c", MANY_RENDERS, json.dumps(job)]
    run = subprocess.run(command, env={**os.environ, **memory}, check=True, capture_output=True, text=True)
    assert int(run.stdout) < 6 << 20, run.stdout


def test_a_progress_function_reads_another_film(job: dict[str, Any]) -> None:
    scene, film = df.Scene.from_job(job), df.Scene.from_job(job).render()
    expected = film.mean
    lock = threading.Lock()

    def progress(*_state: object) -> None:
        with lock:
            assert np.array_equal(film.mean, expected) and film.expose().shape == (1, 16, 24)

    for threads in (2, 16):
        scene.render(spp=2000, threads=threads, progress=progress)


def test_parts_are_merged_to_the_film_of_one_render(tmp_path: Path, job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    parts = [tmp_path / "a.film", tmp_path / "b.film"]
    for i, part in enumerate(parts):
        scene.render(samples=(4 * i, 4 * i + 4), checkpoint=part)
    assert np.array_equal(df.merge(parts).mean, scene.render(spp=8, strategy="uniform").mean)
    # A part is a film of its samples.
    assert np.array_equal(df.Film.load(parts[0]).mean, scene.render(samples=(0, 4)).mean)
    saved = tmp_path / "saved.film"
    scene.render().save(saved)
    uses: list[Callable[[], object]] = [
        lambda: df.merge([saved]),
        lambda: scene.render(checkpoint=saved),
    ]
    for use in uses:
        with pytest.raises(df.InputError, match="saved film"):
            use()


def test_ctrl_c_ends_the_wait_for_a_scene(job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    began = threading.Event()
    stop = False

    def stop_or_begin() -> None:
        began.set()
        if stop:
            raise RuntimeError("enough")

    def render() -> None:
        with pytest.raises(RuntimeError, match="enough"):
            scene.render(time=20, progress=lambda *_: stop_or_begin())

    busy = threading.Thread(target=render)
    busy.start()
    began.wait()
    waits: list[Callable[[], object]] = [lambda: scene.render(spp=1), lambda: scene.objects]
    for use in waits:
        threading.Timer(0.3, lambda: signal.raise_signal(signal.SIGINT)).start()
        start = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            use()
        assert time.monotonic() - start < 5.0
    stop = True
    busy.join()


def test_arrays_are_the_layers_of_an_exr(tmp_path: Path, job: dict[str, Any]) -> None:
    exr = pytest.importorskip("OpenEXR")
    path = tmp_path / "job.toml"
    path.write_text(toml(job))
    out = ["-o", str(tmp_path / "a.png"), "--exr", str(tmp_path / "a.exr")]
    subprocess.run([PROGRAM, "render", str(path), "--seed", "7", *out], check=True, capture_output=True)
    layers = exr.File(str(tmp_path / "a.exr"), separate_channels=True).channels()
    film = df.Scene(path).render(seed=7)
    for name, array in [
        ("{}", film.mean),
        ("variance.{}", film.variance),
        ("albedo.{}", film.albedo),
        ("first_light.{}", film.first_light),
    ]:
        for c, channel in enumerate("RGB"):
            assert np.array_equal(layers[name.format(channel)].pixels, array[..., c]), name
    for c, channel in enumerate("XYZ"):
        assert np.array_equal(layers[f"normal.{channel}"].pixels, film.normal[..., c])
    assert np.array_equal(layers["depth.Z"].pixels, film.depth)
    assert np.array_equal(layers["spp.Y"].pixels, film.spp)
    assert np.array_equal(layers["id.object"].pixels, film.object_ids)
    assert np.array_equal(layers["id.material"].pixels, film.material_ids)
