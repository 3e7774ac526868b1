"""Physical laws. To add one: write a file here, add its name below."""

from ..registry import Registry
from .base import Effect

EFFECT_NAMES = ("viscous_friction", "coulomb_friction", "torque_offset", "armature")  # identified by default
EFFECTS: Registry[Effect] = Registry(
    "effects",
    __name__,
    """viscous_friction coulomb_friction torque_offset armature asymmetric_friction quadratic_friction""",
)
