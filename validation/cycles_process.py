"""Cycles for scripts that use Mitsuba: starts `cycles_worker.py` with a Python that has `bpy`, and sends it commands."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any, Callable

import numpy as np

# What all scenes have in common; docs/research/equal-time.md has the measurements. `manifolds`: refracted shadow rays.
SETTINGS = {"use_light_tree": False, "use_guiding": False, "manifolds": False}


class Cycles:
    """The process. It renders one scene at a time, in linear Rec. 709, radiance in W/(m^2 sr)."""

    def __init__(self, python: str, file: Path):
        self.file = file
        file.parent.mkdir(parents=True, exist_ok=True)
        worker = Path(__file__).with_name("cycles_worker.py")
        self.log = file.with_suffix(".log").open("w")
        self.process = subprocess.Popen(
            [python, worker], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.log, text=True
        )
        self.version = self._answer()["version"]

    def _answer(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"Cycles has ended; {self.log.name} has its messages")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _send(self, **command: Any) -> dict[str, Any]:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(command) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def renderer(
        self, scene: dict[str, str], size: int, settings: dict[str, Any]
    ) -> Callable[[int, int], tuple[np.ndarray, float]]:
        """Builds a scene, {"station": name} or {"scene": file}, in place of the one before. Gives the function that renders it:
        numbers are seeds; the time is that of the process, user and system, in seconds."""
        import mitsuba as mi

        self._send(**scene, size=size, settings=settings)

        def render(spp: int, number: int) -> tuple[np.ndarray, float]:
            answer = self._send(spp=spp, seed=number, file=str(self.file))
            return np.array(mi.Bitmap(str(self.file)), dtype=np.float64), float(answer["seconds"])

        return render

    def close(self) -> None:
        """Ends the process."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()
        self.log.close()
