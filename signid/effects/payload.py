"""Payload: a body attached to the last link."""

from typing import Any

from ..types import Array, Coefficient, View
from .base import BodyLaw, Numbers
from .bodies import add_body, point_inertia

MOMENT, INERTIA = ([f"{name}_{k}" for k in ks.split()] for name, ks in
                   (("first_moment", "x y z"), ("inertia", "xx xy yy xz yz zz")))  # fmt: skip
VALUES = (1.0, 0.05, 0.02, 0.08, 0.0088, -0.001, 0.0109, -0.004, -0.0016, 0.0049)


class PayloadLaw(BodyLaw):
    """Ten inertial parameters about the last joint's frame; without inertia terms, a point mass at its centre."""

    name, equation = "payload", f"body @ array([mass, {', '.join([*MOMENT, *INERTIA])}])"
    source = "Khalil, Gautier, Lemoine, Identification of the payload inertial parameters, IEEE ICRA 2007"
    typical = "up to the rated payload: 3 kg (Panda), 5 kg (UR5), 10 kg (UR10E)"
    parameters = {"mass": Coefficient("kg", positive=True), **dict.fromkeys(MOMENT, Coefficient("kg.m")),
                  **dict.fromkeys(INERTIA, Coefficient("kg.m2", same=True))}  # fmt: skip
    optional, example = tuple(INERTIA), dict(zip(parameters, VALUES, strict=True))
    scope = "tip"
    twins = ("link_inertia", "counterbalance", "encoder_offset")

    def columns(self, x: View) -> list[Array]:
        """Ten regressor columns of the link, (N, n) each [N.m or N per kg, kg.m, kg.m2]."""
        return list(x.whole.body_columns(x.joints[0]).transpose(2, 0, 1))

    def filled(self, parameters: Numbers) -> dict[str, float]:
        """All ten parameters; omitted inertia terms are those of a point mass."""
        point = point_inertia(parameters["mass"], [parameters[key] for key in MOMENT])
        return {**dict(zip(INERTIA, point, strict=True)), **parameters}

    def reshape(self, model: Any, row: int, body: int, **parameters: float) -> None:
        """Add the ten parameters to those of the link."""
        add_body(model, body, self.coefficients(parameters))


PLUGIN = PayloadLaw()
