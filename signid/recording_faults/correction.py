"""Corrections of a recording: order, signs and units of columns, and lags."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..types import Array, Frozen


@dataclass(frozen=True, eq=False)
class Correction(Frozen):
    """Columns and factors of n joints in a recording, and the lag of each torque column."""

    q_from: tuple[int, ...]  # (n,) column of each joint's position
    q_scale: Array  # (n,) [1] factor on the position
    tau_from: tuple[int, ...]  # (n,) column of each joint's torque
    tau_sign: Array  # (n,) [1] factor on the torque
    lag: Array  # (n,) [s] by which each column of torque is late

    @classmethod
    def none(cls, n: int) -> Correction:
        """Correction of n joints that changes nothing."""
        return cls(tuple(range(n)), np.ones(n), tuple(range(n)), np.ones(n), np.zeros(n))

    @property
    def keeps_positions(self) -> bool:
        """Whether positions are unchanged."""
        return self.q_from == tuple(range(len(self.q_from))) and bool(np.all(self.q_scale == 1))

    def exchange(self, order: tuple[int, ...], positions: bool = False, torques: bool = False) -> Correction:
        """Exchange columns: joint i gets those of joint order[i]."""
        at = list(order)
        found = self
        if positions:
            found = replace(found, q_from=tuple(self.q_from[k] for k in at), q_scale=self.q_scale[at])
        if torques:
            found = replace(found, tau_from=tuple(self.tau_from[k] for k in at), tau_sign=self.tau_sign[at])
        return found

    def scale(self, joints: tuple[int, ...], position: float = 1.0, torque: float = 1.0) -> Correction:
        """Multiply positions and torques of some joints by factors."""
        q, tau = self.q_scale.copy(), self.tau_sign.copy()
        q[list(joints)] *= position
        tau[list(joints)] *= torque
        return replace(self, q_scale=q, tau_sign=tau)

    def earlier(self, joints: tuple[int, ...], lag: float) -> Correction:
        """Shift torques of some joints, which were recorded late by `lag` [s]."""
        late = self.lag.copy()
        late[[self.tau_from[j] for j in joints]] += lag
        return replace(self, lag=late)
