"""Distribution of orders over processes of this machine or workers of a Dask scheduler."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager
from logging import CRITICAL, getLogger, root
from typing import Any
from uuid import uuid4

from ...errors import OptionError
from .process import Answer, Order, Processes, carry_out

Answers = Generator[tuple[int, Answer], None, None]
HEARS = 0.2  # poll interval for interruptions while waiting [s]
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
    if scheduler is None or not orders:
        return _here(orders, workers or cores())
    return _elsewhere(orders, scheduler)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _here(orders: Sequence[Order], workers: int) -> Answers:
    processes = Processes()
    with ThreadPoolExecutor(min(workers, max(1, len(orders)))) as pool:
        futures = {pool.submit(processes.carry_out, order): k for k, order in enumerate(orders)}
        try:
            while futures:
                for future in wait(futures, HEARS, FIRST_COMPLETED).done:
                    yield futures.pop(future), future.result()
        finally:  # also if the consumer stops early
            pool.shutdown(wait=False, cancel_futures=True)
            processes.stop()


def _elsewhere(orders: Sequence[Order], address: str) -> Answers:
    try:
        from distributed import Client, as_completed as completed
    except ImportError:
        raise OptionError("--scheduler needs Dask, which is not installed: pip install 'signid[fleet]'") from None
    with _hushed(), _client(Client, address) as client:
        mark = uuid4().hex
        futures = {client.submit(carry_out, order, key=f"signid-{mark}-{k}"): k for k, order in enumerate(orders)}
        for future in completed(list(futures), loop=client.loop):
            yield futures.pop(future), _answer(future, address)
            future.release()


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


def _answer(future: Any, address: str) -> Answer:
    """The answer of a worker, or the reason why there is none."""
    if future.status == "finished":
        found: Answer = future.result()
        return found
    if future.status in ("cancelled", "lost"):
        raise OptionError(
            f"the scheduler at {address} is lost; completed sessions are kept; repeat the command to continue"
        )
    error = future.exception()
    if type(error).__name__ == "KilledWorker":
        return Answer(None, ("every worker that ran it died; it may need more memory than they have",), {})
    return Answer(
        None, (f"the worker failed ({type(error).__name__}: {error}); check that signid is installed there",), {}
    )
