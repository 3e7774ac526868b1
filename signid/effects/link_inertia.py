"""Link inertia: error in the stated mass, first moment and inertia of one link."""

from typing import Any

from ..types import Array, Coefficient, View
from .base import BodyLaw, Numbers
from .bodies import add_body
from .payload import INERTIA, MOMENT


class LinkInertia(BodyLaw):
    """Correction about the frame of the joint that moves the link; the mass alone is seldom identifiable."""

    name, equation = "link_inertia", f"body @ array([mass, {', '.join([*MOMENT, *INERTIA])}])"
    source = "Atkeson, An, Hollerbach, Inertial parameters of loads and links, Int. J. Robotics Research 5(3), 1986"
    typical = "5 to 20 % of the link: unmodelled cables, covers and motors"
    parameters = {"mass": Coefficient("kg"), **dict.fromkeys(MOMENT, Coefficient("kg.m")),
                  **dict.fromkeys(INERTIA, Coefficient("kg.m2", same=True))}  # fmt: skip
    optional = tuple(INERTIA)
    example = {**dict(zip(["mass", *MOMENT], (0.5, 0.1, 0.02, 0.03), strict=True)), **dict.fromkeys(INERTIA, 0.0)}
    scope = "link"
    twins = ("payload", "armature", "counterbalance", "encoder_offset", "torque_gain")

    def columns(self, x: View) -> list[Array]:
        """Ten regressor columns of the link, (N, n) each [N.m or N per kg, kg.m, kg.m2]."""
        return list(x.whole.body_columns(x.joints[0]).transpose(2, 0, 1))

    def filled(self, parameters: Numbers) -> dict[str, float]:
        """All ten parameters; omitted inertia terms are zero."""
        return {**dict.fromkeys(INERTIA, 0.0), **parameters}

    def reshape(self, model: Any, row: int, body: int, **parameters: float) -> None:
        """Add the parameters to those of the link."""
        add_body(model, body, self.coefficients(parameters))


PLUGIN = LinkInertia()
