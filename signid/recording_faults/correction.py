"""What may be wrong with a recording as a whole, as what would mend it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..types import Array, Frozen


@dataclass(frozen=True, eq=False)
class Correction(Frozen):
    """Which column of the recording belongs to each of n joints, with which factor, and how late its torque is."""

    q_from: tuple[int, ...]  # (n,)
    q_scale: Array  # (n,) [1]
    tau_from: tuple[int, ...]  # (n,)
    tau_sign: Array  # (n,) [1]
    lag: Array  # (n,) [s] of each column of torque

    @classmethod
    def none(cls, n: int) -> Correction:
        """Of n joints that nothing is wrong with."""
        return cls(tuple(range(n)), np.ones(n), tuple(range(n)), np.ones(n), np.zeros(n))

    @property
    def keeps_positions(self) -> bool:
        """Whether positions are left as they are."""
        return self.q_from == tuple(range(len(self.q_from))) and bool(np.all(self.q_scale == 1))

    def exchange(self, order: tuple[int, ...], positions: bool = False, torques: bool = False) -> Correction:
        """Joint i gets what joint order[i] had."""
        at = list(order)
        found = self
        if positions:
            found = replace(found, q_from=tuple(self.q_from[k] for k in at), q_scale=self.q_scale[at])
        if torques:
            found = replace(found, tau_from=tuple(self.tau_from[k] for k in at), tau_sign=self.tau_sign[at])
        return found

    def scale(self, joints: tuple[int, ...], position: float = 1.0, torque: float = 1.0) -> Correction:
        """Positions and torques of some joints times these."""
        q, tau = self.q_scale.copy(), self.tau_sign.copy()
        q[list(joints)] *= position
        tau[list(joints)] *= torque
        return replace(self, q_scale=q, tau_sign=tau)

    def earlier(self, joints: tuple[int, ...], lag: float) -> Correction:
        """Torques of some joints were recorded late by `lag` [s]."""
        late = self.lag.copy()
        late[[self.tau_from[j] for j in joints]] += lag
        return replace(self, lag=late)
