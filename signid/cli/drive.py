"""Drive of a simulated robot, from command-line arguments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import OptionError

if TYPE_CHECKING:
    from ..model import Model
    from ..simulation.plant import Torques
    from ..simulation.plant.control import Tracking
    from ..types import Array, Robot, Trajectory

DURATION = 20.0  # default length of random motions [s]


@dataclass(frozen=True, kw_only=True)
class LoopOptions:
    """The position controller."""

    bandwidth: Annotated[
        float | None, typer.Option(metavar="HZ", help="Bandwidth of the position loop [Hz]. Default: 6.")
    ] = None
    kp: Annotated[str | None, typer.Option(metavar="A,B", help="Stiffness of the loop [N.m/rad]; needs --kd.")] = None
    kd: Annotated[str | None, typer.Option(metavar="A,B", help="Damping of the loop [N.m.s/rad]; needs --kp.")] = None
    feed_forward: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="Share of the rigid-body torque that is fed forward. Default: 1."),
    ] = None


def given_drive(
    known: Model, asked: Trajectory | Torques | None, loop: LoopOptions, duration: float | None, step: float, seed: int
) -> tuple[Tracking | Torques, float]:
    """Return the drive of the robot and the duration [s].

    Args:
        known: model that the controller uses.
        asked: motion or torques from a file; None: a random motion.
        loop: controller.
        duration: requested length [s].
        step: time step [s].
        seed: seed of the random generator.

    Raises:
        OptionError: the options contradict each other.
    """
    from ..simulation.excite.random_motions import rest_to_rest_motion
    from ..simulation.plant import Torques, track
    from ..simulation.plant.run import instants

    if isinstance(asked, Torques):
        if loop != LoopOptions():
            raise OptionError("--torque is played back open loop; leave --bandwidth, --kp, --kd, --feed-forward out")
        return asked, float(asked.t[-1]) if duration is None else duration
    if asked is None:
        t = instants(DURATION if duration is None else duration, step)
        asked = rest_to_rest_motion(known.robot, len(t) * step, step, seed)
    gains = None
    if loop.kp is not None or loop.kd is not None:
        if loop.kp is None or loop.kd is None or loop.bandwidth is not None:
            raise OptionError("--kp and --kd belong together and exclude --bandwidth; give both or neither")
        gains = (_numbers("--kp", loop.kp, known.robot), _numbers("--kd", loop.kd, known.robot))
    options = {"bandwidth": loop.bandwidth, "feed_forward": loop.feed_forward}
    given = {key: value for key, value in options.items() if value is not None}
    if not all(abs(value) < float("inf") for value in given.values()):
        raise OptionError("--bandwidth and --feed-forward must be finite; give the bandwidth in Hz and a share")
    return track(known, asked, gains=gains, **given), float(asked.t[-1]) if duration is None else duration


def _numbers(option: str, text: str, robot: Robot) -> Array:
    """Parse one number for all joints, () [units of the option], or one per joint, (n,).

    Raises:
        OptionError: the text is neither.
    """
    import numpy as np

    n = len(robot.joints)
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if len(values) not in (1, n) or not np.isfinite(values).all():
        raise OptionError(
            f"{option} {text!r} is neither one number nor one for each of the {n} joints; separate them by commas"
        )
    return values[0] if len(values) == 1 else values
