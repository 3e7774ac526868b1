"""Evidence -> how late torque was recorded against the motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..types import Array, Mask
from .correction import Correction
from .evidence import LAG, Evidence
from .fits import Columns

STEPS = 25  # to either side
GROSS = 0.25  # of the torque's deviation: what a lag changes, more than a mild one
HALVES, GAINS = 0.5, 0.02  # of what is left unexplained, and of the variance: what a lag must save to be told
TOGETHER, FLOOR = 1.5, 0.01  # times what the joint's own best lag leaves: so little, and a common lag is its own
EDGE = 0.9  # of the longest lag: beyond, no minimum was found


class Lags(NamedTuple):
    """What the joints say of their lags."""

    own: Array  # (n,) [s], NaN where a joint does not tell
    common: float  # [s] of all that tell, NaN where they differ or none tells
    share: Array  # (n,) [1] of the torque's deviation that the lag changes


def lag_table(evidence: Evidence, done: Correction) -> tuple[Array, Array]:
    """Lags (L,) [s], and what each leaves unexplained (L, n) [1] of every joint's torque."""
    lags, x = np.asarray(LAG / STEPS * np.arange(-STEPS, STEPS + 1)), evidence.corrected(done)
    columns = [Columns(x, j) for j in range(len(done.lag))]
    left: Array = np.empty((len(lags), len(columns)))
    for k, lag in enumerate(lags):
        torque = evidence.late(done.lag + lag)[:, list(done.tau_from)] * done.tau_sign
        left[k] = [c.fit(torque[:, j]).unexplained for j, c in enumerate(columns)]
    return lags, left


def judge_lags(evidence: Evidence, done: Correction, told: Mask) -> Lags:
    """How late torque still is after what was corrected.

    Args:
        evidence: the recordings.
        done: what was corrected.
        told: (n,) joints whose torque tells something.
    """
    lags, left = lag_table(evidence, done)
    best = np.array([_minimum(lags, column) for column in left.T])
    zero, least = left[len(lags) // 2], left.min(axis=0)
    tells = told & (np.abs(best) < EDGE * LAG) & (least <= zero)
    saves = tells & (least <= HALVES * zero) & (zero - least >= GAINS)
    own = np.where(tells, best, np.nan)
    if not saves.any():
        return Lags(own, np.nan, np.zeros(len(told)))
    common = _minimum(lags, np.log(np.maximum(left[:, saves], FLOOR)).sum(axis=1))
    at = np.array([np.interp(common, lags, column) for column in left.T])
    together = bool(np.all(at[saves] <= TOGETHER * least[saves] + FLOOR)) and abs(common) < EDGE * LAG
    return Lags(own, common if together else np.nan, np.where(saves, _share(evidence, done, best), 0.0))


def _share(evidence: Evidence, done: Correction, lag: Array) -> Array:
    late = np.zeros_like(lag)
    late[list(done.tau_from)] = lag
    torque = evidence.late(done.lag)
    changed = np.std(evidence.late(done.lag + late) - torque, axis=0) / np.maximum(np.std(torque, axis=0), 1e-300)
    return np.asarray(changed[list(done.tau_from)])


def _minimum(x: Array, y: Array) -> float:
    """Where a curve is lowest, by the parabola through its lowest point and the neighbours."""
    k = int(np.argmin(y))
    if k in (0, len(x) - 1):
        return float(x[k])
    left, middle, right = y[k - 1 : k + 2]
    bend = left - 2 * middle + right
    return float(x[k] + (x[1] - x[0]) * (0.5 * (left - right) / bend if bend > 0 else 0.0))
