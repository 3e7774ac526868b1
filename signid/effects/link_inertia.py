"""Link inertia: error in the stated mass, first moment and inertia of one link."""

from ..types import Coefficient
from .base import Numbers
from .bodies import INERTIA, MOMENT, AddedBody


class LinkInertia(AddedBody):
    """Correction about the frame of the joint that moves the link; the mass alone is seldom identifiable."""

    name = "link_inertia"
    source = "Atkeson, An, Hollerbach, Inertial parameters of loads and links, Int. J. Robotics Research 5(3), 1986"
    typical = "5 to 20 % of the link: unmodelled cables, covers and motors"
    parameters = {"mass": Coefficient("kg"), **AddedBody.parameters}
    example = {**dict(zip(["mass", *MOMENT], (0.5, 0.1, 0.02, 0.03), strict=True)), **dict.fromkeys(INERTIA, 0.0)}
    scope = "link"
    twins = ("payload", "armature", "counterbalance", "encoder_offset", "torque_gain")

    def filled(self, parameters: Numbers) -> dict[str, float]:
        return {**dict.fromkeys(INERTIA, 0.0), **parameters}


PLUGIN = LinkInertia()
