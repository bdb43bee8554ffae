"""The command line of the package, against that of the program."""

import os
import signal
import subprocess
import sys
import time
import types
from pathlib import Path

import dunkelfeld

PROGRAM = os.environ["DUNKELFELD"]
PACKAGE = [sys.executable, "-m", "dunkelfeld"]


def test_the_package_runs_the_program(tmp_path: Path) -> None:
    for arguments in (["sensors"], ["--version"], ["render", "no.glb"], ["no-command"], ["inspect", "--help"]):
        runs = [
            subprocess.run([*start, *arguments], check=False, capture_output=True, cwd=tmp_path)
            for start in ([PROGRAM], PACKAGE)
        ]
        assert [run.returncode for run in runs] == [runs[0].returncode] * 2, arguments
        assert (runs[0].stdout, runs[0].stderr) == (runs[1].stdout, runs[1].stderr), arguments
    subprocess.run([*PACKAGE, "init", "--station", "dark-field-ring"], check=True, cwd=tmp_path, capture_output=True)
    job = ["render", "dark-field-ring.toml", "--width", "32", "--height", "32", "--spp", "1", "-o", "first.png"]
    subprocess.run([*PACKAGE, *job], check=True, cwd=tmp_path, capture_output=True)
    assert (tmp_path / "first.png").read_bytes()[:4] == b"\x89PNG"


def test_an_interrupt_keeps_the_image(tmp_path: Path) -> None:
    subprocess.run([*PACKAGE, "init", "--station", "dark-field-ring"], check=True, cwd=tmp_path, capture_output=True)
    job = [
        "render",
        "dark-field-ring.toml",
        "--width",
        "64",
        "--height",
        "64",
        "--spp",
        "1000000",
        "--progress",
        "json",
    ]
    with subprocess.Popen([*PACKAGE, *job, "-o", "a.png"], cwd=tmp_path, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        while b"pilot" not in process.stderr.readline().lower():
            assert process.poll() is None
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        process.stderr.read()
    assert process.returncode == 130 and (tmp_path / "a.png").is_file()


def test_the_namespace_has_its_own_names_only() -> None:
    public = {name: value for name, value in vars(dunkelfeld).items() if not name.startswith("_")}
    modules = {name for name, value in public.items() if isinstance(value, types.ModuleType)}
    assert all(vars(dunkelfeld)[name].__name__ == f"dunkelfeld.{name}" for name in modules)
    assert set(public) - modules <= set(dunkelfeld.__all__)
