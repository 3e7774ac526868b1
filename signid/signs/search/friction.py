"""Friction in the search: weak prior rows that break the symmetry s -> -s, and sign patterns to try."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...types import Array
from ..rows.observations import Observed
from ..rows.segments import Segment
from ..thresholds import FRICTION_PRIOR, PRIOR_STRENGTH
from .problem import KnownRows, SignProblem, signed_rows


def known_rows(observed: Observed, weights: Array) -> KnownRows:
    """Rows with a known right-hand side: joints whose torque has its sign, and the friction prior.

    Args:
        observed: observations.
        weights: (n,) [1/N.m or 1/N] weight of each joint's torque.
    """
    parts = [signed_rows(observed, weights), friction_prior(observed, weights)]
    return KnownRows(np.concatenate([p.matrix for p in parts]), np.concatenate([p.target for p in parts]))


def friction_prior(observed: Observed, weights: Array, strength: float = PRIOR_STRENGTH) -> KnownRows:
    """Prior rows for offset, Coulomb and viscous friction of joints whose torque has no sign.

    A row exists for each base parameter that is one of these coefficients alone. Rows do not grow with the weights of
    the torque, so the prior loses influence as samples gain weight.

    Args:
        observed: observations; their rms torque and velocity are the units of the prior.
        weights: (n,) [1/N.m or 1/N] weight of each joint's torque; a joint of weight 0 has no prior.
        strength: weight of the rows; with 1 they count as measurements.
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

    The search tries the signs of a joint as this pattern, as its opposite, and multiplied by it: Coulomb friction
    F sign(v) fits as well as a constant offset F whose sign never changes.

    Args:
        problem: boolean least squares of S segments, with or without a known one.
        observed: observations.
        segments: segments whose sign is unknown.
    """
    velocity = np.array([np.sign(observed.v[s.start : s.stop, s.joint].mean()) or 1.0 for s in segments])
    wide = np.append(velocity, np.zeros(problem.count - len(segments)))
    return [np.where(problem.joints == joint, wide, 0.0) for joint in np.unique([s.joint for s in segments])]
