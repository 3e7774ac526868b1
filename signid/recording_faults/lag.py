"""Evidence -> lag of recorded torque against the motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..types import Array, Mask
from .correction import Correction
from .evidence import LAG, FaultEvidence
from .fits import FitColumns

STEPS = 25  # candidates on either side of zero
LARGE, LATE = 0.25, 0.08  # [1] change of the torque by a lag over the rms torque, and [s]: from these on a lag is large
# A lag is significant if the unexplained share falls to HALVES of that without it, by at least GAINS, to at most LEFT
HALVES, GAINS, LEFT = 0.5, 0.02, 0.15  # [1]
TOGETHER, FLOOR = 1.5, 0.01  # [1] unexplained share of a common lag, over and above that of the joint's own best lag
TINY = 1e-3  # [1] unexplained share below which lags count as equally good
EDGE = 0.9  # [1] largest lag over the longest candidate; beyond it there is no minimum


class Lags(NamedTuple):
    """Lags of the joints."""

    own: Array  # (n,) [s], NaN for a joint that is not informative
    common: float  # [s] of all informative joints, NaN if they differ or there is none
    share: Array  # (n,) [1] change of the torque by the lag over its rms; 0 if the lag is not significant
    large: Mask  # (n,) whether it is more than a mild delay


def lag_table(evidence: FaultEvidence, done: Correction) -> tuple[Array, Array]:
    """Candidate lags (L,) [s], and unexplained shares (L, n) [1] of the torques with each of them."""
    lags, x = np.asarray(LAG / STEPS * np.arange(-STEPS, STEPS + 1)), evidence.corrected(done)
    columns = [FitColumns(x, j) for j in range(len(done.lag))]
    left: Array = np.empty((len(lags), len(columns)))
    for k, lag in enumerate(lags):
        torque = evidence.late(done.lag + lag)[:, list(done.tau_from)] * done.tau_sign
        left[k] = [c.fit(torque[:, j]).unexplained for j, c in enumerate(columns)]
    return lags, left


def judge_lags(evidence: FaultEvidence, done: Correction, informative: Mask) -> Lags:
    """Estimate the remaining lags of the corrected torques.

    Args:
        evidence: evidence of the recordings.
        done: correction found so far.
        informative: (n,) joints with informative torque.
    """
    lags, left = lag_table(evidence, done)
    best = np.array([_minimum(lags, column) for column in left.T])
    zero, least = left[len(lags) // 2], left.min(axis=0)
    inside = informative & (np.abs(best) < EDGE * LAG) & (least <= zero)
    saves = inside & (least <= np.minimum(HALVES * zero, LEFT)) & (zero - least >= GAINS)
    own = np.where(inside, best, np.nan)
    known = left[:, informative]
    common = _minimum(lags, np.log(np.maximum(known, TINY)).sum(axis=1)) if informative.any() else EDGE * LAG
    at = np.array([np.interp(common, lags, column) for column in left.T])
    alike = at[informative] <= TOGETHER * least[informative] + FLOOR
    together = bool(np.all(alike)) and abs(common) < EDGE * LAG
    changed, size = _change(evidence, done, best), np.maximum(_rms(evidence.corrected(done).torque), 1e-300)
    share = np.where(saves, changed / size, 0.0)
    if together and 2 * saves.sum() >= max(1, informative.sum()):
        # One clock: the change of all torques together counts, since a joint without gravity changes much alone
        much = float(np.linalg.norm(changed[saves]) / np.linalg.norm(size[saves])) >= LARGE or abs(common) >= LATE
        return Lags(own, common, share, saves & much)
    return Lags(own, common if together else np.nan, share, saves & (share >= LARGE) & (np.abs(best) >= LATE))


def _change(evidence: FaultEvidence, done: Correction, lag: Array) -> Array:
    """Rms (n,) [N.m or N] of the change of each joint's torque by its lag."""
    places = list(done.tau_from)
    late = np.zeros_like(lag)
    late[places] = lag
    return _rms(evidence.late(done.lag + late) - evidence.late(done.lag))[places]


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(x**2, axis=0)))


def _minimum(x: Array, y: Array) -> float:
    """Minimum of a curve, by the parabola through its lowest point and the neighbours."""
    k = int(np.argmin(y))
    if k in (0, len(x) - 1):
        return float(x[k])
    left, middle, right = y[k - 1 : k + 2]
    bend = left - 2 * middle + right
    return float(x[k] + (x[1] - x[0]) * (0.5 * (left - right) / bend if bend > 0 else 0.0))
