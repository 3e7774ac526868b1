"""Friction of a gear by the torques of its motor and of the bodies, and by speed."""

import numpy as np

from ..types import Array, Coefficient, Shape, View
from .base import TorqueLaw

AT_REST = "exp(-(abs(v / velocity) ** exponent))"
SQUARE_TERM = "where(load * v > 0, quadratic_external, quadratic_motor) * load**2"
LEVEL = f"level + coefficient_at_rest * (1 + external_at_rest) * abs(load) + {SQUARE_TERM}"


class GearFriction(TorqueLaw):
    """Dry friction D sign(v); its equation is that of slow motion, where the torques of motor and bodies are the load.

    In a loop D = coefficient |motor + external load| + exp(-|v / velocity|^exponent) [level + coefficient_at_rest
    |motor + external_at_rest load| + square], a square of the weaker of two torques that act against each other.
    """

    name, equation = "gear_friction", f"(coefficient * (1 + external) * abs(load) + {AT_REST} * ({LEVEL})) * sign(v)"
    source = "Duclusaud, Passault, Padois, Ly, Extended friction models for servo actuators, arXiv 2410.08650, M2 to M6"
    typical = "coefficient up to 0.5, exponent 1 to 3 (servo actuators)"
    parameters = {"exponent": Shape("1", ()), "velocity": Shape("rad/s", ()), "level": Coefficient("N.m", True)}
    parameters |= {"coefficient": Coefficient("1", True), "external": Shape("1", (), positive=False)}
    parameters |= {"coefficient_at_rest": Coefficient("1", True), "external_at_rest": Shape("1", (), positive=False)}
    parameters |= {"quadratic_motor": Coefficient("1/N.m", True), "quadratic_external": Coefficient("1/N.m", True)}
    example = {"exponent": 1.4, "velocity": 0.3, "level": 0.1, "coefficient": 0.2, "external": 0.4}
    example |= {"coefficient_at_rest": 0.1, "external_at_rest": 0.5}
    example |= {"quadratic_motor": 0.01, "quadratic_external": 0.02}
    dissipative, reverses = True, True

    def columns(self, x: View, **shape: float) -> list[Array]:
        load, drives = np.abs(x.load), x.load * x.direction > 0
        rest = x.direction * np.exp(-(np.abs(x.v / shape["velocity"]) ** shape["exponent"]))
        pressed = [(1 + shape["external"]) * load * x.direction, (1 + shape["external_at_rest"]) * load * rest]
        return [rest, *pressed, ~drives * load**2 * rest, drives * load**2 * rest]


PLUGIN = GearFriction()
