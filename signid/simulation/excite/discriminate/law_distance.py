"""How far two laws are from each other along a motion, whatever else is fitted beside them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....effects.law import law_columns
from ....model import Model
from ....regression.motion import Motion
from ....regression.projection import leave
from ....types import Array, Frozen, Law, Trajectory
from ..problem import DIRECTION, ExcitationProblem


class Distance(NamedTuple):
    """Both ways: the first law seen while the second is fitted, and the other way round."""

    seen: tuple[float, float]  # lambda [1]
    shares: tuple[float, float]  # [1] of the law's own sum of squares over noise


@dataclass(frozen=True, eq=False)
class Rivals(Frozen):
    """Two laws, and what is fitted beside either of them."""

    problem: ExcitationProblem  # its laws and bodies are what is fitted beside
    first: Law
    second: Law
    bodies: bool  # whether the bodies' base parameters are fitted too
    weight: float  # independent samples per sample

    def distance(self, trajectory: Trajectory) -> Distance:
        """Along a uniformly sampled trajectory; shapes that a law does not state are fitted on their grid.

        Source: T-optimality, Atkinson, Fedorov, Biometrika 62(1), 1975.
        """
        motion = _motion(self.problem.model, trajectory)
        beside = self._beside(motion, trajectory)
        there = self._left(motion, beside, self.first, self.second)
        back = self._left(motion, beside, self.second, self.first)
        return Distance((there[0], back[0]), (there[1], back[1]))

    def _left(self, motion: Motion, beside: Array, true: Law, fitted: Law) -> tuple[float, float]:
        """Sum of squares of the true law that the other leaves, and its share."""
        effect = true.effect
        numbers = {**effect.example, **true.parameters}
        law = Law(effect, true.joints, numbers)
        torque = self._rows(law, motion) @ np.array(effect.coefficients(numbers))
        whole = float(torque @ torque)
        left = min(_rest(torque, np.column_stack([beside, self._rows(f, motion)])) for f in _shaped(fitted, motion))
        return self.weight * left, left / whole if whole > 0 else 0.0

    def _rows(self, law: Law, motion: Motion) -> Array:
        """(N n, k) columns of a law over noise."""
        rows, columns = law_columns(law, motion)
        out = np.zeros((len(motion), len(self.problem.noise), columns.shape[2]))
        out[:, list(rows)] = columns
        return (out / self.problem.noise[:, None]).reshape(-1, columns.shape[2])

    def _beside(self, motion: Motion, trajectory: Trajectory) -> Array:
        """(N n, k) columns that are fitted beside either law."""
        if self.bodies:
            found = self.problem.rows(trajectory.t, trajectory.q, trajectory.v, trajectory.a)
            whole = np.zeros((len(motion), len(self.problem.noise), self.problem.base.rank))
            for j, (x, seen) in enumerate(zip(found, self.problem.base.sees, strict=True)):
                whole[:, j, seen] = x
            return whole.reshape(-1, self.problem.base.rank)
        columns = [self._rows(law, motion) for law in self.problem.laws]
        return np.concatenate(columns, axis=1) if columns else np.zeros((self.problem.noise.size * len(motion), 0))


def _motion(model: Model, trajectory: Trajectory) -> Motion:
    """The motion with the torque that the model predicts, for laws that act on it."""
    t, q, v, a = trajectory.t, trajectory.q, trajectory.v, trajectory.a
    slow = np.full(q.shape[1], DIRECTION)
    torque = model.inverse(Motion(model.robot, t, q, v, a, slow=slow))
    return Motion(model.robot, t, q, v, a, recorded=torque, predicted=torque, slow=slow)


def _shaped(law: Law, motion: Motion) -> Iterator[Law]:
    """The law as it stands, or with every shape that is worth trying."""
    if law.effect.shape(law.parameters).keys() == law.effect.parameters.keys() - law.effect.linear().keys():
        yield law
    else:
        for shape in law.effect.shapes(motion.at(law.joints)):
            yield Law(law.effect, law.joints, shape)


def _rest(torque: Array, columns: Array) -> float:
    """Sum of squares that the columns leave of a torque."""
    left = leave(torque, columns)
    return float(left @ left)


def beside_laws(laws: Sequence[Law], first: Law, second: Law) -> tuple[Law, ...]:
    """The laws that are neither of the two."""
    rivals = {(law.effect.name, law.joints) for law in (first, second)}
    return tuple(law for law in laws if (law.effect.name, law.joints) not in rivals)
