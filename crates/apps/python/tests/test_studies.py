"""The studies against the files that they and the program write."""

import csv
import json
import os
import signal
import subprocess
import threading
from pathlib import Path
from typing import Any, cast

import dunkelfeld as df
import numpy as np
import pytest

PROGRAM = os.environ["DUNKELFELD"]
TEXT = """
scene = "none"
[camera]
look_at = [0, 0, 0]
position = [0, 0.3, 0.4]
[environment]
radiance = 1
[[object]]
name = "ball"
kind = "sphere"
diameter = "100mm"
"""
SMALL: dict[str, Any] = {"width": 16, "height": 12}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "station.toml"
    file.write_text(TEXT)
    return file


def check_tables(study: Any) -> None:
    """The figures are the numbers of the tables on disk, with more digits."""
    folder = Path(study["folder"])
    assert Path(study["report"]) == folder / "report.html" and all(Path(f).is_file() for f in study["files"])
    tables = {name: rows for name, rows in study["figures"].items() if rows}
    assert tables
    for name, rows in tables.items():
        if not (folder / f"{name}.csv").exists():
            continue
        written = list(csv.DictReader((folder / f"{name}.csv").open(newline="")))
        assert len(written) == len(rows), name
        for there, here in zip(written, rows, strict=True):
            assert set(there) == set(here), name
            for key, value in here.items():
                if isinstance(value, int | float):
                    assert np.isclose(float(there[key]), value, rtol=1e-5), (name, key)
                else:
                    assert there[key] == (value or ""), (name, key)


def test_a_bench_has_the_figures_of_its_report(path: Path, tmp_path: Path) -> None:
    seen: list[str] = []
    options: dict[str, Any] = {"spp": [2, 4], "seeds": 4, "denoise": "off", "effects": [], "noise": [1.0], **SMALL}
    study = df.bench(path, tmp_path / "bench", strategies=["uniform"], progress=lambda s, *_: seen.append(s), **options)
    check_tables(study)
    assert study["finished"] == study["renders"] == 10 and study["invalid_samples"] == 0 and study["findings"]
    assert [(row["strategy"], row["spp"]) for row in study["figures"]["noise"]] == [("uniform", 2), ("uniform", 4)]
    assert {row["k"] for row in study["figures"]["hidden"]} == {1.0} and not study["figures"]["effects"]
    assert "load" in seen
    # The program continues a bench of the package, and finds everything.
    command = [PROGRAM, "bench", str(path), "-o", str(tmp_path / "bench"), "--width", "16", "--height", "12"]
    command += ["--spp", "2,4", "--seeds", "4", "--denoise", "off", "--effects", "none", "--noise", "1"]
    noise = (tmp_path / "bench" / "noise.csv").read_bytes()
    subprocess.run([*command, "--strategies", "uniform"], check=True, capture_output=True)
    assert (tmp_path / "bench" / "noise.csv").read_bytes() == noise


def test_a_photon_transfer_has_the_figures_of_its_report(path: Path, tmp_path: Path) -> None:
    study = df.ptc(path, tmp_path / "ptc", frames=4, spp=[2], denoise="off", sensor=df.Sensor("imx174"), **SMALL)
    check_tables(study)
    assert study["finished"] == study["renders"] == 8
    assert [row["spp"] for row in study["figures"]["series"]] == [2]
    sensor = next(row for row in study["figures"]["lines"] if row["curve"] == "the sensor, even light")
    assert abs(sensor["gain_over_truth"] - 1) < 0.2


def test_frames_of_files_have_a_photon_transfer(path: Path, tmp_path: Path) -> None:
    for i in range(3):
        frame = ["--seed", str(i), "--spp", "1", "--linear", str(tmp_path / f"{i}.png"), "-o", str(tmp_path / "x.png")]
        size = ["--width", "16", "--height", "12"]
        subprocess.run([PROGRAM, "render", str(path), *frame, *size], check=True, capture_output=True)
    frames = [tmp_path / f"{i}.png" for i in range(3)]
    study = df.ptc(frames, tmp_path / "stack")
    assert Path(str(study["report"])).is_file() and study["renders"] == 3
    curves = study["figures"]["curves"]
    assert {row["pixels_of"] for row in curves} == {"all", "without strong edges"}
    assert sum(row["pixels"] for row in curves if row["pixels_of"] == "all") <= 16 * 12
    assert study["figures"]["variance"][0]["variance"] > 0
    with pytest.raises(df.SettingError, match="spp"):
        df.ptc(frames, tmp_path / "other", spp=[4])


def test_a_data_set_gives_the_figures_of_its_sensor(tmp_path: Path) -> None:
    folder, seen = tmp_path / "emva", []
    options: dict[str, Any] = {"levels": 12, "size": (48, 32), "spatial": 3}
    made = df.emva.dataset("imx174", folder, progress=lambda *state: seen.append(state), **options)
    assert Path(made["descriptor"]).is_file() and made["frames"] == 12 * 4 + 6 and len(seen) == made["frames"]
    assert made["figures"] == json.loads(Path(made["truth"]).read_text())
    found = df.emva.analyse(made["descriptor"], json=folder / "a.json", html=folder / "a.html", pixel_pitch=5.86e-6)
    assert found["figures"] == json.loads((folder / "a.json").read_text()) and (folder / "a.html").is_file()
    gain, truth = found["quantities"]["K"], made["figures"]["quantities"]["K"]
    assert abs(gain["value"] - truth) < 5 * gain["standard_error"] and gain["unit"]
    general = df.emva.analyse(made["descriptor"], general=True, release="3.1")
    assert general["figures"]["module"] == "general" and general["json"] is None
    # The frames are those of the program.
    command = [PROGRAM, "emva", "dataset", "--sensor", "imx174", "--levels", "12", "--size", "48x32", "--spatial", "3"]
    subprocess.run([*command, "-o", str(tmp_path / "same")], check=True, capture_output=True)
    names = sorted(p.name for p in (folder / "images").iterdir())
    assert all((folder / "images" / n).read_bytes() == (tmp_path / "same" / "images" / n).read_bytes() for n in names)


BAD: list[tuple[Any, type[BaseException], str]] = [
    (lambda p, o: df.bench(p / "none.glb", o), df.InputError, "none.glb"),
    (lambda p, o: df.bench(p / "station.toml", o, spp=[4, 2]), df.SettingError, "spp"),
    (lambda p, o: df.bench(p / "station.toml", o, spp=[-1]), OverflowError, ""),
    (lambda p, o: df.bench(p / "station.toml", o, seeds=3), df.SettingError, "seeds"),
    (lambda p, o: df.bench(p / "station.toml", o, strategies=cast(Any, "best")), df.SettingError, "best"),
    (lambda p, o: df.bench(p / "station.toml", o, effects=["magic"]), df.SettingError, "magic"),
    (lambda p, o: df.bench(p / "station.toml", o, denoise=cast(Any, ["loud"])), df.SettingError, "loud"),
    (lambda p, o: df.bench(p / "station.toml", o, noise=[float("nan")]), df.SettingError, "k"),
    (lambda p, o: df.bench(p / "station.toml", o, memory="some"), df.SettingError, "memory"),
    (lambda p, o: df.bench(p / "station.toml", o, memory=0), df.SettingError, "memory"),
    (lambda p, o: df.bench(p / "station.toml", o, memory=1000, **SMALL), df.OutOfMemoryError, "memory"),
    (lambda p, o: df.bench(p / "station.toml", o, threads=10**6), df.SettingError, "threads"),
    (lambda p, o: df.bench(p / "station.toml", o, width=0), df.SettingError, "width"),
    (lambda p, o: df.bench(p / "station.toml", p), df.OutputError, "station.toml"),
    (lambda p, o: df.bench(p / "station.toml", o, sensor="none", exposure=1.0), df.InputError, "exposure"),
    (lambda p, o: df.ptc([], o), df.SettingError, "inputs"),
    (lambda p, o: df.ptc(p / "station.toml", o, spp=[]), df.SettingError, "spp"),
    (lambda p, o: df.bench(p / "station.toml", o, spp=[]), df.SettingError, "spp"),
    (lambda p, o: df.bench(p / "station.toml", o, denoise=[]), df.SettingError, "denoise"),
    (lambda p, o: df.emva.dataset("imx174", o, wavelength="545 apples"), df.SettingError, "wavelength"),
    (lambda p, o: df.ptc(p / "station.toml", o, frames=3), df.SettingError, "frames"),
    (lambda p, o: df.ptc(p / "station.toml", o, edges=float("nan")), df.SettingError, "edges"),
    (lambda p, o: df.ptc(p / "station.toml", o, dark=1.0), df.SettingError, "dark"),
    (lambda p, o: df.ptc([p / "a.png", p / "b.png"], o), df.SettingError, "too few"),
    (lambda p, o: df.ptc([p / f"{i}.png" for i in range(3)], o), df.InputError, "0.png"),
    (lambda p, o: df.emva.dataset("imx999", o), df.InputError, "imx999"),
    (lambda p, o: df.emva.dataset("imx174", p), df.InputError, "empty"),
    (lambda p, o: df.emva.dataset("imx174", o, levels=3), df.SettingError, "levels"),
    (lambda p, o: df.emva.dataset("imx174", o, size=(0, 16)), df.SettingError, "width"),
    (lambda p, o: df.emva.dataset("imx174", o, size=(16, 2**31)), df.SettingError, "height"),
    (lambda p, o: df.emva.dataset("imx174", o, size=(32768, 32768)), df.SettingError, "pixels"),
    (lambda p, o: df.emva.dataset("imx174", o, exposure=float("nan")), df.SettingError, "exposure"),
    (lambda p, o: df.emva.dataset("imx174", o, exposure=-1.0), df.SettingError, "exposure"),
    (lambda p, o: df.emva.dataset("imx174", o, wavelength=float("inf")), df.SettingError, "wavelength"),
    (lambda p, o: df.emva.dataset("imx174", o, bit_depth=99), df.SettingError, "bit depth"),
    (lambda p, o: df.emva.dataset("imx174", o, vary=cast(Any, "gain")), df.SettingError, "gain"),
    (lambda p, o: df.emva.dataset("imx174", o, color="red"), df.SettingError, "color"),
    (lambda p, o: df.emva.analyse(p / "none.txt"), df.InputError, "none.txt"),
    (lambda p, o: df.emva.analyse(p / "station.toml"), df.InputError, "station.toml"),
    (lambda p, o: df.emva.analyse(p / "none.txt", release=cast(Any, "5.0")), df.SettingError, "5.0"),
    (lambda p, o: df.emva.analyse(p / "none.txt", pixel_pitch=float("nan")), df.SettingError, "pixel pitch"),
]


@pytest.mark.parametrize(("call", "kind", "says"), BAD)
def test_bad_input_is_an_exception_with_help(call: Any, kind: type[BaseException], says: str, path: Path) -> None:
    output = path.parent / "out"
    with pytest.raises(kind) as caught:
        call(path.parent, output)
    assert says in str(caught.value), str(caught.value)
    if isinstance(caught.value, df.DunkelfeldError):
        assert caught.value.help and caught.value.problem
    assert not (output / "report.html").exists()


def test_ctrl_c_keeps_the_finished_renders(path: Path, tmp_path: Path) -> None:
    options: dict[str, Any] = {"frames": 40, "spp": [16], "denoise": "off", "pictures_only": True}
    threading.Timer(0.4, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        df.ptc(path, tmp_path / "ptc", width=128, height=128, **options)
    finished = len(list((tmp_path / "ptc" / "units").glob("paper-*.json")))
    assert finished < 40


def test_an_exception_of_progress_ends_a_study(path: Path, tmp_path: Path) -> None:
    def fail(stage: str, *_: object) -> None:
        raise LookupError(stage)

    calls: list[Any] = [
        lambda: df.bench(path, tmp_path / "bench", progress=fail, **SMALL),
        lambda: df.ptc(path, tmp_path / "ptc", progress=fail, **SMALL),
        lambda: df.emva.dataset("imx174", tmp_path / "emva", progress=fail),
    ]
    for call in calls:
        with pytest.raises(LookupError):
            call()
    assert not (tmp_path / "emva").exists()


def test_the_interpreter_runs_during_a_study(tmp_path: Path) -> None:
    made: list[Any] = []
    thread = threading.Thread(target=lambda: made.append(df.emva.dataset("imx174", tmp_path / "a", size=(320, 240))))
    thread.start()
    ticks = 0
    while thread.is_alive():
        ticks += 1
        thread.join(0.001)
    assert made and ticks > 10
