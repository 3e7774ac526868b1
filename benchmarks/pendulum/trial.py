"""Identification of one motion of the pendulum by each method, with logged and with restored torque signs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from signid.identify import identify
from signid.recording import read_recording
from signid.regression.session import Options
from signid.types import Robot

from .bullet import FUNDAMENTAL, GRAVITY, PERIOD, Track
from .signs import Signs, evaluate, predict, search, segments

Array = NDArray[np.float64]

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


def restore(track: Track, true: Track) -> tuple[Track, Signs]:
    """Restore the torque signs of a log from its |torque|, and evaluate them."""
    acceleration = derive(track, WIDE)["ddq_1"]
    columns, magnitude = np.column_stack([np.sin(track.q), acceleration]), np.abs(track.tau)
    spans = segments(magnitude[KEPT])
    choice = search(columns[KEPT], magnitude[KEPT], spans)
    signed = Track(track.t, track.q, predict(columns, choice.value) * magnitude)
    return signed, evaluate(choice, spans, columns[KEPT], true.tau[KEPT])


def estimate(robot: Robot, track: Track, corner: float | None) -> tuple[Array, Array]:
    """Coefficients and standard deviations, (2,) each [N.m, kg.m2], identified by signid from the middle periods.

    Args:
        robot: robot robots/1r.
        track: logged track with signs.
        corner: corner of the filter [Hz], without further filtering by signid; None: signid's filters.
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
