"""Torque gain: a torque constant that is not what the sheet says."""

from ..types import Array, Coefficient, View
from .base import Numbers, RecordingLaw

FACTOR = (0.3, 3.3)  # of recorded torque over true torque: less or more is no torque constant, but another quantity


class TorqueGain(RecordingLaw):
    """The record is the true torque by a constant factor."""

    name, equation = "torque_gain", "(1 + error) * torque"
    source = (
        "Gautier, Briot, Global identification of the joint drive gains using a known payload mass, IEEE/RSJ IROS 2011"
    )
    typical = "0.05 to 0.2 either way"
    parameters = {"error": Coefficient("1")}
    example = {"error": 0.1}
    twins = ("torque_sign", "link_inertia")

    def possible_value(self, parameters: Numbers) -> bool:
        """The factor keeps away from zero, where the law deletes the torque, and from units that are wrong."""
        return FACTOR[0] <= 1 + parameters["error"] <= FACTOR[1]

    def recorded_torque(self, x: View, error: float) -> Array:
        """Enlarged."""
        return (1 + error) * x.torque

    def acted_torque(self, x: View, error: float) -> Array:
        """As it was."""
        return x.torque / (1 + error)


PLUGIN = TorqueGain()
