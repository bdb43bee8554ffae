"""Files, replays, effects, images of other renderers, first jobs and single samples, against the command line."""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any, cast

import dunkelfeld as df
import numpy as np
import pytest

PROGRAM = os.environ["DUNKELFELD"]
TEXT = """
scene = "none"
film = { width = 24, height = 16 }
budget = { spp = 8 }
[camera]
look_at = [0, 0, 0]
position = [0, 0.3, 0.4]
vertical_fov = "50deg"
[environment]
radiance = 1
[[object]]
name = "ball"
kind = "sphere"
diameter = "100mm"
[[object]]
name = "floor"
kind = "plane"
size = ["500mm", "500mm"]
translate = [0, "-60mm", 0]
[[material]]
name = "ball"
transmission = 1
ior = 1.5
solid = true
"""
FILES = {"image": "a.png", "linear": "a.tif", "exr": "a.exr", "stats": "a.json", "plan": "plan.exr"}
FLAGS = {"image": "--output", "linear": "--linear", "exr": "--exr", "stats": "--stats", "plan": "--plan"}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "station.toml"
    file.write_text(TEXT)
    return file


def run(*arguments: object) -> str:
    """The standard output of the program."""
    command = [PROGRAM, *(str(argument) for argument in arguments)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def program_files(path: Path, folder: Path, *flags: object, left_out: str = "") -> dict[str, bytes]:
    """The files that the program writes."""
    folder.mkdir()
    names = {key: folder / name for key, name in FILES.items() if key != left_out}
    outputs = [part for key, name in names.items() for part in (FLAGS[key], name)]
    run("render", path, *flags, *outputs)
    return {key: name.read_bytes() for key, name in names.items()}


def saved_files(film: df.Film, folder: Path, left_out: str = "") -> dict[str, bytes]:
    """The files that a film writes."""
    folder.mkdir()
    names = {key: folder / name for key, name in FILES.items() if key != left_out}
    film.save_files(**names)
    return {key: name.read_bytes() for key, name in names.items()}


def without_times(stats: bytes) -> dict[str, Any]:
    """Statistics without times and memory, which depend on the machine."""
    found: dict[str, Any] = json.loads(stats)
    for key in ("seconds", "total_seconds", "samples_per_second", "memory"):
        del found[key]
    if found["denoise"] is not None:
        del found["denoise"]["seconds"]
    return found


def check_same(film_files: dict[str, bytes], program: dict[str, bytes]) -> None:
    assert film_files.keys() == program.keys()
    for key, content in program.items():
        if key == "stats":
            assert without_times(film_files[key]) == without_times(content)
        else:
            assert film_files[key] == content, key


@pytest.mark.parametrize(
    ("flags", "keywords"),
    [
        (["--seed", "7"], {"seed": 7}),
        (["--denoise", "builtin", "--frame", "3"], {"denoise": "builtin", "frame": 3}),
        (["--vignetting", "cos4", "--exposure-noise", "matched"], {"vignetting": "cos4", "exposure_noise": "matched"}),
        (["--allocate", "uniform"], {"strategy": "uniform"}),
        (["--sensor", "none"], {"sensor": "none"}),
    ],
)
def test_files_of_a_film_are_those_of_the_program(
    flags: list[str], keywords: dict[str, Any], path: Path, tmp_path: Path
) -> None:
    left_out = "linear" if "none" in flags else ""
    program = program_files(path, tmp_path / "program", *flags, left_out=left_out)
    film = df.Scene(path).render(**keywords)
    check_same(saved_files(film, tmp_path / "film", left_out), program)
    check_same(saved_files(pickle.loads(pickle.dumps(film)), tmp_path / "copy", "linear"), without_linear(program))


def without_linear(files: dict[str, bytes]) -> dict[str, bytes]:
    return {key: content for key, content in files.items() if key != "linear"}


def test_single_files_and_films_of_files(path: Path, tmp_path: Path) -> None:
    program = program_files(path, tmp_path / "program")
    film = df.Scene(path).render()
    film.save(tmp_path / "a.film")
    for made in (film, df.Film.load(tmp_path / "a.film")):
        made.save_image(tmp_path / "b.png")
        made.save_linear(tmp_path / "b.tif")
        made.save_exr(tmp_path / "b.exr")
        made.save_plan(tmp_path / "c.exr")
        for key, name in {"image": "b.png", "linear": "b.tif", "exr": "b.exr", "plan": "c.exr"}.items():
            assert (tmp_path / name).read_bytes() == program[key], key
            (tmp_path / name).unlink()
    film.save_stats(tmp_path / "b.json")
    assert json.loads((tmp_path / "b.json").read_text()) == film.stats
    with pytest.raises(df.SettingError, match="statistics"):
        df.Film.load(tmp_path / "a.film").save_stats(tmp_path / "c.json")
    assert not (tmp_path / "c.json").exists()


def test_no_file_replaces_an_input(path: Path, tmp_path: Path) -> None:
    scene, plan = df.Scene(path), tmp_path / "plan.exr"
    first = scene.render(spp=2)
    first.save_plan(plan)
    film = scene.render(replay=plan)
    before = {file: file.read_bytes() for file in (path, plan)}
    for made in (film, pickle.loads(pickle.dumps(film))):
        for save, file in [(made.save_exr, plan), (made.save_plan, plan), (made.save, path)]:
            with pytest.raises(df.OutputError) as caught:
                save(file)
            assert caught.value.help and caught.value.file
    (tmp_path / "link.exr").symlink_to(plan)
    with pytest.raises(df.OutputError, match="plan to replay"):
        film.save_exr(tmp_path / "link.exr")
    assert {file: file.read_bytes() for file in (path, plan)} == before
    # The plan belonged to one render alone.
    first.save_plan(plan)
    scene.render(spp=1).save_plan(plan)


@pytest.mark.parametrize(
    ("call", "kind", "says"),
    [
        (lambda f, p: f.save_image(p / "a.jpg"), df.OutputError, "png"),
        (lambda f, p: f.save_exr(p / "none" / "a.exr"), df.OutputError, "folder"),
        (lambda f, p: f.save_files(exr=p / "a.exr", plan=p / "a.exr"), df.OutputError, "two outputs"),
        (lambda f, p: f.save_files(), df.SettingError, "output"),
        (lambda f, p: df.Film.load(p / "plain.film").save_linear(p / "a.png"), df.OutputError, "sensor"),
        (lambda f, p: f.certificate(k=1e-4), df.SettingError, "0.001"),
        (lambda f, p: f.noise_map(k=1001), df.SettingError, "1000"),
    ],
)
def test_bad_files_are_refused(call: Any, kind: type[df.DunkelfeldError], says: str, path: Path) -> None:
    scene = df.Scene(path)
    scene.render(sensor="none", spp=1).save(path.parent / "plain.film")
    film = scene.render(spp=1)
    before = sorted(path.parent.iterdir())
    with pytest.raises(kind, match=says) as caught:
        call(film, path.parent)
    assert caught.value.help and sorted(path.parent.iterdir()) == before


def test_a_replay_has_the_bits_of_its_render(path: Path, tmp_path: Path) -> None:
    scene = df.Scene(path)
    film = scene.render(time=0.1, seed=5, frame=2)
    assert film.plan.dtype == np.uint32 and film.plan.shape == (16, 24) and np.array_equal(film.plan, film.spp)
    film.save_files(exr=tmp_path / "film.exr", plan=tmp_path / "plan.exr")
    plans: list[Any] = [film, tmp_path / "film.exr", str(tmp_path / "plan.exr"), pickle.loads(pickle.dumps(film))]
    for plan in plans:
        again = scene.render(replay=plan)
        assert np.array_equal(again.mean, film.mean) and again.stats["allocation"] == "replay"
        assert np.array_equal(again.expose(), film.expose())
    for counts in (film.plan, film.plan.astype(np.int64), np.asfortranarray(film.plan)):
        of_array = scene.render(replay=counts, seed=5, frame=2)
        assert np.array_equal(of_array.mean, film.mean)
    # The program has the same samples from that plan, and a film those of a plan of the program.
    run("render", path, "--replay", tmp_path / "plan.exr", "--exr", tmp_path / "again.exr", "-o", tmp_path / "a.png")
    assert (tmp_path / "again.exr").read_bytes() == (tmp_path / "film.exr").read_bytes()
    # The settings of the scene stay as they are.
    assert (scene.render().spp == 8).all()


BAD: list[tuple[dict[str, Any], type[BaseException], str]] = [
    ({"replay": "none.exr"}, df.InputError, "none.exr"),
    ({"replay": np.zeros((4, 4), np.uint32)}, df.SettingError, "no samples"),
    ({"replay": np.full((4, 4), -1)}, df.SettingError, "-1"),
    ({"replay": np.ones((4, 4), np.uint32), "width": 8}, df.SettingError, "8 x 4"),
    ({"replay": np.ones((4, 4), np.uint32), "spp": 4}, df.SettingError, "limit"),
    ({"replay": np.ones((4, 4), np.uint32), "strategy": "uniform"}, df.SettingError, "strategy"),
    ({"replay": np.ones(4, np.uint32)}, TypeError, "shape"),
    ({"replay": np.ones((4, 4))}, TypeError, "uint32"),
    ({"replay": 3}, TypeError, "int"),
    ({"vignetting": "cos3"}, df.SettingError, "cos4"),
    ({"denoise": "loud"}, df.SettingError, "builtin"),
    ({"denoise": "oidn", "oidn": "none.so"}, df.SettingError, "none.so"),
    ({"exposure_noise": "matched", "sensor": "none"}, df.InputError, "sensor"),
    ({"memory": 1000}, df.OutOfMemoryError, "memory"),
    ({"memory": "much"}, df.SettingError, "2GiB"),
    ({"checkpoint_every": 1.0}, df.SettingError, "checkpoint"),
    ({"checkpoint_every": -1.0, "checkpoint": "a.film"}, df.SettingError, "out of range"),
]


@pytest.mark.parametrize(("keywords", "kind", "says"), BAD)
def test_bad_settings_are_refused(
    keywords: dict[str, Any], kind: type[BaseException], says: str, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(path.parent)
    scene = df.Scene(path)
    with pytest.raises(kind) as caught:
        scene.render(**keywords)
    assert says in str(caught.value), str(caught.value)
    if isinstance(caught.value, df.DunkelfeldError):
        assert caught.value.help
    assert [file.name for file in path.parent.iterdir()] == ["station.toml"]


def test_a_checkpoint_is_written_and_continued(path: Path, tmp_path: Path) -> None:
    scene, checkpoint = df.Scene(path), tmp_path / "a.film"
    scene.render(samples=(0, 4), checkpoint=checkpoint, checkpoint_every=0)
    assert np.array_equal(df.Film.load(checkpoint).mean, scene.render(samples=(0, 4)).mean)


def test_effects_are_left_out(path: Path, tmp_path: Path) -> None:
    whole = df.Scene(path)
    names = {entry["name"]: entry["on"] for entry in whole.inspect()["effects"]}
    assert whole.effects == [name for name, on in names.items() if on] and whole.without == []
    assert {"rough-refraction", "environment"} <= set(whole.effects)
    program = program_files(path, tmp_path / "program", "--without", "environment,every-light")
    scene = df.Scene(path, without=["environment", "every-light"])
    assert scene.without == ["environment", "every-light"] and "environment" not in scene.effects
    check_same(saved_files(scene.render(), tmp_path / "film"), program)
    others = [
        pickle.loads(pickle.dumps(scene)),
        df.Scene.from_job(TEXT, without=("environment", "every-light")),
    ]
    for i, other in enumerate(others):
        assert other.without == scene.without
        check_same(saved_files(other.render(), tmp_path / str(i)), program)
    scene.set_overrides(film={"width": 12})
    assert scene.render().stats["without"] == ["environment", "every-light"]
    assert df.Scene(path, without="every-light").without == ["every-light"]
    for name in ("every-lamp", next(name for name in names if name not in run_names())):
        with pytest.raises(df.SettingError, match="cover-connection") as caught:
            df.Scene(path, without=name)
        assert name in str(caught.value)


def run_names() -> list[str]:
    """The effects that the program can leave out."""
    refused = subprocess.run(
        [PROGRAM, "render", "a.glb", "--without", "no"], check=False, capture_output=True, text=True
    )
    return refused.stderr.split("write one of ")[1].splitlines()[0].split(", ")


@pytest.fixture
def exr(path: Path) -> Path:
    file = path.parent / "in.exr"
    df.Scene(path).render(seed=1).save_exr(file)
    return file


def test_an_exr_is_exposed_as_by_the_program(exr: Path, tmp_path: Path) -> None:
    flags = ["--sensor", "imx174", "--exposure", "0.00004s", "--frames", 3, "--frame", 5, "--seed", 9]
    flags += [
        "--f-number",
        2.8,
        "--transmission",
        0.5,
        "--magnification",
        0.1,
        "--vignetting",
        "cos4",
        "--focal-length",
        "1mm",
    ]
    run("expose", exr, *flags, "-o", tmp_path / "a.png", "--linear", tmp_path / "a.tif")
    keywords: dict[str, Any] = {"exposure": 40e-6, "frames": 3, "frame": 5, "seed": 9, "f_number": 2.8}
    keywords |= {"transmission": 0.5, "magnification": 0.1, "vignetting": "cos4", "focal_length": 1e-3}
    made = df.expose_exr_files(exr, tmp_path / "b.png", tmp_path / "b.tif", sensor=df.Sensor("imx174"), **keywords)
    assert made["frames"] == 3 and made["exposure"] == 40e-6 and made["matched"] is None and made["invalid"] == 0
    assert made["files"][0] == str(tmp_path / "b-0005.png") and len(made["files"]) == 6
    for file in map(Path, made["files"]):
        assert file.read_bytes() == file.with_name(file.name.replace("b", "a")).read_bytes()
    frames = df.expose_exr(exr, "imx174", **keywords)
    assert frames.shape == (3, 16, 24) and frames.dtype == np.uint16
    for i in range(3):
        assert np.array_equal(df_image(tmp_path / f"a-000{5 + i}.tif"), frames[i])
    whole = df.Film.load(saved(exr))
    assert np.array_equal(frames, df.expose_radiance(whole.mean, "imx174", **keywords))
    assert np.array_equal(frames, df.expose_radiance(whole.mean.astype(np.float64), "imx174", **keywords))


def saved(exr: Path) -> Path:
    """The film of the EXR."""
    file = exr.with_name("in.film")
    df.Scene(exr.with_name("station.toml")).render(seed=1).save(file)
    return file


def df_image(file: Path) -> Any:
    from dunkelfeld._native import read_image

    return read_image(file)


def test_matched_noise_and_layers_of_an_exr(exr: Path, tmp_path: Path) -> None:
    run("expose", exr, "--exposure-noise", "matched", "--exposure", "20us", "--linear", tmp_path / "a.tif")
    matched = df.expose_exr(exr, exposure=2e-5, exposure_noise="matched")
    assert np.array_equal(matched[0], df_image(tmp_path / "a.tif"))
    assert not np.array_equal(matched, df.expose_exr(exr, exposure=2e-5))
    lens: dict[str, Any] = {"f_number": 4, "transmission": 0.9, "magnification": 0}
    albedo = df.expose_exr(exr, "imx250", exposure=2e-5, layer="albedo", **lens)
    assert np.array_equal(albedo, df.expose_radiance(df.Film.load(saved(exr)).albedo, exposure=2e-5))


def test_an_exr_is_denoised_as_by_the_program(exr: Path, tmp_path: Path) -> None:
    for name in ("a.exr", "a.png"):
        run("denoise", exr, "--denoise", "builtin", "-o", tmp_path / name)
        array = df.denoise_exr(exr, tmp_path / f"own-{name}", denoise="builtin")
        assert (tmp_path / name).read_bytes() == (tmp_path / f"own-{name}").read_bytes()
    film = df.Film.load(saved(exr))
    assert array.shape == (16, 24, 3) and array.dtype == np.float32
    assert np.array_equal(array, film.denoise("builtin")) and np.array_equal(
        array, df.denoise_exr(exr, denoise="builtin")
    )
    alone = df.denoise_radiance(film.mean, denoise="builtin")
    helped = df.denoise_radiance(
        film.mean, variance=film.variance, albedo=film.albedo, normal=film.normal, depth=film.depth, denoise="builtin"
    )
    assert alone.shape == helped.shape == (16, 24, 3) and not np.array_equal(alone, helped)
    # An even image has nothing to denoise.
    even = np.full((8, 8, 3), 0.25, np.float32)
    assert np.allclose(df.denoise_radiance(even, denoise="builtin"), even, rtol=1e-5)


IMAGE = np.ones((4, 6, 3), np.float32)
BAD_IMAGES: list[tuple[Any, type[BaseException], str]] = [
    (lambda e: df.expose_exr(e.with_name("no.exr")), df.InputError, "no.exr"),
    (lambda e: df.expose_exr(e, "none"), df.SettingError, "sensor"),
    (lambda e: df.expose_exr(e, frames=0), df.SettingError, "frames"),
    (lambda e: df.expose_exr(e, frames=2, exposure_noise="matched"), df.SettingError, "noise"),
    (lambda e: df.expose_exr(e, frames=2**31), df.OutOfMemoryError, "fewer frames"),
    (lambda e: df.expose_exr(e, f_number=0.1), df.SettingError, "f_number"),
    (lambda e: df.expose_exr(e, vignetting="cos4"), df.SettingError, "focal length"),
    (lambda e: df.expose_exr(e, focal_length=0.01), df.SettingError, "vignetting"),
    (lambda e: df.expose_exr(e, layer="none"), df.InputError, "none"),
    (lambda e: df.expose_exr_files(e), df.SettingError, "output"),
    (lambda e: df.expose_exr_files(e, e), df.OutputError, "png"),
    (lambda e: df.expose_radiance(IMAGE[..., :2]), df.SettingError, "channels"),
    (lambda e: df.expose_radiance(IMAGE[:0]), df.SettingError, "pixel"),
    (lambda e: df.expose_radiance(IMAGE[..., 0]), df.SettingError, "radiance: has 2 dimensions"),
    (lambda e: df.expose_radiance(1j * IMAGE), df.SettingError, "radiance: contains no real numbers"),
    (lambda e: df.expose_radiance(np.ma.masked_less(IMAGE, 0)), df.SettingError, "radiance: is a masked array"),
    (lambda e: df.denoise_radiance(IMAGE, albedo=np.array([["a"]])), df.SettingError, "albedo"),
    (lambda e: df.denoise_radiance(IMAGE, albedo=[[["a"]]]), TypeError, "albedo"),
    (lambda e: df.expose_radiance(IMAGE, exposure="5 parsecs"), df.SettingError, "exposure"),
    (lambda e: df.expose_radiance(IMAGE, memory=True), TypeError, "memory"),
    (lambda e: df.expose_radiance(IMAGE, memory=-1), df.SettingError, "out of range"),
    (lambda e: df.denoise_exr(e, e, denoise="builtin"), df.OutputError, "input"),
    (lambda e: df.denoise_exr(e, denoise="off"), df.SettingError, "off"),
    (lambda e: df.denoise_exr(e, oidn="none.so"), df.SettingError, "none.so"),
    (lambda e: df.denoise_radiance(IMAGE, depth=np.ones((4, 5)), denoise="builtin"), df.SettingError, "5 x 4"),
    (lambda e: df.denoise_radiance(IMAGE, memory=10, denoise="builtin"), df.OutOfMemoryError, "memory"),
    (lambda e: df.init_job(e.with_name("no.glb")), df.InputError, "no.glb"),
    (lambda e: df.init_job(e.with_name("no.glb"), station="ring"), df.SettingError, "dark-field-ring"),
    (lambda e: df.station_job("ring"), df.SettingError, "dark-field-ring"),
    (lambda e: df.Scene(e.with_name("station.toml")).trace_sample(24, 0, 0), df.SettingError, "outside"),
]


@pytest.mark.parametrize(("call", "kind", "says"), BAD_IMAGES)
def test_bad_images_are_refused(call: Any, kind: type[BaseException], says: str, exr: Path) -> None:
    before = exr.read_bytes()
    with pytest.raises(kind) as caught:
        call(exr)
    assert says in str(caught.value), str(caught.value)
    if isinstance(caught.value, df.DunkelfeldError):
        assert caught.value.help
    assert exr.read_bytes() == before


def test_first_jobs_are_those_of_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    scene = tmp_path / "a.obj"
    scene.write_text("o lid\nv 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
    assert [line.split()[0] for line in run("init").splitlines()[1:-1]] == df.stations()
    (tmp_path / "jobs").mkdir()
    for station in (None, "dome", "line-scan"):
        flags = [] if station is None else ["--station", station]
        for job in (Path("job.toml"), Path("jobs/job.toml")):
            run("init", "a.obj", *flags, "-o", job)
            assert df.init_job("a.obj", station, folder=job.parent) == job.read_text()
            job.unlink()
    film = df.Scene.from_job(df.init_job(scene)).render(spp=1, width=8, height=8)
    assert film.object_names == ["lid"]
    for name in df.stations()[:2]:
        run("init", "--station", name, "-o", "job.toml")
        assert df.station_job(name) == Path("job.toml").read_text()
        Path("job.toml").unlink()


def test_a_traced_sample_is_that_of_the_program(path: Path) -> None:
    scene = df.Scene(path)
    lengths = set()
    cases: list[tuple[int, int, int, dict[str, Any]]] = [
        (12, 8, 3, {}),
        (12, 9, 0, {"seed": 4}),
        (0, 0, 5, {"width": 30, "frame": 2}),
    ]
    for x, y, sample, keywords in cases:
        flags = [str(part) for key, value in keywords.items() for part in (f"--{key}", value)]
        text = run("render", path, "--debug-sample", f"{x},{y},{sample}", *flags)
        traced = scene.trace_sample(x, y, sample, **keywords)
        vertices = traced["vertices"]
        assert traced["is_valid"]
        lengths.add(len(vertices))
        found = [float(word) for word in text.split("radiance ")[1].split()[:3]]
        assert traced["radiance"] == found
        names = [line.split('"')[1] for line in text.splitlines() if '" at ' in line]
        assert names == [vertex["material"] for vertex in vertices if vertex["material"] is not None]
        lobes = [line.split("lobe ")[1].split(",")[0] for line in text.splitlines() if "lobe " in line]
        assert lobes == [vertex["scattered"]["lobe"] for vertex in vertices if vertex["scattered"] is not None]
        # The radiance is the sum over the vertices.
        parts = [part for v in vertices for part in (v["emitted"], v["direct"])]
        parts += [c["contribution"] for v in vertices for c in v["connections"]]
        assert np.allclose(np.sum(parts, axis=0), found, rtol=1e-5)
        left = [v for v in vertices if v["position"] is None]
        assert all(np.isclose(np.linalg.norm(cast(Any, v["left_toward"])), 1) for v in left)
    assert len(lengths) > 1


def test_a_study_takes_a_scene_of_a_file(path: Path, tmp_path: Path) -> None:
    options: dict[str, Any] = {"frames": 4, "spp": [2], "denoise": "off", "width": 16, "height": 12}
    of_path = df.ptc(path, tmp_path / "a", **options)
    of_scene = df.ptc(df.Scene(path), tmp_path / "b", **options)
    assert of_scene["renders"] == 8
    assert [row["gain"] for row in of_scene["figures"]["lines"]] == [row["gain"] for row in of_path["figures"]["lines"]]
    changed = df.Scene(path)
    changed.set_overrides(seed=3)
    for scene, says in [
        (df.Scene.from_job(TEXT), "text"),
        (changed, "overrides"),
        (df.Scene(path, without="every-light"), "effects"),
    ]:
        with pytest.raises(df.SettingError, match=says):
            df.bench(scene, tmp_path / "c")
        with pytest.raises(df.SettingError, match=says):
            df.ptc(scene, tmp_path / "c")
    changed.set_overrides()
    small: dict[str, Any] = {"spp": [2], "seeds": 4, "denoise": "off", "effects": [], "noise": [1.0]}
    made = df.bench(changed, tmp_path / "c", strategies="uniform", width=8, height=8, **small)
    assert made["finished"] == made["renders"] > 0


def test_files_of_a_merge_are_those_of_the_program(path: Path, tmp_path: Path) -> None:
    scene, parts = df.Scene(path), [tmp_path / "0.film", tmp_path / "1.film"]
    films = [scene.render(samples=(4 * i, 4 * i + 4), checkpoint=part) for i, part in enumerate(parts)]
    outputs = [tmp_path / name for name in ("a.png", "a.tif", "a.exr")]
    run("merge", *parts, "-o", outputs[0], "--linear", outputs[1], "--exr", outputs[2])
    merged = df.merge(parts, memory="1GB")
    own = [tmp_path / f"own{output.suffix}" for output in outputs]
    merged.save_files(image=own[0], linear=own[1], exr=own[2])
    assert [file.read_bytes() for file in own] == [file.read_bytes() for file in outputs]
    with pytest.raises(df.OutOfMemoryError):
        df.merge(parts, memory=1000)
    # Neither a part nor the checkpoint of a render becomes a film that cannot be continued.
    before = [part.read_bytes() for part in parts]
    for film, part in [(merged, parts[1]), (films[0], parts[0]), (df.Film.load(parts[0]), parts[0])]:
        with pytest.raises(df.OutputError, match="part|checkpoint"):
            film.save(part)
    assert [part.read_bytes() for part in parts] == before


@pytest.mark.parametrize("name", ["imx250", df.sensors()[-1]])
def test_data_sheets_are_those_of_the_program(name: str) -> None:
    sheet = df.Sensor(name).data_sheet()
    assert sheet == json.loads(run("sensors", name, "--json")) and sheet["figures"]
    assert np.isclose(sheet["pixel_pitch_um"], 1e6 * df.Sensor(name).pixel_pitch)


SIGNALS = """
import os, signal, sys, threading, time
import dunkelfeld as df
scene = df.Scene(sys.argv[1])
other = df.Scene(sys.argv[1])
def at(seconds):
    threading.Timer(seconds, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
def elsewhere(*_):
    thread = threading.Thread(target=lambda: scene.cameras)
    thread.start()
    thread.join()
began = time.monotonic()
try:
    if sys.argv[2] == "expose":
        film = scene.render(spp=1, width=300, height=300)
        at(0.3)
        film.expose(frames=8000)
    elif sys.argv[2] == "thread":
        at(0.5)
        scene.render(time=60, progress=elsewhere)
    else:
        scene.render(time=60, progress=lambda *_: other.render(spp=1, progress=lambda *_: scene.cameras))
except KeyboardInterrupt:
    print("interrupted")
except df.SettingError as error:
    print("refused", error.problem)
assert time.monotonic() - began < 30
"""


@pytest.mark.parametrize(
    ("work", "says"), [("expose", "interrupted"), ("thread", "interrupted"), ("nested", "refused")]
)
def test_signals_end_each_kind_of_work(work: str, says: str, path: Path) -> None:
    """Ctrl-C while numpy is first used, and while a progress function waits for its own scene through another thread. A scene
    that another scene's progress function uses within its own is refused."""
    command = [sys.executable, "-c", SIGNALS, str(path), work]
    found = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert found.returncode == 0 and found.stdout.startswith(says), (found.stdout, found.stderr)
    assert "panicked" not in found.stderr
