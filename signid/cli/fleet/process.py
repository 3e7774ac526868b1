"""Worker processes that run commands one after another, and are restarted if they die."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from threading import Event, Lock, Thread, Timer
from typing import IO, NamedTuple

from ...errors import SignidError
from ...version import __version__

TRIES = 2  # attempts at a command whose process dies
IDLE = 60.0  # time after which an idle process ends [s]
GRACE = 3.0  # time for a process to clean up before it is killed [s]
STOPPED, LOOKS = 60.0, 0.5  # time after which a stopped process (SIGSTOP) is killed, and between looks [s]
LASTS = 50  # commands per process; limits the growth of its memory
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS")
DONE, FLAGGED = 0, 3  # exit codes of commands that leave results


# -P and START: modules beside the manifest, such as a numpy.py, are not imported
_ROOT = str(Path(__file__).absolute().parents[3])  # folder that holds the package
START = (
    "import sys; sys.path[:0] = [] if {package!r} in sys.path else [{package!r}]; "
    "from signid.cli.worker import main; main()"
)


class Order(NamedTuple):
    """One command to run in a folder; its result files are returned."""

    arguments: tuple[str, ...]  # without -o
    folder: str  # folder to which paths are relative
    output: str = ""  # name of the result if the command writes a single file
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


class _Died(Exception):
    """A process ended during a command."""


class _Process:
    """A running worker process; it ends when its standard input is closed."""

    def __init__(self) -> None:
        heard = None if os.environ.get("SIGNID_DEBUG") else subprocess.DEVNULL
        self.child = subprocess.Popen(
            [sys.executable, "-P", "-c", START.format(package=_ROOT)],
            cwd=sys.prefix,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=heard,
            env=_environment(),
            start_new_session=True,  # Ctrl-C in a terminal reaches the caller only
        )
        self.carried_out, self.retires, self.stopped = 0, Timer(IDLE, self.end), False

    def ask(self, order: Order) -> Answer:
        orders, answers = self.child.stdin, self.child.stdout
        assert orders is not None and answers is not None, "both are pipes"
        answered = Event()
        Thread(target=self._end_if_stopped, args=(answered,), daemon=True).start()
        try:
            orders.write(json.dumps(order._asdict()).encode() + b"\n")
            orders.flush()
            header = json.loads(_read_exactly(answers, int(_read_exactly(answers, 16))))
            files = {name: _read_exactly(answers, size) for name, size in header["files"]}
        except (OSError, EOFError):
            self.child.kill()
            code = self.child.wait()
            why = f"stopped for {STOPPED:g} s, and killed" if self.stopped else f"by signal {-code}"
            raise _Died(why if code < 0 else f"with code {code}") from None
        finally:
            answered.set()
        self.carried_out += 1
        return Answer(header["code"], tuple(header["said"]), files)

    def _end_if_stopped(self, answered: Event) -> None:
        """Kill the process once it is stopped (SIGSTOP) for too long: it would never answer."""
        looks = 0
        while hasattr(os, "waitid") and not answered.wait(LOOKS):
            try:
                found = os.waitid(os.P_PID, self.child.pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT)
            except ChildProcessError:  # it has ended
                return
            looks = looks + 1 if found is not None else 0
            if looks * LOOKS >= STOPPED:
                self.stopped = True
                return self.child.kill()

    def end(self) -> None:
        self.child.terminate()
        try:
            self.child.wait(GRACE)
        except subprocess.TimeoutExpired:
            self.child.kill()
            self.child.wait()
        for pipe in (self.child.stdin, self.child.stdout):
            if pipe is not None:
                with suppress(BrokenPipeError):  # input that the child did not read
                    pipe.close()


def _environment() -> dict[str, str]:
    """Environment of a worker: one thread, and only absolute folders of modules."""
    folders = filter(os.path.isabs, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    return {**os.environ, "PYTHONPATH": os.pathsep.join(folders), **dict.fromkeys(THREADS, "1")}


def _read_exactly(stream: IO[bytes], count: int) -> bytes:
    found = stream.read(count)
    if len(found) < count:
        raise EOFError
    return found


class Processes:
    """A pool with as many processes as there are concurrent calls."""

    def __init__(self) -> None:
        self._idle, self._all, self._lock, self._stopped = list[_Process](), set[_Process](), Lock(), False

    def carry_out(self, order: Order) -> Answer:
        """Run a command in a worker process and return its answer.

        Raises:
            Stopped: `stop` was called.
        """
        if order.version != __version__:
            versions = f"signid {__version__} on the worker, {order.version} on the calling machine"
            return Answer(None, (f"the versions differ: {versions}; install the same version",), {})
        ending = ""
        for _ in range(TRIES):
            process = self._take()
            try:
                answer = process.ask(order)
            except _Died as death:
                self._drop(process)
                ending = str(death)
                continue
            self._give(process)
            return answer
        with self._lock:
            if self._stopped:
                raise Stopped("stopped")
        why = f"its process died {TRIES} times, the last time {ending}"
        return Answer(None, (f"{why}; if memory is short, give it fewer or shorter recordings",), {})

    def stop(self) -> None:
        """End all processes permanently."""
        with self._lock:
            self._stopped = True
            for process in self._all:
                process.child.terminate()
            while self._all:
                process = self._all.pop()
                process.retires.cancel()
                process.end()

    def _take(self) -> _Process:
        with self._lock:
            if self._stopped:
                raise Stopped("stopped")
            process = self._idle.pop() if self._idle else _Process()
            process.retires.cancel()
            self._all.add(process)
            return process

    def _give(self, process: _Process) -> None:
        if process.carried_out >= LASTS:
            return self._drop(process)
        process.retires = Timer(IDLE, self._retire, (process,))
        process.retires.daemon = True
        with self._lock:
            self._idle.append(process)
            process.retires.start()

    def _retire(self, process: _Process) -> None:
        with self._lock:
            if process not in self._idle:
                return
            self._idle.remove(process)
        self._drop(process)

    def _drop(self, process: _Process) -> None:
        with self._lock:
            self._all.discard(process)
        process.end()


_POOL = Processes()


def carry_out(order: Order) -> Answer:
    """Run a command in a child of a Dask worker."""
    return _POOL.carry_out(order)
