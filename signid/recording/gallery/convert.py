"""Convert source files to recordings and URDF, reproducibly on all machines."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping

import numpy as np

from ...types import Array

DIGITS = 9  # significant digits of numbers
SPLINES = {"pos": "position", "vel": "velocity", "acc": "acceleration"}  # variables of the files of 1r and 3r
_RATIO = np.array([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])  # gear ratios of the TX40; motor 6 also turns with joint 5
_OFFSET = np.array([0, -np.pi / 2, np.pi / 2, 0, 0, 0])  # [rad] of the TX40
DRIVE_DIGITS = 8  # significant digits of numbers
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


def _read_numbers(raw: bytes, skip: int = 0) -> Array:
    """Numbers (rows, columns) of comma-separated text below `skip` lines of header [units of the source].

    Raises:
        ValueError: the text is not a table of numbers.
    """
    lines = raw.split(b"\n", skip)[skip:]
    if not lines or not lines[0].strip():
        raise ValueError("it contains no numbers")
    return np.loadtxt(io.BytesIO(lines[0]), delimiter=",", ndmin=2)


def _read_matrix(raw: bytes, name: str) -> Array:
    """Variable of a MATLAB file, (rows, columns) [unit of the source]."""
    from scipy.io import loadmat

    return np.asarray(loadmat(io.BytesIO(raw), variable_names=[name])[name], np.float64)


def _by_joint(kind: str, values: Array) -> dict[str, Array]:
    """Split a matrix into the columns KIND_1, KIND_2, ...; values: (N, n) [unit of the kind]."""
    return {f"{kind}_{j + 1}": column for j, column in enumerate(values.T)}


def write_table(columns: Mapping[str, Array], digits: int = DIGITS) -> str:
    """CSV text with a header and one line per sample; columns: (N,) each, by name [units of the columns]."""
    text = io.StringIO()
    text.write(",".join(columns) + "\n")
    np.savetxt(text, np.column_stack(list(columns.values())), fmt=f"%.{digits}g", delimiter=",")
    return text.getvalue()


def without_meshes(raw: bytes) -> str:
    """URDF text without visual and collision elements, whose meshes are not downloaded."""
    text = raw.decode("utf-8-sig").replace("\r\n", "\n")
    return re.sub(r"<(visual|collision)\b.*?</\1>", "", text, flags=re.DOTALL)


def instants(samples: int, step: float = 0.02) -> Array:
    """Times of the samples, (N,) [s]; the simulated arms 1r and 3r, and the servo of mauicv, have 50 Hz."""
    return np.arange(samples, dtype=np.float64) * step


def pendulum(regressor: bytes, torque: bytes, position: bytes = b"", velocity: bytes = b"") -> str:
    """Recording of 1r; without a trajectory file, sin q and acceleration come from the regressor."""
    rows = _read_matrix(regressor, "Y_stack")
    columns = {"t": instants(len(rows)), "sin_q_1": rows[:, 0], "ddq_1": rows[:, 1]}
    columns["tau_1"] = _read_matrix(torque, "u_stack")[:, 0]
    for kind, raw, part in (("q_1", position, "pos"), ("dq_1", velocity, "vel")):
        columns |= {kind: _read_matrix(raw, SPLINES[part])[0]} if raw else {}
    return write_table(columns)


def arm(torque: bytes, *raw: bytes) -> str:
    """Recording of 3r: torque, position, velocity and acceleration of each joint."""
    tau = _read_matrix(torque, "u_stack").reshape(-1, 3)
    columns = {"t": instants(len(tau))}
    for k, (kind, part) in enumerate(zip(("q", "dq", "ddq"), SPLINES, strict=True)):
        values = [_read_matrix(raw[3 * joint + k], SPLINES[part])[0] for joint in range(3)]
        columns |= _by_joint(kind, np.column_stack(values))
    return write_table({**columns, **_by_joint("tau", tau)})


def motion(*raw: bytes) -> str:
    """Trajectory of one joint, without torque."""
    values = [_read_matrix(part, name)[0] for part, name in zip(raw, SPLINES.values(), strict=True)]
    return write_table({"t": instants(len(values[0])), **dict(zip(("q", "dq", "ddq"), values, strict=True))})


def emps(raw: bytes, pulses: tuple[str, ...] = ()) -> str:
    """Recording of EMPS with force = input voltage of the drive times its gain."""
    t, q, voltage, reference, gain, *more = (
        _read_matrix(raw, name)[:, 0] for name in ("t", "qm", "vir", "qg", "gtau", *pulses)
    )
    columns = {"t": t - t[0], "q_1": q, "tau_1": gain * voltage, "voltage_1": voltage, "q_ref_1": reference}
    return write_table({**columns, **dict(zip(pulses, more, strict=True))})


def emps_pulses(raw: bytes) -> str:
    """Recording of EMPS with pulses of force."""
    return emps(raw, ("pulses_N",))


def panda(*raw: bytes) -> str:
    """Recording of the Panda: times, positions, velocities and torques, seven numbers per sample."""
    time, *parts = (_read_numbers(part) for part in raw)
    columns = {"t": time[:, 0]}
    for kind, values in zip(("q", "dq", "tau"), parts, strict=True):
        columns |= _by_joint(kind, values.reshape(-1, 7))
    return write_table(columns)


def tx40(positions: bytes, torques: bytes) -> str:
    """Recording of the TX40 at its joints; without a matrix product, so digits do not depend on the BLAS library."""
    motor, current = _read_numbers(positions, skip=1), _read_numbers(torques, skip=1)
    q, tau = motor * (1 / _RATIO), current * _RATIO
    q[:, 5] -= motor[:, 4] * (1 / _RATIO[4])
    tau[:, 4] += current[:, 5] * _RATIO[5]
    columns = {"t": instants(len(q), 2e-4), **_by_joint("q", q + _OFFSET), **_by_joint("tau", tau)}
    return write_table({**columns, **_by_joint("q_motor", motor), **_by_joint("current", current)}, digits=7)


def ur10e(raw: bytes) -> str:
    """Recording of the UR10e from the log of its controller, 31 numbers per sample."""
    values = _read_numbers(raw)
    columns = {"t": values[:, 0] - values[0, 0]}
    for k, kind in enumerate(("q", "dq", "current", "current_des", "tau_des")):
        columns |= _by_joint(kind, values[:, 1 + 6 * k : 7 + 6 * k])
    return write_table(columns)


def bam(raw: bytes) -> str:
    """Recording of a pendulum of BAM; the unsigned 16-bit register of the duty gets its sign."""
    entries = json.loads(raw)["entries"]
    columns = {name: np.array([entry[key] for entry in entries], np.float64) for name, key in _BAM.items()}
    load = columns["pwm_servo"]
    columns["pwm_servo"] = np.where(load >= 2**15, load - 2**16, load) / _DUTY
    return write_table(columns, DRIVE_DIGITS)


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
    return write_table(columns, DRIVE_DIGITS).replace("nan", "")
