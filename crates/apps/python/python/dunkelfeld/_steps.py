"""The progress of a render as steps of a loop."""

from __future__ import annotations

import inspect
import queue
import threading
from typing import TYPE_CHECKING, Any, NamedTuple

from ._keys import RenderKeys

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ._native import Film, Scene

__all__ = ["RenderStep", "RenderSteps"]


class RenderStep(NamedTuple):
    """The state of a render: stage, share that is done (0 to 1), elapsed and remaining time [s]."""

    stage: str
    fraction: float
    elapsed: float
    remaining: float | None


class _Stop(KeyboardInterrupt):
    """Ends the render of an iterator; its film has the samples until then."""


class RenderSteps:
    """The steps of one render, one for each per cent, from `Scene.render_steps`. It can be iterated over once.

    The render begins with the first step, on another thread. `len` is 100, so that `tqdm` shows the share that is done
    and the remaining time. After the last step, `film` is the film. An exception of the render is raised by the
    iteration. `break`, Ctrl-C or `close` end the render early; then `film` has the samples until then.
    """

    def __init__(self, scene: Scene, options: dict[str, Any]) -> None:
        if "progress" in options:
            raise TypeError("render_steps() has no argument 'progress'; the steps are the progress")
        # An unknown option is an error of this call, not of the first step.
        keys = inspect.signature(scene.render).bind(**options).arguments.get("keys", {})
        for unknown in keys.keys() - RenderKeys.__annotations__.keys():
            raise TypeError(f"render_steps() has no keyword {unknown!r}")
        self._scene = scene
        self._options = options
        self._states: queue.SimpleQueue[RenderStep | None] = queue.SimpleQueue()
        self._stop = False
        self._thread: threading.Thread | None = None
        self._film: Film | None = None
        self._error: BaseException | None = None
        self._count = 0

    def __len__(self) -> int:
        return 100

    @property
    def film(self) -> Film:
        """The film. Before the last step this ends the render, and the film has the samples until then."""
        if self._thread is None:
            raise ValueError("the render has not begun; iterate over the steps")
        self.close()
        if self._error is not None:
            raise self._error
        assert self._film is not None, "a render ends with a film or an error"
        return self._film

    def close(self) -> None:
        """Ends the render, if it works, and waits for its end."""
        if self._thread is not None:
            self._stop = True
            self._thread.join()

    def __iter__(self) -> Iterator[RenderStep]:
        if self._thread is not None:
            raise ValueError("the steps of a render can be taken once; call render_steps again")
        self._thread = threading.Thread(target=self._render, name="dunkelfeld-render", daemon=True)
        self._thread.start()
        return self._steps()

    def _steps(self) -> Iterator[RenderStep]:
        last = RenderStep("render", 0.0, 0.0, None)
        try:
            while (state := self._next()) is not None:
                last = state
                # The last step comes after the end, so that the film is complete then.
                while self._count < min(int(100.0 * state.fraction), 99):
                    self._count += 1
                    yield state
            if self._error is not None:
                raise self._error
            while self._count < 100:
                self._count += 1
                yield last._replace(fraction=1.0, remaining=0.0)
        finally:
            self.close()

    def _next(self) -> RenderStep | None:
        # A wait with a limit, so that Ctrl-C ends it on all systems.
        while True:
            try:
                return self._states.get(timeout=0.1)
            except queue.Empty:
                continue

    def _report(self, stage: str, fraction: float, elapsed: float, remaining: float | None) -> None:
        if self._stop:
            raise _Stop
        self._states.put(RenderStep(stage, fraction, elapsed, remaining))

    def _render(self) -> None:
        from ._native import Interrupted

        try:
            self._film = self._scene.render(**self._options, progress=self._report)
        except Interrupted as interrupted:
            self._film = interrupted.film
        except BaseException as error:  # noqa: BLE001, the iteration raises it
            self._error = error
        finally:
            self._states.put(None)
