"""Inertial parameters that laws of bodies add."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin


def point_inertia(mass: float, moment: Sequence[float]) -> list[float]:
    """Inertia Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the origin of a point of that mass and first moment [kg.m2].

    Args:
        mass: [kg].
        moment: (3,) first moment [kg.m].
    """
    c = np.array(moment)
    full = (c @ c * np.eye(3) - np.outer(c, c)) / mass if mass else np.zeros((3, 3))
    return [float(full[i, j]) for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]


def add_body(model: Any, body: int, added: Sequence[float]) -> None:
    """Add the first of the ten inertial parameters to a body of a pin.Model, about its joint's frame.

    Args:
        model: a pin.Model, changed.
        body: the joint that moves the body.
        added: mass [kg], first moment [kg.m], and so on in Pinocchio's order.
    """
    whole = model.inertias[body].toDynamicParameters()
    whole[: len(added)] += added
    model.inertias[body] = pin.Inertia.FromDynamicParameters(whole)
