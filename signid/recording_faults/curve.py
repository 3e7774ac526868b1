"""Uniform samples -> values between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Array, Frozen

NODES = 6  # samples around a moment. Measured: off by 3 % of a sine of four samples a period, 0.05 % of one of eight


@dataclass(frozen=True, eq=False)
class Curve(Frozen):
    """Uniform samples of n signals."""

    t: Array  # (M,) [s]
    x: Array  # (M, n) [any unit]

    def at(self, t: Array) -> Array:
        """(K, n) values by the polynomial through the nearest samples; those at the ends hold beyond them.

        Args:
            t: (K,) [s].
        """
        count, last = min(NODES, len(self.t)), len(self.t) - 1
        place = (np.clip(t, self.t[0], self.t[-1]) - self.t[0]) / (self.t[-1] - self.t[0]) * last
        start = np.clip(np.floor(place).astype(np.intp) - count // 2 + 1, 0, last + 1 - count)
        nodes, off = np.arange(count), place - start
        value = np.zeros((len(t), self.x.shape[1]))
        for k in nodes:
            others = nodes[nodes != k]
            weight = np.prod((off[:, None] - others) / (k - others), axis=1)
            value += weight[:, None] * self.x[start + k]
        return value
