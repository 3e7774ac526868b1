"""Run the sessions of a manifest, store each in its folder, and evaluate them jointly."""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, chdir, closing, contextmanager, redirect_stderr, redirect_stdout
from hashlib import sha256
from importlib import import_module
from io import StringIO
from logging import CRITICAL, getLogger
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from shutil import rmtree
from threading import Lock, Thread, local
from types import MappingProxyType, ModuleType
from typing import Any, NamedTuple

from ...errors import InputError, OptionError
from ...output.report import check_foreign, probe_folder, write_files
from ...toml_json import read_json
from ...typed import typed
from ...types import Progress
from ...version import __version__
from ..terminal import DONE, FLAGGED
from .manifest import Entry, describe_robots, digest, read_inputs, read_manifest
from .result import DOCUMENT_OF_TASK, Fleet, Outcome, summarise

SESSION_FILE = "session.json"
SESSION_SCHEMA = "signid.session/2"
COMMANDS_MODULE = "signid.cli.run"  # carries out all commands, this room's too
COMMANDS_PER_PROCESS = 50  # [commands] per process; limits the growth of its memory
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS")
DASK_LOGGERS = ("distributed", "distributed.client", "tornado.application", "asyncio")  # loggers of Dask
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

    The folder of a session holds the files of its command and session.json, which appears last. Sessions whose
    session.json states the same files, command and version are not run again.

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
    entries, outcomes = listed.entries, dict[int, Outcome]()
    report = progress or (lambda stage, share: None)
    described, places = describe_robots(listed), [Path(folder, "sessions", entry.session) for entry in entries]
    probe_folder(Path(folder, "sessions"))
    for entry, place in zip(entries, places, strict=True):
        check_foreign(place, (SESSION_FILE, DOCUMENT_OF_TASK[entry.task], "model.json", "robot.urdf", "report.html"))

    def fail(k: int, code: int | None, said: tuple[str, ...]) -> None:
        reason = "; ".join(said) or "no reason given"
        sentence = f"session {entries[k].session} (line {entries[k].line}) failed: {reason}"
        if not keep_going:
            raise InputError(sentence)
        outcomes[k] = Outcome(entries[k], code, said)
        if failed is not None:
            failed(sentence)

    todo, reused = dict[int, Mapping[str, Any]](), 0
    for k, entry in enumerate(entries):
        report("reading recordings", k / len(entries))
        try:
            inputs = [file._asdict() for file in (*described[k], *read_inputs(entry, listed.folder))]
        except InputError as error:
            fail(k, None, (str(error),))
            continue
        record = {"arguments": list(entry.arguments(seed)), "inputs": inputs, "version": __version__}
        if DOCUMENT_OF_TASK[entry.task] in (stored := read_session(places[k], record)).get("files", ()):
            outcomes[k], reused = _outcome(entry, places[k], stored), reused + 1
        else:
            todo[k] = record
    orders = [Order(entries[k].arguments(seed), str(listed.folder)) for k in todo]
    numbers = list(todo)
    report(f"{len(outcomes)} of {len(entries)} sessions", len(outcomes) / len(entries))
    with closing(spread(orders, workers, scheduler)) as answers:
        for number, answer in answers:
            k = numbers[number]
            if answer.done:
                ending = {"code": answer.code, "said": list(answer.said)}
                stored = write_session(places[k], {**todo[k], **ending}, answer.files)
                outcomes[k] = _outcome(entries[k], places[k], stored)
            else:
                fail(k, answer.code, answer.said)
            report(f"{len(outcomes)} of {len(entries)} sessions", len(outcomes) / len(entries))
    return Fleet(tuple(outcomes[k] for k in range(len(entries))), listed.input, seed, reused)


def read_session(place: Path, wanted: Mapping[str, Any] = MappingProxyType({})) -> Mapping[str, Any]:
    """The session.json of a folder; empty if it or a listed file is not as signid wrote it, or not as `wanted`.

    Args:
        place: folder of the session.
        wanted: arguments, inputs and version that the session must have.
    """
    try:
        session = read_json(place / SESSION_FILE)
        files, said = dict(session["files"]), list(session["said"])
        whole = files and files == {name: digest(place / name, name) for name in files}
        sound = session["code"] in (DONE, FLAGGED) and all(isinstance(sentence, str) for sentence in said)
        return session if whole and sound and session.items() >= wanted.items() else {}
    except (OSError, ValueError, TypeError, KeyError):
        return {}


def write_session(place: Path, record: Mapping[str, Any], files: Mapping[str, bytes]) -> Mapping[str, Any]:
    """Write the files of a session and return its session.json, which appears last; files of an earlier one go.

    Raises:
        OutputError: they cannot be written, or would replace files that signid did not write.
    """
    earlier = read_session(place).get("files", {})
    digests = {name: sha256(content).hexdigest() for name, content in sorted(files.items())}
    written = {"schema": SESSION_SCHEMA, "session": place.name, **record, "files": digests}
    write_files(place, {SESSION_FILE: json.dumps(written, indent=2, ensure_ascii=False) + "\n", **files})
    for path in place.iterdir():
        if path.name in earlier and path.name not in files:
            path.unlink()
    return written


def _outcome(entry: Entry, place: Path, stored: Mapping[str, Any]) -> Outcome:
    summary = summarise(entry.task, read_json(place / DOCUMENT_OF_TASK[entry.task]))
    return Outcome(entry, stored["code"], tuple(stored["said"]), tuple(stored["files"]), summary)


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
    """Run a command in this process, after those that other threads of it run.

    Raises:
        RuntimeError: the order comes from another version of signid.
    """
    if order.version != __version__:
        raise RuntimeError(f"signid {__version__} there, {order.version} here")
    errors = StringIO()
    with _RUNNING, tempfile.TemporaryDirectory(prefix="signid-") as place:
        with chdir(order.folder), redirect_stdout(StringIO()), redirect_stderr(errors):
            code = import_module(COMMANDS_MODULE).run([*order.arguments, "-o", place])
        files = {path.name: path.read_bytes() for path in sorted(Path(place).iterdir())}
    return Answer(code, tuple(line.removeprefix("signid: ") for line in errors.getvalue().splitlines()), files)


def spread(
    orders: Sequence[Order], workers: int | None = None, scheduler: str | None = None
) -> Generator[tuple[int, Answer], None, None]:
    """Yield the index and answer of each order when it completes, with the reason where a worker failed.

    Raises:
        OptionError: Dask is not installed, or no scheduler with a worker answers, or the scheduler is lost.
    """
    if scheduler is not None and workers is not None:
        raise OptionError("--workers is for this machine, a scheduler has its own; give one of these options")
    place = _processes(workers or cores()) if scheduler is None or not orders else _cluster(scheduler)
    with place as submit:
        futures = {submit(order): k for k, order in enumerate(orders)}
        for future in as_completed(list(futures)):
            try:
                answer = future.result()
            except CancelledError:
                raise OptionError(f"the scheduler at {scheduler} is lost; repeat the command to continue") from None
            except Exception as error:  # of any type: executors pass on what a worker raises
                died = type(error).__name__ in ("BrokenProcessPool", "KilledWorker")
                why = "its process died; if memory is short, give it fewer or shorter recordings, or fewer workers"
                what = f"the worker failed ({type(error).__name__}: {error}); it needs the same signid and paths"
                answer = Answer(None, (why if died else what,), {})
            yield futures.pop(future), answer


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _processes(workers: int) -> Iterator[Callable[[Order], Future[Answer]]]:
    """Threads of this process, each with a warm process of its own; these end with the block or with the caller."""
    context, thread = _Context(), local()
    lives, end = context.Pipe(duplex=False)

    def start() -> None:
        if hasattr(signal, "pthread_sigmask"):  # Ctrl-C reaches the caller alone: processes inherit the mask
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        renew()

    def renew() -> None:
        thread.pool = ProcessPoolExecutor(1, context, _begin, (place, lives), max_tasks_per_child=COMMANDS_PER_PROCESS)

    def answer(order: Order) -> Answer:
        try:
            future: Future[Answer] = thread.pool.submit(carry_out, order)
            return future.result()
        except BrokenProcessPool:
            renew()
            raise

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
        given = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(folders), **dict.fromkeys(THREAD_VARIABLES, "1")}
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
    """Prepare a process: temporary files in one place, no output of libraries, an end when `lives` is closed."""
    tempfile.tempdir = place
    silent = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(silent, stream)

    def end() -> None:
        lives.poll(None)
        rmtree(place, ignore_errors=True)
        os._exit(1)

    Thread(target=end, daemon=True).start()


@contextmanager
def _cluster(address: str) -> Iterator[Callable[[Order], Future[Answer]]]:
    """Workers of a Dask scheduler, each of which runs one order at a time; without Dask's messages."""
    try:
        from distributed import Client, rpc
        from distributed.utils import LoopRunner, sync
    except ImportError:
        raise OptionError("--scheduler needs Dask, which is not installed: pip install 'signid[fleet]'") from None

    async def greet() -> None:
        async with rpc(address, timeout=PATIENCE) as scheduler:
            await scheduler.identity()

    runner = LoopRunner()
    with ExitStack() as stack:
        for log in map(getLogger, DASK_LOGGERS):
            stack.callback(log.setLevel, log.level)
            log.setLevel(CRITICAL + 1)
        runner.start()
        stack.callback(runner.stop)
        try:
            sync(runner.loop, greet, callback_timeout=PATIENCE)  # a client waits for a silent server without end
            client = stack.enter_context(Client(address, timeout=PATIENCE, set_as_default=False))
            client.wait_for_workers(1, timeout=PATIENCE)
        except (OSError, TimeoutError, ValueError) as error:
            raise OptionError(
                f"no Dask scheduler with a worker answers at {address} ({type(error).__name__}); start `dask scheduler`"
                f" and `dask worker {address}`, and give its address: tcp://HOST:8786"
            ) from None
        executor = client.get_executor()
        stack.callback(executor.shutdown, wait=False)
        yield lambda order: executor.submit(carry_out, order)
