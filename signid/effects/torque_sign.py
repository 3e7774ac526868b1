"""Torque sign: the torque of a channel is recorded negated."""

from ..types import Array, View
from .base import RecordingLaw


class TorqueSign(RecordingLaw):
    """Recorded torque = - true torque."""

    name, equation = "torque_sign", "-torque"
    source = "Isermann, Fault-Diagnosis Systems, Springer, 2006 (faults of sensors)"
    headline = "a wrong sign of the torque of {joint}"
    typical = "a reversed axis or motor phase: present or absent"
    common, approximate = 0.3, True
    twins = ("torque_gain",)

    def recorded_torque(self, x: View) -> Array:
        return -x.torque

    acted_torque = recorded_torque


PLUGIN = TorqueSign()
