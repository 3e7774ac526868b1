"""Orders over processes of this machine, or over all that a Dask scheduler has."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager
from logging import CRITICAL, getLogger
from typing import Any
from uuid import uuid4

from ...errors import OptionError
from .process import Answer, Order, Processes, carry_out

Answers = Generator[tuple[int, Answer], None, None]
HEARS = 0.2  # [s] after which whoever waits hears an interruption, whichever thread it reached
PATIENCE = 30.0  # [s] for a scheduler to answer and to have a worker


def spread(orders: Sequence[Order], workers: int | None = None, scheduler: str | None = None) -> Answers:
    """Each order's number and answer, as soon as it is there; work whose worker is lost is done again elsewhere.

    Args:
        orders: what is to be done.
        workers: processes of this machine; as many as it has cores by default.
        scheduler: address of a Dask scheduler whose workers do it instead.

    Raises:
        OptionError: Dask is not installed, or no scheduler with a worker answers at the address, or it is lost.
    """
    if scheduler is not None and workers is not None:
        raise OptionError("--workers counts processes of this machine, a scheduler has workers of its own; give one")
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
        finally:  # also when nobody wants the rest
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
    """Dask's own words about a lost connection are left out: a sentence of ours says it."""
    log = getLogger("distributed.client")
    level = log.level
    log.setLevel(CRITICAL)
    try:
        yield
    finally:
        log.setLevel(level)


def _client(make: Any, address: str) -> Any:
    try:
        client = make(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        told = f"no Dask scheduler answers at {address} ({type(error).__name__})"
        raise OptionError(f"{told}; start one with `dask scheduler`, and give its address: tcp://HOST:8786") from None
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        client.close()
        raise OptionError(
            f"the scheduler at {address} has no workers; start some with `dask worker {address}`"
        ) from None
    return client


def _answer(future: Any, address: str) -> Answer:
    """What a worker answered, or why none did."""
    if future.status == "finished":
        found: Answer = future.result()
        return found
    if future.status in ("cancelled", "lost"):
        raise OptionError(
            f"the scheduler at {address} is lost; what is done is kept, and the same command goes on from it"
        )
    error = future.exception()
    if type(error).__name__ == "KilledWorker":
        return Answer(None, ("worker after worker died on it; it may need more memory than they have",), {})
    return Answer(
        None, (f"the worker could not do it ({type(error).__name__}: {error}); is signid installed there?",), {}
    )
