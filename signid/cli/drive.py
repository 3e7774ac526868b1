"""What moves a simulated robot: from arguments to the library."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ..errors import OptionError

if TYPE_CHECKING:
    from ..model import Model
    from ..simulation.plant import Torques
    from ..simulation.plant.control import Tracking
    from ..types import Array, Robot, Trajectory

DURATION = 20.0  # [s] of motions at random


class Loop(NamedTuple):
    """The controller, as it was asked for."""

    bandwidth: float | None
    kp: str | None
    kd: str | None
    feed_forward: float | None


def given_drive(
    known: Model, asked: Trajectory | Torques | None, loop: Loop, duration: float | None, step: float, seed: int
) -> tuple[Tracking | Torques, float]:
    """What moves the robot, and for how long [s].

    Raises:
        OptionError: what was given contradicts itself.
    """
    from ..simulation.excite.motions.random_motion import rest_to_rest_motion
    from ..simulation.plant import Torques, track
    from ..simulation.plant.run import instants

    if isinstance(asked, Torques):
        if any(option is not None for option in loop):
            raise OptionError("--torque is played back open loop; leave --bandwidth, --kp, --kd, --feed-forward out")
        return asked, float(asked.t[-1]) if duration is None else duration
    if asked is None:
        t = instants(DURATION if duration is None else duration, step)
        asked = rest_to_rest_motion(known.robot, len(t) * step, step, seed)
    gains = None
    if loop.kp is not None or loop.kd is not None:
        if loop.kp is None or loop.kd is None or loop.bandwidth is not None:
            raise OptionError("--kp and --kd go together and leave no room for --bandwidth; give both or neither")
        gains = (_numbers("--kp", loop.kp, known.robot), _numbers("--kd", loop.kd, known.robot))
    options = {"bandwidth": loop.bandwidth, "feed_forward": loop.feed_forward}
    given = {key: value for key, value in options.items() if value is not None}
    if not all(abs(value) < float("inf") for value in given.values()):
        raise OptionError("--bandwidth and --feed-forward are finite numbers; give the bandwidth in Hz and a share")
    return track(known, asked, gains=gains, **given), float(asked.t[-1]) if duration is None else duration


def _numbers(option: str, text: str, robot: Robot) -> Array:
    """A number for all joints, or one for each: (n,) or ().

    Raises:
        OptionError: it is neither.
    """
    import numpy as np

    n = len(robot.joints)
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if len(values) not in (1, n) or not np.isfinite(values).all():
        raise OptionError(f"{option} {text!r} is neither a number nor one for each of the {n} joints, with commas")
    return values[0] if len(values) == 1 else values
