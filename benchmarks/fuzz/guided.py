"""Mutations guided by code coverage: `python -m benchmarks.fuzz --guided [--inputs 20000] [--readers URDF CSV ...]`.

Each reader of `readers.py` runs in a separate process on `--inputs` files (xacro: a hundredth, because it starts a
process per file). atheris (libFuzzer) mutates the files, guided by code coverage of signid. A fault is an exception
other than SignidError, more than SECONDS for one file, or more than MEMORY. Needs `pip install atheris`.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

from rich.console import Console
from rich.table import Table

from ..one_thread import ONE_THREAD

SECONDS, MEMORY, LENGTH = (
    60,
    3000,
    20_000,
)  # time per file [s], memory [MB], largest file unless a seed is larger [byte]
SLOW = 100  # divisor on the number of files for readers that start processes


@dataclass(frozen=True)
class Row:
    """Result of one reader."""

    reader: str
    inputs: int
    minutes: float
    memory: int  # peak [MB]
    fault: str  # "" without fault


def attack(name: str, folder: Path, inputs: int) -> None:
    """Fuzz one reader; runs in a separate process and does not return.

    Args:
        name: name of the reader.
        folder: folder for seed files and mutated files.
        inputs: number of files.
    """
    import atheris

    with atheris.instrument_imports(include=["signid", "tomllib"]):
        from .readers import TOKENS, readers
    (reader,) = (each for each in readers() if each.name == name)
    corpus, place, words = folder / "corpus", folder / "files", folder / "words"
    for subfolder in (corpus, place):
        subfolder.mkdir()
    for k, seed in enumerate(reader.seeds):
        (corpus / str(k)).write_bytes(seed)
    words.write_text(
        "\n".join(f'"{"".join(f"{chr(92)}x{b:02x}" for b in token[:60])}"' for token in TOKENS) + "\n", encoding="utf-8"
    )
    warnings.simplefilter("ignore")
    reader(reader.seeds[0], place)
    length = max(LENGTH, *map(len, reader.seeds))
    options = [f"-runs={inputs}", f"-timeout={SECONDS}", f"-rss_limit_mb={MEMORY}", f"-max_len={length}", "-seed=1"]
    options += [f"-dict={words}", f"-artifact_prefix={folder}/fault-", "-print_final_stats=1", "-len_control=0"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], lambda content: reader(content, place) and None)
    atheris.Fuzz()


def measure(name: str, inputs: int, keep: Path | None) -> Row:
    """Fuzz one reader in a separate process; copy a faulty file to `keep`."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks.fuzz", "--attack", name, folder, "--inputs", str(inputs)]
        start = time.perf_counter()
        done = subprocess.run(
            command,
            env={**os.environ, **ONE_THREAD},
            capture_output=True,
            text=True,
            errors="replace",
            encoding="utf-8",
        )
        minutes, output = (time.perf_counter() - start) / 60, done.stdout + done.stderr
        numbers = {key: int(value) for key, value in re.findall(r"stat::(\w+):\s+(\d+)", output)}
        fault = "" if done.returncode == 0 else _fault(output)
        for file in Path(folder).glob("fault-*") if keep else ():
            (keep / f"{name.replace(' ', '_')}-{file.name}").write_bytes(file.read_bytes())
    return Row(name, numbers.get("number_of_executed_units", 0), minutes, numbers.get("peak_rss_mb", 0), fault)


def _fault(output: str) -> str:
    """Extract the line that describes the fault."""
    lines = [
        line for line in output.splitlines() if re.match(r"[\w.]*(Error|Exception|Interrupt)\b|==.*(ERROR|ALARM)", line)
    ]
    return (lines or output.strip().splitlines() or ["unknown"])[0][:200]


def show(rows: Sequence[Row]) -> Table:
    """Format the rows as a table."""
    table = Table(title="files given to each reader")
    for name in ("reader", "files", "minutes", "peak, MB", "fault"):
        table.add_column(name, justify="left" if name in ("reader", "fault") else "right")
    for row in rows:
        table.add_row(row.reader, f"{row.inputs:,}", f"{row.minutes:.1f}", str(row.memory), row.fault or "none")
    return table


def run_guided(options: argparse.Namespace) -> NoReturn:
    """Fuzz every reader and print the table; exit with 1 on a fault."""
    if find_spec("atheris") is None:
        raise SystemExit("atheris is not installed; run `pip install atheris` (Linux and macOS)")
    if options.attack:
        attack(options.attack[0], Path(options.attack[1]), options.inputs)
    from .readers import readers

    console, rows = Console(), list[Row]()
    for reader in readers():
        if not options.readers or reader.name in options.readers:
            with console.status(reader.name):
                rows.append(measure(reader.name, max(1, options.inputs // (SLOW if reader.slow else 1)), options.keep))
    console.print(show(rows))
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=1), encoding="utf-8")
    raise SystemExit(1 if any(row.fault for row in rows) else 0)
