"""Cost of fleets: `python -m benchmarks.fleet [--sessions 8] [--turns 2] [--json FILE]`.

Sessions of the 3R arm (20 s at 250 Hz, drives missing in the simulation) are diagnosed by 1, 2 and 4 processes and by a
Dask cluster with two workers, in turns. The best turn of each counts, and all outputs must be equal byte for byte.
"""

from __future__ import annotations

import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from distributed import LocalCluster
from rich.console import Console
from rich.markup import escape
from rich.table import Table

import signid
from signid.regression.motion import Motion
from signid.types import Robot

from .summary import command_line, one_thread, write_json

FREQUENCIES = (0.07, 0.13, 0.29, 0.41, 0.67)  # of the motion [Hz]
BITS, NOISE = 17, 0.02  # encoder bits per turn, torque noise over each joint's rms torque [1]
WAYS = {"1 process": 1, "2 processes": 2, "4 processes": 4}
CLUSTER = "Dask, 2 workers"


class Taken(NamedTuple):
    """Times of one way of execution [s]."""

    wall: float
    processor: float  # of the child processes; not measured for Dask, whose workers end later


def write(path: Path, robot: Robot, seconds: float, rate: float, seed: int) -> None:
    """Write a quantised and noisy recording of the robot with drives missing in its description."""
    t, n = np.arange(round(seconds * rate)) / rate, len(robot.joints)
    rng, w = np.random.default_rng(seed), 2 * np.pi * np.array(FREQUENCIES)
    waves = rng.uniform(0.05, 0.3, (n, len(w))) * np.exp(1j * rng.uniform(0, 2 * np.pi, (n, len(w))))
    centre = np.clip(0.0, robot.lower + 0.5, robot.upper - 0.5)
    q, v, a = (np.imag(np.exp(1j * np.outer(t, w)) @ (waves * (1j * w) ** k).T) for k in range(3))
    torque = Motion(robot, t, q + centre, v, a).load + 0.1 * a + 0.5 * v + 0.8 * np.sign(v)
    step, noise = 2 * np.pi / 2**BITS, rng.standard_normal((2, *q.shape))
    columns = {"q": step * np.round((q + centre) / step + 0.3 * noise[0])}
    columns["tau"] = torque + NOISE * np.sqrt(np.mean(torque**2, axis=0)) * noise[1]
    named = {f"{key}_{robot.joints[j]}": x[:, j] for key, x in columns.items() for j in range(n)}
    pl.DataFrame({"t": t, **named}).write_parquet(path, compression="zstd", compression_level=1)


def best(job: Callable[[], Any], turns: int) -> tuple[float, Any]:
    """Least processor time over `turns` [s] and the last result."""
    seconds, found = [], None
    for _ in range(turns):
        start = time.process_time()
        found = job()
        seconds.append(time.process_time() - start)
    return min(seconds), found


def scale(sessions: int, turns: int, folder: Path) -> tuple[dict[str, Taken], bool]:
    """Least time of each way, and whether all outputs are equal byte for byte."""
    robot, rows = signid.load_robot("3r"), ["robot,recording,name"]
    for k in range(sessions):
        write(folder / f"{k}.parquet", robot, 20.0, 250.0, k)
        rows.append(f"3r,{k}.parquet,arm {k}")
    manifest = folder / "manifest.csv"
    manifest.write_text("\n".join(rows), encoding="utf-8")
    seconds, outputs = dict[str, Taken](), list[dict[str, bytes]]()
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        for turn in range(turns):
            for way in (*WAYS, CLUSTER):
                out = folder / f"{way} {turn}"
                where: dict[str, Any] = (
                    {"scheduler": cluster.scheduler_address} if way == CLUSTER else {"workers": WAYS[way]}
                )
                start = Taken(time.perf_counter(), _children())
                found = signid.fleet(manifest, out, **where)
                now = Taken(time.perf_counter() - start.wall, _children() - start.processor)
                seconds[way] = Taken(*map(min, now, seconds.get(way, now)))
                assert all(one.done for one in found.outcomes), "a session was not diagnosed"
                outputs.append({p.relative_to(out).as_posix(): p.read_bytes() for p in out.rglob("*") if p.is_file()})
    return seconds, all(files == outputs[0] for files in outputs)


def _children() -> float:
    """Processor time of all ended child processes [s]."""
    used = os.times()
    return used.children_user + used.children_system


def show(seconds: dict[str, Taken], sessions: int) -> Table:
    """Times of each way of execution."""
    one = seconds["1 process"]
    lines = [
        (way, f"{taken.wall:.1f}", f"{one.wall / taken.wall:.2f}", "-" if way == CLUSTER else f"{taken.processor:.1f}")
        for way, taken in seconds.items()
    ]
    heads = ("execution", "s", "speed-up over 1 process", "processor time [s]")
    return table(f"{sessions} sessions diagnosed, with process start", heads, lines)


def table(title: str, heads: Sequence[str], lines: Iterable[Sequence[str]]) -> Table:
    """Table of text cells; all columns but the first are right-aligned."""
    result = Table(title=title)
    for k, head in enumerate(heads):
        result.add_column(head, justify="right" if k else "left")
    for line in lines:
        result.add_row(*map(escape, line))
    return result


def main() -> None:
    """Measure, print the tables and write the numbers; exit with 1 when results differ."""
    one_thread()
    parser = command_line("fleet", __doc__)
    parser.add_argument("--sessions", type=int, default=8, help="number of diagnosed sessions")
    parser.add_argument("--turns", type=int, default=2, help="repetitions of each measurement")
    options, console = parser.parse_args(), Console()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seconds, same = scale(options.sessions, options.turns, folder)
        # processor time of one diagnosis without process start [s]
        model = signid.load_model("3r")
        recording = signid.read_recording(folder / "0.parquet", model.robot)
        diagnosis = best(lambda: signid.diagnose(model, [recording]), options.turns)[0]
    console.print(show(seconds, options.sessions), f"outputs {'are equal' if same else 'DIFFER'}", sep="\n")
    machine = {"python": platform.python_version(), "numpy": np.__version__}
    ways = {way: taken._asdict() for way, taken in seconds.items()}
    write_json(options.json, {"machine": machine, "seconds": ways, "same": same, "diagnosis": diagnosis})
    raise SystemExit(0 if same else 1)


if __name__ == "__main__":
    main()
