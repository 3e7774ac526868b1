"""Speed of base-parameter identification: `python -m benchmarks.regressor [--json FILE]`.

10,000 samples at 100 Hz of an arm along a periodic motion; torque from its URDF plus armature, viscous and Coulomb
friction. The baseline ("floor") is a plain Pinocchio loop with normal equations and known base columns. signid does the
same job from the same arrays, then with its filter and noise model. All run in turn on one thread, so that the load of
the machine affects all alike; the least processor time of several turns counts. `--hours H ...` measures the memory
and the time of `signid identify` for long recordings instead.
"""

from __future__ import annotations

import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import polars as pl
from rich.console import Console
from rich.table import Table
from scipy.linalg import cho_factor, cho_solve

from signid.estimation.least_squares import estimate
from signid.identify import identify
from signid.recording import read_recording
from signid.regression.factors import LAGS
from signid.regression.motion import Motion, base_rows
from signid.regression.session import Options, Session, prepare
from signid.robot import hold, load_robot
from signid.types import Array, BaseMap, Recording, Robot

from .arms import base_parameters
from .plants.bodies import Drives
from .summary import command_line, measured, one_thread, print_targets, write_json

ROBOTS = {"panda": ("panda_finger_joint1",), "ur10": ()}  # joints held at zero
# samples, rate [Hz], period [s], harmonics, amplitude [rad]
SAMPLES, RATE, PERIOD, HARMONICS, REACH = 10_000, 100.0, 10.0, 5, 1.8
TIMES, SLIDE = np.arange(SAMPLES) / RATE, 0.01  # [s]; amplitude of a prismatic joint over that of others [m/rad]
LONG_RATE, NOISE, TICK = 1000, 0.02, 2 * np.pi / 2**17  # of long recordings: [Hz], over rms torque [1], [rad or m]
# from base to tip [kg.m2], [N.m.s/rad], [N.m]
DRIVES = {"armature": (0.8, 0.1), "viscous_friction": (3.0, 0.3), "coulomb_friction": (6.0, 0.5)}


class Track(NamedTuple):
    """True motion and torque of an arm."""

    q: Array  # (N, n) [rad]
    v: Array  # (N, n) [rad/s]
    a: Array  # (N, n) [rad/s2]
    tau: Array  # (N, n) [N.m]


def load(name: str) -> Robot:
    """Load the arm with fingers held."""
    return hold(load_robot(name), dict.fromkeys(ROBOTS[name], 0.0))


def move(robot: Robot, seed: int, t: Array = TIMES) -> Track:
    """Draw a motion of five harmonics and compute its torque at times t (N,) [s]."""
    n, order = len(robot.joints), np.arange(1, HARMONICS + 1)
    sines, cosines = np.random.default_rng(seed).standard_normal((2, n, HARMONICS))
    size = REACH / np.sum(np.hypot(sines, cosines), axis=1)[:, None] * (sines + 1j * cosines)
    size, w = size * np.where(robot.prismatic, SLIDE, 1.0)[:, None], 2 * np.pi * order / PERIOD
    q, v, a = (np.imag(np.exp(1j * np.outer(t, w)) @ (size * (1j * w) ** k).T) for k in range(3))
    own = drives(robot)
    rubbing = own.viscous_friction * v + own.coulomb_friction * np.sign(v)
    return Track(q, v, a, Motion(robot, t, q, v, a).load + own.armature * a + rubbing)


def drives(robot: Robot) -> Drives:
    """True drives of the robot."""
    n = len(robot.joints)
    return replace(Drives.none(n), **{name: np.linspace(*ends, n) for name, ends in DRIVES.items()})


def plain(robot: Robot, base: BaseMap, effects: Sequence[str], track: Track, solve: bool = True) -> Callable[[], Array]:
    """Return a function that solves the job with known base columns and all rows in memory."""
    moves = [bool(row.any()) for row in robot.drive]
    still = [k + 1 for k, moving in enumerate(moves) if not moving]
    model = pin.buildReducedModel(robot.model, still, pin.neutral(robot.model)) if still else robot.model
    data, (q, v, a, tau), n = model.createData(), track, model.nv
    place = np.repeat(np.cumsum(moves) - 1, 10) * 10 + np.tile(np.arange(10), len(moves))
    rigid = [int(place[k]) for k in base.independent if base.labels[k].body is not None]
    others = [base.labels[k] for k in base.independent if base.labels[k].body is None]
    signals = {"armature": a, "viscous_friction": v, "coulomb_friction": np.sign(v), "torque_offset": np.ones_like(v)}
    whole, columns = np.empty((SAMPLES, n, 10 * n)), np.zeros((SAMPLES, n, base.rank))

    def run() -> Array:
        compute = pin.computeJointTorqueRegressor
        for i in range(SAMPLES):
            whole[i] = compute(model, data, q[i], v[i], a[i])
        if not solve:
            return whole
        columns[:, :, : len(rigid)] = whole[:, :, rigid]
        for k, label in enumerate(others, len(rigid)):
            columns[:, label.joint, k] = signals[effects[label.law or 0]][:, label.joint]
        x = columns.reshape(-1, base.rank)
        return np.asarray(cho_solve(cho_factor(x.T @ x), x.T @ tau.ravel()))

    return run


BARE = Options(cutoff=np.inf, derivatives="recorded", whiten=False)  # equivalent to the plain loop
TOKEN = 200  # held-out samples, few because validation is not timed
LIMIT, AGREE = 1.5, 1e-9  # bounds [1]: time over the floor, relative error
LOOP, PLAIN = "Pinocchio's loop alone", "floor: + least squares"
SAME, READY, DEFAULT, WHOLE = "signid, same job", "signid, + prepare()", "signid, by default", "signid, identify()"


@dataclass
class Row:
    """Times and errors of one method."""

    robot: str
    job: str
    seconds: list[float]
    parameters: float | None = None  # largest error over the largest base parameter
    torque: float | None = None  # largest error along another motion over the largest torque


def fit(session: Session, whiten: bool) -> Array:
    """Base parameters by signid; without noise model, lagged products are omitted."""
    lags = LAGS if whiten else 0
    factors = session.reduce(session.train, lags=lags)
    return estimate(factors, session.task.base, whiten=whiten).value


def prepare_and_fit(robot: Robot, recording: Recording, token: Recording, options: Options) -> Array:
    """Base parameters by signid including base map, survey and band."""
    return fit(prepare(robot, [recording], [token], options), options.whiten)


def measure(name: str, turns: int) -> Iterator[Row]:
    """Run all methods in turns and yield their rows."""
    robot = load(name)
    train, test = (move(robot, seed) for seed in (0, 1))
    columns = {"t": TIMES, "q": train.q, "dq": train.v, "ddq": train.a, "tau": train.tau}
    recording = read_recording(columns, robot)
    token = read_recording({key: x[:TOKEN] for key, x in columns.items()}, robot)
    same, default = (prepare(robot, [recording], [token], options) for options in (BARE, Options()))
    base, effects = same.task.base, [law.effect.name for law in same.task.laws]
    ways: dict[str, Callable[[], Any]] = {
        LOOP: plain(robot, base, effects, train, solve=False),
        PLAIN: plain(robot, base, effects, train),
        SAME: partial(fit, same, False),
        READY: partial(prepare_and_fit, robot, recording, token, BARE),
        DEFAULT: partial(fit, default, True),
        WHOLE: lambda: identify(robot, [recording], held_out=[token]).base_value,
    }
    seconds: dict[str, list[float]] = {way: [] for way in ways}
    answers: dict[str, Any] = {}
    for turn in range(turns + 1):  # the first turn is a warm-up
        for way, run in ways.items():
            start = time.process_time()
            answers[way] = run()
            seconds[way] += [time.process_time() - start] * (turn > 0)
    errors = partial(_errors, robot, same, test)
    for way, times in seconds.items():
        yield Row(name, way, times, **(errors(answers[way]) if way != LOOP else {}))


def _errors(robot: Robot, session: Session, test: Track, value: Array) -> dict[str, float]:
    """Largest relative errors of parameters and torque."""
    base, laws = session.task.base, session.task.laws
    truth = base_parameters(robot, base, laws, drives(robot))
    motion = Motion(robot, TIMES, test.q, test.v, test.a)
    rows = base_rows(motion, laws, [base.independent] * len(robot.joints))
    torque = np.column_stack([x @ value for x in rows])
    worst = [np.abs(a - b).max() / np.abs(b).max() for a, b in ((value, truth), (torque, test.tau))]
    return {"parameters": float(worst[0]), "torque": float(worst[1])}


def check_targets(rows: Sequence[Row]) -> Iterator[tuple[str, bool]]:
    """Yield each target and whether it is met."""
    for robot in dict.fromkeys(row.robot for row in rows):
        jobs = {row.job: row for row in rows if row.robot == robot}
        best = {job: min(row.seconds) for job, row in jobs.items()}
        for job in (SAME, DEFAULT):
            ratio = best[job] / best[PLAIN]
            yield f"{robot}: {job}: {ratio:.2f} times the floor (at most {LIMIT:g})", ratio <= LIMIT
        worst = max(x for job in (PLAIN, SAME) for x in (jobs[job].parameters, jobs[job].torque) if x is not None)
        yield f"{robot}: parameters and torque agree with the truth to {worst:.1e} (at most {AGREE:g})", worst <= AGREE


def show(robot: str, rows: Sequence[Row]) -> Table:
    """Format the rows of one robot as a table."""
    table = Table(title=f"{robot}: base parameters from {SAMPLES:,} samples, one thread")
    for name in ("job", "best, ms", "median", "x floor", "parameters", "torque"):
        table.add_column(name, justify="left" if name == "job" else "right", no_wrap=True)
    floor = min(next(row.seconds for row in rows if row.job == PLAIN))
    for row in rows:
        best, middle = min(row.seconds), float(np.median(row.seconds))
        times = [f"{1e3 * best:.1f}", f"{1e3 * middle:.1f}"]
        errors = ["" if x is None else f"{x:.0e}" for x in (row.parameters, row.torque)]
        table.add_row(row.job, *times, f"{best / floor:.2f}", *errors)
    return table


def write_long(folder: str, hours: float) -> None:
    """Write hours of the Panda with a finger (8 joints) to FOLDER/long.parquet, made minute by minute."""
    robot, rows = load_robot("panda"), 60 * LONG_RATE
    for minute in range(round(60 * hours)):
        t = np.arange(minute * rows, (minute + 1) * rows) / LONG_RATE
        track, rng = move(robot, 0, t), np.random.default_rng(minute)
        tau = track.tau + NOISE * track.tau.std(0) * rng.standard_normal(track.tau.shape)
        columns = {"t": t}
        for joint, q, torque in zip(robot.joints, track.q.T, tau.T, strict=True):
            columns |= {f"q_{joint}": np.round(q / TICK) * TICK, f"tau_{joint}": torque}
        pl.DataFrame(columns).write_parquet(f"{folder}/part_{minute:04d}.parquet")
    pl.scan_parquet(f"{folder}/part_*.parquet").sink_parquet(f"{folder}/long.parquet")


def identify_long(hours: float) -> dict[str, float]:
    """Memory and time of `signid identify` for hours of a recording, which another process makes."""
    words = [sys.executable, "-m", "signid", "identify", "panda", "long.parquet", "-o", "result"]
    with tempfile.TemporaryDirectory() as place:
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            pool.submit(write_long, place, hours).result()
        code, peak, seconds = measured(words, cwd=place)
    return {"hours": hours, "exit code": code, "peak [MiB]": peak, "processor time [s]": seconds}


def main() -> None:
    """Measure, print the tables and write the numbers; exit with 1 when a target is missed."""
    one_thread()
    parser = command_line("regressor", __doc__)
    parser.add_argument("--turns", type=int, default=7, help="number of turns, of which the best counts (7)")
    parser.add_argument("--hours", type=float, nargs="+", metavar="H", help="identify recordings of 8 joints at 1 kHz")
    options = parser.parse_args()
    console, rows = Console(), list[Row]()
    if options.hours:
        found = [identify_long(hours) for hours in options.hours]
        console.print(*found, sep="\n", highlight=False)
        write_json(options.json, {"hours": found})
        return
    for name in ROBOTS:
        with console.status(name):
            own = list(measure(name, options.turns))
        console.print(show(name, own))
        rows += own
    targets = list(check_targets(rows))
    met = print_targets(console, targets)
    machine = {"python": platform.python_version(), "pinocchio": pin.__version__, "numpy": np.__version__}
    numbers = {"machine": machine, "rows": [vars(row) for row in rows], "targets": dict(targets)}
    write_json(options.json, numbers)
    raise SystemExit(0 if met else 1)


if __name__ == "__main__":
    main()
