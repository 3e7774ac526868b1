"""Convert source files to recordings and URDF, reproducibly on all machines."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping, Sequence

import numpy as np

from ...types import Array

DIGITS, DRIVE_DIGITS = 9, 8  # significant digits of numbers; those of position drives
SPLINES = {"pos": "position", "vel": "velocity", "acc": "acceleration"}  # variables of the files of 1r and 3r
_RATIO = np.array([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])  # gear ratios of the TX40; motor 6 also turns with joint 5
_OFFSET = np.array([0, -np.pi / 2, np.pi / 2, 0, 0, 0])  # [rad] of the TX40
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


def _write_table(columns: Mapping[str, Array], digits: int = DIGITS) -> str:
    """CSV text with a header and one line per sample; columns: (N,) each, by name [units of the columns]."""
    text = io.StringIO()
    text.write(",".join(columns) + "\n")
    np.savetxt(text, np.column_stack(list(columns.values())), fmt=f"%.{digits}g", delimiter=",")
    return text.getvalue()


def _instants(samples: int, step: float = 0.02) -> Array:
    """Times of the samples, (N,) [s]; the simulated arms 1r and 3r have 50 Hz."""
    return np.arange(samples, dtype=np.float64) * step


def without_meshes(raw: bytes) -> str:
    """URDF text without visual and collision elements, whose meshes are not downloaded."""
    text = raw.decode("utf-8-sig").replace("\r\n", "\n")
    return re.sub(r"<(visual|collision)\b.*?</\1>", "", text, flags=re.DOTALL)


def pendulum(regressor: bytes, torque: bytes, position: bytes = b"", velocity: bytes = b"") -> str:
    """Recording of 1r; without a trajectory file, sin q and acceleration come from the regressor."""
    rows = _read_matrix(regressor, "Y_stack")
    columns = {"t": _instants(len(rows)), "sin_q_1": rows[:, 0], "ddq_1": rows[:, 1]}
    columns["tau_1"] = _read_matrix(torque, "u_stack")[:, 0]
    for kind, raw, part in (("q_1", position, "pos"), ("dq_1", velocity, "vel")):
        columns |= {kind: _read_matrix(raw, SPLINES[part])[0]} if raw else {}
    return _write_table(columns)


def arm(torque: bytes, *raw: bytes) -> str:
    """Recording of 3r: torque, position, velocity and acceleration of each joint."""
    tau = _read_matrix(torque, "u_stack").reshape(-1, 3)
    columns = {"t": _instants(len(tau))}
    for k, (kind, name) in enumerate(zip(("q", "dq", "ddq"), SPLINES.values(), strict=True)):
        columns |= _by_joint(kind, np.column_stack([_read_matrix(part, name)[0] for part in raw[k::3]]))
    return _write_table({**columns, **_by_joint("tau", tau)})


def motion(*raw: bytes) -> str:
    """Trajectory of one joint, without torque."""
    values = [_read_matrix(part, name)[0] for part, name in zip(raw, SPLINES.values(), strict=True)]
    return _write_table({"t": _instants(len(values[0])), **dict(zip(("q", "dq", "ddq"), values, strict=True))})


def emps(raw: bytes, pulses: Sequence[str] = ()) -> str:
    """Recording of EMPS with force = input voltage of the drive times its gain; `pulses` are variables of force."""
    t, q, voltage, reference, gain, *more = (
        _read_matrix(raw, name)[:, 0] for name in ("t", "qm", "vir", "qg", "gtau", *pulses)
    )
    columns = {"t": t - t[0], "q_1": q, "tau_1": gain * voltage, "voltage_1": voltage, "q_ref_1": reference}
    return _write_table({**columns, **dict(zip(pulses, more, strict=True))})


def log(*raw: bytes, kinds: str) -> str:
    """Recording from times and `kinds` of numbers per joint, in one file or side by side in several."""
    parts = [_read_numbers(part) for part in raw]
    rows = np.hstack([parts[0], *(part.reshape(len(parts[0]), -1) for part in parts[1:])])
    columns = {"t": rows[:, 0] - rows[0, 0]}
    for kind, values in zip(kinds.split(), np.hsplit(rows[:, 1:], len(kinds.split())), strict=True):
        columns |= _by_joint(kind, values)
    return _write_table(columns)


def tx40(positions: bytes, torques: bytes) -> str:
    """Recording of the TX40 at its joints; without a matrix product, so digits do not depend on the BLAS library."""
    motor, current = _read_numbers(positions, skip=1), _read_numbers(torques, skip=1)
    q, tau = motor * (1 / _RATIO), current * _RATIO
    q[:, 5] -= motor[:, 4] * (1 / _RATIO[4])
    tau[:, 4] += current[:, 5] * _RATIO[5]
    columns = {"t": _instants(len(q), 2e-4), **_by_joint("q", q + _OFFSET), **_by_joint("tau", tau)}
    return _write_table({**columns, **_by_joint("q_motor", motor), **_by_joint("current", current)}, digits=7)


def bam(raw: bytes) -> str:
    """Recording of a pendulum of BAM; the unsigned 16-bit register of the duty gets its sign."""
    entries = json.loads(raw)["entries"]
    columns = {name: np.array([entry[key] for entry in entries], np.float64) for name, key in _BAM.items()}
    load = columns["pwm_servo"]
    columns["pwm_servo"] = np.where(load >= 2**15, load - 2**16, load) / _DUTY
    return _write_table(columns, DRIVE_DIGITS)
