"""Choices of signs that friction suggests: torque along the motion, or offset taken for it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..types import Array
from .observed import Observed
from .problem import Segment


def friction_moves(observed: Observed, segments: Sequence[Segment]) -> list[Array]:
    """Per joint the signs (S,) of the mean velocity in its segments, 0 elsewhere [1].

    A search tries each joint's signs as these, against these, and multiplied by these: |F sign(v)| is explained as well
    by an offset F whose sign never changes.
    """
    velocity = np.array([np.sign(observed.v[s.start : s.stop, s.joint].mean()) or 1.0 for s in segments])
    joints = np.array([s.joint for s in segments])
    return [np.where(joints == joint, velocity, 0.0) for joint in np.unique(joints)]
