"""Linear algebra on one thread: the matrices are small, so that more threads cost up to seven times what they bring."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import ThreadpoolController


@contextmanager
def one_thread() -> Iterator[None]:
    """Within it, BLAS works on one thread, however many it would take otherwise; as before afterwards."""
    with ThreadpoolController().limit(limits=1, user_api="blas"):
        yield
