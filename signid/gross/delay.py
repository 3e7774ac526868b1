"""Session -> delay of torque against the motion, from the part of its residual that follows the torque's rate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..rows import read_rows, torque_rates
from ..sampling import spread
from ..session import Session
from ..types import Array, Mask

SECONDS = 30.0  # [s] of recordings that are read, in evenly spread stretches
SPARE = 2.0  # rows per column, at least
# [s] of a delay that is worth a flag, and that the rate tells. Measured on real arms: TX40 -2.8 ms, UR10e, panda and
# EMPS below 2.2 ms; longer ones are found by `judge_lags`
LEAST, LONGEST = 0.003, 0.04
# Mean over the joints of the logarithm by which a delay lessens the residual's variance, and the same where viscous
# friction is negative at most joints. Measured: 0.30 TX40, 0.19 rokae, 0.03 panda, 0.02 UR10e, 0.08 EMPS; simulated
# arms with torque 8 ms late or early 0.54 (go2), 0.88 (3r), 1.2 (ur10)
CLEAR, SUPPORTED = 0.4, 0.1
MOST = 0.5  # share of the joints whose viscous friction is estimated as negative: torque leads
SURE = 5.0  # standard deviations of a delay


class Delay(NamedTuple):
    """Delay of torque, positive where it is recorded late."""

    common: float  # [s] of all joints, weighted by what each can tell
    std: float  # [s] of it, for independent residuals
    gain: float  # [1] mean logarithm of the residual's variance without over with delays of the joints' own

    def is_clear(self, negative: float) -> bool:
        """Whether it is worth a flag.

        Args:
            negative: share of the joints whose viscous friction was estimated as negative [1].
        """
        if not LEAST <= abs(self.common) <= LONGEST or abs(self.common) < SURE * self.std:
            return False
        leads = self.common < 0 and negative >= MOST
        return self.gain >= (SUPPORTED if leads else CLEAR)


def estimate_delay(session: Session, signed: Mask) -> Delay | None:
    """The delay that explains the residual of each joint's own least squares best; None where rows are too few.

    To first order, torque that is recorded late by L differs by -L times its rate. Rows near reversals take no part,
    since dry friction there leads the motion by itself.

    Args:
        session: recordings to learn from.
        signed: (n,) joints that move and whose torque is recorded with its sign.
    """
    rows = _rows(session, signed)
    rates, residuals = zip(*rows, strict=True) if rows else ((), ())
    if not rows:
        return None
    power = [float(d @ d) for d in rates]
    own = [-float(d @ y) / p for d, y, p in zip(rates, residuals, power, strict=True)]
    rest = [y + lag * d for d, y, lag in zip(rates, residuals, own, strict=True)]
    before, after = ([float(x @ x) / len(x) for x in some] for some in (residuals, rest))
    weight = np.array([p / max(v, 1e-300) for p, v in zip(power, after, strict=True)])
    gain = np.mean([np.log(max(b, 1e-300) / max(a, 1e-300)) for b, a in zip(before, after, strict=True)])
    return Delay(float(np.average(own, weights=weight)), float(weight.sum() ** -0.5), float(gain))


def _rows(session: Session, signed: Mask) -> list[tuple[Array, Array]]:
    """Per joint that tells something, the torque's rate and the torque, (M,) each, without what columns explain."""
    task, made = session.task, [list[Array]() for _ in signed]
    whole = sum(sampling.duration for _, sampling in session.train)
    for recording, sampling in session.train:
        few = spread(sampling, SECONDS * sampling.duration / whole)
        for rows, rate in zip(read_rows(task, recording, few), torque_rates(task, recording, few), strict=True):
            for j in np.flatnonzero(rows.recorded & signed).tolist():
                kept = rows.steady[:, j]
                beside = np.column_stack([rate[kept, j], rows.torque[kept, j]])
                made[j].append(np.column_stack([rows.columns[j][kept], beside]))
    found = [_free(np.concatenate(own)) for own in made if own]
    return [(x[:, 0], x[:, 1]) for x in found if len(x) and np.any(x[:, 0])]


def _free(x: Array) -> Array:
    """(M, 2) the last two columns without what the others explain; no rows where these are too many."""
    columns, rest = x[:, :-2], x[:, -2:]
    if len(x) < SPARE * columns.shape[1]:
        return rest[:0]
    basis = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))[0]
    return np.asarray(rest - basis @ (basis.T @ rest))
