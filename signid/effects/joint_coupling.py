"""Joint coupling: in a geared wrist, one joint also moves the motor of the other."""

import numpy as np

from ..types import Array, Coefficient, View
from .base import TorqueLaw

SIGN_VELOCITY = 0.01  # [rad/s or m/s] velocity scale of the tanh that replaces the sign of the sum


class JointCoupling(TorqueLaw):
    """Acceleration and velocity act on the other joint; dry friction of the summed velocity acts on both."""

    name = "joint_coupling"
    equation = "inertia * a[::-1] + viscous * v[::-1] + coulomb * tanh(sum(v) / 0.01)"
    source = "figaroh, add_coupling_TX40: geared wrist of the Staubli TX40"
    typical = "inertia 0.01 kg.m2, viscous 0.6 N.m.s/rad, coulomb 2 N.m (wrist of the TX40)"
    parameters = {
        "inertia": Coefficient("kg.m2"),
        "viscous": Coefficient("N.m.s/rad"),
        "coulomb": Coefficient("N.m", positive=True),
    }
    example = {"inertia": 0.01, "viscous": 0.6, "coulomb": 1.0}
    scope = "pair"

    def columns(self, x: View) -> list[Array]:
        both = np.tanh(x.v.sum(-1, keepdims=True) / SIGN_VELOCITY)
        return [x.a[..., ::-1], x.v[..., ::-1], np.broadcast_to(both, x.v.shape)]


PLUGIN = JointCoupling()
