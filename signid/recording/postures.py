"""Recordings of postures at rest, one a row: they have no velocity, and the order of their rows means nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import RecordingError
from ..types import Array, Recording, Table
from .formats.base import MemoryTable

DISORDER = 0.7  # [1] mean square step of positions over twice their variance, above which rows jump; 1: white noise
STANDSTILL = 0.05  # [rad or m] largest range of positions that are noise of joints at rest
APART = 0.2  # [s] smallest time between rows of postures
APPROACH = 1e-3  # [rad/s or m/s] velocity that stands for the direction of approach; its inertial torque is negligible
FIRST, FEWEST = 65_536, 8  # rows that are examined, and that are needed


def disorder(q: Array) -> float:
    """Mean square step of positions over twice their variance [1], of the smoothest joint that moves.

    q: (N, n) [rad or m].
    """
    spread = np.var(q, axis=0) if len(q) >= FEWEST else np.zeros(1)
    moves = spread > 1e-6 * max(float(spread.max(initial=0.0)), 1e-300)
    return (
        float((np.mean(np.diff(q[:, moves], axis=0) ** 2, axis=0) / (2 * spread[moves])).min()) if moves.any() else 0.0
    )


def are_postures(table: Table, positions: tuple[str, ...], time: str) -> bool:
    """Whether positions jump from row to row, and rows of a column `time` [s], if any, are at least 0.2 s apart."""
    values = table.read([*([time] if time else []), *positions], 0, FIRST)
    values = values[np.isfinite(values).all(axis=1)]
    if len(values) < FEWEST:
        return False
    q, period = values[:, -len(positions) :], float(np.median(np.diff(values[:, 0]))) if time else np.inf
    return period >= APART and np.ptp(q, axis=0).max() >= STANDSTILL and disorder(q) > DISORDER


def at_rest(recording: Recording) -> Recording:
    """The recording with a posture a row: rows count the time, and velocities are zero, or of the size of an approach.

    The sign of a recorded velocity is the direction from which the joint came to the posture. Rows without a position
    or torque are left out.

    Raises:
        RecordingError: no row is complete.
    """
    wanted = {kind: recording.columns[kind] for kind in ("q", "tau", "dq")}
    names = tuple(dict.fromkeys(c for group in wanted.values() for c in group if c))
    values = recording.table.read(names, 0, recording.table.rows)
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        raise RecordingError(f"{recording.path or 'the recording'} has no row with all positions and torques")
    columns = {name: np.ascontiguousarray(x) for name, x in zip(names, values.T, strict=True)}
    known = all(wanted["dq"]) and all(columns[name].any() for name in wanted["dq"])
    rates = tuple(f"approach of {c}" for c in wanted["dq"]) if known else ("at rest",) * len(wanted["q"])
    columns |= {f"approach of {c}": np.sign(columns[c]) * APPROACH for c in wanted["dq"] if known}
    columns |= {"row": np.arange(len(values), dtype=float), "at rest": np.zeros(len(values))}
    kept = {"t": ("row",), "q": wanted["q"], "tau": wanted["tau"], "dq": rates, "ddq": ("at rest",) * len(rates)}
    absent = {kind: ("",) * len(rates) for kind in recording.columns if kind not in kept}
    how = "their velocities give the direction of approach" if known else "the direction of approach is not known"
    lost = recording.table.rows - len(values)
    note = f"each row is read as a posture at rest, without velocity and acceleration; {how}"
    note += f"; {lost} incomplete rows are left out" if lost else ""
    table = MemoryTable(columns, {}, recording.path or "the recording")
    return replace(recording, table=table, columns={**kept, **absent}, notes=(*recording.notes, note), static=True)
