"""Physical laws. To add one: write a file here, add its name below."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..registry import Registry

if TYPE_CHECKING:
    from .base import Effect

EFFECT_NAMES = ("viscous_friction", "coulomb_friction", "torque_offset", "armature")  # identified by default
EFFECTS: Registry[Effect] = Registry(
    "effects",
    __name__,
    """viscous_friction coulomb_friction torque_offset armature asymmetric_friction quadratic_friction""",
)
