"""A recording of the pendulum 1r with friction, as text or as an archive, whole or spoilt."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np

import signid
from signid.regression.motion import Motion

Columns = dict[str, Any]
RATE, SECONDS = 100.0, 12.0


@cache
def pristine() -> Mapping[str, np.ndarray]:
    """Twelve seconds at 100 Hz."""
    t = np.arange(0, SECONDS, 1 / RATE)
    parts = [(1.1, 0.35, 0.2), (0.6, 0.8, 1.9), (0.3, 1.7, 0.4)]  # amplitude, frequency, phase
    q, v, a = np.zeros((3, len(t)))
    for size, frequency, phase in parts:
        w = 2 * np.pi * frequency
        q += size * np.sin(w * t + phase)
        v += size * w * np.cos(w * t + phase)
        a -= size * w**2 * np.sin(w * t + phase)
    robot = signid.load_robot("1r")
    load = Motion(robot, t, q[:, None], v[:, None], a[:, None]).load[:, 0]
    noise = np.random.default_rng(1).standard_normal((2, len(t)))
    tau = load + 0.8 * v + 1.5 * np.sign(v) + 0.3 + 0.1 * noise[0]
    return {"t": t, "q_1": q + 1e-5 * noise[1], "tau_1": tau}


def swing(**changes: Any) -> Columns:
    """A recording of the pendulum 1r with friction, with columns changed, added, or removed (None)."""
    columns = {**pristine(), **changes}
    return {name: column for name, column in columns.items() if column is not None}


def csv(columns: Columns) -> str:
    rows = np.column_stack(list(columns.values()))
    return "\n".join([",".join(columns), *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n"


def npz(columns: Columns) -> bytes:
    file = io.BytesIO()
    np.savez(file, allow_pickle=True, **columns)
    return file.getvalue()


def changed(column: str, change: Callable[[np.ndarray], Any]) -> str:
    """The recording with one column changed."""
    values = pristine()[column].copy()
    got = change(values)
    return csv(swing(**{column: values if got is None else got}))


def put(values: np.ndarray, where: Any, what: Any) -> None:
    values[where] = what


def only(rows: slice) -> str:
    return csv({name: column[rows] for name, column in pristine().items()})


def cells(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)
