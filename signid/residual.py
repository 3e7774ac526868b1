"""What columns leave of torque."""

from __future__ import annotations

import numpy as np

from .types import Array

RANK = 1e-9  # of the largest singular value, columns scaled


def leave(target: Array, columns: Array) -> Array:
    """The part of a target that no combination of columns makes, (N,) or (N, m) as the target.

    Args:
        target: (N,) or (N, m) [N.m or N].
        columns: (N, k) [any unit]; columns of zeros do not count.
    """
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0] / size[size > 0]
    return np.asarray(target - scaled @ np.linalg.lstsq(scaled, target, rcond=RANK)[0])
