"""T-optimality distance of two laws along a motion, with nuisance columns fitted besides."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...effects.law import law_columns, law_torque
from ...model import Model
from ...regression.motion import Motion
from ...regression.projection import leave
from ...regression.rows import away_from_reversals
from ...types import Array, Frozen, Law, Mask, Trajectory
from .problem import DIRECTION, ExcitationProblem

INDEPENDENT = 20.0  # [Hz] rate of torque samples with independent errors, after filters
NEAR = 0.06  # [s] before and after a reversal in which torque does not count
STRUCTURAL = 1e-6  # [1] share of a law's sum of squares below which the laws are equal up to rounding and linearisation


class Distance(NamedTuple):
    """Distance of two laws, for either of them being the true one."""

    seen: tuple[float, float]  # lambda [1]: first law true and second fitted, second true and first fitted
    shares: tuple[float, float]  # [1] of the true law's own sum of squares over noise


@dataclass(frozen=True, eq=False)
class LawPair(Frozen):
    """Two laws, and the nuisance that is fitted besides either of them."""

    problem: ExcitationProblem  # its laws and bodies are the nuisance
    first: Law
    second: Law
    bodies: bool  # whether the bodies' base parameters are fitted too

    def distance(self, trajectory: Trajectory) -> Distance:
        """Distance along a uniformly sampled trajectory."""
        motion = with_torque(self.problem.model, trajectory)
        nuisance, noise = self._nuisance(motion, trajectory), self.problem.noise
        there = law_distance(self.first, self.second, motion, nuisance, noise)
        back = law_distance(self.second, self.first, motion, nuisance, noise)
        return Distance((there[0], back[0]), (there[1], back[1]))

    def _nuisance(self, motion: Motion, trajectory: Trajectory) -> Array:
        """(N, n, k) columns that are fitted besides either law [N.m or N per unit of each]."""
        if not self.bodies:
            return wide_columns(self.problem.laws, motion)
        rows = self.problem.rows(trajectory.t, trajectory.q, trajectory.v, trajectory.a)
        out = np.zeros((*motion.q.shape, self.problem.base.rank))
        for j, (x, seen) in enumerate(zip(rows, self.problem.base.sees, strict=True)):
            out[:, j, seen] = x * self.problem.noise[j]
        return out


def law_distance(law: Law, rival: Law, motion: Motion, nuisance: Array, noise: Array) -> tuple[float, float]:
    """Sum of squares over noise of a law's torque that a rival and the nuisance cannot explain, and its share.

    If one of the laws jumps with the direction of a joint's motion, samples near its reversals do not count, as in
    identification: dry friction is uncertain there. Parameters that the law does not state take the example values of
    its effect. Shapes that the rival does not state are tried on their grid. The N samples of the motion are uniform
    and have the predicted torque. The columns nuisance (N, n, k) [N.m or N per unit of each] are fitted besides. The
    sum [1], over noise (n,) [N.m or N], is for independent samples at 20 Hz; its share [1] is of the law's own.

    Source: T-optimality, Atkinson, Fedorov, Biometrika 62(1), 1975.
    """
    weight = _certain(motion, {j for one in (law, rival) if one.effect.reverses for j in one.joints}) / noise
    stated = Law(law.effect, law.joints, {**law.effect.example, **law.parameters})
    rows, torque = law_torque(stated, motion)
    wide = np.zeros_like(motion.q)
    wide[:, list(rows)] = torque
    y = (wide * weight).ravel()
    whole = float(y @ y)
    candidates = (np.concatenate([nuisance, wide_columns([one], motion)], axis=2) for one in _shaped(rival, motion))
    rests = (leave(y, (x * weight[:, :, None]).reshape(len(y), -1)) for x in candidates)
    left = min(float(rest @ rest) for rest in rests)
    return INDEPENDENT * motion.dt * left, left / whole if whole > 0 else 0.0


def wide_columns(laws: Sequence[Law], motion: Motion) -> Array:
    """Columns (N, n, k) of laws over all joints [N.m or N per unit of each], zero where a law does not act."""
    parts = [np.zeros((*motion.q.shape, 0))]
    for law in laws:
        rows, columns = law_columns(law, motion)
        out = np.zeros((*motion.q.shape, columns.shape[2]))
        out[:, list(rows)] = columns
        parts.append(out)
    return np.concatenate(parts, axis=2)


def with_torque(model: Model, trajectory: Trajectory) -> Motion:
    """Motion with the torque that a model predicts, for laws that act on torque."""
    t, q, v, a = trajectory.t, trajectory.q, trajectory.v, trajectory.a
    slow = np.full(q.shape[1], DIRECTION)
    torque = model.inverse(Motion(model.robot, t, q, v, a, slow=slow))
    return Motion(model.robot, t, q, v, a, recorded=torque, predicted=torque, slow=slow)


def _certain(motion: Motion, joints: Collection[int]) -> Mask:
    """Mask (N, n) of samples that are not near a reversal of some joints; a reversal may lie between two samples."""
    sign, at = np.sign(motion.v), list(joints)
    speed = np.where(np.diff(sign, axis=0, append=sign[-1:]) != 0, 0.0, motion.v)
    certain = np.ones(motion.v.shape, dtype=bool)
    certain[:, at] = away_from_reversals(speed[:, at], round(NEAR / motion.dt), np.full(len(at), DIRECTION))
    return certain


def _shaped(law: Law, motion: Motion) -> Iterator[Law]:
    """The law as it stands if it states its shape, else the law with each shape on the grid of its effect."""
    if law.effect.shape(law.parameters).keys() == law.effect.parameters.keys() - law.effect.linear().keys():
        yield law
    else:
        for shape in law.effect.shapes(motion.at(law.joints)):
            yield Law(law.effect, law.joints, shape)
