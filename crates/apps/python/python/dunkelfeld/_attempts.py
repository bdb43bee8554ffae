"""Tasks of Dask of which the first result counts, on workers that may die and stall."""

from __future__ import annotations

import asyncio
import importlib
import operator
import os
import queue
import statistics
import time
from collections import Counter, deque
from concurrent.futures import Future as LocalFuture
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from ._native import DunkelfeldError, SettingError

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self

__all__ = ["Attempt", "Cluster", "dask", "setting", "whole_number"]


def dask() -> Any:
    """The module `distributed`, which is optional."""
    try:
        return importlib.import_module("distributed")
    except ImportError as error:
        raise ImportError(
            "dunkelfeld.distributed needs Dask; install it with `pip install dunkelfeld[dask]`"
        ) from error


def setting(what: str, problem: str, help: str) -> SettingError:
    """An error of a setting, with the attributes of the other errors."""
    error = SettingError(f"{what}: {problem}\n  help: {help}")
    error.place, error.problem, error.help = what, problem, help
    return error


def whole_number(name: str, number: int) -> int:
    """A whole number, also one of numpy."""
    try:
        return operator.index(number)
    except TypeError:
        raise setting(name, f"{number!r} is not a whole number", "pass a whole number, such as 64") from None


def failure(problem: str, help: str) -> DunkelfeldError:
    """An error of the cluster, with the attributes of the other errors."""
    error = DunkelfeldError(f"{problem}\n  help: {help}")
    error.problem, error.help = problem, help
    return error


@dataclass(eq=False)
class Attempt:
    """One submission of a task."""

    name: str
    """The name of the task."""
    kind: str
    """Tasks of one kind take similar times."""
    call: tuple[Any, ...]
    """The function and its arguments."""
    future: Any
    began: float
    limit_factor: float
    """Factor of the time after which it counts as stalled."""
    worker: str = ""
    is_repeated: bool = False
    """Is there a newer attempt, because this one seems to stall?"""


Event: TypeAlias = tuple[Attempt, str, Any]


class _Lost(Exception):
    """No worker has the result any more."""


class Cluster:
    """The attempts of all tasks, and the state of the workers.

    A task has a name. It runs from `start` to `settle` or `drop`. An attempt that is lost, because its worker dies, is
    submitted again. For an attempt that stalls, another one is submitted beside it.
    """

    REFRESH = 1.0
    """Least seconds between two looks at the workers."""
    LEAST_RESULTS = 3
    """Results of a kind before their median counts."""

    def __init__(
        self,
        client: Any,
        patience: float,
        stall: float,
        retries: int,
        refused: tuple[type[BaseException], ...] = (),
    ) -> None:
        if getattr(client, "asynchronous", False):
            raise setting("client", "is asynchronous", "pass a Client that was made without asynchronous=True")
        retries = whole_number("retries", retries)
        if retries < 0:
            raise setting("retries", f"{retries} is out of range", "pass 0 or more")
        if not patience > 0:
            raise setting("patience", f"{patience} s is out of range", "pass a number of seconds above 0")
        if not stall >= 1:
            raise setting("stall", f"{stall} is out of range", "pass a factor of 1 or more")
        self.client = client
        self.refused = refused
        """Errors of the work that end a task with the event "refused" instead of the call."""
        self.patience, self.stall, self.retries = patience, stall, retries
        self.threads = 0
        """Threads of the workers that do not stall."""
        self.silent: set[str] = set()
        """Workers without a sign of life."""
        self.repeated = 0
        """Attempts beyond the first one of each task."""
        self._dask = dask()
        self._healthy: dict[str, int] = {}
        # Workers with an attempt that took too long, and the time until which they are avoided.
        self._slow: dict[str, float] = {}
        self._attempts: dict[str, list[Attempt]] = {}
        self._failures: Counter[str] = Counter()
        self._numbers: Counter[str] = Counter()
        self._seconds: dict[str, deque[float]] = {}
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._token = f"dunkelfeld-{os.urandom(6).hex()}"
        self._watched, self._interval = float("-inf"), self.REFRESH

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for name in list(self._attempts):
            self.drop(name)

    def is_running(self, name: str) -> bool:
        """Has the task been started, and not ended?"""
        return name in self._attempts

    def has_room(self) -> bool:
        """May another task start? One for each thread, and one that waits for each worker process."""
        return len(self._attempts) < self.threads + len(self._healthy)

    def start(self, name: str, kind: str, *call: Any) -> None:
        """Starts a task: a function and its arguments."""
        self._submit(name, kind, call, 1.0)

    def again(self, attempt: Attempt) -> None:
        """Submits the task of an attempt again, which ends."""
        self._end(attempt)
        # Attempts that seem to stall do not count.
        if all(other.is_repeated for other in self._attempts.get(attempt.name, ())):
            self._submit(attempt.name, attempt.kind, attempt.call, attempt.limit_factor)

    def fail(self, attempt: Attempt, problem: str) -> None:
        """Submits the task of an attempt again that was lost, unless too many were."""
        self._failures[attempt.name] += 1
        count = self._failures[attempt.name]
        if count > self.retries:
            text = f"{attempt.kind} {attempt.name}: attempt {count} failed: {problem}"
            raise failure(text, "read the logs of the workers; they may need more memory")
        self.again(attempt)

    def fetch(self, attempt: Attempt) -> None:
        """Fetches the result of a finished attempt; its event is "fetched"."""
        # `Future.result` fetches several results together, and would wait for all of them if one worker stalls.
        loop = self.client.loop.asyncio_loop
        work = asyncio.run_coroutine_threadsafe(_gathered(self.client, attempt.future.key), loop)
        self.follow(attempt, "fetched", work)

    def follow(self, attempt: Attempt, kind: str, work: LocalFuture[Any]) -> None:
        """The end of `work` becomes an event of the attempt."""
        work.add_done_callback(lambda done: self._events.put((attempt, kind, done)))

    def settle(self, attempt: Attempt, *, keep: bool = False) -> None:
        """Ends a task with the result of an attempt. With `keep` the result stays on the worker, as long as its future is
        referenced."""
        self._seconds.setdefault(attempt.kind, deque(maxlen=1000)).append(time.monotonic() - attempt.began)
        self._slow.pop(attempt.worker, None)
        self.drop(attempt.name, keep=attempt if keep else None)

    def drop(self, name: str, keep: Attempt | None = None) -> None:
        """Ends a task, and releases its attempts."""
        for attempt in self._attempts.pop(name, ()):
            if attempt is not keep:
                attempt.future.release()

    def wait(self) -> Event | None:
        """The next event of a running task, or None: an attempt, "finished", "refused" or the kind of `follow`, and the result.

        Raises the error of the task.
        """
        try:
            attempt, kind, value = self._events.get(timeout=0.1)
        except queue.Empty:
            return None
        if attempt not in self._attempts.get(attempt.name, ()):
            return None
        if kind != "ended":
            try:
                return attempt, kind, value.result()
            except (_Lost, ConnectionError, TimeoutError):
                self.fail(attempt, "its result was lost")
                return None
        if attempt.future.status == "finished":
            return attempt, "finished", None
        problem = attempt.future.status
        if problem == "error":
            error = attempt.future.exception()
            # Errors of the work itself would come again everywhere.
            if isinstance(error, self.refused):
                return attempt, "refused", error
            if not isinstance(error, (self._dask.KilledWorker, ConnectionError, TimeoutError)):
                raise error
            problem = str(error)
        self.fail(attempt, problem)
        return None

    def watch(self) -> None:
        """Looks at the workers, once a second or in the interval of heartbeats. Tasks of stalled workers, and tasks that take long, start again
        elsewhere."""
        now = time.monotonic()
        if now - self._watched < self._interval:
            return
        self._watched = now
        if self.client.status not in {"running", "connecting"}:
            problem = f"the connection to the scheduler is {self.client.status}"
            raise failure(problem, "call the function again with a new client")
        workers = _workers(self.client)
        if self.client.status != "running":
            return
        newest = max((worker["last_seen"] for worker in workers.values()), default=0.0)
        # The list of many workers costs the scheduler time, and has news only after a heartbeat.
        self._interval = max(self.REFRESH, _heartbeat(len(workers)))
        silence = max(self.patience, 4 * _heartbeat(len(workers)))
        self.silent = {address for address, worker in workers.items() if newest - worker["last_seen"] > silence}
        self._healthy = {a: int(worker["nthreads"]) for a, worker in workers.items() if a not in self.silent}
        self.threads = sum(self._healthy.values())
        self._slow = {address: until for address, until in self._slow.items() if until > now}
        running = [a for attempts in self._attempts.values() for a in attempts if not a.is_repeated]
        late = {id(attempt) for attempt in running if self._is_late(attempt, now)}
        if not late and not self.silent:
            return
        places = self._places(running)
        for attempt in running:
            where = places.get(attempt.future.key, set())
            is_late = id(attempt) in late
            if is_late:
                self._slow.update((address, now + 10 * self.patience) for address in where)
            # An attempt without a worker waits for one. Another attempt would wait as well.
            if where and (is_late or where <= self.silent) and self._others():
                attempt.is_repeated = True
                self._submit(attempt.name, attempt.kind, attempt.call, 2 * attempt.limit_factor)

    def _others(self) -> list[str]:
        """The workers that neither stall nor are slow."""
        return [address for address in self._healthy if address not in self._slow]

    def _submit(self, name: str, kind: str, call: tuple[Any, ...], limit_factor: float) -> None:
        number = self._numbers[name]
        self._numbers[name] += 1
        self.repeated += number > 0
        options: dict[str, Any] = {}
        if (self.silent or self._slow) and (others := self._others()):
            # If they have all died, the scheduler takes another worker.
            options = {"workers": others, "allow_other_workers": True}
        future = self.client.submit(*call, key=f"{self._token}-{name}-{number}", pure=False, **options)
        attempt = Attempt(name, kind, call, future, time.monotonic(), limit_factor)
        self._attempts.setdefault(name, []).append(attempt)
        future.add_done_callback(lambda _: self._events.put((attempt, "ended", None)))

    def _end(self, attempt: Attempt) -> None:
        attempts = self._attempts.get(attempt.name, [])
        if attempt in attempts:
            attempts.remove(attempt)
        attempt.future.release()

    def _is_late(self, attempt: Attempt, now: float) -> bool:
        times = self._seconds.get(attempt.kind, ())
        if len(times) < self.LEAST_RESULTS:
            return False
        limit = max(self.patience, self.stall * statistics.median(times))
        return now - attempt.began > limit * attempt.limit_factor

    def _places(self, attempts: list[Attempt]) -> dict[str, set[str]]:
        """The workers that compute or hold the result of each attempt, by its key."""
        keys = {attempt.future.key for attempt in attempts}
        places: dict[str, set[str]] = {}
        if not keys:
            return places
        for address, processing in self.client.processing().items():
            for key in keys.intersection(processing):
                places.setdefault(key, set()).add(address)
        for key, holders in self.client.who_has([attempt.future for attempt in attempts]).items():
            places.setdefault(key, set()).update(holders)
        return places


async def _gathered(client: Any, key: str) -> Any:
    response = await client.scheduler.gather(keys=[key])
    if response["status"] != "OK":
        raise _Lost(key)
    return response["data"][key]


def _workers(client: Any) -> dict[str, dict[str, Any]]:
    """All workers by their addresses."""
    try:
        info = client.scheduler_info(n_workers=-1)
    except TypeError:  # Older versions list all workers.
        info = client.scheduler_info()
    # Without a connection to the scheduler there are none.
    found: dict[str, dict[str, Any]] = dict(info.get("workers", {}))
    return found


def _heartbeat(workers: int) -> float:
    """The longest interval of the heartbeats of so many workers [s], as `distributed.scheduler.heartbeat_interval`."""
    return 0.5 if workers <= 10 else 1 if workers < 50 else 2 if workers < 200 else 1 + workers / 200
