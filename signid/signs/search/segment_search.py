"""Exact search over the signs of some segments: friction prior and patterns, physical cone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...types import Array, Frozen
from ..observations import Observed
from ..segments import Segment
from ..thresholds import FRICTION_PRIOR, PRIOR_STRENGTH
from .cone import PhysicalCone
from .exact import SignSolution, search_signs
from .problem import KnownRows, SignProblem, signed_rows


def known_rows(observed: Observed, weights: Array) -> KnownRows:
    """Known rows with weights (n,) [1/N.m or 1/N]: joints whose torque has its sign, and the friction prior."""
    parts = [signed_rows(observed, weights), friction_prior(observed, weights)]
    return KnownRows(np.concatenate([p.matrix for p in parts]), np.concatenate([p.target for p in parts]))


def friction_prior(observed: Observed, weights: Array, strength: float = PRIOR_STRENGTH) -> KnownRows:
    """Prior rows for offset, Coulomb and viscous friction of joints whose torque has no sign.

    A row exists for each base parameter that is one of these coefficients alone, in units of the joint's rms torque and
    velocity; with strength 1 it counts as a measurement. Rows do not grow with the weights (n,) [1/N.m or 1/N] of the
    torque, so the prior loses influence as samples gain weight; a joint of weight 0 has no prior.
    """
    torque, speed = observed.rms, np.sqrt(np.mean(observed.v**2, axis=0))
    matrix, target = [np.zeros((0, observed.count))], []
    for k, (name, joint) in observed.coefficients.items():
        used = joint in observed.hidden and weights[joint] > 0 and torque[joint] * speed[joint] > 0
        if name in FRICTION_PRIOR and used:
            expected, deviation = FRICTION_PRIOR[name]
            unit = torque[joint] / (speed[joint] if name == "viscous_friction" else 1.0)
            matrix.append(np.eye(1, observed.count, k) * strength / (deviation * unit))
            target.append(strength * expected / deviation)
    return KnownRows(np.concatenate(matrix), np.array(target))


def friction_patterns(problem: SignProblem, observed: Observed, segments: Sequence[Segment]) -> list[Array]:
    """Per joint, the signs (S,) of the mean velocity in its segments; 0 in segments of other joints [1].

    The search tries the signs of a joint as this pattern, as its opposite, and multiplied by it: Coulomb friction F
    sign(v) fits as well as a constant offset F whose sign never changes.
    """
    velocity = np.array([np.sign(observed.v[s.start : s.stop, s.joint].mean()) or 1.0 for s in segments])
    wide = np.append(velocity, np.zeros(problem.count - len(segments)))
    return [np.where(problem.joints == joint, wide, 0.0) for joint in np.unique([s.joint for s in segments])]


@dataclass(frozen=True, eq=False)
class SegmentSearch(Frozen):
    """Search over the signs of any segments of some observations."""

    observed: Observed
    inequalities: Array  # (g, b) rows c with c'theta >= 0 [1 over units of base]
    seed: int = 0

    def cone(self, problem: SignProblem) -> PhysicalCone:
        """The physical cone in the coordinates of a problem."""
        return PhysicalCone.of(problem, self.inequalities)

    def solve(self, problem: SignProblem, segments: Sequence[Segment], start: Array | None = None) -> SignSolution:
        """The signs of lowest loss within the cone; start (S,) [1] may be good. `segments` lack the known one."""
        patterns = friction_patterns(problem, self.observed, segments)
        return search_signs(problem, self.cone(problem), patterns, start, seed=self.seed)
