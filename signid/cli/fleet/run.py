"""Run the sessions of a manifest, store each in its folder, and evaluate them jointly."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import chdir, closing, contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
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

from ...errors import InputError, ManifestError, OptionError, SignidError
from ...typed import typed
from ...types import Input, Progress
from ...version import __version__
from ..terminal import DONE, FLAGGED
from .manifest import Entry, Manifest, read_manifest
from .result import Fleet, Outcome, gather
from .store import Store, check_robot, key, read_inputs
from .summary import FILES, Summary, summarise

COMMANDS = "signid.cli.run"  # carries out all commands, this room's too
TRIES = 2  # attempts at a command that runs alone
LASTS = 50  # [commands] per process; limits the growth of its memory
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS")
LOUD = ("distributed", "tornado", "asyncio")  # loggers of Dask
PATIENCE = 8.0  # time limit for a scheduler to answer and to have a worker [s]
_RUNNING = Lock()  # held by the command that runs, since folder and streams are those of the process
_STARTING = Lock()  # held while a process starts, since it inherits environment and main module


@dataclass(frozen=True)
class _Task:
    """A session with its input files and its key."""

    entry: Entry
    inputs: tuple[Input, ...]
    key: str  # "" if an input file cannot be read
    fault: str = ""  # reason


@typed
def fleet(
    manifest: str | Path,
    folder: str | Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    seed: int = 0,
    keep_going: bool = True,
    progress: Progress | None = None,
    failed: Callable[[str], None] | None = None,
) -> Fleet:
    """Diagnose or identify many robots and recordings, each session in a separate process.

    The folder of a session appears when it is complete; it holds the files of its command and session.json. Existing
    sessions with the same files, command and version are not run again.

    Args:
        manifest: CSV file of sessions, see `read_manifest`.
        folder: output folder; its folder `sessions` gets one folder per session.
        scheduler: address of a Dask scheduler to use; its workers read the same paths as this machine.
        workers: processes on this machine; default: one per core.
        seed: seed of every session.
        keep_going: continue if a session fails.
        progress: callback with the number of completed sessions.
        failed: callback with a sentence for each session that fails, at once: before any session runs if a file of it
            cannot be read.

    Raises:
        ManifestError: rows of the manifest are invalid.
        InputError: the scheduler is not available; or a session failed and `keep_going` is False.
        OutputError: results cannot be written.
    """
    listed = read_manifest(manifest)
    report = progress or (lambda stage, share: None)
    say = failed or (lambda sentence: None)
    tasks = _prepare(listed, seed, workers or cores(), report)
    with Store(folder) as store:
        store.check(task.entry.session for task in tasks)
        answers = {k: Answer(None, (task.fault,), {}) for k, task in enumerate(tasks) if task.fault}
        if answers and not keep_going:
            raise InputError(_sentence(tasks[min(answers)].entry, answers[min(answers)]))
        for k, answer in answers.items():
            say(_sentence(tasks[k].entry, answer))
        todo = [k for k, task in enumerate(tasks) if store.record(task.entry.session).get("key") != task.key != ""]
        done = len(tasks) - len(todo)
        reused = done - len(answers)
        report(f"{done} of {len(tasks)} sessions", done / len(tasks))
        entries = [tasks[k].entry for k in todo]
        orders = [Order(one.arguments(seed), str(listed.folder)) for one in entries]
        with closing(spread(orders, workers, scheduler)) as found:
            for number, answer in found:
                task, done = tasks[todo[number]], done + 1
                if answer.done:
                    _keep(store, task, orders[number], answer)
                elif keep_going:
                    answers[todo[number]] = answer
                    say(_sentence(task.entry, answer))
                else:
                    raise InputError(_sentence(task.entry, answer))
                report(f"{done} of {len(tasks)} sessions", done / len(tasks))
        return gather(
            [_outcome(store, task, answers.get(k)) for k, task in enumerate(tasks)], listed.input, seed, reused
        )


def _prepare(listed: Manifest, seed: int, workers: int, report: Progress) -> list[_Task]:
    """Check all robots, then list each session with the digests of its files."""
    described, faults = list[tuple[Input, ...]](), list[str]()
    for entry in listed.entries:
        try:
            described.append(check_robot(entry, listed.folder))
        except SignidError as error:
            faults.append(f"{Path(listed.input.path).name}, line {entry.line}: {error}")
    if faults:
        raise ManifestError(faults)

    def made(entry: Entry, robot: Sequence[Input]) -> _Task:
        try:
            inputs = (*robot, *read_inputs(entry, listed.folder))
        except InputError as error:
            return _Task(entry, (), "", str(error))
        return _Task(entry, inputs, key(entry.arguments(seed), inputs))

    tasks = list[_Task]()
    with ThreadPoolExecutor(workers) as pool:  # digests are computed in parallel
        for task in pool.map(made, listed.entries, described):
            report("reading recordings", len(tasks) / len(listed.entries))
            tasks.append(task)
    return tasks


def _keep(store: Store, task: _Task, order: Order, answer: Answer) -> None:
    record = {
        "session": task.entry.session,
        "key": task.key,
        "arguments": list(order.arguments),
        "inputs": [file._asdict() for file in task.inputs],
        "code": answer.code,
        "said": list(answer.said),
        "files": sorted(answer.files),
        "version": order.version,
    }
    store.keep(task.entry.session, record, answer.files)


def _outcome(store: Store, task: _Task, answer: Answer | None) -> Outcome:
    """The outcome of a session, from its folder or from the answer of a failed command."""
    if answer is not None:
        return Outcome(task.entry, answer.code, answer.said, (), Summary())
    record = store.record(task.entry.session)
    summary = summarise(task.entry.task, store.document(task.entry.session, FILES[task.entry.task]))
    return Outcome(task.entry, record["code"], tuple(record["said"]), tuple(record["files"]), summary)


def _sentence(entry: Entry, answer: Answer) -> str:
    return f"session {entry.session} (line {entry.line}) failed: {'; '.join(answer.said) or 'no reason given'}"


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
        pool = ProcessPoolExecutor(workers, context, _begin, (place,))
        try:
            yield pool, context.started
        finally:
            for process in context.started:
                if process.pid is not None:
                    process.terminate()
            pool.shutdown(cancel_futures=True)


def _begin(place: str) -> None:
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
