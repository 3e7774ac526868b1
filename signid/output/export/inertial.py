"""Conversion of ten inertial parameters to mass, centre, principal axes and moments, as in MJCF."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Array
from .shapes import quaternion

LEAST = 1e-12  # minimum mass [kg] and moment [kg.m2] of a moving body; MuJoCo rejects zero
_ROUNDING = 1e-9  # tolerance, relative to the largest principal moment


class Principal(NamedTuple):
    """A body about its centre of mass."""

    mass: float  # [kg]
    centre: Array  # (3,) [m]
    moments: Array  # (3,) [kg.m2]
    quaternion: Array  # (4,) w x y z [1]


def principal(parameters: Array) -> Principal | None:
    """Return a body in its principal axes; None if it is not physically consistent.

    A massless body gets the minimum mass.

    Args:
        parameters: (10,) in Pinocchio's order [kg, kg.m, kg.m2].
    """
    mass, first = float(parameters[0]), parameters[1:4]
    if not np.isfinite(parameters).all() or mass < 0 or (mass == 0 and np.any(first)):
        return None
    xx, xy, yy, xz, yz, zz = parameters[4:]
    centre = first / mass if mass else np.zeros(3)
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    inertia = inertia - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    moments, axes = np.linalg.eigh(inertia)
    small = _ROUNDING * abs(moments[2])
    if moments[0] < -small or moments[0] + moments[1] < moments[2] - small:
        return None
    moments = np.maximum(moments, LEAST)
    moments[:2] += max(0.0, moments[2] * (1 + 1e-15) - moments[0] - moments[1])  # corrects rounding errors
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return Principal(max(mass, LEAST), centre, moments, quaternion(axes))
