"""Restriction of numerical libraries to one thread, for timing and on shared machines."""

from __future__ import annotations

import os
import sys

LIBRARIES = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
ONE_THREAD = {**LIBRARIES, "POLARS_MAX_THREADS": "1"}  # environment of child processes


def one_thread() -> None:
    """Restart the program with the one-thread environment unless it is set already."""
    if any(os.environ.get(key) != value for key, value in LIBRARIES.items()):
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], {**os.environ, **LIBRARIES})
