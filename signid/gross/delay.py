"""Evidence -> a delay between torque and motion, of all joints together, that is too short to be a gross lag."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..types import Array, Mask
from .evidence import Evidence, Signals
from .lag import minimum

LONGEST, STEP = 0.08, 0.004  # [s] range and step of the delays that are tried
FAST = 0.3  # of a joint's rms speed: slower rows are left out, since friction near a reversal is not certain
LEAST, SURE = 0.004, 4.0  # [s]; standard deviations: a delay that is shorter or less certain is not reported
BETTER = 0.9  # of the variance of the residual: a delay that leaves more (mean over joints) is not reported


class Delay(NamedTuple):
    """How late torque is recorded; negative where it leads the motion."""

    seconds: float  # [s]
    std: float  # [s]


def judge_delay(evidence: Evidence, told: Mask) -> Delay | None:
    """The common delay of all joints, if there is one.

    Each joint's torque at t + delay is fitted by the model's torque, friction, a rotor and an offset; the delay is
    where the sum of the logarithms of the residuals' variances is least. Its standard deviation is that of a jackknife
    over parts of the recordings and over joints (Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982).

    Args:
        evidence: rows of all recordings.
        told: (n,) joints whose torque is recorded with its sign and strong enough.
    """
    joints, delays = np.flatnonzero(told), np.arange(-LONGEST, LONGEST + STEP / 2, STEP)
    if not len(joints):
        return None
    late = [evidence.late(np.full(len(told), delay)) for delay in delays]
    squares = np.array([_squares(evidence, int(j), [torque[:, j] for torque in late]) for j in joints])
    if not np.all(squares.sum(axis=1) > 0):
        return None
    found = _best(delays, squares)
    blocks = [_best(delays, np.delete(squares, k, axis=1)) for k in range(squares.shape[1])]
    others = [_best(delays, np.delete(squares, k, axis=0)) for k in range(len(joints))] if len(joints) > 1 else []
    std = float(np.hypot(_jackknife(blocks), _jackknife(others)))
    total = squares.sum(axis=1)
    at = np.array([np.interp(found, delays, one) / one[len(delays) // 2] for one in total])
    clear = abs(found) >= max(LEAST, SURE * std) and abs(found) < LONGEST - STEP
    return Delay(found, std) if clear and np.exp(np.mean(np.log(at))) <= BETTER else None


def _squares(evidence: Evidence, joint: int, torques: list[Array]) -> Array:
    """(blocks, delays) sums of squares of the residual of a joint [N2.m2 or N2]."""
    x: Signals = evidence.plain
    v = x.v[:, joint]
    fast = np.abs(v) > FAST * np.sqrt(np.mean(v**2))
    columns = np.column_stack([x.predicted[:, joint], v, x.direction[:, joint], x.a[:, joint], np.ones(len(v))])[fast]
    basis = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))[0]
    y = np.column_stack(torques)[fast]
    rest, block = (y - basis @ (basis.T @ y)) ** 2, evidence.block[fast]
    return np.array([rest[block == k].sum(axis=0) for k in np.unique(evidence.block)])


def _best(delays: Array, squares: Array) -> float:
    """The delay [s] at which the residuals (joints, blocks, delays) are least."""
    total = squares.sum(axis=1)
    return minimum(delays, np.log(np.maximum(total, 1e-12 * total.max(axis=1, keepdims=True))).sum(axis=0))


def _jackknife(found: list[float]) -> float:
    """Standard deviation of what was found without each part in turn."""
    x, count = np.array(found), len(found)
    return float(np.sqrt((count - 1) / count * np.sum((x - x.mean()) ** 2))) if count > 1 else 0.0
