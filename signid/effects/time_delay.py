"""Time delay: torque is recorded late or early relative to the position."""

import numpy as np

from ..types import Array, Coefficient, View
from .base import Numbers, RecordingLaw, akima


class TimeDelay(RecordingLaw):
    """Recorded torque = delayed true torque; negative if a command is recorded before it acts."""

    name, equation = "time_delay", "torque_at(t - delay)"
    source = "Akima, J. ACM 17(4), 1970, pages 589-602 (interpolation that preserves jumps)"
    typical = "1 to 10 ms, one or two bus cycles (10 ms: UR10E); -2 to -10 ms if commands are recorded"
    parameters = {"delay": Coefficient("s")}
    example = {"delay": 0.004}
    scope = "any"
    twins = ("torque_lag",)

    def recorded_torque(self, x: View, delay: float) -> Array:
        """Torque shifted in time; beyond the ends of the recording it is extended by point reflection."""
        t = x.t[:, 0]
        wanted = np.clip(t - delay, 2 * t[0] - t[-1], 2 * t[-1] - t[0])
        inside, at = np.clip(wanted, t[0], t[-1]), akima(t.tobytes(), x.torque.tobytes())
        beyond, out = wanted != inside, at(inside).reshape(x.torque.shape)
        out[beyond] = 2 * out[beyond] - at(2 * inside[beyond] - wanted[beyond])
        return np.asarray(out)

    def acted_torque(self, x: View, delay: float) -> Array:
        return self.recorded_torque(x, -delay)

    def meaning(self, parameters: Numbers) -> str:
        """Whether torque or motion is early."""
        size = f"{1e3 * abs(parameters['delay']):.1f} ms"
        return f"torque leads the motion by {size}" if parameters["delay"] < 0 else f"torque recorded {size} late"


PLUGIN = TimeDelay()
