"""Distribution of orders over processes of this machine or workers of a Dask scheduler."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor, as_completed
from contextlib import AbstractContextManager, contextmanager
from logging import CRITICAL, getLogger, root
from typing import Any

from ...errors import OptionError
from .process import Answer, Order, Processes, carry_out, release

Answers = Generator[tuple[int, Answer], None, None]
Place = tuple[Executor, Callable[[Order], Answer]]  # where orders run, and how
LOUD = ("distributed", "tornado", "asyncio")  # loggers of Dask
PATIENCE = 8.0  # time limit for a scheduler to answer and to have a worker [s]


def spread(orders: Sequence[Order], workers: int | None = None, scheduler: str | None = None) -> Answers:
    """Yield the index and answer of each order when it completes; orders of lost workers are repeated.

    Raises:
        OptionError: Dask is not installed, or no scheduler with a worker answers, or the scheduler is lost.
    """
    if scheduler is not None and workers is not None:
        raise OptionError(
            "--workers is for this machine, but a scheduler has its own workers; give one of these options"
        )
    here = scheduler is None or not orders
    return _answers(_here(workers or cores()) if here else _elsewhere(str(scheduler)), orders, scheduler)


def _answers(opened: AbstractContextManager[Place], orders: Sequence[Order], scheduler: str | None) -> Answers:
    with opened as (executor, job):
        futures = {executor.submit(job, order): k for k, order in enumerate(orders)}
        for future in as_completed(list(futures)):
            yield futures.pop(future), _answer(future, scheduler)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _here(workers: int) -> Iterator[Place]:
    """Threads of this process, each of which waits for a process of its own."""
    processes = Processes()
    with ThreadPoolExecutor(workers) as threads:
        try:
            yield threads, processes.carry_out
        finally:  # also if the consumer stops early
            threads.shutdown(wait=False, cancel_futures=True)
            processes.stop()


@contextmanager
def _elsewhere(address: str) -> Iterator[Place]:
    """Workers of a Dask scheduler, each of which runs orders in processes of its own."""
    try:
        from distributed import Client
    except ImportError:
        raise OptionError("--scheduler needs Dask, which is not installed: pip install 'signid[fleet]'") from None
    with _hushed(), _client(Client, address) as client:
        executor = client.get_executor()
        try:
            yield executor, carry_out
            client.run(release, on_error="ignore")
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


def _answer(future: Future[Answer], address: str | None) -> Answer:
    """The answer of a worker, or the reason why there is none."""
    try:
        return future.result()
    except CancelledError:
        raise OptionError(
            f"the scheduler at {address} is lost; completed sessions are kept; repeat the command to continue"
        ) from None
    except Exception as error:  # of any type: Dask passes on what a worker raises
        if address is None:
            raise
        if type(error).__name__ == "KilledWorker":
            return Answer(None, ("every worker that ran it died; it may need more memory than they have",), {})
        why = f"the worker failed ({type(error).__name__}: {error}); check that signid is installed there"
        return Answer(None, (why,), {})
