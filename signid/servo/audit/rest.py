"""Errors at rest: droop, and how they depend on the direction of approach."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...types import Array
from .tracks import Part

SETTLE, LAGS = 0.4, 5.0  # [s], [lags] after the last change of the command
STILL = 0.2  # [s] over which a joint at rest stays within two steps of its encoder
FEWEST = 2  # approaches of each direction for a dead band
CHANGE = 1e-4  # [1] share of the range of the command below which it does not change


class Rest(NamedTuple):
    """Errors q_des - q at rest."""

    droop: float  # [rad or m] median size
    droop_most: float  # [rad or m]
    holds: int
    dead_band: float  # [rad or m]


def at_rest(parts: Sequence[Part], lag: float, quantum: float, span: float) -> Rest:
    """Errors of one joint at rest; lag [s], quantum of q and range of the command `span` [rad or m]."""
    found = [hold for part in parts for hold in _holds(part, lag, quantum, span)]
    if not found:
        return Rest(np.nan, np.nan, 0, np.nan)
    error, way = np.array(found).T
    up, down = error[way > 0], error[way < 0]
    both = min(len(up), len(down)) >= FEWEST
    dead = abs(float(np.median(up) - np.median(down))) / 2 if both else np.nan
    return Rest(float(np.median(np.abs(error))), float(np.abs(error).max()), len(error), dead)


def _holds(part: Part, lag: float, quantum: float, span: float) -> list[tuple[float, float]]:
    """Mean error [rad or m] and direction of approach (1, -1; 0 unknown) of each time at rest."""
    settle = max(SETTLE, LAGS * lag if np.isfinite(lag) else 0.0)
    changed = np.flatnonzero(np.abs(np.diff(part.command)) > CHANGE * span) + 1
    edges = np.concatenate([[0], changed, [len(part.t)]])
    holds = []
    for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        first = int(np.searchsorted(part.t, part.t[low] + settle))
        if high - first < 3 or part.t[high - 1] - part.t[first] < STILL:
            continue
        q = _still(part.t[first:high], part.q[first:high], quantum)
        if len(q):
            step = float(part.command[low] - part.command[low - 1]) if low else 0.0
            holds.append((float(part.command[low] - np.median(q)), float(np.sign(step))))
    return holds


def _still(t: Array, q: Array, quantum: float) -> Array:
    """Positions (M,) from which on the joint does not move any more, at least for 0.2 s."""
    away = np.flatnonzero(np.abs(q - q[-1]) > 2.5 * quantum)
    first = int(away[-1]) + 1 if len(away) else 0
    return q[first:] if t[-1] - t[first] >= STILL else q[:0]
