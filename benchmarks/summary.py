"""Shared parts of benchmarks: one thread, tables, JSON-compatible numbers, and where they come from."""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, is_dataclass
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


def command_line(name: str, text: str | None) -> argparse.ArgumentParser:
    """Parser of `python -m benchmarks.NAME` with the option that all share."""
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks.{name}", description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE as JSON")
    return parser


def data() -> Path:
    """Folder of the real recordings; without one the program ends."""
    if not (folder := os.environ.get("SIGNID_DATA")):
        sys.exit("SIGNID_DATA is not set; real recordings are not in the repository; set it to their folder")
    return Path(folder)


def write_json(path: Path | None, document: Any) -> None:
    """Write a document in one step, if a file was asked for; dataclasses are objects, NaN is null."""
    if path is not None:
        part = path.with_name(f"{path.name}.part")
        part.write_text(json.dumps(finite(document), indent=1, allow_nan=False) + "\n", encoding="utf-8")
        part.replace(path)


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


def peak() -> float:
    """Peak memory of this process [MB], without that of its parent where the system reports it."""
    status = Path("/proc/self/status")
    if status.is_file():
        line = next(x for x in status.read_text(encoding="utf-8").splitlines() if x.startswith("VmHWM"))
        return float(line.split()[1]) * 1.024e-3
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1e-6 if sys.platform == "darwin" else 1.024e-3)


def measured(words: Sequence[str], **options: Any) -> tuple[int, float, float]:
    """Run a program on one thread: exit code, peak of its largest process [MiB], processor time of all [s].

    The peak is at least the memory of this process, as the system counts it from before the program begins.

    Args:
        words: program and arguments.
        options: those of `subprocess.Popen`; what the program prints is dropped by default.
    """
    dropped = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    child = subprocess.Popen(words, env={**os.environ, **ONE_THREAD}, **(dropped | options))
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return child.returncode, usage.ru_maxrss / unit, usage.ru_utime + usage.ru_stime


def finite(x: Any) -> Any:
    """Dataclasses as dictionaries, and numbers that JSON cannot represent as None."""
    if is_dataclass(x) and not isinstance(x, type):
        return finite(asdict(x))
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
