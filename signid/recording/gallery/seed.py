"""Simulated arms 1r and 3r of Penne: splines and torques without noise, in MATLAB files."""

from __future__ import annotations

import numpy as np

from ...types import Array
from .convert import by_joint, read_matrix, write_table

REPOSITORY = "MarcoPenne/Robotics_Project"
COMMIT = "ed5bee28024af657ebe2bb061266d55150afa1cd"
CITE = "its repository: dynamic identification of a 1R and a 3R robot without the signs of their torques"
FOLDER = "seed_penne"
STEP = 0.02  # [s]
SPLINES = {"pos": "position", "vel": "velocity", "acc": "acceleration"}


def splines(arm: str, number: int, *parts: str) -> tuple[str, ...]:
    """Paths of the position, velocity and acceleration files of a trajectory."""
    return tuple(f"Code/data/{arm}/trajectory{number}/{part}.mat" for part in parts)


def instants(samples: int) -> Array:
    """Times of the samples, (N,) [s]."""
    return np.arange(samples, dtype=np.float64) * STEP


def pendulum(regressor: bytes, torque: bytes, position: bytes = b"", velocity: bytes = b"") -> str:
    """Recording of 1r; without a trajectory file, sin q and acceleration come from the regressor."""
    rows = read_matrix(regressor, "Y_stack")
    columns = {"t": instants(len(rows)), "sin_q_1": rows[:, 0], "ddq_1": rows[:, 1]}
    columns["tau_1"] = read_matrix(torque, "u_stack")[:, 0]
    for kind, raw, part in (("q_1", position, "pos"), ("dq_1", velocity, "vel")):
        columns |= {kind: read_matrix(raw, SPLINES[part])[0]} if raw else {}
    return write_table(columns)


def arm(torque: bytes, *raw: bytes) -> str:
    """Recording of 3r: torque, position, velocity and acceleration of each joint."""
    tau = read_matrix(torque, "u_stack").reshape(-1, 3)
    columns = {"t": instants(len(tau))}
    for k, (kind, part) in enumerate(zip(("q", "dq", "ddq"), SPLINES, strict=True)):
        values = [read_matrix(raw[3 * joint + k], SPLINES[part])[0] for joint in range(3)]
        columns |= by_joint(kind, np.column_stack(values))
    return write_table({**columns, **by_joint("tau", tau)})


def motion(*raw: bytes) -> str:
    """Trajectory of one joint, without torque."""
    values = [read_matrix(part, name)[0] for part, name in zip(raw, SPLINES.values(), strict=True)]
    return write_table({"t": instants(len(values[0])), **dict(zip(("q", "dq", "ddq"), values, strict=True))})
