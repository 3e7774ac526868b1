"""Torque sign: a channel is written down negated."""

from ..types import Array, View
from .base import RecordingLaw


class TorqueSign(RecordingLaw):
    """The record is minus the true torque."""

    name, equation = "torque_sign", "-torque"
    source = "Isermann, Fault-Diagnosis Systems, Springer, 2006 (faults of sensors)"
    typical = "a reversed axis or motor phase: there, or not"
    common, approximate = 0.3, True
    twins = ("torque_gain",)

    def recorded_torque(self, x: View) -> Array:
        """Negated."""
        return -x.torque

    acted_torque = recorded_torque


PLUGIN = TorqueSign()
