"""Friction of a gear by the torques of its motor and of the bodies, and by speed."""

import numpy as np

from ..types import Array, Shape, View
from .base import TorqueLaw

AT_REST = "exp(-(abs(v / velocity) ** exponent))"
QUADRATIC = "where(load * v > 0, quadratic_external, quadratic_motor) * load**2"
LEVEL = f"level + coefficient_at_rest * (1 + external_at_rest) * abs(load) + {QUADRATIC}"


class GearFriction(TorqueLaw):
    """Slow motion of D sign(v), where the motor's torque and the load are equal; the closed loop of a drive has both.

    D = coefficient |motor + external load| + exp(-|v / velocity|^exponent) [level + coefficient_at_rest
    |motor + external_at_rest load| + quadratic], quadratic while the two act against each other: quadratic_external
    load^2 if the motor is stronger, else quadratic_motor motor^2.
    """

    name, equation = "gear_friction", f"(coefficient * (1 + external) * abs(load) + {AT_REST} * ({LEVEL})) * sign(v)"
    source = "Duclusaud, Passault, Padois, Ly, Extended friction models for servo actuators, arXiv 2410.08650, M2 to M6"
    headline = "friction of the gear of {joint} by load: {coefficient}"
    typical = "coefficient up to 0.5, exponent 1 to 3 (servo actuators)"
    units = {"exponent": "1", "velocity": "rad/s", "level": "N.m", "coefficient": "1", "external": "1"}
    units |= {"coefficient_at_rest": "1", "external_at_rest": "1", "quadratic_motor": "1/N.m"}
    parameters = {key: Shape(unit, ()) for key, unit in {**units, "quadratic_external": "1/N.m"}.items()}
    reverses = True

    def columns(self, x: View, **gear: float) -> list[Array]:
        load = np.abs(x.load)
        square = np.where(x.load * x.direction > 0, gear["quadratic_external"], gear["quadratic_motor"]) * load**2
        rest = gear["level"] + gear["coefficient_at_rest"] * (1 + gear["external_at_rest"]) * load + square
        rest = rest * np.exp(-(np.abs(x.v / gear["velocity"]) ** gear["exponent"]))
        return [(gear["coefficient"] * (1 + gear["external"]) * load + rest) * x.direction]


PLUGIN = GearFriction()
