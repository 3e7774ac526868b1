"""Residual of blocks -> residual of the momentum observer, with the signals that its thresholds need."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..types import Array
from .momentum import Residual

GAIN = 50.0  # [1/s] of the observer: its residual follows a contact with a time constant of 20 ms
RINGING = 0.15  # [s] for which a sudden change of torque is remembered: links and gears swing after it


class Observed(NamedTuple):
    """K blocks of n joints after the observer."""

    residual: Array  # (K, n) [N.m or N]
    columns: Array  # (K, 4, n) [rad/s or m/s, 1, N.m or N, 1] of the changes of a joint's own laws: frames.LOCAL
    low: Array  # (K, n) [N.m or N] least residual that unknown friction leaves
    high: Array  # (K, n) [N.m or N] the largest
    rate: Array  # (K, n) [N.m/s or N/s] of the predicted torque, its largest of the last moments
    friction: Array  # (K, n) [N.m or N] size of the predicted friction

    def beyond(self, base: Array) -> tuple[Array, Array]:
        """Residual (K, n) without known changes, and what friction cannot explain of it (K, n) [N.m or N].

        base: (n, 4) coefficients of the columns [units of the laws].
        """
        r = self.residual - np.einsum("kcn,nc->kn", self.columns, base)
        return r, np.maximum(np.maximum(r - self.high, self.low - r), 0.0)


class Observer:
    """First-order filter of the residual: De Luca, Albu-Schaeffer, Haddadin, Hirzinger, IEEE/RSJ IROS 2006."""

    def __init__(self, joints: int) -> None:
        self.state, self.rate, self.empty = np.zeros((9, joints)), np.zeros(joints), True

    def restart(self) -> None:
        """Begin a new stretch: the residual is zero, but what its thresholds need is as it was."""
        self.state[:], self.empty = 0.0, True

    def observe(self, found: Residual, step: float) -> Observed:
        """Blocks of `step` [s] through the filter."""
        from scipy.signal import lfilter  # slow to import

        motion, predicted = found.motion, found.predicted
        signals = (motion.v, motion.direction, predicted, np.ones_like(predicted))
        given = np.stack([found.residual, *signals, found.low, found.high, found.friction, predicted], axis=1)
        if self.empty:
            self.state[7:], self.empty = given[0, 7:], False
        keep, count = float(np.exp(-GAIN * step)), len(given)
        powers = np.power(keep, np.arange(1.0, count + 1.0))
        whole = lfilter([1 - keep], [1.0, -keep], given, axis=0) + powers[:, None, None] * self.state
        self.state = whole[-1]
        fade = np.exp(-step / RINGING * np.arange(1.0, count + 1.0))[:, None]
        rate = GAIN * np.abs(predicted - whole[:, 8])  # derivative of the filtered torque
        rate = fade * np.maximum.accumulate(np.maximum(rate / fade, self.rate), axis=0)
        self.rate = rate[-1]
        return Observed(whole[:, 0], whole[:, 1:5], whole[:, 5], whole[:, 6], rate, whole[:, 7])
