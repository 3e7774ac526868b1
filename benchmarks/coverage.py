"""Coverage of 95 % confidence intervals on simulated robots: `python -m benchmarks.coverage [--quick] [--json FILE]`.

MuJoCo simulates each robot along 20 motions. Each motion is logged ten times with independent noise and identified.
"""

from __future__ import annotations

import platform
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table

from signid.estimation.least_squares import estimate
from signid.recording import read_recording
from signid.regression.session import Session, prepare
from signid.types import TWO_SIDED, Array, Estimate, Robot

from .arms import ARMS, Arm, load, truth
from .plants.mujoco_ import Body, Track, draw_motion, log, simulate
from .summary import command_line, frame, origin, write_json

MOTIONS, DRAWS, DURATION, BITS = 20, 10, 20.0, 17  # motions, recordings per motion, duration [s], encoder bits per turn
# white and coloured noise over each joint's rms torque [1]
NOISES = {"white": (0.05, 0.0), "white, 3 Hz": (0.05, 0.025)}
LOW_NOISE = {"1 % white": (0.01, 0.0)}  # low enough to reveal small model errors
HELD = {"held 2 ms, 1 %": (0.01, 0.0), "held 2 ms, 0.1 %": (0.001, 0.0)}  # zero-order hold of the torque over HOLD rows
HOLD, HELD_RATE, HELD_MOTIONS = 2, 1000.0, 10  # rows, rate [Hz], motions with one recording each
TARGET = (93.0, 97.0)  # accepted coverage [%]
HELD_TARGET = 90.0  # lower bound on coverage [%]; no upper bound, because the model error justifies wider intervals


class Trial(NamedTuple):
    """Error of the estimate from one recording."""

    z: Array  # (b,) [1] error over its standard deviation
    cutoff: float  # Hz
    orders: tuple[int, ...]


@dataclass(frozen=True)
class Row:
    """Results of one robot under one noise; shares of intervals that contain the true value [%]."""

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
    median_bias: float  # median over parameters of |median of z|
    largest_bias: float
    without_width: float  # intervals with a variance that is not positive and finite [%]; they count as misses
    cutoff: float  # median [Hz]
    highest_order: int
    seconds: float

    @property
    def holds(self) -> bool:
        """Whether mean coverage is within the target, over all parameters and over those of the drives."""
        if self.noise in HELD:
            return self.coverage >= HELD_TARGET
        return all(TARGET[0] <= share <= TARGET[1] for share in (self.coverage, self.drives))


def record(arm: Arm, robot: Robot, motions: int = MOTIONS) -> list[Track]:
    """Simulate the noise-free track of each motion."""
    body = Body(robot.document, robot.joints)
    return [simulate(body, arm.drives, draw_motion(arm.centre, k), DURATION, arm.rate) for k in range(motions)]


def hold(track: Track) -> Track:
    """Hold the recorded torque over HOLD rows (zero order); the mean delay is half a row."""
    first = np.arange(len(track.t)) // HOLD * HOLD
    return track._replace(tau=track.tau[first])


def identify(robot: Robot, columns: dict[str, Array]) -> tuple[Session, Estimate]:
    """Estimate base parameters by least squares from a whole recording, with signid's defaults."""
    recording = read_recording(columns, robot)
    session = prepare(robot, [recording], held_out=[recording])
    return session, estimate(session.reduce(session.train), session.task.base)


def trials(
    arm: Arm, robot: Robot, tracks: Sequence[Track], noise: tuple[float, float], draws: int = DRAWS
) -> Iterator[tuple[Session, Trial]]:
    """Yield one trial for each motion and noise draw."""
    for k, track in enumerate(tracks):
        for draw in range(draws):
            session, found = identify(robot, log(track, 1000 * k + draw, BITS, *noise))
            z = (found.value - truth(arm, session)) / found.std
            yield session, Trial(z, session.task.band.cutoff, found.orders)


def evaluate(arm: Arm, robot: Robot, tracks: Sequence[Track], noise: str, draws: int = DRAWS) -> Row:
    """Compute the coverage of one robot under one noise."""
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
    """Format the rows as a table."""
    title = f"coverage of nominal 95 % intervals, % (target {TARGET[0]:g} to {TARGET[1]:g}; held: {HELD_TARGET:g})"
    names = ("robot", "noise", "runs", "b", "all", "inertial", "drives", "worst", "rms z", "Hz")
    table = frame(title, names, left=2)
    for row in rows:
        shares = [f"{share:.1f}" for share in (row.coverage, row.inertial, row.drives, row.worst)]
        rest = [f"{row.rms_z:.2f}", f"{row.cutoff:.1f}"]
        counts = [str(row.recordings), str(row.parameters)]
        table.add_row(row.robot, row.noise, *counts, *shares, *rest, style="" if row.holds else "red")
    return table


def main() -> None:
    """Run the selected cells, print the table and write the numbers; a full run exits with 1 when a cell misses."""
    parser = command_line("coverage", __doc__)
    parser.add_argument(
        "--quick", action="store_true", help="the 3R arm unless --robot is given, three recordings per motion"
    )
    parser.add_argument("--low-noise", action="store_true", help="add 1 %% white noise alone")
    parser.add_argument("--held", action="store_true", help="add torque held for 2 ms, recorded at 1 kHz")
    parser.add_argument("--robot", choices=[arm.robot for arm in ARMS], help="run only this robot")
    options = parser.parse_args()
    only = options.robot or ("3r" if options.quick else None)
    console, rows = Console(), []
    for arm in (arm for arm in ARMS if only in (None, arm.robot)):
        robot = load(arm)
        tracks = record(arm, robot)
        for noise in [*NOISES, *(LOW_NOISE if options.low_noise else ())]:
            with console.status(f"{arm.robot}, {noise} noise"):
                rows.append(evaluate(arm, robot, tracks, noise, 3 if options.quick else DRAWS))
        if options.held:
            held = [hold(track) for track in record(replace(arm, rate=HELD_RATE), robot, HELD_MOTIONS)]
            rows += [evaluate(arm, robot, held, noise, 1) for noise in HELD]
    console.print(show(rows))
    for row in rows:
        summary = f"{row.robot}, {row.noise}: worst {row.worst:.0f} % at {row.worst_parameter}"
        invalid = f"; {row.without_width:.2g} % of the intervals have no valid variance" if row.without_width else ""
        console.print(summary + invalid, highlight=False, soft_wrap=True)
    machine = {"python": platform.python_version(), "mujoco": mujoco.__version__, "processor": platform.machine()}
    document = {"origin": origin("coverage", sys.argv[1:]), "machine": machine, "rows": rows}
    write_json(options.json, document)
    raise SystemExit(0 if options.quick or all(row.holds for row in rows) else 1)


if __name__ == "__main__":
    main()
