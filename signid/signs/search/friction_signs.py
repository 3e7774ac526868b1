"""Choices of signs that friction suggests: torque along the motion, or offset taken for it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...types import Array
from ..rows.observations import Observed
from ..rows.segments import Segment
from .problem import Problem


def friction_patterns(problem: Problem, observed: Observed, segments: Sequence[Segment]) -> list[Array]:
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
