"""Time and memory on long recordings: `python -m benchmarks.long [--samples N ...] [--json FILE]`.

The 3R arm at 1 kHz, from 0.3 to 36 million samples in one Parquet file: a motion of 100 s with torque by Pinocchio plus
drives, repeated with independent noise. Each file is identified in a separate process with all defaults. Time and peak
memory are those of the whole process, start and reading included.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import polars as pl
from polars.io.plugins import register_io_source
from rich.console import Console
from rich.table import Table

import signid
from signid.regression.motion import Motion
from signid.types import Array, Robot

from .measure_command import peak
from .summary import ONE_THREAD, command_line, print_targets, write_json

ROBOT, RATE, PERIOD = "3r", 1000.0, 100.0  # robot, rate [Hz], period of the motion [s]
SAMPLES = (300_000, 1_000_000, 3_000_000, 10_000_000, 36_000_000)
DRIVES = {"armature": (0.12, 0.1, 0.03), "viscous_friction": (0.6, 0.5, 0.2), "coulomb_friction": (0.9, 0.8, 0.3)}
FREQUENCIES = (0.07, 0.13, 0.29, 0.41, 0.67)  # of the motion [Hz]; whole cycles per period
BITS, NOISE = 17, 0.02  # encoder bits per turn; torque noise over each joint's rms torque [1]
ROW_GROUP = 2**18
MEMORY, SLOPE = 1000.0, 1.05  # upper bounds: memory [MB]; d log(time) / d log(samples) between the longest two [1]


@dataclass(frozen=True)
class Row:
    """Results of one recording."""

    samples: int
    megabytes: float  # file size
    seconds: float
    memory: float  # peak [MB]
    error: float  # largest relative error of the drive parameters [1]
    held_out_r2: float  # smallest over joints

    @property
    def rate(self) -> float:
        """Seconds per million samples."""
        return self.seconds / self.samples * 1e6


def move(robot: Robot) -> tuple[Array, Array]:
    """Noise-free positions and torque over one period, (N, 3) each [rad], [N.m]."""
    t, n = np.arange(round(PERIOD * RATE)) / RATE, len(robot.joints)
    rng, w = np.random.default_rng(0), 2 * np.pi * np.array(FREQUENCIES)
    waves = rng.uniform(0.1, 0.4, (n, len(w))) * np.exp(1j * rng.uniform(0, 2 * np.pi, (n, len(w))))
    q, v, a = (np.imag(np.exp(1j * np.outer(t, w)) @ (waves * (1j * w) ** k).T) for k in range(3))
    load = Motion(robot, t, q, v, a).load
    armature, viscous, coulomb = map(np.array, DRIVES.values())
    return q, load + armature * a + viscous * v + coulomb * np.sign(v)


def write(path: Path, samples: int, joints: Sequence[str], q: Array, torque: Array) -> None:
    """Write a recording period by period: the same motion with independent noise in each period.

    Args:
        path: Parquet file to write.
        samples: number of samples.
        joints: joint names (n,).
        q: positions over one period (N, n) [rad or m].
        torque: noise-free torque (N, n) [N.m or N].
    """
    names = ["t", *(f"{kind}_{joint}" for kind in ("q", "tau") for joint in joints)]
    step, size = 2 * np.pi / 2**BITS, NOISE * np.sqrt(np.mean(torque**2, axis=0))

    def periods(*_: Any) -> Iterator[pl.DataFrame]:
        for k, start in enumerate(range(0, samples, len(q))):
            count, rng = min(len(q), samples - start), np.random.default_rng((1, k))
            noise = rng.standard_normal((2, count, q.shape[1]))
            read = step * np.round(q[:count] / step + 0.3 * noise[0])
            t = np.round(np.arange(start, start + count) / RATE, 6)
            columns = np.column_stack([t, read, torque[:count] + size * noise[1]]).T
            yield pl.DataFrame(dict(zip(names, columns, strict=True)))

    schema = dict.fromkeys(names, pl.Float64())
    frame = register_io_source(periods, schema=schema)
    frame.sink_parquet(path, row_group_size=ROW_GROUP, compression="zstd", compression_level=1)


def identify(path: Path) -> dict[str, float]:
    """Identify a recording: work of the separate process, and its results."""
    robot = signid.load_robot(ROBOT)
    found = signid.identify(robot, [signid.read_recording(path, robot)])
    values = dict(zip((label.name for label in found.parameters.labels), found.parameters.values, strict=True))
    true = {f"{key}_{j + 1}": x for key in ("viscous_friction", "coulomb_friction") for j, x in enumerate(DRIVES[key])}
    error = max(abs(values[name] / x - 1) for name, x in true.items())
    return {"memory": peak(), "error": error, "held_out_r2": float(found.fit.held_out_r2.min())}


def measure(path: Path, samples: int) -> Row:
    """Write a recording, identify it in a separate process and remove it."""
    q, torque = move(signid.load_robot(ROBOT))
    write(path, samples, [str(j + 1) for j in range(q.shape[1])], q, torque)
    start = time.perf_counter()
    command = [sys.executable, "-m", "benchmarks.long", "--identify", str(path)]
    output = subprocess.run(command, env={**os.environ, **ONE_THREAD}, stdout=subprocess.PIPE, check=True).stdout
    seconds, size = time.perf_counter() - start, path.stat().st_size / 1e6
    path.unlink()
    return Row(samples, size, seconds, **json.loads(output))


def slopes(rows: Sequence[Row]) -> list[float]:
    """Log-log slope of time over samples from each row to the next (1: linear)."""
    time_, count = np.log([row.seconds for row in rows]), np.log([row.samples for row in rows])
    return [float(x) for x in np.diff(time_) / np.diff(count)]


def check_targets(rows: Sequence[Row]) -> Iterator[tuple[str, bool]]:
    """Yield each target and whether it is met."""
    worst = max(row.memory for row in rows)
    yield f"peak memory: {worst:.0f} MB (at most {MEMORY:g})", worst <= MEMORY
    if len(rows) > 1:
        slope = slopes(rows)[-1]
        yield f"log-log slope of time at the end: {slope:.2f} (at most {SLOPE:g}; 1 is linear)", slope <= SLOPE


def show(rows: Sequence[Row]) -> Table:
    """Format the rows as a table."""
    table = Table(title=f"{ROBOT} at {RATE:g} Hz, one Parquet file, all defaults, one thread")
    for name in ("samples", "file, MB", "time, s", "s / million", "slope", "peak, MB", "friction"):
        table.add_column(name, justify="right", no_wrap=True)
    for row, slope in zip(rows, [None, *slopes(rows)], strict=True):
        size = [f"{row.samples / 1e6:g} M", f"{row.megabytes:.0f}", f"{row.seconds:.1f}", f"{row.rate:.2f}"]
        found = [f"{row.memory:.0f}", f"{100 * row.error:.2f} %"]
        table.add_row(*size, "" if slope is None else f"{slope:.2f}", *found)
    return table


def main() -> None:
    """Measure, print the table and write the numbers; exit with 1 when a target is missed."""
    parser = command_line("long", __doc__)
    parser.add_argument(
        "--samples", type=int, nargs="+", default=SAMPLES, help="lengths of the recordings [samples], ascending"
    )
    parser.add_argument("--identify", type=Path, metavar="FILE", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.identify:
        print(json.dumps(identify(options.identify)))
        return
    console, rows = Console(), list[Row]()
    with tempfile.TemporaryDirectory() as folder:
        for samples in options.samples:
            with console.status(f"{samples:,} samples"):
                rows.append(measure(Path(folder) / "recording.parquet", samples))
    console.print(show(rows))
    targets = list(check_targets(rows))
    met = print_targets(console, targets)
    machine = {"python": platform.python_version(), "pinocchio": pin.__version__, "polars": pl.__version__}
    numbers = {"machine": machine, "rows": rows, "targets": dict(targets)}
    write_json(options.json, numbers)
    raise SystemExit(0 if met else 1)


if __name__ == "__main__":
    main()
