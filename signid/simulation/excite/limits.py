"""Limits of a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import OptionError
from ...types import Array, Frozen, Mask, Robot

MARGIN = 0.95  # [1] share of every limit that a motion may use
RANGE = (np.pi, 0.5)  # [rad], [m] default position limit on either side of zero
SPEED = (2.0, 0.25)  # [rad/s], [m/s] default velocity limit
RISE = 0.25  # [s] time to reach the velocity limit at the default acceleration limit

Given = float | Sequence[float] | Array | None


@dataclass(frozen=True, eq=False)
class Limits(Frozen):
    """Limits of n joints; a motion uses at most the share `margin` of each."""

    lower: Array  # (n,) [rad or m]
    upper: Array  # (n,) [rad or m]
    velocity: Array  # (n,) [rad/s or m/s]
    acceleration: Array  # (n,) [rad/s2 or m/s2]
    torque: Array  # (n,) [N.m or N], inf where none
    margin: float = MARGIN
    notes: tuple[str, ...] = ()

    @property
    def middle(self) -> Array:
        return (self.lower + self.upper) / 2

    @property
    def half(self) -> Array:
        """Half of the usable position range, (n,) [rad or m]."""
        return self.margin * (self.upper - self.lower) / 2

    @property
    def allowed(self) -> Array:
        """Usable limits (3, n) [rad or m, and per s, per s2]: half of the range, velocity and acceleration."""
        return np.array([self.half, self.margin * self.velocity, self.margin * self.acceleration])

    def shares(self, q: Array, v: Array, a: Array) -> Array:
        """Signed shares (3, N, n) [1] of the usable limits.

        Samples are q (N, n) [rad or m], v (N, n) [rad/s or m/s], a (N, n) [rad/s2 or m/s2].
        """
        return np.array([q - self.middle, v, a]) / self.allowed[:, None]


def build_limits(
    robot: Robot,
    *,
    lower: Given = None,
    upper: Given = None,
    velocity: Given = None,
    acceleration: Given = None,
    torque: Given = None,
    margin: float = MARGIN,
) -> Limits:
    """Limits of the description, or the given ones: one number for all joints, or one for each.

    Defaults if the description has none: half a turn (0.5 m) on either side of zero, 2 rad/s (0.25 m/s), no torque
    limit. The default acceleration limit reaches the velocity limit in 0.25 s. Units are rad or m, s, and N.m or N.

    Raises:
        OptionError: a limit leaves no motion, or the number of limits is not that of the joints.
    """
    if not 0 < margin <= 1:
        raise OptionError(f"the margin is {margin:g}; give a share of the limits above 0 and at most 1")
    notes: list[str] = []
    span = np.where(robot.prismatic, RANGE[1], RANGE[0])
    low, up = _given(robot, "lower", lower, robot.lower), _given(robot, "upper", upper, robot.upper)
    bare = ~np.isfinite(low) | ~np.isfinite(up)
    low = np.where(np.isfinite(low), low, np.where(np.isfinite(up), up - 2 * span, -span))
    up = np.where(np.isfinite(up), up, low + 2 * span)
    speed = _given(robot, "velocity", velocity, robot.velocity_limit)
    free = ~np.isfinite(speed)
    speed = np.where(free, np.where(robot.prismatic, SPEED[1], SPEED[0]), speed)
    notes += _note(robot, bare, "no position limit is stated: half a turn (0.5 m) on either side of zero is used")
    notes += _note(robot, free, f"no velocity limit is stated: {SPEED[0]:g} rad/s ({SPEED[1]:g} m/s) is used")
    if acceleration is None:
        notes.append(f"the acceleration limit is the one that reaches the velocity limit in {RISE:g} s")
    rise = _given(robot, "acceleration", acceleration, speed / RISE)
    effort = _given(robot, "torque", torque, robot.effort_limit)
    notes += _note(robot, ~np.isfinite(effort), "no torque limit is stated")
    _refuse_empty(robot, low, up, {"velocity": speed, "acceleration": rise, "torque": effort})
    return Limits(low, up, speed, rise, effort, margin, tuple(notes))


def _given(robot: Robot, name: str, value: Given, stated: Array) -> Array:
    n = len(robot.joints)
    if value is None:
        return np.array(stated, float)
    array = np.asarray(value, float)
    if array.shape not in ((), (n,)) or np.isnan(array).any():
        raise OptionError(f"the {name} limit has shape {array.shape}; give one number, or one for each of {n} joints")
    return np.broadcast_to(array, (n,)).copy()


def _refuse_empty(robot: Robot, lower: Array, upper: Array, sizes: dict[str, Array]) -> None:
    for j, joint in enumerate(robot.joints):
        if not lower[j] < upper[j]:
            raise OptionError(
                f"joint {joint} would move from {lower[j]:g} to {upper[j]:g}; the lower limit must be below the upper"
            )
        for name, size in sizes.items():
            if not size[j] > 0:
                raise OptionError(
                    f"the {name} limit of joint {joint} is {size[j]:g}, which leaves no motion; "
                    "give a positive one, or hold the joint with --lock"
                )


def _note(robot: Robot, which: Mask, text: str) -> list[str]:
    named = [joint for joint, bare in zip(robot.joints, which, strict=True) if bare]
    return [f"{', '.join(named)}: {text}"] if named else []
