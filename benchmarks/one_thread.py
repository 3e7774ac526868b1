"""Benchmarks that are timed, or that share a machine, compute in one thread."""

from __future__ import annotations

import os
import sys

LIBRARIES = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
ONE_THREAD = {**LIBRARIES, "POLARS_MAX_THREADS": "1"}  # environment of programs that benchmarks start


def one_thread() -> None:
    """Start the program anew unless its libraries were told before they were loaded."""
    if any(os.environ.get(key) != value for key, value in LIBRARIES.items()):
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], {**os.environ, **LIBRARIES})
