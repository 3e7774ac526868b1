"""Encoder offset: the zero of the encoder differs from that of the description."""

from ..types import Array, Coefficient, View
from .base import RecordingLaw


class EncoderOffset(RecordingLaw):
    """Recorded position = true position + constant; visible in the torques of all joints."""

    name, equation = "encoder_offset", "q + offset"
    source = (
        "Hollerbach, Khalil, Gautier, Model identification, Springer Handbook of Robotics, 2nd edition, 2016, chapter 6"
    )
    typical = "1 to 20 mrad"
    parameters = {"offset": Coefficient("rad")}
    example = {"offset": 0.02}
    scope = "link"
    twins = ("link_inertia", "base_tilt", "counterbalance", "payload")

    def recorded_q(self, x: View, offset: float) -> Array:
        return x.q + offset


PLUGIN = EncoderOffset()
