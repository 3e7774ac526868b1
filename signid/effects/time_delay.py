"""Time delay: the torque is written down later than the position."""

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from ..types import Array, Coefficient, View
from .base import RecordingLaw


class TimeDelay(RecordingLaw):
    """The record is the true torque some time ago: Akima's cubic between samples, which keeps jumps as they are."""

    name, equation = "time_delay", "torque_at(t - delay)"
    source = "Akima, J. ACM 17(4), 1970, pages 589-602 (interpolation)"
    typical = "1 to 10 ms, one or two cycles of the bus (10 ms: UR10E)"
    parameters = {"delay": Coefficient("s", positive=True)}
    example = {"delay": 0.004}
    scope = "any"
    twins = ("torque_lag",)

    def recorded_torque(self, x: View, delay: float) -> Array:
        """As it was; before the first sample as at the first."""
        t = x.t[:, 0]
        return np.asarray(Akima1DInterpolator(t, x.torque)(np.clip(t - delay, t[0], t[-1])))

    def acted_torque(self, x: View, delay: float) -> Array:
        """As it is later; after the last sample as at the last."""
        return self.recorded_torque(x, -delay)


PLUGIN = TimeDelay()
