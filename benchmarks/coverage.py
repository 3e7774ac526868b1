"""Do 95 % intervals hold the truth in 95 % of recordings? `python -m benchmarks.coverage [--quick] [--json FILE]`.

Robots are simulated by MuJoCo along 20 motions, each logged ten times with other noise, and identified by signid.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from signid.estimation.least_squares import estimate
from signid.recording import read_recording
from signid.regression.prepare import prepare
from signid.regression.session import Session
from signid.types import TWO_SIDED, Estimate, Robot

from .arms import ARMS, Arm, load, truth
from .plants.mujoco_ import Body, Track, draw_motion, log, simulate

Array = NDArray[np.float64]

MOTIONS, DRAWS, DURATION, BITS = 20, 10, 20.0, 17  # motions, recordings of each, s, bits a turn
NOISES = {"white": (0.05, 0.0), "white, 3 Hz": (0.05, 0.025)}  # shares of each joint's rms torque
LOW_NOISE = {"1 % white": (0.01, 0.0)}  # small errors of the model show against it
HELD = {"held 2 ms, 1 %": (0.01, 0.0), "held 2 ms, 0.1 %": (0.001, 0.0)}  # each torque is held for HOLD rows
HOLD, HELD_RATE, HELD_MOTIONS = 2, 1000.0, 10  # rows, Hz, motions of one recording each
TARGET = (93.0, 97.0)  # %
HELD_TARGET = 90.0  # %, lower bound only: the model has an error, and wider intervals are correct


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
        if self.noise in HELD:
            return self.coverage >= HELD_TARGET
        return all(TARGET[0] <= share <= TARGET[1] for share in (self.coverage, self.drives))


def record(arm: Arm, robot: Robot, motions: int = MOTIONS) -> list[Track]:
    """What truly happens along each motion."""
    body = Body(robot.document, robot.joints)
    return [simulate(body, arm.drives, draw_motion(arm.centre, k), DURATION, arm.rate) for k in range(motions)]


def hold(track: Track) -> Track:
    """Zero-order hold of the recorded torque over HOLD rows: half a row late on average."""
    first = np.arange(len(track.t)) // HOLD * HOLD
    return track._replace(tau=track.tau[first])


def identify(robot: Robot, columns: dict[str, Array]) -> tuple[Session, Estimate]:
    """Least squares from a whole recording, by signid's own pipeline and defaults."""
    recording = read_recording(columns, robot)
    session = prepare(robot, [recording], held_out=[recording])
    return session, estimate(session.reduce(session.train), session.task.base)


def trials(
    arm: Arm, robot: Robot, tracks: Sequence[Track], noise: tuple[float, float], draws: int = DRAWS
) -> Iterator[tuple[Session, Trial]]:
    """Each motion with each draw of the noise."""
    for k, track in enumerate(tracks):
        for draw in range(draws):
            session, found = identify(robot, log(track, 1000 * k + draw, BITS, *noise))
            z = (found.value - truth(arm, session)) / found.std
            yield session, Trial(z, session.task.band.cutoff, found.orders)


def judge(arm: Arm, robot: Robot, tracks: Sequence[Track], noise: str, draws: int = DRAWS) -> Row:
    """Coverage of one robot under one noise."""
    start = time.perf_counter()
    done = list(trials(arm, robot, tracks, (NOISES | LOW_NOISE | HELD)[noise], draws))
    base = done[0][0].task.base
    z = np.array([trial.z for _, trial in done])
    held = 100 * (np.abs(z) < TWO_SIDED).mean(0)
    of_drive = np.array([base.labels[k].law is not None for k in base.independent])
    bias = np.abs(np.nanmedian(z, axis=0))
    return Row(
        robot=arm.robot,
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
        title=f"truth inside nominal 95 % intervals, % (target {TARGET[0]:g} to {TARGET[1]:g}; held: {HELD_TARGET:g})",
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
    parser.add_argument("--held", action="store_true", help="also torque that is held for 2 ms, recorded at 1 kHz")
    parser.add_argument("--robot", choices=[arm.robot for arm in ARMS], help="one robot alone")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there")
    options = parser.parse_args()
    only = options.robot or ("3r" if options.quick else None)
    console, rows = Console(), []
    for arm in (arm for arm in ARMS if only in (None, arm.robot)):
        robot = load(arm)
        tracks = record(arm, robot)
        for noise in [*NOISES, *(LOW_NOISE if options.low_noise else ())]:
            with console.status(f"{arm.robot}, {noise} noise"):
                rows.append(judge(arm, robot, tracks, noise, 3 if options.quick else DRAWS))
        if options.held:
            held = [hold(track) for track in record(replace(arm, rate=HELD_RATE), robot, HELD_MOTIONS)]
            rows += [judge(arm, robot, held, noise, 1) for noise in HELD]
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
