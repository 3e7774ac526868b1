"""All that the worth of a motion depends on, but the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...model import Model
from ...regression.motion import Motion
from ...regression.regressor import base_rows
from ...types import Array, BaseMap, Frozen, Indices, Law, Trajectory
from .collision import Collision
from .limits import Limits
from .result import Use

DIRECTION = 0.01  # [rad/s or m/s] slower, the direction of motion counts in proportion


@dataclass(frozen=True, eq=False)
class ExcitationProblem(Frozen):
    """A model, what is to be told of it, and what a motion of it must obey."""

    model: Model
    laws: tuple[Law, ...]  # whose coefficients are to be told, beside the bodies
    base: BaseMap
    limits: Limits
    noise: Array  # (n,) [N.m or N]
    size: Array  # (b,) [noise per unit of base] reference size of each column
    collision: Collision | None
    clearance: float  # [m]
    home: Array  # (n,) [rad or m] posture that obeys all limits

    @cached_property
    def wanted(self) -> list[Indices]:
        """Per joint, the columns of the regressor that it sees."""
        return [self.base.independent[seen] for seen in self.base.sees]

    @cached_property
    def value(self) -> Array:
        """(b,) [units of base] what the model states of the base parameters, zero where nothing."""
        return self.base.combination @ _stated(self.model, self.laws)

    def rows(self, t: Array, q: Array, v: Array, a: Array, slow: Array | float = DIRECTION) -> list[Array]:
        """Per joint, the base regressor (N, m_j) over noise and reference size [1].

        Args:
            t: (N,) [s] instants.
            q: (N, n) [rad or m] positions.
            v: (N, n) [rad/s or m/s] velocities.
            a: (N, n) [rad/s2 or m/s2] accelerations.
            slow: (n,) [rad/s or m/s] slower, the direction of motion counts in proportion.
        """
        motion = Motion(self.model.robot, t, q, v, a, slow=np.broadcast_to(slow, self.noise.shape))
        found = base_rows(motion, self.laws, self.wanted)
        return [x / (s * self.size[seen]) for x, s, seen in zip(found, self.noise, self.base.sees, strict=True)]

    def information(self, rows: Sequence[Array]) -> Array:
        """(b, b) [1] of scaled base parameters, from rows (N, m_j) [1] per joint."""
        out = np.zeros((self.base.rank, self.base.rank))
        for x, seen in zip(rows, self.base.sees, strict=True):
            out[np.ix_(seen, seen)] += x.T @ x
        return out

    def use(self, trajectory: Trajectory) -> Use:
        """Largest share of each limit along a trajectory."""
        limits, robot = self.limits, self.model.robot
        share = np.abs(limits.shares(trajectory.q, trajectory.v, trajectory.a)).max(1) * limits.margin
        torque = self.model.inverse(Motion(robot, trajectory.t, trajectory.q, trajectory.v, trajectory.a))
        return Use(share[0], share[1], share[2], (np.abs(torque) / limits.torque).max(0))


def _stated(model: Model, laws: Sequence[Law]) -> Array:
    """Standard parameters (p,) of the bodies and laws, zero where the model states none."""
    known = {(law.effect.name, law.joints): law.effect.coefficients(law.parameters) for law in model.laws}
    found = [known.get((law.effect.name, law.joints), [0.0] * max(1, len(law.effect.linear()))) for law in laws]
    return np.concatenate([model.inertials.ravel(), *map(np.array, found)])
