"""Cost of fleets: `python -m benchmarks.fleet [--sessions 8] [--minutes 5] [--turns 2] [--json FILE]`.

Sessions of the 3R arm (20 s at 250 Hz, drives missing in the simulation) are diagnosed by 1, 2 and 4 processes and by a
Dask cluster with two workers, in turns. The best turn of each counts, and all outputs must be equal byte for byte. Then
a 1 kHz recording of the 3R and of the Panda (7 joints) is identified from samples and from its factors file, whole and
in parts, with equal results. The cost of 10,000 robots that record one hour per day is extrapolated from these figures.
Times are processor times of one thread, except for the scaling table.
"""

from __future__ import annotations

import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
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
from signid.regression.reduced import Reduced, add_up, encode_factors, load_factors, reduce
from signid.types import Robot

from .summary import command_line, one_thread, write_json

FREQUENCIES = (0.07, 0.13, 0.29, 0.41, 0.67)  # of the motion [Hz]
PANDA = tuple(f"panda_joint{k}" for k in range(1, 8))
ROBOTS = {"3r": None, "panda": PANDA}
RATE, BITS, NOISE = 1000.0, 17, 0.02  # rate [Hz], encoder bits per turn, torque noise over each joint's rms torque [1]
WAYS = {"1 process": 1, "2 processes": 2, "4 processes": 4}
CLUSTER, PARTS = "Dask, 2 workers", 4
FLEET, DAY = 10_000, 3600.0  # robots, recorded time per robot and day [s]
SAME = 1e-12  # tolerated relative difference between results


@dataclass(frozen=True)
class Reduction:
    """File sizes of a recording and its factors, and times of identification from either."""

    robot: str
    samples: int
    recording: int  # bytes of the Parquet file
    factors: int  # bytes
    report: int  # bytes of report.html
    reading: float  # time to reduce the recording [s]
    samples_seconds: float  # identification from samples [s]
    factors_seconds: float  # identification from the factors file [s]
    squares_seconds: float  # the same without the physically consistent fit [s]
    difference: float  # between the two results, over the largest value [1]
    parts_difference: float  # the same for the sum of the factors of all parts [1]


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


def measure(name: str, minutes: float, folder: Path, turns: int) -> Reduction:
    """Measure identification of one recording from samples and from factors."""
    robot, path = signid.load_robot(name, joints=ROBOTS[name]), folder / f"{name}.parquet"
    write(path, robot, 60 * minutes, RATE, 0)

    def from_recording() -> Any:
        return signid.identify(robot, [signid.read_recording(path, robot)])

    def reduce_recording() -> Reduced:
        return reduce(robot, [signid.read_recording(path, robot)])

    file = folder / f"{name}.npz"
    reading, reduced = best(reduce_recording, turns)
    file.write_bytes(encode_factors(reduced))
    from_samples, whole = best(from_recording, turns)
    from_factors, again = best(lambda: signid.identify(robot, load_factors(file, robot)), 5 * turns)
    squares, _ = best(lambda: signid.identify(robot, load_factors(file, robot), method="wls"), 5 * turns)
    recording = signid.read_recording(path, robot)
    parts = add_up([reduce(robot, [recording], share=(k + 1, PARTS)) for k in range(PARTS)])
    differences = (difference(found, whole) for found in (again, signid.identify(robot, parts)))
    sizes = path.stat().st_size, file.stat().st_size, len(signid.report(whole).encode())
    return Reduction(name, len(recording), *sizes, reading, from_samples, from_factors, squares, *differences)


def best(job: Callable[[], Any], turns: int) -> tuple[float, Any]:
    """Least processor time over `turns` [s] and the last result."""
    seconds, found = [], None
    for _ in range(turns):
        start = time.process_time()
        found = job()
        seconds.append(time.process_time() - start)
    return min(seconds), found


def difference(one: Any, other: Any) -> float:
    """Largest difference of parameters and fit, over the largest value of the same kind."""
    pairs = [(found.base_value, found.estimate.value, found.fit.held_out_rms) for found in (one, other)]
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(*pairs, strict=True))


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


def on_paper(rows: Sequence[Reduction], diagnosis: float) -> Iterator[tuple[str, str, str]]:
    """Yield the extrapolated daily cost of the fleet: quantity and its value for each measured robot."""

    def cells(value: Callable[[Reduction], str]) -> tuple[str, str]:
        first, second = (value(row) for row in rows)
        return first, second

    samples = DAY * RATE
    tera, giga, hours = FLEET * 1e-12, FLEET * 1e-9, FLEET / 3600
    yield "samples, as Parquet [TB]", *cells(lambda r: f"{tera * samples * r.recording / r.samples:.2f}")
    yield "factors shipped instead [GB]", *cells(lambda r: f"{giga * r.factors:.2f}")
    yield "ratio", *cells(lambda r: f"{samples * r.recording / r.samples / r.factors:.0f}")
    yield "reduction at the robot [core-hours]", *cells(lambda r: f"{hours * samples * r.reading / r.samples:.0f}")
    yield "identification from factors, all robots [core-hours]", *cells(lambda r: f"{hours * r.factors_seconds:.2f}")
    whole = f"{hours * diagnosis:.1f}"
    yield "diagnosis of 20 s per robot (3r) [core-hours]", whole, "-"
    yield "report.html of each robot (optional) [GB]", *cells(lambda r: f"{giga * r.report:.0f}")


def show(seconds: dict[str, Taken], sessions: int, rows: Sequence[Reduction], diagnosis: float) -> Iterator[Table]:
    """Yield three tables: scaling, factors, extrapolated fleet."""
    one = seconds["1 process"]
    lines = [
        (way, f"{taken.wall:.1f}", f"{one.wall / taken.wall:.2f}", "-" if way == CLUSTER else f"{taken.processor:.1f}")
        for way, taken in seconds.items()
    ]
    heads = ("execution", "s", "speed-up over 1 process", "processor time [s]")
    yield table(f"{sessions} sessions diagnosed, with process start", heads, lines)
    lines = [
        ("Parquet [MB]", *(f"{r.recording / 1e6:.1f}" for r in rows)),
        ("factors [kB]", *(f"{r.factors / 1e3:.0f}" for r in rows)),
        ("reduce [s]", *(f"{r.reading:.2f}" for r in rows)),
        ("identify from samples [s]", *(f"{r.samples_seconds:.2f}" for r in rows)),
        ("identify from factors [s]", *(f"{r.factors_seconds:.3f}" for r in rows)),
        ("the same with least squares only (wls) [s]", *(f"{r.squares_seconds:.3f}" for r in rows)),
        ("speed-up from factors", *(f"{r.samples_seconds / r.factors_seconds:.0f}" for r in rows)),
        ("difference of the results", *(f"{r.difference:.0e}" for r in rows)),
        (f"the same, in {PARTS} parts", *(f"{r.parts_difference:.0e}" for r in rows)),
    ]
    names = ("", *(row.robot for row in rows))
    yield table(f"a recording of {rows[0].samples / RATE / 60:g} minutes at 1 kHz, processor times", names, lines)
    yield table(
        f"extrapolated: {FLEET:,} robots, one hour per day each at 1 kHz; per day", names, on_paper(rows, diagnosis)
    )


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
    parser.add_argument("--minutes", type=float, default=5.0, help="duration of the long recordings [min]")
    parser.add_argument("--turns", type=int, default=2, help="repetitions of each measurement")
    options, console = parser.parse_args(), Console()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seconds, same = scale(options.sessions, options.turns, folder)
        # processor time of one diagnosis without process start [s]
        model = signid.load_model("3r")
        recording = signid.read_recording(folder / "0.parquet", model.robot)
        diagnosis = best(lambda: signid.diagnose(model, [recording]), options.turns)[0]
        rows = [measure(robot, options.minutes, folder, options.turns) for robot in ROBOTS]
    console.print(*show(seconds, options.sessions, rows, diagnosis), sep="\n")
    worst = max(max(row.difference, row.parts_difference) for row in rows)
    console.print(f"outputs {'are equal' if same else 'DIFFER'}; largest difference {worst:.0e} (at most {SAME:g})")
    numbers = {
        "seconds": {way: taken._asdict() for way, taken in seconds.items()},
        "same": same,
        "diagnosis": diagnosis,
        "rows": rows,
    }
    machine = {"python": platform.python_version(), "numpy": np.__version__}
    write_json(options.json, {"machine": machine, **numbers})
    raise SystemExit(0 if same and worst <= SAME else 1)


if __name__ == "__main__":
    main()
