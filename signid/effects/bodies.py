"""Inertial parameters of bodies: point masses, sums, conversion to Pinocchio."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ..types import Array

FAR = 1e6  # [m] lever that stands for a first moment without mass: its mass is negligible


def point_inertia(mass: float, moment: Sequence[float]) -> list[float]:
    """Inertia Ixx, Ixy, Iyy, Ixz, Iyz, Izz of a point mass about the origin [kg.m2].

    Args:
        mass: mass [kg].
        moment: (3,) first moment [kg.m].
    """
    c = np.array(moment)
    full = (c @ c * np.eye(3) - np.outer(c, c)) / mass if mass else np.zeros((3, 3))
    return [float(full[i, j]) for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]


def add_body(model: Any, body: int, added: Sequence[float]) -> None:
    """Add inertial parameters to a body of a pin.Model, about the frame of its joint.

    Args:
        model: pin.Model, modified in place.
        body: index of the joint that moves the body.
        added: mass [kg], first moment [kg.m], ...; up to ten parameters in Pinocchio's order.
    """
    whole = model.inertias[body].toDynamicParameters()
    whole[: len(added)] += added
    model.inertias[body] = body_inertia(whole)


def body_inertia(numbers: Array) -> pin.Inertia:
    """pin.Inertia of ten inertial parameters; supports zero mass, where Pinocchio cannot compute the lever.

    Args:
        numbers: (10,) in Pinocchio's order [kg, kg.m, kg.m2].
    """
    mass, moment = float(numbers[0]), numbers[1:4]
    if mass == 0:
        mass = float(np.linalg.norm(moment)) / FAR
    if mass == 0:
        xx, xy, yy, xz, yz, zz = numbers[4:]
        return pin.Inertia(0.0, np.zeros(3), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    return pin.Inertia.FromDynamicParameters(np.append(mass, numbers[1:]))
