"""What is believed of friction beforehand: weak rows that tell a model from its mirror image."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...regression.rows import Task
from ...types import Array
from ..rows.observations import Observed, law_coefficients
from ..rows.segments import Segment
from .problem import KnownRows, SignProblem

FRICTION_PRIOR = {  # in rms torques of the joint, at its rms velocity: expected, standard deviation
    "torque_offset": (0.0, 0.15),
    "coulomb_friction": (0.1, 0.1),
    "viscous_friction": (0.1, 0.1),
}


def friction_prior(task: Task, observed: Observed, weights: Array, strength: float = 0.3) -> KnownRows:
    """Rows for offset, Coulomb and viscous friction of joints whose torque has no sign.

    A row is there where a base parameter is one of these coefficients alone. Rows do not grow with the weights: the
    more samples count, the less does belief.

    Args:
        task: laws and base map.
        observed: gives the rms of torque and velocity.
        weights: (n,) [1/N.m or 1/N] of each joint's torque; where it is 0 nothing is believed.
        strength: of the rows; at 1 they count as measurements.
    """
    torque, speed = observed.rms, np.sqrt(np.mean(observed.v**2, axis=0))
    matrix, target = [np.zeros((0, observed.count))], []
    for k, (name, joint) in law_coefficients(task).items():
        used = joint in observed.hidden and weights[joint] > 0 and torque[joint] * speed[joint] > 0
        if name in FRICTION_PRIOR and used:
            expected, deviation = FRICTION_PRIOR[name]
            unit = torque[joint] / (speed[joint] if name == "viscous_friction" else 1.0)
            matrix.append(np.eye(1, observed.count, k) * strength / (deviation * unit))
            target.append(strength * expected / deviation)
    return KnownRows(np.concatenate(matrix), np.array(target))


def friction_patterns(problem: SignProblem, observed: Observed, segments: Sequence[Segment]) -> list[Array]:
    """Per joint the signs (S,) of the mean velocity in its segments, 0 elsewhere and for a known segment [1].

    A search tries each joint's signs as these, against these, and multiplied by these: |F sign(v)| is explained as well
    by an offset F whose sign never changes.

    Args:
        problem: of S segments, with a known one or without.
        observed: the rows.
        segments: those whose sign is not known.
    """
    velocity = np.array([np.sign(observed.v[s.start : s.stop, s.joint].mean()) or 1.0 for s in segments])
    wide = np.append(velocity, np.zeros(problem.count - len(segments)))
    return [np.where(problem.joints == joint, wide, 0.0) for joint in np.unique([s.joint for s in segments])]
