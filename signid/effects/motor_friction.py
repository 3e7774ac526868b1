"""Friction of a position drive that grows with the torque of its motor."""

import numpy as np

from ..types import Array, Shape, View
from .base import TorqueLaw

TORQUE = "load + inertia * a + viscous * v + coulomb * sign(v) + offset"  # of the motor without this friction


class MotorFriction(TorqueLaw):
    """Number `load_friction` of a drive where torque is recorded: k abs(tau_m) sign(v), solved for the torque tau_m.

    The law `load_friction` is proportional to the torque of the link instead. The other parameters are those of the
    same drive, since its motor moves its rotor and overcomes its own friction as well.
    """

    name = "motor_friction"
    equation = f"coefficient * abs({TORQUE}) * sign(v) / maximum(1 - coefficient * sign(v) * sign({TORQUE}), 0.05)"
    source = "Duclusaud, Passault, Padois, Ly, Extended friction models for servo actuators, arXiv 2410.08650"
    typical = "0.3 to 0.5 (plastic gears)"
    parameters = {
        "coefficient": Shape("1", ()),
        "inertia": Shape("kg.m2", ()),
        "viscous": Shape("N.m.s/rad", ()),
        "coulomb": Shape("N.m", ()),
        "offset": Shape("N.m", ()),
    }
    reverses = True

    def columns(self, x: View, **drive: float) -> list[Array]:
        k, dry = drive["coefficient"], drive["coulomb"] * x.direction
        torque = x.load + drive["inertia"] * x.a + drive["viscous"] * x.v + dry + drive["offset"]
        return [k * np.abs(torque) * x.direction / np.maximum(1 - k * x.direction * np.sign(torque), 0.05)]


PLUGIN = MotorFriction()
