"""Shared parts of benchmarks: one thread, tables, JSON-compatible numbers, and where they come from."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

LIBRARIES = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
ONE_THREAD = {**LIBRARIES, "POLARS_MAX_THREADS": "1"}  # environment of child processes


def one_thread() -> None:
    """Restart the program with the one-thread environment unless it is set already."""
    if any(os.environ.get(key) != value for key, value in LIBRARIES.items()):
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], {**os.environ, **LIBRARIES})


def frame(title: str, names: Sequence[str], left: int = 1) -> Table:
    """Empty table whose first `left` columns are left-aligned text."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title=title)
    for k, name in enumerate(names):
        table.add_column(name, justify="left" if k < left else "right", no_wrap=True)
    return table


def print_targets(console: Console, targets: Iterable[tuple[str, bool]]) -> bool:
    """Print each target, missed ones in red; return whether all are met."""
    listed = list(targets)
    for sentence, met in listed:
        console.print(sentence, style="" if met else "red", highlight=False)
    return all(met for _, met in listed)


def finite(x: Any) -> Any:
    """Replace numbers that JSON cannot represent by None."""
    if isinstance(x, dict):
        return {key: finite(value) for key, value in x.items()}
    if isinstance(x, list | tuple):
        return [finite(value) for value in x]
    return None if isinstance(x, float) and not math.isfinite(x) else x


def origin(module: str, arguments: Sequence[str], files: Sequence[str] = ("--json", "--cache")) -> dict[str, str]:
    """Command and commit of figures, for their JSON file.

    Args:
        module: name of the benchmark, such as `concealed_real`.
        arguments: arguments of the command line.
        files: options that name a file or folder; the command leaves them out.
    """
    shown, skip = [], False
    for one in arguments:
        if not skip and not one.startswith(tuple(f"{name}=" for name in files)) and one not in files:
            shown.append(one)
        skip = one in files
    command = " ".join(["python -m", f"benchmarks.{module}", *shown])
    describe = ["git", "describe", "--always", "--dirty", "--abbrev=7", "--exclude=*"]
    try:
        done = subprocess.run(describe, cwd=Path(__file__).parent, capture_output=True, encoding="utf-8", check=True)
    except (OSError, subprocess.CalledProcessError):
        return {"command": command, "commit": "unknown"}
    return {"command": command, "commit": done.stdout.strip()}
