"""Evidence -> how late torque was recorded against the motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..types import Array, Mask
from .correction import Correction
from .evidence import LAG, Evidence
from .fits import Columns

STEPS = 25  # to either side
GROSS, LATE = 0.25, 0.08  # of the rms torque, what a lag changes; s: a lag of neither is a mild one
HALVES, GAINS, LEFT = (
    0.5,
    0.02,
    0.15,
)  # of what is left unexplained, of the variance: what a lag must save, and may leave
TOGETHER, FLOOR = 1.5, 0.01  # times what the joint's own best lag leaves: so little, and a common lag is its own
TINY = 1e-3  # unexplained share below which lags do not compete
EDGE = 0.9  # of the longest lag: beyond, no minimum was found


class Lags(NamedTuple):
    """What the joints say of their lags."""

    own: Array  # (n,) [s], NaN where a joint does not tell
    common: float  # [s] of all that tell, NaN where they differ or none tells
    share: Array  # (n,) [1] of the rms torque that the lag changes; 0 where it saves little
    gross: Mask  # (n,) whether that is more than a mild delay


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
    saves = tells & (least <= np.minimum(HALVES * zero, LEFT)) & (zero - least >= GAINS)
    own = np.where(tells, best, np.nan)
    common = _minimum(lags, np.log(np.maximum(left[:, told], TINY)).sum(axis=1)) if told.any() else EDGE * LAG
    at = np.array([np.interp(common, lags, column) for column in left.T])
    together = bool(np.all(at[told] <= TOGETHER * least[told] + FLOOR)) and abs(common) < EDGE * LAG
    changed, size = _change(evidence, done, best), np.maximum(_rms(evidence.corrected(done).torque), 1e-300)
    share = np.where(saves, changed / size, 0.0)
    if together and 2 * saves.sum() >= max(
        1, told.sum()
    ):  # one clock: what it changes of all torques counts, not of a joint without gravity
        much = float(np.linalg.norm(changed[saves]) / np.linalg.norm(size[saves])) >= GROSS or abs(common) >= LATE
        return Lags(own, common, share, saves & much)
    return Lags(own, common if together else np.nan, share, saves & (share >= GROSS) & (np.abs(best) >= LATE))


def _change(evidence: Evidence, done: Correction, lag: Array) -> Array:
    """(n,) [N.m or N] rms of what a lag of each joint changes."""
    places = list(done.tau_from)
    late = np.zeros_like(lag)
    late[places] = lag
    return _rms(evidence.late(done.lag + late) - evidence.late(done.lag))[places]


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(x**2, axis=0)))


def _minimum(x: Array, y: Array) -> float:
    """Where a curve is lowest, by the parabola through its lowest point and the neighbours."""
    k = int(np.argmin(y))
    if k in (0, len(x) - 1):
        return float(x[k])
    left, middle, right = y[k - 1 : k + 2]
    bend = left - 2 * middle + right
    return float(x[k] + (x[1] - x[0]) * (0.5 * (left - right) / bend if bend > 0 else 0.0))
