"""Single-threaded linear algebra: for small matrices, more threads are up to seven times slower."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import ThreadpoolController


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit BLAS to one thread within the block."""
    with ThreadpoolController().limit(limits=1, user_api="blas"):
        yield
