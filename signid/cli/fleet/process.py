"""Processes that run commands one after another, and are replaced if they die."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import current_process
from multiprocessing.context import SpawnContext, SpawnProcess
from tempfile import TemporaryDirectory
from threading import Lock
from types import ModuleType
from typing import Any, NamedTuple

from ...errors import SignidError
from ...version import __version__
from .. import worker

TRIES = 2  # attempts at a command whose process dies
LASTS = 50  # commands per process; limits the growth of its memory
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS")
DONE, FLAGGED = 0, 3  # exit codes of commands that leave results
_STARTS = Lock()  # held while a process starts, as its environment is that of this process


class Order(NamedTuple):
    """One command to run in a folder; its result files are returned."""

    arguments: tuple[str, ...]  # without -o
    folder: str  # folder to which paths are relative
    version: str = __version__


class Answer(NamedTuple):
    """How a command ended."""

    code: int | None  # exit code; None: the process died or did not start
    said: tuple[str, ...]  # sentences, as on standard error
    files: Mapping[str, bytes]

    @property
    def done(self) -> bool:
        """Whether there are results."""
        return self.code in (DONE, FLAGGED)


class Stopped(SignidError):
    """The caller requested a stop."""


class _Process(SpawnProcess):
    """A process of one thread that Ctrl-C in a terminal does not reach, and that imports nothing of the caller."""

    def start(self) -> None:
        with _STARTS, _bare():
            super().start()


class _Context(SpawnContext):
    """Starts a process and keeps it, so that it can be ended."""

    process: _Process | None = None

    def Process(self, *args: Any, **options: Any) -> _Process:  # type: ignore[override]  # noqa: N802
        self.process = _Process(*args, **options)
        return self.process


@contextmanager
def _bare() -> Iterator[None]:
    """Set what a child inherits: environment, blocked signals, an empty main module; allow workers of Dask a child."""
    folders = filter(os.path.isabs, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    given = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(folders), **dict.fromkeys(THREADS, "1")}
    before, main = {name: os.environ.get(name) for name in given}, sys.modules["__main__"]
    blocks = hasattr(signal, "pthread_sigmask")
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if blocks else set()
    os.environ.update(given)
    sys.modules["__main__"] = ModuleType("__main__")
    caller = current_process()
    daemon, caller.daemon = caller.daemon, False
    try:
        yield
    finally:
        sys.modules["__main__"], caller.daemon = main, daemon
        os.environ.update({name: value for name, value in before.items() if value is not None})
        for name in (name for name, value in before.items() if value is None):
            del os.environ[name]
        if blocks:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


class _Warm:
    """One process that keeps its imports between commands."""

    def __init__(self) -> None:
        self.place = TemporaryDirectory(prefix="signid-", ignore_cleanup_errors=True)
        self.context, self.orders = _Context(), 0
        self.executor = ProcessPoolExecutor(1, self.context, worker.prepare, (self.place.name,))

    def submit(self, order: Order) -> Future[tuple[int | None, list[str], dict[str, bytes]]]:
        self.orders += 1
        return self.executor.submit(worker.perform, order.arguments, order.folder)

    def end(self) -> str:
        """End the process, and tell how it ended."""
        process = self.context.process
        if process is not None and process.pid is not None:
            process.terminate()
        self.executor.shutdown()
        self.place.cleanup()
        code = None if process is None else process.exitcode
        return f"by signal {-code}" if code is not None and code < 0 else f"with code {code}"


class Processes:
    """As many processes as there are concurrent calls."""

    def __init__(self) -> None:
        self._idle, self._all, self._lock, self._stopped = list[_Warm](), set[_Warm](), Lock(), False

    def carry_out(self, order: Order) -> Answer:
        """Run a command in a process of its own, warm from earlier ones, and return its answer.

        Raises:
            Stopped: `stop` was called.
        """
        if order.version != __version__:
            versions = f"signid {__version__} on the worker, {order.version} on the calling machine"
            return Answer(None, (f"the versions differ: {versions}; install the same version",), {})
        ending = ""
        for _ in range(TRIES):
            with self._lock:
                if self._stopped:
                    raise Stopped("stopped")
                warm = self._idle.pop() if self._idle else _Warm()
                self._all.add(warm)
                answer = warm.submit(order)  # starts the process, so that `stop` finds it
            try:
                code, said, files = answer.result()
            except BrokenProcessPool:
                ending = self._drop(warm)
                continue
            if warm.orders < LASTS:
                self._idle.append(warm)
            else:
                self._drop(warm)
            return Answer(code, tuple(said), files)
        with self._lock:
            if self._stopped:
                raise Stopped("stopped")
        why = f"its process died {TRIES} times, the last time {ending}"
        return Answer(None, (f"{why}; if memory is short, give it fewer or shorter recordings",), {})

    def release(self) -> None:
        """End the processes that are idle."""
        while self._idle:
            self._drop(self._idle.pop())

    def stop(self) -> None:
        """End all processes permanently."""
        with self._lock:
            self._stopped = True
        for warm in list(self._all):  # threads whose process ends remove it
            warm.end()

    def _drop(self, warm: _Warm) -> str:
        self._all.discard(warm)
        return warm.end()


_POOL = Processes()


def carry_out(order: Order) -> Answer:
    """Run a command in a child of a Dask worker."""
    return _POOL.carry_out(order)


def release() -> None:
    """End the idle children of a Dask worker."""
    _POOL.release()
