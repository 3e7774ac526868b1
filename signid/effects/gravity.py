"""Gravity: it acts along another direction than the simulation has it, or the recorded torque carries no weight."""

from typing import Any

import numpy as np

from ..types import Array, Coefficient, View
from .base import BodyLaw, Numbers


class Gravity(BodyLaw):
    """Gravity in the frame of the root link instead of the simulation's; zeros: torque without weight."""

    name, equation = "gravity", "gravity_torque(array([x, y, z]) - gravity)"
    source = "Featherstone, Rigid Body Dynamics Algorithms, 2008, section 5.3 (gravity as acceleration of the base)"
    headline = "another gravity, ({x}, {y}, {z})"
    typical = "9.81 m/s2 along another axis: a robot on a wall or ceiling; 0: weight that the driver compensates"
    parameters = {key: Coefficient("m/s2", same=True) for key in "xyz"}
    example = {"x": 0.0, "y": -9.81, "z": 0.0}
    scope = "robot"
    twins = ("base_tilt",)

    def columns(self, x: View) -> list[Array]:
        """Torque of unit gravity along each axis, (N, n) [N.m or N per m/s2], and less that of the simulation."""
        whole = x.whole
        axes = [whole.gravity_torque(axis) for axis in np.eye(3)]
        return [*axes, -whole.gravity_torque(whole.robot.model.gravity.linear)]

    def coefficients(self, parameters: Numbers) -> list[float]:
        """The vector, and 1 for the removal of the simulation's gravity."""
        return [*super().coefficients(parameters), 1.0]

    def reshape(self, model: Any, row: int, body: int, x: float, y: float, z: float) -> None:
        model.gravity.linear = np.array([x, y, z])


PLUGIN = Gravity()
