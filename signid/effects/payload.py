"""Payload: a body that the last link carries."""

from typing import Any

from ..types import Array, Coefficient, View
from .base import BodyLaw, add_body


class Payload(BodyLaw):
    """Its mass and first moment about the frame of the last joint."""

    name, equation = "payload", "body @ array([mass, first_moment_x, first_moment_y, first_moment_z])"
    source = (
        "Khalil, Gautier, Lemoine, Identification of the payload inertial parameters, IEEE ICRA 2007, pages 4943-4948"
    )
    typical = "up to the rated payload: 3 kg (Panda), 5 kg (UR5), 10 kg (UR10E)"
    parameters = {
        "mass": Coefficient("kg", positive=True),
        "first_moment_x": Coefficient("kg.m"),
        "first_moment_y": Coefficient("kg.m"),
        "first_moment_z": Coefficient("kg.m"),
    }
    example = {"mass": 1.0, "first_moment_x": 0.05, "first_moment_y": 0.02, "first_moment_z": 0.08}
    scope = "tip"
    twins = ("link_inertia", "counterbalance", "encoder_offset")

    def columns(self, x: View) -> list[Array]:
        """Of the regressor of the link: mass and first moment, (N, n) each [N.m or N per kg, and per kg.m]."""
        link = x.whole.body_columns(x.joints[0])
        return [link[..., k] for k in range(4)]

    def reshape(self, model: Any, row: int, body: int, **parameters: float) -> None:
        """Add mass and first moment to the link; the inertia about the frame stays."""
        add_body(model, body, [parameters[key] for key in self.parameters])


PLUGIN = Payload()
