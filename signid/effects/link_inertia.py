"""Link inertia: mass and first moment of one link differ from the drawing."""

from typing import Any

from ..types import Array, Coefficient, View
from .base import BodyLaw, add_body


class LinkInertia(BodyLaw):
    """A correction about the frame of the joint that moves the link; masses alone seldom show."""

    name, equation = "link_inertia", "body[:, :4] @ array([mass, first_moment_x, first_moment_y, first_moment_z])"
    source = "Atkeson, An, Hollerbach, Inertial parameters of loads and links, Int. J. Robotics Research 5(3), 1986"
    typical = "5 to 20 % of the link: cables, covers and motors that the drawing lacks"
    parameters = {
        "mass": Coefficient("kg"),
        "first_moment_x": Coefficient("kg.m"),
        "first_moment_y": Coefficient("kg.m"),
        "first_moment_z": Coefficient("kg.m"),
    }
    example = {"mass": 0.5, "first_moment_x": 0.1, "first_moment_y": 0.02, "first_moment_z": 0.03}
    scope = "link"
    twins = ("payload", "armature", "counterbalance", "encoder_offset", "torque_gain")

    def columns(self, x: View) -> list[Array]:
        """Of the regressor of the link: mass and first moment, (N, n) each [N.m or N per kg, and per kg.m]."""
        link = x.whole.body_columns(x.joints[0])
        return [link[..., k] for k in range(4)]

    def reshape(self, model: Any, row: int, body: int, **parameters: float) -> None:
        """Add mass and first moment to the link; the inertia about the frame stays."""
        add_body(model, body, [parameters[key] for key in self.parameters])


PLUGIN = LinkInertia()
