"""Command delay: time from the stamp of a command to its effect."""

from collections.abc import Sequence

import numpy as np

from ..servos import Servo
from ..types import Array, Shape
from .drive import DriveLaw, Reach


class CommandDelay(DriveLaw):
    """The drive acts on the command of a while ago; the recorded torque is not shifted (law `time_delay`)."""

    name, equation = "command_delay", "command_at(t - delay)"
    source = "Astrom, Murray, Feedback Systems, Princeton University Press, 2008, chapter 8 (time delays)"
    headline = "the drive of {joint} acts {delay} after its command"
    typical = "1 to 40 ms"
    parameters = {"delay": Shape("s", (), positive=False)}
    example = {"delay": 0.01}
    stage, numbers = "delay", {"delay": "delay"}
    fault, variable = "the command acts earlier or later than stated", "velocity"
    tolerance, relative = 1e-3, False

    def moved(self, t: Array, command: Array, delay: float) -> Array:
        late = np.searchsorted(t, t - delay + 1e-9, side="right") - 1  # commands are held
        return np.asarray(command[np.maximum(late, 0)])

    def trials(self, servo: Servo, reach: Reach) -> Sequence[Servo]:
        return [servo.with_(delay=max(servo.delay + x, 0.0)) for x in (0.0, -0.015, 0.01, 0.03)]


PLUGIN = CommandDelay()
