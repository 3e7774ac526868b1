"""Convert logs of position drives to recordings, reproducibly on all machines."""

from __future__ import annotations

import json

import numpy as np

from ...types import Array
from .convert import instants, write_table

DIGITS = 8  # significant digits of numbers
_BAM = {  # column: key of an entry; angles in rad, volts, degrees Celsius, torque enabled
    "t": "timestamp",
    "q_servo": "position",
    "q_des_servo": "goal_position",
    "dq_servo": "speed",
    "pwm_servo": "load",
    "volt_servo": "input_volts",
    "temp_servo": "temp",
    "on_servo": "torque_enable",
}
_DUTY = 885  # full duty in the register of a Dynamixel XL330
_PAUSE = 1.0  # time between runs in one recording [s]
_SMALL = 0.3  # commands below are small [half turns]; those of the source are up to 0.05, or from 0.55


def bam(raw: bytes) -> str:
    """Recording of a pendulum of BAM; the unsigned 16-bit register of the duty gets its sign."""
    entries = json.loads(raw)["entries"]
    columns = {name: np.array([entry[key] for entry in entries], np.float64) for name, key in _BAM.items()}
    load = columns["pwm_servo"]
    columns["pwm_servo"] = np.where(load >= 2**15, load - 2**16, load) / _DUTY
    return write_table(columns, DIGITS)


def mauicv(raw: bytes, motion: str, small: bool | None = None) -> str:
    """Runs of one motion, one after another; `small`: those with small or large commands only, None: all.

    Raises:
        ValueError: there is no such run.
    """
    runs = [_run(entry) for entry in json.loads(raw)["data"] if entry["type"] == motion]
    runs = [run for run in runs if small is None or small == (np.nanmax(np.abs(run[1])) < _SMALL * np.pi)]
    if not runs:
        raise ValueError(f"it contains no {motion}")
    start, times = 0.0, []
    for q, _ in runs:
        times.append(start + instants(len(q)))
        start = times[-1][-1] + _PAUSE
    columns = {"t": np.concatenate(times), **_positions(*map(np.concatenate, zip(*runs, strict=True)))}
    return _blank({**columns, "run": np.repeat(np.arange(len(runs), dtype=np.float64), [len(q) for q, _ in runs])})


def mauicv_drop(raw: bytes) -> str:
    """Recording of one fall of the arm."""
    (entry,) = json.loads(raw)["data"]
    q, command = _run(entry)
    return _blank({"t": instants(len(q)), **_positions(q, command)})


def _run(entry: dict[str, list[float | None]]) -> tuple[Array, Array]:
    """Positions and commands of a run, (N,) each [rad]; NaN: the servo gets no pulses."""
    q, command = (np.pi * np.array(entry[key], np.float64) for key in ("sensor_data", "actions"))
    return q, command


def _positions(q: Array, command: Array) -> dict[str, Array]:
    return {"q_servo": q, "q_des_servo": command}


def _blank(columns: dict[str, Array]) -> str:
    """Text of a table whose missing commands are blank cells."""
    return write_table(columns, DIGITS).replace("nan", "")
