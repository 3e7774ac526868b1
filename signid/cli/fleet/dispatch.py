"""Sessions as calls of an executor: processes of this machine, or workers of a Dask scheduler."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections import deque
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    as_completed,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout, suppress
from importlib import import_module
from io import StringIO
from logging import CRITICAL, getLogger, root
from multiprocessing import parent_process
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from shutil import rmtree
from threading import Lock, Thread
from types import ModuleType
from typing import Any, NamedTuple

from ...errors import OptionError
from ...version import __version__
from ..terminal import DONE, FLAGGED

COMMANDS = "signid.cli.run"  # carries out all commands, this room's too
TRIES = 2  # attempts at a command that runs alone
LASTS = 50  # [commands] per process; limits the growth of its memory
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS")
LOUD = ("distributed", "tornado", "asyncio")  # loggers of Dask
PATIENCE = 8.0  # time limit for a scheduler to answer and to have a worker [s]
_RUNNING = Lock()  # held by the command that runs, since folder and streams are those of the process
_STARTING = Lock()  # held while a process starts, since it inherits environment and main module


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


def carry_out(order: Order) -> Answer:
    """Run a command in this process, after those that other threads of it run."""
    if order.version != __version__:
        versions = f"signid {__version__} on the worker, {order.version} on the calling machine"
        return Answer(None, (f"the versions differ: {versions}; install the same version",), {})
    errors = StringIO()
    with _RUNNING, tempfile.TemporaryDirectory(prefix="signid-") as place:
        try:
            with chdir(order.folder), redirect_stdout(StringIO()), redirect_stderr(errors):
                code = import_module(COMMANDS).run([*order.arguments, "-o", place])
        except OSError as error:
            return Answer(None, (f"the folder {order.folder} cannot be used on the worker: {error.strerror}",), {})
        files = {path.name: path.read_bytes() for path in sorted(Path(place).iterdir())}
    return Answer(code, tuple(line.removeprefix("signid: ") for line in errors.getvalue().splitlines()), files)


def spread(
    orders: Sequence[Order], workers: int | None = None, scheduler: str | None = None
) -> Generator[tuple[int, Answer], None, None]:
    """Yield the index and answer of each order when it completes; orders of lost workers are repeated.

    Raises:
        OptionError: Dask is not installed, or no scheduler with a worker answers, or the scheduler is lost.
    """
    if scheduler is not None and workers is not None:
        raise OptionError(
            "--workers is for this machine, but a scheduler has its own workers; give one of these options"
        )
    if scheduler is None or not orders:
        yield from _here(orders, workers or cores())
        return
    with _cluster(scheduler) as executor:
        futures = {executor.submit(carry_out, order): k for k, order in enumerate(orders)}
        for future in as_completed(list(futures)):
            yield futures.pop(future), _answer(future, scheduler)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _here(orders: Sequence[Order], workers: int) -> Iterator[tuple[int, Answer]]:
    """Answers of processes of this machine; what ran when one of them died is repeated alone."""
    waiting = deque(range(len(orders)))
    while waiting:
        running, left = dict[Future[Answer], int](), LASTS * workers
        with _processes(workers) as (pool, _), suppress(BrokenProcessPool):
            while running or (waiting and left):
                while waiting and left and len(running) < workers:
                    k, left = waiting.popleft(), left - 1
                    running[pool.submit(carry_out, orders[k])] = k
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    answer = future.result()
                    yield running.pop(future), answer
        for k in running.values():
            yield k, _alone(orders[k])


def _alone(order: Order) -> Answer:
    """Answer of an order in a process that runs nothing else."""
    for _ in range(TRIES):
        with _processes(1) as (pool, started):
            try:
                return pool.submit(carry_out, order).result()
            except BrokenProcessPool:
                pool.shutdown()
                code = started[0].exitcode or 0
    ending = f"by signal {-code}" if code < 0 else f"with code {code}"
    why = f"its process died {TRIES} times, the last time {ending}"
    return Answer(None, (f"{why}; if memory is short, give it fewer or shorter recordings",), {})


class _Process(SpawnProcess):
    """A process of one thread that Ctrl-C in a terminal does not reach, and that imports nothing of the caller."""

    def start(self) -> None:
        with _STARTING, _bare():
            super().start()


class _Context(SpawnContext):
    """Starts processes and lists them."""

    def __init__(self) -> None:
        super().__init__()
        self.started = list[_Process]()

    def Process(self, *args: Any, **options: Any) -> _Process:  # type: ignore[override]  # noqa: N802
        self.started.append(_Process(*args, **options))
        return self.started[-1]


@contextmanager
def _processes(workers: int) -> Iterator[tuple[Executor, list[_Process]]]:
    """A pool whose processes stay warm between commands, and end with the block or with this process."""
    context = _Context()
    with tempfile.TemporaryDirectory(prefix="signid-", ignore_cleanup_errors=True) as place:
        pool = ProcessPoolExecutor(workers, context, _prepare, (place,))
        try:
            yield pool, context.started
        finally:
            for process in context.started:
                if process.pid is not None:
                    process.terminate()
            pool.shutdown(cancel_futures=True)


def _prepare(place: str) -> None:
    """Prepare a process: a session and temporary files of its own, no output, an end when the caller ends."""
    if begin_session := getattr(os, "setsid", None):  # Linux shares processor time between sessions
        begin_session()
    tempfile.tempdir = place
    silent = os.open(os.devnull, os.O_WRONLY)
    for stream in (1,) if os.environ.get("SIGNID_DEBUG") else (1, 2):
        os.dup2(silent, stream)
    Thread(target=_end_with_caller, args=(place,), daemon=True).start()


def _end_with_caller(place: str) -> None:
    caller = parent_process()
    if caller is not None:
        caller.join()
    rmtree(place, ignore_errors=True)
    os._exit(1)


@contextmanager
def _bare() -> Iterator[None]:
    """Set what a child inherits: environment, blocked signals, an empty main module."""
    folders = filter(os.path.isabs, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    given = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(folders), **dict.fromkeys(THREADS, "1")}
    before, main = {name: os.environ.get(name) for name in given}, sys.modules["__main__"]
    blocks = hasattr(signal, "pthread_sigmask")
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if blocks else set()
    os.environ.update(given)
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
        os.environ.update({name: value for name, value in before.items() if value is not None})
        for name in (name for name, value in before.items() if value is None):
            del os.environ[name]
        if blocks:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    """Workers of a Dask scheduler, each of which runs one order at a time."""
    try:
        from distributed import Client
    except ImportError:
        raise OptionError("--scheduler needs Dask, which is not installed: pip install 'signid[fleet]'") from None
    with _hushed(), _client(Client, address) as client:
        executor = client.get_executor()
        try:
            yield executor
        finally:
            executor.shutdown(wait=False)


@contextmanager
def _hushed() -> Iterator[None]:
    """Suppress Dask's messages and tracebacks; `OptionError` reports what matters."""
    names = [name for name in root.manager.loggerDict if name.partition(".")[0] in LOUD]
    levels = {log: log.level for log in map(getLogger, {*LOUD, *names})}
    for log in levels:
        log.setLevel(CRITICAL + 1)
    try:
        yield
    finally:
        for log, level in levels.items():
            log.setLevel(level)


def _client(make: Any, address: str) -> Any:
    try:
        _greet(address)  # a client would wait longer for a server that is silent
        client = make(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise OptionError(
            f"no Dask scheduler answers at {address} ({type(error).__name__}); start one with `dask scheduler`, "
            f"and give its address: tcp://HOST:8786"
        ) from None
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        client.close()
        raise OptionError(
            f"the scheduler at {address} has no workers; start some with `dask worker {address}`"
        ) from None
    return client


def _greet(address: str) -> None:
    """Ask a scheduler for its identity; TimeoutError, OSError or ValueError if none answers in time."""
    from distributed import rpc
    from distributed.utils import LoopRunner, sync

    async def ask() -> None:
        async with rpc(address, timeout=PATIENCE) as scheduler:
            await scheduler.identity()

    runner = LoopRunner()
    runner.start()
    try:
        sync(runner.loop, ask, callback_timeout=PATIENCE)
    finally:
        runner.stop()


def _answer(future: Future[Answer], address: str) -> Answer:
    """The answer of a worker, or the reason why there is none."""
    try:
        return future.result()
    except CancelledError:
        raise OptionError(
            f"the scheduler at {address} is lost; completed sessions are kept; repeat the command to continue"
        ) from None
    except Exception as error:  # of any type: Dask passes on what a worker raises
        if type(error).__name__ == "KilledWorker":
            return Answer(None, ("every worker that ran it died; it may need more memory than they have",), {})
        why = f"the worker failed ({type(error).__name__}: {error}); check that signid is installed there"
        return Answer(None, (why,), {})
