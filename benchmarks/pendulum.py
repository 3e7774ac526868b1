"""A pendulum in Bullet, identified with and without the signs of its torque: `python -m benchmarks.pendulum`.

PyBullet swings robots/1r under PD along random motions; position and torque are logged at 50 Hz. Velocity and
acceleration come from differences, filtered as Pennese and Vulcano do (Robotics II project, Sapienza University of
Rome, 2020), or from signid's own filters.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import polars as pl
import pybullet
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from scipy.signal import butter, sosfiltfilt

from signid.identify import identify
from signid.recording import read_recording
from signid.robot import load_robot
from signid.session import Options
from signid.types import Robot

from .pendulum_bullet import BITS, FUNDAMENTAL, GRAVITY, NOISE, PERIOD, Pendulum, Track, log, record
from .pendulum_signs import Signs, judge, predict, search, segments

Array = NDArray[np.float64]

MOTIONS = 40
KEPT = slice(round(1 / FUNDAMENTAL / PERIOD), round(4 / FUNDAMENTAL / PERIOD))  # the middle three of five periods
ORDER, CORNER = 16, 0.35 * np.pi  # of the low-pass; the corner in rad/sample, or in Hz
WIDE = CORNER / (2 * np.pi * PERIOD)  # Hz
WAYS = {"0.35 pi rad/sample": WIDE, "0.35 pi Hz": CORNER, "signid's own": None}  # corner [Hz]
COEFFICIENTS = "m g d", "I + m d2"  # N.m, kg.m2
NORMAL = 1.96  # standard deviations of a nominal 95 % interval
TARGET = 1.0  # %, rms error of a coefficient by any way, with and without signs
LOGS = ("1dof_experiment_easy1", "1dof_experiment_easy2", "1dof_experiment1")  # of SIGNID_DATA, without noise
TRUTH = np.array([24.525, 1.67085])  # N.m, kg.m2, of the logs
LOG_TARGET = 1e-4  # error of either coefficient from them


@dataclass(frozen=True)
class Trial:
    """One motion identified in one way."""

    motion: int
    way: str
    signed: bool
    value: tuple[float, ...]  # as COEFFICIENTS lists them
    std: tuple[float, ...]


@dataclass(frozen=True)
class Row:
    """One coefficient found in one way, over all motions."""

    way: str
    signed: bool
    coefficient: str
    true: float
    mean: float
    rms_error: float  # %
    interval: float  # %, half of a nominal 95 % interval, median
    inside: float  # %, of the intervals that hold the truth

    @property
    def holds(self) -> bool:
        """Whether the error is within the target."""
        return self.rms_error <= TARGET


def smooth(signal: Array, corner: float) -> Array:
    """Butterworth of order 16 forth and back (N,): no delay, half amplitude at the corner [Hz]."""
    return np.asarray(sosfiltfilt(butter(ORDER, corner, fs=1 / PERIOD, output="sos"), signal))


def derive(track: Track, corner: float) -> dict[str, Array]:
    """Columns of a recording: central differences, acceleration and torque filtered alike, the position as it is."""
    velocity = np.gradient(track.q, PERIOD)
    acceleration = smooth(np.gradient(velocity, PERIOD), corner)
    return {"t": track.t, "q_1": track.q, "dq_1": velocity, "ddq_1": acceleration, "tau_1": smooth(track.tau, corner)}


def restore(track: Track, true: Track) -> tuple[Track, Signs]:
    """The log with the signs that its |torque| alone tells, and how often they are the true ones."""
    acceleration = derive(track, WIDE)["ddq_1"]
    columns, magnitude = np.column_stack([np.sin(track.q), acceleration]), np.abs(track.tau)
    spans = segments(magnitude[KEPT])
    choice = search(columns[KEPT], magnitude[KEPT], spans)
    signed = Track(track.t, track.q, predict(columns, choice.value) * magnitude)
    return signed, judge(choice, spans, columns[KEPT], true.tau[KEPT])


def estimate(robot: Robot, track: Track, corner: float | None) -> tuple[Array, Array]:
    """Coefficients and their standard deviations, (2,) each [N.m, kg.m2], by signid from the middle periods.

    Args:
        robot: robots/1r.
        track: as logged, with signs.
        corner: of the filter [Hz], and signid filters no further; None: all by signid.
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
    """One motion in every way, with the signs logged and with those found."""
    for way, corner in WAYS.items():
        for known, track in ((True, signed), (False, restored)):
            value, std = estimate(robot, track, corner)
            yield Trial(motion, way, known, tuple(value.tolist()), tuple(std.tolist()))


def summarise(done: Sequence[Trial], truth: Array) -> Iterator[Row]:
    """A row for each way, with and without signs, and each coefficient."""
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
                interval=float(100 * NORMAL * np.median(std[:, k]) / truth[k]),
                inside=float(100 * np.mean(np.abs(error[:, k]) < NORMAL * std[:, k])),
            )


def read_log(path: Path) -> tuple[Array, Signs]:
    """Coefficients (2,) [N.m, kg.m2] from the |torque| of a log without noise, and how often its signs were right."""
    table = pl.read_csv(path)
    columns, torque = table.select("sin_q_1", "ddq_1").to_numpy(), table["tau_1"].to_numpy()
    spans = segments(np.abs(torque))
    choice = search(columns, np.abs(torque), spans)
    signed = predict(columns, choice.value) * np.abs(torque)
    return np.linalg.lstsq(columns, signed, rcond=None)[0], judge(choice, spans, columns, torque)


def show_rows(rows: Sequence[Row]) -> Table:
    """What was found, beside what is true."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title="error and half interval in % of true")
    for name in ("filter", "signs", "coefficient", "true", "found", "error", "95 %", "inside"):
        table.add_column(name, justify="right" if name in ("error", "95 %", "inside") else "left", no_wrap=True)
    for row in rows:
        shares = [f"{row.rms_error:.3f}", f"{row.interval:.3f}", f"{row.inside:.0f} %"]
        told = [row.way, "logged" if row.signed else "found", row.coefficient]
        table.add_row(*told, f"{row.true:.5g}", f"{row.mean:.5g}", *shares, style="" if row.holds else "red")
    return table


def show_signs(signs: Mapping[str, Sequence[Signs]]) -> Table:
    """How often the signs were right, over one or many recordings."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True, title="signs from |torque| alone")
    for name in ("recordings", "segments", "mixed", "right", "samples", "beyond 10 %", "rival"):
        table.add_column(name, justify="left" if name == "recordings" else "right", no_wrap=True)
    for name, some in signs.items():
        counts = [str(sum(getattr(got, key) for got in some)) for key in ("segments", "mixed", "right")]
        shares = [f"{np.mean([getattr(got, key) for got in some]):.2f} %" for key in ("samples", "away")]
        rivals = [got.next_rms / max(got.rms, 1e-6) for got in some if np.isfinite(got.next_rms)]
        rival = f"{min(rivals):.3g}" if rivals else ""
        table.add_row(name, *counts, *shares, rival, style="" if all(got.holds for got in some) else "red")
    return table


def main() -> None:
    """Record, identify, print the tables, write the numbers; exits with 1 when a target is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pendulum", description=__doc__)
    parser.add_argument("--motions", type=int, default=MOTIONS, help="how many, by default %(default)s")
    parser.add_argument("--bits", type=int, default=BITS, help="of the encoder a turn, by default %(default)s")
    parser.add_argument("--noise", type=float, default=NOISE, help="share of the rms torque, by default %(default)s")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there")
    options = parser.parse_args()
    robot, pendulum, console = load_robot("1r"), Pendulum(), Console()
    done: list[Trial] = []
    signs: dict[str, list[Signs]] = {f"{options.motions} motions": []}
    for motion in range(options.motions):
        true = record(pendulum, motion)
        logged = log(true, motion, options.bits, options.noise)
        restored, got = restore(logged, true)
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
        console.print(f"{name}: without signs, coefficients are off by {error:.2g} (norm)", highlight=False)
    if options.json:
        machine = {"python": platform.python_version(), "pybullet": pybullet.getAPIVersion()}
        told = {"machine": machine, "rows": rows, "trials": done, "signs": signs, "log_errors": errors}
        options.json.write_text(json.dumps(told, default=asdict, indent=1), encoding="utf-8")
    held = all(item.holds for group in (rows, *signs.values()) for item in group)
    raise SystemExit(0 if held and all(error < LOG_TARGET for error in errors.values()) else 1)


if __name__ == "__main__":
    main()
