"""Identification of a pendulum with and without the signs of its torque: `python -m benchmarks.pendulum`.

PyBullet swings robots/1r under PD along random motions; position and torque are logged at 50 Hz. Velocity and
acceleration come from differences, filtered as Pennese and Vulcano do (Robotics II project, Sapienza University of
Rome, 2020), or from signid's own filters. Of logged |torque| the signs are found by an exhaustive search: the torque is
linear in two coefficients, so each choice of signs costs one product with two numbers per segment. The simulation is
independent of signid: Bullet parses the URDF and computes the dynamics.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
import pybullet
from rich.console import Console
from rich.table import Table
from scipy.signal import butter, sosfiltfilt

from signid.identify import identify
from signid.recording import read_recording
from signid.regression.session import Options
from signid.robot import load_robot
from signid.types import TWO_SIDED, Array, Robot

from .summary import command_line, frame, write_json

URDF = Path(__file__).parents[1] / "robots" / "1r" / "robot.urdf"
GRAVITY = 9.81  # [m/s2]
STEP, PERIOD = 1e-3, 0.02  # periods of simulation and control, and of the log [s]
STIFFNESS, DAMPING = 600.0, 60.0  # gains of the position loop [N.m/rad], [N.m.s/rad]: 3 Hz, well damped
HARMONICS, FUNDAMENTAL = 5, 0.1  # number of harmonics, fundamental frequency [Hz]
RANGE = np.pi / 2  # largest distance of a motion from its start [rad]
REPEATS = 5  # periods per motion
BITS, NOISE = 17, 0.02  # encoder bits per turn, torque noise over rms torque [1]


class Track(NamedTuple):
    """True position, and the torque held until the next sample."""

    t: Array  # (N,) [s]
    q: Array  # (N,) [rad]
    tau: Array  # (N,) [N.m]


class Motion(NamedTuple):
    """Fourier motion from zero: sums of sine / frequency - cosine / frequency."""

    sine: Array  # (HARMONICS,) [rad/s]
    cosine: Array  # (HARMONICS,) [rad/s]

    def at(self, t: Array) -> tuple[Array, Array]:
        """Position and velocity, (N,) each [rad, rad/s] at times (N,) [s]."""
        w = 2 * np.pi * FUNDAMENTAL * np.arange(1, HARMONICS + 1)
        s, c = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
        return s @ (self.sine / w) + (1 - c) @ (self.cosine / w), c @ self.sine + s @ self.cosine


def draw_motion(seed: int) -> Motion:
    """Draw uniform coefficients, scaled to a largest distance RANGE from the start."""
    motion = Motion(*np.random.default_rng(seed).uniform(-0.5, 0.5, (2, HARMONICS)))
    scale = RANGE / np.abs(motion.at(np.arange(0, 1 / FUNDAMENTAL, 1e-3))[0]).max()
    return Motion(scale * motion.sine, scale * motion.cosine)


class Pendulum:
    """robots/1r in Bullet without Bullet's default dampers and motor."""

    def __init__(self, step: float = STEP) -> None:
        self.step, self.client = step, {"physicsClientId": pybullet.connect(pybullet.DIRECT)}
        pybullet.setGravity(0, 0, -GRAVITY, **self.client)
        pybullet.setTimeStep(step, **self.client)
        with _silence():  # Bullet prints a warning about the massless base
            self.body = pybullet.loadURDF(
                str(URDF), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE, **self.client
            )
        pybullet.setJointMotorControl2(self.body, 0, pybullet.VELOCITY_CONTROL, force=0, **self.client)
        for link in (-1, 0):
            pybullet.changeDynamics(self.body, link, linearDamping=0, angularDamping=0, jointDamping=0, **self.client)

    def close(self) -> None:
        """Disconnect from Bullet."""
        pybullet.disconnect(**self.client)

    @property
    def truth(self) -> Array:
        """True m g d and I + m d2 (2,) [N.m, kg.m2] from Bullet's inertia."""
        info = pybullet.getDynamicsInfo(self.body, 0, **self.client)
        mass, inertia, depth = info[0], info[2][1], -info[3][2]
        return np.array([mass * GRAVITY * depth, inertia + mass * depth**2])

    def swing(self, position: Array, velocity: Array, stiffness: float = STIFFNESS, damping: float = DAMPING) -> Track:
        """Follow positions (N,) [rad] and velocities (N,) [rad/s], one per step; without gains the motion is free."""
        pybullet.resetJointState(self.body, 0, position[0], velocity[0], **self.client)
        q, tau = np.zeros((2, len(position)))
        for k in range(len(position)):
            q[k], v = pybullet.getJointState(self.body, 0, **self.client)[:2]
            tau[k] = stiffness * (position[k] - q[k]) + damping * (velocity[k] - v)
            pybullet.setJointMotorControl2(self.body, 0, pybullet.TORQUE_CONTROL, force=tau[k], **self.client)
            pybullet.stepSimulation(**self.client)
        return Track(np.arange(len(q)) * self.step, q, tau)


def record(pendulum: Pendulum, seed: int) -> Track:
    """Simulate a motion; return the true track at the times of the log."""
    t = np.arange(0, REPEATS / FUNDAMENTAL, pendulum.step)
    kept = slice(0, None, round(PERIOD / pendulum.step))
    return Track(*(x[kept] for x in pendulum.swing(*draw_motion(seed).at(t))))


def log(track: Track, seed: int, bits: int = BITS, noise: float = NOISE) -> Track:
    """Quantise positions to encoder counts and add white noise to the torque."""
    count = 2 * np.pi / 2**bits
    white = noise * np.sqrt(np.mean(track.tau**2)) * np.random.default_rng(seed).standard_normal(len(track.tau))
    return Track(track.t, np.round(track.q / count) * count, track.tau + white)


@contextmanager
def _silence() -> Iterator[None]:
    stdout, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        os.dup2(stdout, 1)
        os.close(stdout)
        os.close(null)


QUANTILE = 0.1  # quantile of |torque| below which the sign may change [1]
SHORTEST, SEARCHED = 5, 16  # fewest samples per segment, most segments (the longest)


class Choice(NamedTuple):
    """Best signs of the segments and their coefficients."""

    value: Array  # (2,) [N.m, kg.m2]
    signs: Array  # (S,) [1]
    rms: float  # N.m, of the residual
    next_rms: float  # residual of the second best signs [N.m]; nan without alternatives


@dataclass(frozen=True)
class Signs:
    """Counts and shares of correct signs."""

    segments: int  # number of searched segments
    mixed: int  # segments with a change of the true sign
    right: int  # segments with the true sign throughout
    samples: float  # correct samples by the model's prediction [%]
    away: float  # the same for samples with true torque above the QUANTILE [%]
    rms: float  # N.m, of the residual
    next_rms: float  # N.m, of the second best signs

    @property
    def holds(self) -> bool:
        """Whether all unmixed segments and all samples above the QUANTILE have their true sign."""
        return self.right + self.mixed == self.segments and self.away == 100


def segments(magnitude: Array) -> list[slice]:
    """Longest runs of |torque| (N,) [N.m] above its QUANTILE, in order of time."""
    above = np.concatenate([[0], magnitude > np.quantile(magnitude, QUANTILE), [0]])
    starts, stops = (np.flatnonzero(np.diff(above) == step) for step in (1, -1))
    spans = [slice(a, b) for a, b in zip(starts.tolist(), stops.tolist(), strict=True) if b - a >= SHORTEST]
    longest = sorted(spans, key=lambda span: span.start - span.stop)[:SEARCHED]
    return sorted(longest, key=lambda span: span.start)


def search(columns: Array, magnitude: Array, spans: Sequence[slice]) -> Choice:
    """Find the signs with the smallest least-squares residual on the segments and positive inertia.

    Columns (N, 2) [1, rad/s2]: sine of the position and acceleration; magnitude (N,) [N.m]: |torque|.
    """
    gram = sum(columns[span].T @ columns[span] for span in spans)
    products = np.array([columns[span].T @ magnitude[span] for span in spans])
    square = sum(float(magnitude[span] @ magnitude[span]) for span in spans)
    count = sum(span.stop - span.start for span in spans)
    choices = np.arange(2 ** (len(spans) - 1))[:, None] >> np.arange(len(spans)) & 1  # the last segment's sign is fixed
    sums = (1.0 - 2.0 * choices) @ products
    explained = np.sum(np.linalg.solve(np.linalg.cholesky(gram), sums.T) ** 2, axis=0)
    best, *others = np.argsort(-explained)[:2]
    rms = np.sqrt(np.maximum(square - explained, 0.0) / count)
    value, signs = np.linalg.solve(gram, sums[best]), 1.0 - 2.0 * choices[best]
    side = np.sign(value[1])
    return Choice(side * value, side * signs, float(rms[best]), float(rms[others[0]]) if others else float("nan"))


def predict(columns: Array, value: Array) -> Array:
    """Signs (N,) [1] of the torque from columns (N, 2) [1, rad/s2] and coefficients (2,) [N.m, kg.m2]."""
    return np.where(columns @ value < 0, -1.0, 1.0)


def evaluate(choice: Choice, spans: Sequence[slice], columns: Array, torque: Array) -> Signs:
    """Compare chosen signs with those of the torque (N,) [N.m], for columns (N, 2) [1, rad/s2] as in `search`."""
    true = np.where(torque < 0, -1.0, 1.0)
    same = predict(columns, choice.value) == true
    away = np.abs(torque) > np.quantile(np.abs(torque), QUANTILE)
    return Signs(
        segments=len(spans),
        mixed=sum(bool(np.ptp(true[span])) for span in spans),
        right=sum(bool((true[span] == sign).all()) for span, sign in zip(spans, choice.signs, strict=True)),
        samples=float(100 * same.mean()),
        away=float(100 * same[away].mean()),
        rms=choice.rms,
        next_rms=choice.next_rms,
    )


KEPT = slice(round(1 / FUNDAMENTAL / PERIOD), round(4 / FUNDAMENTAL / PERIOD))  # the middle three of five periods
ORDER, CORNER = 16, 0.35 * np.pi  # order of the low-pass; corner in rad/sample or in Hz
WIDE = CORNER / (2 * np.pi * PERIOD)  # corner in rad/sample converted to [Hz]
WAYS = {"0.35 pi rad/sample": WIDE, "0.35 pi Hz": CORNER, "signid's own": None}  # corner [Hz]
LOGS = ("1dof_experiment_easy1", "1dof_experiment_easy2", "1dof_experiment1")  # noise-free logs in SIGNID_DATA
TRUTH = np.array([24.525, 1.67085])  # true coefficients of the logs [N.m], [kg.m2]


@dataclass(frozen=True)
class Trial:
    """Coefficients from one motion by one method."""

    motion: int
    way: str
    signed: bool
    value: tuple[float, ...]  # m g d [N.m], I + m d2 [kg.m2]
    std: tuple[float, ...]


def smooth(signal: Array, corner: float) -> Array:
    """Filter (N,) with a Butterworth of order 16 forward and backward: no delay, half amplitude at the corner [Hz]."""
    return np.asarray(sosfiltfilt(butter(ORDER, corner, fs=1 / PERIOD, output="sos"), signal))


def derive(track: Track, corner: float) -> dict[str, Array]:
    """Columns of a recording: central differences, equally filtered acceleration and torque, unfiltered position."""
    velocity = np.gradient(track.q, PERIOD)
    acceleration = smooth(np.gradient(velocity, PERIOD), corner)
    return {"t": track.t, "q_1": track.q, "dq_1": velocity, "ddq_1": acceleration, "tau_1": smooth(track.tau, corner)}


def estimate(robot: Robot, track: Track, corner: float | None) -> tuple[Array, Array]:
    """Coefficients and standard deviations, (2,) each [N.m, kg.m2], identified by signid from the middle periods.

    The signals are filtered at a corner [Hz] and not again by signid; None: signid's filters.
    """
    if corner is None:
        columns, options = {"t": track.t, "q_1": track.q, "tau_1": track.tau}, Options(effects=())
    else:
        columns, options = derive(track, corner), Options(effects=(), derivatives="recorded", cutoff=np.inf)
    recording = read_recording({name: column[KEPT] for name, column in columns.items()}, robot)
    result = identify(robot, [recording], method="wls", options=options)
    index = [result.base.expressions.index(name) for name in ("mz_1", "Iyy_1")]
    scale = np.array([-GRAVITY, 1.0])
    return scale * result.estimate.value[index], np.abs(scale) * result.estimate.std[index]


def trials(robot: Robot, motion: int, signed: Track, restored: Track) -> Iterator[Trial]:
    """Yield trials of one motion by every method, with logged and with restored signs."""
    for way, corner in WAYS.items():
        for known, track in ((True, signed), (False, restored)):
            value, std = estimate(robot, track, corner)
            yield Trial(motion, way, known, tuple(value.tolist()), tuple(std.tolist()))


def read_log(path: Path) -> tuple[Array, Signs]:
    """Coefficients (2,) [N.m, kg.m2] from the |torque| of a noise-free log, and evaluation of its signs."""
    table = pl.read_csv(path)
    columns, torque = table.select("sin_q_1", "ddq_1").to_numpy(), table["tau_1"].to_numpy()
    spans = segments(np.abs(torque))
    choice = search(columns, np.abs(torque), spans)
    signed = predict(columns, choice.value) * np.abs(torque)
    return np.linalg.lstsq(columns, signed, rcond=None)[0], evaluate(choice, spans, columns, torque)


COEFFICIENTS = "m g d", "I + m d2"  # N.m, kg.m2
TARGET = 1.0  # upper bound on the rms error of a coefficient [%]


@dataclass(frozen=True)
class Row:
    """Statistics of one coefficient and one method over all motions."""

    way: str
    signed: bool
    coefficient: str
    true: float
    mean: float
    rms_error: float  # [%]
    interval: float  # median half width of the nominal 95 % interval [%]
    inside: float  # intervals that contain the true value [%]

    @property
    def holds(self) -> bool:
        """Whether the error is within the target."""
        return self.rms_error <= TARGET


def summarise(done: Sequence[Trial], truth: Array) -> Iterator[Row]:
    """Yield a row for each method, with and without signs, and each coefficient."""
    for way, known in dict.fromkeys((trial.way, trial.signed) for trial in done):
        some = [trial for trial in done if (trial.way, trial.signed) == (way, known)]
        value, std = np.array([trial.value for trial in some]), np.array([trial.std for trial in some])
        error = value - truth
        for k, name in enumerate(COEFFICIENTS):
            yield Row(
                way=way,
                signed=known,
                coefficient=name,
                true=float(truth[k]),
                mean=float(value[:, k].mean()),
                rms_error=float(100 * np.sqrt(np.mean(error[:, k] ** 2)) / truth[k]),
                interval=float(100 * TWO_SIDED * np.median(std[:, k]) / truth[k]),
                inside=float(100 * np.mean(np.abs(error[:, k]) < TWO_SIDED * std[:, k])),
            )


def show_rows(rows: Sequence[Row]) -> Table:
    """Table of identified and true coefficients."""
    names = ("filter", "signs", "coefficient", "true", "found", "error", "95 %", "inside")
    table = frame("error and half interval in % of true", names, left=5)
    for row in rows:
        shares = [f"{row.rms_error:.3f}", f"{row.interval:.3f}", f"{row.inside:.0f} %"]
        labels = [row.way, "logged" if row.signed else "found", row.coefficient]
        table.add_row(*labels, f"{row.true:.5g}", f"{row.mean:.5g}", *shares, style="" if row.holds else "red")
    return table


def show_signs(signs: Mapping[str, Sequence[Signs]]) -> Table:
    """Table of correct signs over one or many recordings."""
    names = ("recordings", "segments", "mixed", "right", "samples", "above 10 %", "second rms / rms")
    table = frame("signs from |torque| alone", names)
    for name, some in signs.items():
        counts = [str(sum(getattr(got, key) for got in some)) for key in ("segments", "mixed", "right")]
        shares = [f"{np.mean([getattr(got, key) for got in some]):.2f} %" for key in ("samples", "away")]
        rivals = [got.next_rms / max(got.rms, 1e-6) for got in some if np.isfinite(got.next_rms)]
        rival = f"{min(rivals):.3g}" if rivals else ""
        table.add_row(name, *counts, *shares, rival, style="" if all(got.holds for got in some) else "red")
    return table


MOTIONS = 40
LOG_TARGET = 1e-4  # upper bound on the coefficient error (norm) from a log


def main() -> None:
    """Record, identify, print the tables and write the numbers; exit with 1 when a target is missed."""
    parser = command_line("pendulum", __doc__)
    parser.add_argument("--motions", type=int, default=MOTIONS, help="number of motions (%(default)s)")
    parser.add_argument("--bits", type=int, default=BITS, help="encoder bits per turn (%(default)s)")
    parser.add_argument("--noise", type=float, default=NOISE, help="torque noise over rms torque (%(default)s)")
    options = parser.parse_args()
    robot, pendulum, console = load_robot("1r"), Pendulum(), Console()
    done: list[Trial] = []
    signs: dict[str, list[Signs]] = {f"{options.motions} motions": []}
    for motion in range(options.motions):
        true = record(pendulum, motion)
        logged = log(true, motion, options.bits, options.noise)
        # restore the torque signs of a log from its |torque|, and evaluate them
        acceleration = derive(logged, WIDE)["ddq_1"]
        columns, magnitude = np.column_stack([np.sin(logged.q), acceleration]), np.abs(logged.tau)
        spans = segments(magnitude[KEPT])
        choice = search(columns[KEPT], magnitude[KEPT], spans)
        signed = Track(logged.t, logged.q, predict(columns, choice.value) * magnitude)
        restored, got = signed, evaluate(choice, spans, columns[KEPT], true.tau[KEPT])
        signs[f"{options.motions} motions"].append(got)
        done += trials(robot, motion, logged, restored)
    rows, errors = list(summarise(done, pendulum.truth)), {}
    for name in LOGS if os.environ.get("SIGNID_DATA") else ():
        value, got = read_log(Path(os.environ["SIGNID_DATA"]) / "seed_penne" / f"{name}.csv.gz")
        signs[name] = [got]
        errors[name] = float(np.linalg.norm(value - TRUTH))
    console.print(show_rows(rows))
    console.print(show_signs(signs))
    for name, error in errors.items():
        console.print(f"{name}: coefficient error without signs {error:.2g} (norm)", highlight=False)
    machine = {"python": platform.python_version(), "pybullet": pybullet.getAPIVersion()}
    document = {"machine": machine, "rows": rows, "trials": done, "signs": signs, "log_errors": errors}
    write_json(options.json, document)
    met = all(item.holds for group in (rows, *signs.values()) for item in group)
    raise SystemExit(0 if met and all(error < LOG_TARGET for error in errors.values()) else 1)


if __name__ == "__main__":
    main()
