"""Delay of torque against the motion, from the correlation of the residual with the derivative of the torque."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..recording.sampling import select_stretches
from ..regression.projection import least_squares
from ..regression.rows import Rows, read_rows, torque_rates
from ..regression.session import Session
from ..types import Array, Mask

SECONDS = 30.0  # [s] total duration of the evenly spread stretches that are read
SPARE = 2.0  # [rows per column] smallest number of rows
# [s] smallest delay that is flagged, and largest one for a first-order estimate. Measured on real arms: TX40 -3.0 ms;
# UR10e, panda and EMPS within 3 standard deviations of 0. `judge_lags` finds longer delays
LEAST, LONGEST = 0.003, 0.04
# [standard deviations] smallest significant delay. Measured: 6 for rokae joint sensors; 11 and more for 8 ms, simulated
# with 2 % noise
SURE = 7.0
# [1] mean square over the joints of the difference from the common delay, in standard deviations, up to which delays
# have one cause, for certain and roughly. Measured: 41 TX40, 5.3 rokae motor side; simulated arms with torque 8 ms late
# or early 0.1 to 1.6, 3.9 (ur10, early)
ALIKE, ROUGHLY = 3.0, 10.0
# [1] smallest mean reduction of the log variance of the residual. Measured: 0.26 TX40, 0.15 rokae; 0.46 and more for
# 8 ms, simulated without noise
CLEAR = 0.4
NEGATIVE = 0.5  # [1] share of joints with negative viscous friction from which on torque leads


class Delay(NamedTuple):
    """Delay of torque, positive if it is recorded late."""

    common: float  # [s] mean of all joints, weighted by their precision
    std: float  # [s] its standard deviation, for independent residuals
    scatter: float  # [1] mean square difference of the joints from it, in standard deviations; NaN for one joint
    gain: float  # [1] mean log ratio of the residual's variance without and with the delays

    def is_clear(self, negative: float) -> bool:
        """Whether the delay is large and certain enough for a flag.

        Args:
            negative: share of the joints with negative estimates of viscous friction [1].
        """
        if not LEAST <= abs(self.common) <= LONGEST or abs(self.common) < SURE * self.std:
            return False
        leads = self.common < 0 and negative >= NEGATIVE
        strong = (self.gain >= CLEAR or leads) and not self.scatter > ROUGHLY
        return strong or self.scatter <= ALIKE


class _JointDelay(NamedTuple):
    delay: float  # [s]
    std: float  # [s]
    gain: float  # [1]


def estimate_delay(session: Session, signed: Mask) -> Delay | None:
    """Delay that best explains the residuals of each joint's least-squares fit; None if there are too few rows.

    To first order, torque that is recorded late by L differs by -L times its derivative. The derivative of the
    predicted torque is the instrument for that of the recorded torque, whose noise would bias delays towards zero. Rows
    near reversals are excluded, since dry friction leads the motion there.

    Args:
        session: session with the training recordings.
        signed: (n,) joints that move and have signed torque.
    """
    windows = _windows(session)
    found = [own for j in np.flatnonzero(signed).tolist() if (own := _joint_delay(windows, j)) is not None]
    if not found:
        return None
    delay, std, gain = (np.array(x) for x in zip(*found, strict=True))
    common = float(np.average(delay, weights=std**-2))
    scatter = float(np.sum(((delay - common) / std) ** 2) / (len(delay) - 1)) if len(delay) > 1 else float("nan")
    return Delay(common, float(np.sum(std**-2) ** -0.5), scatter, float(gain.mean()))


def _windows(session: Session) -> list[tuple[Rows, Array]]:
    """Rows of evenly spread stretches, and the derivative (M, n) [N.m/s or N/s] of their torque."""
    task, out = session.task, list[tuple[Rows, Array]]()
    whole = sum(sampling.duration for _, sampling in session.train)
    for recording, sampling in session.train:
        few = select_stretches(sampling, SECONDS * sampling.duration / whole)
        out += zip(read_rows(task, recording, few), torque_rates(task, recording, few), strict=True)
    return [(rows, rate) for rows, rate in out if len(rows.t) > 1]


def _joint_delay(windows: list[tuple[Rows, Array]], joint: int) -> _JointDelay | None:
    """Delay of one joint; None if its rows are not informative."""
    kept = [rows.steady[:, joint] & rows.recorded[joint] for rows, _ in windows]
    pairs = list(zip(windows, kept, strict=True))
    if sum(int(k.sum()) for k in kept) < SPARE * max((rows.columns[joint].shape[1] for rows, _ in windows), default=1):
        return None
    columns = np.concatenate([rows.columns[joint][k] for (rows, _), k in pairs])
    torque = np.concatenate([rows.torque[k, joint] for (rows, _), k in pairs])
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis, factor = np.linalg.qr(columns / size)
    value = least_squares(factor, basis.T @ torque, 1e-10) / size
    rate = np.concatenate([rate[k, joint] for (_, rate), k in pairs])
    instrument = np.concatenate([np.gradient(rows.columns[joint] @ value, rows.t)[k] for (rows, _), k in pairs])
    y, d, z = (x - basis @ (basis.T @ x) for x in (torque, rate, instrument))
    overlap = float(z @ d)
    if overlap <= 0 or not y.any():
        return None
    delay = -float(z @ y) / overlap
    rest = y + delay * d
    variance = float(rest @ rest) / len(y)
    std = max(variance * float(z @ z), 1e-300) ** 0.5 / overlap
    return _JointDelay(delay, std, float(np.log(float(y @ y) / max(float(rest @ rest), 1e-300))))
