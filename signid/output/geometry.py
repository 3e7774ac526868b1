"""Numbers and poses of URDF elements."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..robot.document import children
from ..types import Array


def vector(text: str | None, count: int, default: float = 0.0) -> Array:
    """Parse the numbers of an attribute, (count,) [unit of the attribute]; the default if missing or invalid."""
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.empty(0)
    return values if len(values) == count and np.isfinite(values).all() else np.full(count, default)


def origin(element: Any) -> Any:
    """Pose (pin.SE3) of an element relative to its parent."""
    import pinocchio as pin

    stated = next(iter(children(element, "origin")), None)
    xyz, rpy = (vector(None if stated is None else stated.get(key), 3) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
