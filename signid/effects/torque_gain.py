"""Torque gain: an error of the torque constant."""

from ..types import Array, Coefficient, View
from .base import Numbers, RecordingLaw

GAIN_LIMITS = (0.3, 3.3)  # accepted ratio of recorded to true torque; beyond it, the quantity or unit is wrong


class TorqueGain(RecordingLaw):
    """Recorded torque = true torque times a constant factor."""

    name, equation = "torque_gain", "(1 + error) * torque"
    source = (
        "Gautier, Briot, Global identification of the joint drive gains using a known payload mass, IEEE/RSJ IROS 2011"
    )
    headline = "torque gain error of {joint}: {error}"
    typical = "-0.2 to -0.05 or 0.05 to 0.2"
    parameters = {"error": Coefficient("1")}
    example = {"error": 0.1}
    twins = ("torque_sign", "link_inertia")

    def possible_value(self, parameters: Numbers) -> bool:
        """Whether the factor is neither near zero, where torque vanishes, nor so large that the unit is wrong."""
        return GAIN_LIMITS[0] <= 1 + parameters["error"] <= GAIN_LIMITS[1]

    def recorded_torque(self, x: View, error: float) -> Array:
        return (1 + error) * x.torque

    def acted_torque(self, x: View, error: float) -> Array:
        return x.torque / (1 + error)


PLUGIN = TorqueGain()
