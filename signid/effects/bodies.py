"""Inertial parameters of bodies: point masses, sums, conversion to Pinocchio."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ..types import Array, Coefficient, View
from .base import BodyLaw

MASSLESS_LEVER = 1e6  # [m] lever that stands for a first moment without mass: its mass is negligible
MOMENT = [f"first_moment_{k}" for k in "xyz"]
INERTIA = [f"inertia_{k}" for k in "xx xy yy xz yz zz".split()]


class AddedBody(BodyLaw):
    """Ten inertial parameters that are added to a link about the frame of its joint."""

    equation = f"body @ array([mass, {', '.join([*MOMENT, *INERTIA])}])"
    parameters = dict.fromkeys(MOMENT, Coefficient("kg.m")) | dict.fromkeys(INERTIA, Coefficient("kg.m2", same=True))
    optional = tuple(INERTIA)

    def columns(self, x: View) -> list[Array]:
        """Ten regressor columns of the link, (N, n) each [N.m or N per kg, kg.m, kg.m2]."""
        return list(x.whole.body_columns(x.joints[0]).transpose(2, 0, 1))

    def reshape(self, model: Any, row: int, body: int, **parameters: float) -> None:
        add_body(model, body, self.coefficients(parameters))


def point_inertia(mass: float, moment: Sequence[float]) -> list[float]:
    """Inertia Ixx, Ixy, Iyy, Ixz, Iyz, Izz [kg.m2] of a point mass [kg] about the origin, at a first moment [kg.m]."""
    c = np.array(moment)
    full = (c @ c * np.eye(3) - np.outer(c, c)) / mass if mass else np.zeros((3, 3))
    return [float(full[i, j]) for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]


def add_body(model: Any, body: int, added: Sequence[float]) -> None:
    """Add up to ten inertial parameters, in Pinocchio's order, to the body that a joint of a pin.Model moves."""
    whole = model.inertias[body].toDynamicParameters()
    whole[: len(added)] += added
    model.inertias[body] = body_inertia(whole)


def body_inertia(numbers: Array) -> pin.Inertia:
    """pin.Inertia of ten parameters; supports zero mass, where Pinocchio cannot compute the lever.

    numbers: (10,) in Pinocchio's order [kg, kg.m, kg.m2].
    """
    mass, moment = float(numbers[0]), numbers[1:4]
    if mass == 0:
        mass = float(np.linalg.norm(moment)) / MASSLESS_LEVER
    if mass == 0:
        xx, xy, yy, xz, yz, zz = numbers[4:]
        return pin.Inertia(0.0, np.zeros(3), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    return pin.Inertia.FromDynamicParameters(np.append(mass, numbers[1:]))
