"""Run the sessions of a manifest, store each in its folder, and evaluate them jointly."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import chdir, closing, contextmanager, redirect_stderr, redirect_stdout
from importlib import import_module
from io import StringIO
from logging import CRITICAL, getLogger, root
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from shutil import rmtree
from threading import Lock, Thread, local
from types import ModuleType
from typing import Any, NamedTuple

from ...errors import InputError, ManifestError, OptionError, SignidError
from ...typed import typed
from ...types import Input, Progress
from ...version import __version__
from ..terminal import DONE, FLAGGED
from .manifest import Entry, Manifest, read_manifest
from .result import Fleet
from .store import Store, check_robot, read_inputs
from .summary import FILES, Outcome, summarise

COMMANDS = "signid.cli.run"  # carries out all commands, this room's too
TRIES = 2  # attempts at a session whose process dies
LASTS = 50  # [commands] per process; limits the growth of its memory
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS")
LOUD = ("distributed", "tornado", "asyncio")  # loggers of Dask
PATIENCE = 8.0  # time limit for a scheduler to answer and to have a worker [s]
_RUNNING = Lock()  # held by the command that runs, since folder and streams are those of the process
_STARTING = Lock()  # held while a process starts, since it inherits environment and main module


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
    report, entries, missing = progress or (lambda stage, share: None), listed.entries, dict[int, Outcome]()
    records = _records(listed, seed, workers or cores(), report)

    def fail(k: int, code: int | None, said: tuple[str, ...]) -> None:
        reason = "; ".join(said) or "no reason given"
        sentence = f"session {entries[k].session} (line {entries[k].line}) failed: {reason}"
        if not keep_going:
            raise InputError(sentence)
        missing[k] = Outcome(entries[k], code, said)
        if failed is not None:
            failed(sentence)

    with Store(folder) as store:
        store.check(entry.session for entry in entries)
        for k, record in enumerate(records):
            if isinstance(record, str):
                fail(k, None, (record,))
        runs = {k: one for k, one in enumerate(records) if not isinstance(one, str)}
        todo = [k for k, record in runs.items() if not store.record(entries[k].session, record)]
        reused, done = len(runs) - len(todo), len(entries) - len(todo)
        report(f"{done} of {len(entries)} sessions", done / len(entries))
        orders = [Order(entries[k].arguments(seed), str(listed.folder)) for k in todo]
        with closing(spread(orders, workers, scheduler)) as answers:
            for number, answer in answers:
                k, done = todo[number], done + 1
                if answer.done:
                    ending = {"code": answer.code, "said": list(answer.said)}
                    store.keep(entries[k].session, {**runs[k], **ending}, answer.files)
                else:
                    fail(k, answer.code, answer.said)
                report(f"{done} of {len(entries)} sessions", done / len(entries))
        outcomes = (missing.get(k) or _stored(store, entry) for k, entry in enumerate(entries))
        return Fleet(tuple(outcomes), listed.input, seed, reused)


def _records(listed: Manifest, seed: int, workers: int, report: Progress) -> list[Mapping[str, Any] | str]:
    """Check all robots; then what a stored session must have been made from, or why its files cannot be read."""
    described, faults = list[tuple[Input, ...]](), list[str]()
    for entry in listed.entries:
        try:
            described.append(check_robot(entry, listed.folder))
        except SignidError as error:
            faults.append(f"{Path(listed.input.path).name}, line {entry.line}: {error}")
    if faults:
        raise ManifestError(faults)

    def made(entry: Entry, robot: Sequence[Input]) -> Mapping[str, Any] | str:
        try:
            inputs = [file._asdict() for file in (*robot, *read_inputs(entry, listed.folder))]
        except InputError as error:
            return str(error)
        return {"arguments": list(entry.arguments(seed)), "inputs": inputs, "version": __version__}

    records = list[Mapping[str, Any] | str]()
    with ThreadPoolExecutor(workers) as pool:  # digests are computed in parallel
        for record in pool.map(made, listed.entries, described):
            report("reading recordings", len(records) / len(listed.entries))
            records.append(record)
    return records


def _stored(store: Store, entry: Entry) -> Outcome:
    record, document = store.record(entry.session), store.document(entry.session, FILES[entry.task])
    summary = summarise(entry.task, document)
    return Outcome(entry, record["code"], tuple(record["said"]), tuple(record["files"]), summary)


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
    place = _processes(workers or cores()) if scheduler is None or not orders else _cluster(scheduler)
    with place as submit:
        futures = {submit(order): k for k, order in enumerate(orders)}
        for future in as_completed(list(futures)):
            yield futures.pop(future), _answer(future, scheduler)


def _answer(future: Future[Answer], address: str | None) -> Answer:
    """The answer of a worker, or the reason why there is none."""
    try:
        return future.result()
    except CancelledError:
        raise OptionError(
            f"the scheduler at {address} is lost; completed sessions are kept; repeat the command to continue"
        ) from None
    except BrokenProcessPool:
        why = f"its process died {TRIES} times; if memory is short, give it fewer or shorter recordings"
    except Exception as error:  # of any type: executors pass on what a worker raises
        why = f"the worker failed ({type(error).__name__}: {error}); check that signid is installed there"
        if type(error).__name__ == "KilledWorker":
            why = "every worker that ran it died; it may need more memory than they have"
    return Answer(None, (why,), {})


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _processes(workers: int) -> Iterator[Callable[[Order], Future[Answer]]]:
    """Threads of this process, each with a warm process of its own; these end with the block or with the caller."""
    context, own = _Context(), local()
    lives, end = context.Pipe(duplex=False)

    def renew() -> None:
        own.pool, own.left = ProcessPoolExecutor(1, context, _begin, (place, lives)), LASTS

    def start() -> None:
        if hasattr(signal, "pthread_sigmask"):  # Ctrl-C reaches the caller alone, also while a process starts
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        renew()

    def answer(order: Order, tries: int = TRIES) -> Answer:
        if not own.left:
            own.pool.shutdown()
            renew()
        own.left -= 1
        try:
            future: Future[Answer] = own.pool.submit(carry_out, order)
            return future.result()
        except BrokenProcessPool:
            renew()
            if tries == 1 or end.closed:
                raise
            return answer(order, tries - 1)

    with (
        tempfile.TemporaryDirectory(prefix="signid-", ignore_cleanup_errors=True) as place,
        ThreadPoolExecutor(workers, initializer=start) as threads,
    ):
        try:
            yield lambda order: threads.submit(answer, order)
        finally:
            end.close()
            threads.shutdown(cancel_futures=True)


class _Process(SpawnProcess):
    """A process of one thread that imports nothing of the caller: no main module, nothing beside the manifest."""

    def start(self) -> None:
        folders = filter(os.path.isabs, os.environ.get("PYTHONPATH", "").split(os.pathsep))
        given = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(folders), **dict.fromkeys(THREADS, "1")}
        with _STARTING:
            before, main = dict(os.environ), sys.modules["__main__"]
            os.environ.update(given)
            sys.modules["__main__"] = ModuleType("__main__")
            try:
                super().start()
            finally:
                sys.modules["__main__"] = main
                for name in given:
                    del os.environ[name]
                os.environ.update({name: before[name] for name in given.keys() & before.keys()})


class _Context(SpawnContext):
    Process = _Process


def _begin(place: str, lives: Connection) -> None:
    """Prepare a process: a session and temporary files of its own, no output, an end when `lives` is closed."""
    if begin_session := getattr(os, "setsid", None):  # Linux shares processor time between sessions
        begin_session()
    tempfile.tempdir = place
    silent = os.open(os.devnull, os.O_WRONLY)
    for stream in (1,) if os.environ.get("SIGNID_DEBUG") else (1, 2):
        os.dup2(silent, stream)

    def end() -> None:
        lives.poll(None)
        rmtree(place, ignore_errors=True)
        os._exit(1)

    Thread(target=end, daemon=True).start()


@contextmanager
def _cluster(address: str) -> Iterator[Callable[[Order], Future[Answer]]]:
    """Workers of a Dask scheduler, each of which runs one order at a time; without Dask's messages and tracebacks."""
    try:
        from distributed import Client, rpc
        from distributed.utils import LoopRunner, sync
    except ImportError:
        raise OptionError("--scheduler needs Dask, which is not installed: pip install 'signid[fleet]'") from None

    async def greet() -> None:
        async with rpc(address, timeout=PATIENCE) as scheduler:
            await scheduler.identity()

    runner = LoopRunner()
    names = [name for name in root.manager.loggerDict if name.partition(".")[0] in LOUD]
    levels = {log: log.level for log in map(getLogger, {*LOUD, *names})}
    for log in levels:
        log.setLevel(CRITICAL + 1)
    try:
        try:
            runner.start()
            sync(runner.loop, greet, callback_timeout=PATIENCE)  # a client would wait longer for a silent server
            client = Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise OptionError(
                f"no Dask scheduler answers at {address} ({type(error).__name__}); start one with `dask scheduler`, "
                f"and give its address: tcp://HOST:8786"
            ) from None
        with client:
            try:
                client.wait_for_workers(1, timeout=PATIENCE)
            except TimeoutError:
                why = f"has no workers; start some with `dask worker {address}`"
                raise OptionError(f"the scheduler at {address} {why}") from None
            executor = client.get_executor()
            try:
                yield lambda order: executor.submit(carry_out, order)
            finally:
                executor.shutdown(wait=False)
    finally:
        runner.stop()
        for log, level in levels.items():
            log.setLevel(level)
