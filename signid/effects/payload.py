"""Payload: a body attached to the last link."""

from ..types import Coefficient
from .base import Numbers
from .bodies import INERTIA, MOMENT, AddedBody, point_inertia

EXAMPLE_VALUES = (1.0, 0.05, 0.02, 0.08, 0.0088, -0.001, 0.0109, -0.004, -0.0016, 0.0049)


class PayloadLaw(AddedBody):
    """Ten inertial parameters about the last joint's frame; without inertia terms, a point mass at its centre."""

    name = "payload"
    source = "Khalil, Gautier, Lemoine, Identification of the payload inertial parameters, IEEE ICRA 2007"
    headline = "a payload of {mass}"
    typical = "up to the rated payload: 3 kg (Panda), 5 kg (UR5), 10 kg (UR10E)"
    parameters = {"mass": Coefficient("kg", positive=True), **AddedBody.parameters}
    example = dict(zip(parameters, EXAMPLE_VALUES, strict=True))
    scope = "tip"
    twins = ("link_inertia", "counterbalance", "encoder_offset")

    def filled(self, parameters: Numbers) -> dict[str, float]:
        """All ten parameters; omitted inertia terms are those of a point mass."""
        point = point_inertia(parameters["mass"], [parameters[key] for key in MOMENT])
        return {**dict(zip(INERTIA, point, strict=True)), **parameters}


PLUGIN = PayloadLaw()
