"""Processor time of whole commands on logs of position drives: imports, reading, fit, report."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from ..long import ONE_THREAD
from .drive import Truth
from .identified import RATE, SECONDS
from .plant import record
from .robots import Bench, data_folder, motion

ROWS, EPISODE, PAUSE = 100_000, 300, 3.0  # rows of a long log and of its episodes, time between these [s]


@dataclass(frozen=True)
class Time:
    """Numbers of one process."""

    command: str
    seconds: float  # processor time
    memory: float  # peak [MB]


def times(found: Sequence[Bench], folder: Path) -> Iterator[Time]:
    """Check and identify logs of robots; the first command also compiles the loop, as after an installation."""
    for k, bench in enumerate(found):
        log = folder / f"{bench.name}.csv"
        truth, command = Truth(dict(bench.drives)), motion(bench, 4, SECONDS, RATE, fast=3.0)
        table = pl.DataFrame(record(bench.urdf, truth, command, RATE, 4))
        table.write_csv(log)
        for name in (f"identify {bench.name}, first run", f"identify {bench.name}")[k > 0 :]:
            yield measure(name, ["identify", str(bench.urdf), str(log), "-o", str(folder / "result")], folder)
        for name, pause in (("one stretch", 0.0), (f"episodes of {EPISODE} rows", PAUSE)):
            long_log(table, pause).write_csv(log)
            yield measure(f"check {bench.name}, {ROWS} rows, {name}", ["check", str(log)], folder)
    if data := data_folder():
        go2 = data / "go2_dls"
        files = [str(go2 / "go2.urdf"), str(go2 / "held_base_first.csv.gz")]
        yield measure("identify go2_dls", ["identify", *files, "-o", str(folder / "result")], folder)


def long_log(table: pl.DataFrame, pause: float) -> pl.DataFrame:
    """Rows of a log, repeated, with a pause [s] after each episode."""
    rows = np.arange(ROWS)
    t = rows / RATE + pause * (rows // EPISODE)
    return table[rows % len(table)].with_columns(pl.Series("t", t))


def measure(name: str, arguments: list[str], folder: Path) -> Time:
    """Run one command in a process of its own, with a cache of compiled code in the folder."""
    numbers = folder / "numbers.json"
    environment = {**os.environ, **ONE_THREAD, "NUMBA_CACHE_DIR": str(folder / "compiled")}
    wrapper = [sys.executable, "-m", "benchmarks.measure_command", str(numbers), *arguments]
    subprocess.run(wrapper, env=environment, capture_output=True, check=True)
    found = json.loads(numbers.read_text(encoding="utf-8"))
    return Time(name, found["seconds"], found["memory"])
