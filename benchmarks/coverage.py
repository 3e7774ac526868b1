"""Do 95 % intervals hold the truth in 95 % of recordings? `python -m benchmarks.coverage [--quick] [--json FILE]`.

Robots are simulated by MuJoCo along 20 motions, each logged ten times with other noise, and identified by signid.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from signid.estimate import estimate
from signid.prepare import prepare
from signid.recording import read_recording
from signid.robot import load_robot
from signid.session import Session
from signid.types import Estimate, Robot

from .plants.mujoco_ import Body, Drives, Track, draw_motion, log, simulate

Array = NDArray[np.float64]

MOTIONS, DRAWS, DURATION, BITS = 20, 10, 20.0, 17  # motions, recordings of each, s, bits a turn
NOISES = {"white": (0.05, 0.0), "white, 3 Hz": (0.05, 0.025)}  # shares of each joint's rms torque
LOW_NOISE = {"1 % white": (0.01, 0.0)}  # small errors of the model show against it
NORMAL = 1.96  # standard deviations of a nominal 95 % interval
TARGET = (93.0, 97.0)  # %


@dataclass(frozen=True)
class Case:
    """A robot, its drives and where it moves."""

    robot: str
    joints: int  # the first of the file; the others are held at zero
    rate: float  # Hz
    centre: tuple[float, ...]  # rad
    drives: Drives


CASES = (
    Case(
        "3r",
        3,
        250.0,
        (0.0, 0.3, 0.5),
        Drives((0.12, 0.10, 0.03), (0.60, 0.50, 0.20), (0.90, 0.80, 0.30), (0.05, -0.12, 0.04)),
    ),
    Case(
        "panda",
        7,
        250.0,
        (0.0, -0.3, 0.0, -1.8, 0.0, 1.8, 0.5),
        Drives(
            (0.6, 0.6, 0.45, 0.6, 0.2, 0.2, 0.1),
            (0.8, 1.0, 0.6, 1.2, 0.5, 0.3, 0.3),
            (0.5, 0.8, 0.6, 1.2, 0.8, 0.3, 0.5),
            (-0.1, 0.3, 0.1, -0.2, 0.1, 0.05, -0.05),
        ),
    ),
    Case(
        "ur10",
        6,
        125.0,
        (0.0, -1.2, 1.2, -0.5, 0.5, 0.0),
        Drives(
            (3.0, 3.0, 1.5, 0.4, 0.4, 0.4),
            (15.0, 14.0, 8.0, 2.5, 2.0, 2.0),
            (8.0, 8.0, 4.0, 2.0, 2.0, 1.8),
            (0.2, -0.7, 0.2, 0.05, 0.0, 0.04),
        ),
    ),
)


class Trial(NamedTuple):
    """One recording's estimate against the truth."""

    z: Array  # (b,) [1] error over its standard deviation
    cutoff: float  # Hz
    orders: tuple[int, ...]


@dataclass(frozen=True)
class Row:
    """One robot under one noise; percentages of intervals that hold the truth."""

    robot: str
    noise: str
    recordings: int
    parameters: int
    coverage: float
    inertial: float
    drives: float
    worst: float
    worst_parameter: str
    rms_z: float
    median_bias: float  # |median of z|, in the median over parameters
    largest_bias: float
    without_width: float  # % of intervals whose variance is not a positive number; they hold nothing
    cutoff: float  # Hz, median
    highest_order: int
    seconds: float

    @property
    def holds(self) -> bool:
        """Whether the mean over all parameters, and over those of the drives, is within the target."""
        return all(TARGET[0] <= share <= TARGET[1] for share in (self.coverage, self.drives))


def load(case: Case) -> Robot:
    """The robot as signid sees it, surplus joints held."""
    return load_robot(case.robot, joints=[str(j + 1) for j in range(case.joints)])


def record(case: Case, robot: Robot, motions: int = MOTIONS) -> list[Track]:
    """What truly happens along each motion."""
    body = Body(robot.document, robot.joints)
    return [simulate(body, case.drives, draw_motion(case.centre, k), DURATION, case.rate) for k in range(motions)]


def truth(case: Case, session: Session) -> Array:
    """(b,) [units of base] from the URDF's inertials and the drives of the plant."""
    task = session.task
    bodies = [task.robot.model.inertias[i + 1].toDynamicParameters() for i in range(len(task.robot.links))]
    drives = [getattr(case.drives, law.effect.name)[law.joints[0]] for law in task.laws]
    return np.asarray(task.base.combination @ np.concatenate([*bodies, drives]))


def identify(robot: Robot, columns: dict[str, Array]) -> tuple[Session, Estimate]:
    """Least squares from a whole recording, by signid's own pipeline and defaults."""
    recording = read_recording(columns, robot)
    session = prepare(robot, [recording], held_out=[recording])
    return session, estimate(session.reduce(session.train), session.task.base)


def trials(
    case: Case, robot: Robot, tracks: Sequence[Track], noise: tuple[float, float], draws: int = DRAWS
) -> Iterator[tuple[Session, Trial]]:
    """Each motion with each draw of the noise."""
    for k, track in enumerate(tracks):
        for draw in range(draws):
            session, found = identify(robot, log(track, 1000 * k + draw, BITS, *noise))
            z = (found.value - truth(case, session)) / found.std
            yield session, Trial(z, session.task.band.cutoff, found.orders)


def judge(case: Case, robot: Robot, tracks: Sequence[Track], noise: str, draws: int = DRAWS) -> Row:
    """Coverage of one robot under one noise."""
    start = time.perf_counter()
    done = list(trials(case, robot, tracks, (NOISES | LOW_NOISE)[noise], draws))
    base = done[0][0].task.base
    z = np.array([trial.z for _, trial in done])
    held = 100 * (np.abs(z) < NORMAL).mean(0)
    of_drive = np.array([base.labels[k].law is not None for k in base.independent])
    bias = np.abs(np.nanmedian(z, axis=0))
    return Row(
        robot=case.robot,
        noise=noise,
        recordings=len(z),
        parameters=len(held),
        coverage=float(held.mean()),
        inertial=float(held[~of_drive].mean()),
        drives=float(held[of_drive].mean()),
        worst=float(held.min()),
        worst_parameter=base.expressions[int(held.argmin())],
        rms_z=float(np.sqrt(np.nanmean(z**2))),
        median_bias=float(np.median(bias)),
        largest_bias=float(bias.max()),
        without_width=float(100 * np.mean(~np.isfinite(z))),
        cutoff=float(np.median([trial.cutoff for _, trial in done])),
        highest_order=max(max(trial.orders) for _, trial in done),
        seconds=time.perf_counter() - start,
    )


def show(rows: Sequence[Row]) -> Table:
    """The rows as a table to read."""
    table = Table(
        box=SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
        title=f"truth inside nominal 95 % intervals, % (target {TARGET[0]:g} to {TARGET[1]:g})",
    )
    for name in ("robot", "noise", "runs", "b", "all", "inertial", "drives", "worst", "rms z", "Hz"):
        table.add_column(name, justify="left" if name in ("robot", "noise") else "right", no_wrap=True)
    for row in rows:
        shares = [f"{share:.1f}" for share in (row.coverage, row.inertial, row.drives, row.worst)]
        rest = [f"{row.rms_z:.2f}", f"{row.cutoff:.1f}"]
        counts = [str(row.recordings), str(row.parameters)]
        table.add_row(row.robot, row.noise, *counts, *shares, *rest, style="" if row.holds else "red")
    return table


def main() -> None:
    """Run the cells asked for, print the table, write the numbers; a full run exits with 1 when a cell misses."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.coverage", description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="the 3R arm unless another is named, three recordings a motion"
    )
    parser.add_argument("--low-noise", action="store_true", help="also 1 %% of white noise alone")
    parser.add_argument("--robot", choices=[case.robot for case in CASES], help="one robot alone")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there")
    options = parser.parse_args()
    only = options.robot or ("3r" if options.quick else None)
    console, rows = Console(), []
    for case in (case for case in CASES if only in (None, case.robot)):
        robot = load(case)
        tracks = record(case, robot)
        for noise in [*NOISES, *(LOW_NOISE if options.low_noise else ())]:
            with console.status(f"{case.robot}, {noise} noise"):
                rows.append(judge(case, robot, tracks, noise, 3 if options.quick else DRAWS))
    console.print(show(rows))
    for row in rows:
        told = f"{row.robot}, {row.noise}: worst {row.worst:.0f} % at {row.worst_parameter}"
        none = f"; {row.without_width:.2g} % of the intervals have no width" if row.without_width else ""
        console.print(told + none, highlight=False, soft_wrap=True)
    if options.json:
        machine = {"python": platform.python_version(), "mujoco": mujoco.__version__, "processor": platform.machine()}
        options.json.write_text(
            json.dumps({"machine": machine, "rows": [asdict(row) for row in rows]}, indent=1), encoding="utf-8"
        )
    raise SystemExit(0 if options.quick or all(row.holds for row in rows) else 1)


if __name__ == "__main__":
    main()
