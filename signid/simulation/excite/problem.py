"""Problem of finding an exciting motion: model, parameters to identify, limits."""

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

DIRECTION = 0.01  # [rad/s or m/s] speed below which the direction of motion is proportional to the velocity


@dataclass(frozen=True, eq=False)
class ExcitationProblem(Frozen):
    """Model, parameters to be identified, and limits of a motion."""

    model: Model
    laws: tuple[Law, ...]  # laws whose coefficients are to be identified, besides the bodies
    base: BaseMap
    limits: Limits
    noise: Array  # (n,) [N.m or N] assumed standard deviation of the torque
    size: Array  # (b,) [noise per unit of base] reference size of each column
    collision: Collision | None  # None: self-collision is not checked
    clearance: float  # [m] smallest distance between links
    home: Array  # (n,) [rad or m] posture that obeys all limits

    @cached_property
    def wanted(self) -> list[Indices]:
        """Standard parameters of each joint's columns, the argument `wanted` of `base_rows`."""
        return [self.base.independent[seen] for seen in self.base.sees]

    @cached_property
    def value(self) -> Array:
        """Base parameters (b,) [units of base] of the model; laws that it does not have count as zero."""
        return self.base.combination @ _stated(self.model, self.laws)

    def rows(self, t: Array, q: Array, v: Array, a: Array, slow: Array | float = DIRECTION) -> list[Array]:
        """Base regressor (N, m_j) of each joint, over noise and reference size [1].

        Args:
            t: (N,) [s] instants.
            q: (N, n) [rad or m] positions.
            v: (N, n) [rad/s or m/s] velocities.
            a: (N, n) [rad/s2 or m/s2] accelerations.
            slow: (n,) [rad/s or m/s] speed below which the direction of motion is proportional to the velocity.
        """
        motion = Motion(self.model.robot, t, q, v, a, slow=np.broadcast_to(slow, self.noise.shape))
        found = base_rows(motion, self.laws, self.wanted)
        return [x / (s * self.size[seen]) for x, s, seen in zip(found, self.noise, self.base.sees, strict=True)]

    def information(self, rows: Sequence[Array]) -> Array:
        """Information (b, b) [1] of scaled base parameters, from rows (N, m_j) [1] per joint."""
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
    """Standard parameters (p,) of the bodies and laws; laws that the model does not have are zero."""
    known = {(law.effect.name, law.joints): law.effect.coefficients(law.parameters) for law in model.laws}
    found = [known.get((law.effect.name, law.joints), [0.0] * max(1, len(law.effect.linear()))) for law in laws]
    return np.concatenate([model.inertials.ravel(), *map(np.array, found)])
