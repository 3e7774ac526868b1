"""Time delay: torque is recorded later than the position, or earlier."""

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from ..types import Array, Coefficient, View
from .base import Numbers, RecordingLaw


class TimeDelay(RecordingLaw):
    """The record is the true torque some time ago, or ahead where negative: a command recorded before it acts."""

    name, equation = "time_delay", "torque_at(t - delay)"
    source = "Akima, J. ACM 17(4), 1970, pages 589-602 (interpolation that keeps jumps as they are)"
    typical = "1 to 10 ms, one or two cycles of the bus (10 ms: UR10E); -2 to -10 ms where commands are recorded"
    parameters = {"delay": Coefficient("s")}
    example = {"delay": 0.004}
    scope = "any"
    twins = ("torque_lag",)

    def recorded_torque(self, x: View, delay: float) -> Array:
        """Shifted in time; beyond either end of the record, torque is reflected in its last point."""
        t = x.t[:, 0]
        wanted = np.clip(t - delay, 2 * t[0] - t[-1], 2 * t[-1] - t[0])
        inside, at = np.clip(wanted, t[0], t[-1]), Akima1DInterpolator(t, x.torque)
        beyond = (wanted != inside)[:, None]
        return np.asarray(np.where(beyond, 2 * at(inside) - at(2 * inside - wanted), at(inside)))

    def acted_torque(self, x: View, delay: float) -> Array:
        """Shifted back."""
        return self.recorded_torque(x, -delay)

    def meaning(self, parameters: Numbers) -> str:
        """Which of torque and motion comes first."""
        size = f"{1e3 * abs(parameters['delay']):.1f} ms"
        return f"torque leads the motion by {size}" if parameters["delay"] < 0 else f"torque recorded {size} late"


PLUGIN = TimeDelay()
