"""Base tilt: the base is not level."""

from typing import Any

import numpy as np
import pinocchio as pin

from ..types import Array, Coefficient, View
from .base import BodyLaw


class BaseTilt(BodyLaw):
    """Rotation of the base about its x and y axes, which changes the direction of gravity; linear for small angles."""

    name, equation = "base_tilt", "gravity_torque(cross(gravity, array([x, y, 0])))"
    source = "Featherstone, Rigid Body Dynamics Algorithms, 2008, section 5.3 (gravity as acceleration of the base)"
    headline = "a base tilt of {x} about x and {y} about y"
    typical = "0.5 to 3 degrees (0.01 to 0.05 rad)"
    parameters = {"x": Coefficient("rad", same=True), "y": Coefficient("rad", same=True)}
    example = {"x": 0.03, "y": -0.02}
    scope = "robot"
    twins = ("counterbalance", "encoder_offset", "payload", "link_inertia")

    def columns(self, x: View) -> list[Array]:
        """Derivative of the gravity torque with respect to each angle, (N, n) [N.m or N per rad]."""
        gravity = x.whole.robot.model.gravity.linear
        return [x.whole.gravity_torque(np.cross(gravity, axis)) for axis in np.eye(3)[:2]]

    def reshape(self, model: Any, row: int, body: int, x: float, y: float) -> None:
        """Rotate gravity by the inverse of the base rotation."""
        model.gravity.linear = pin.exp3(np.array([x, y, 0.0])).T @ model.gravity.linear


PLUGIN = BaseTilt()
