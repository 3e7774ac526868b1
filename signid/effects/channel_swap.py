"""Channel swap: the torques of two joints are exchanged."""

from ..types import Array, View
from .base import RecordingLaw


class ChannelSwap(RecordingLaw):
    """The recorded torque of each of two joints is that of the other."""

    name, equation = "channel_swap", "torque[::-1]"
    source = "Isermann, Fault-Diagnosis Systems, Springer, 2006 (faults of sensors)"
    headline = "an exchange of the torques of {joint} and {partner}"
    typical = "two exchanged plugs or columns: present or absent"
    common, approximate = 0.3, True
    scope = "pair"

    def recorded_torque(self, x: View) -> Array:
        return x.torque[..., ::-1]

    acted_torque = recorded_torque


PLUGIN = ChannelSwap()
