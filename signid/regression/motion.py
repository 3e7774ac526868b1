"""Recording -> Motion: how the robot moved, on a uniform grid, with velocities and accelerations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import OptionError
from ..robot import configuration
from ..robot.dynamics import (
    Sensitivity,
    body_regressor,
    effective_inertia,
    gravity_torque,
    moved_bodies,
    own_body,
    rigid_torque,
    sensitivity,
    tip_jacobian,
)
from ..types import Array, Frozen, Mask, Robot, Samples, View
from .bandwidth import Band
from .filters import HALF, differentiate, smooth


@dataclass(frozen=True, eq=False)
class Motion(Frozen):
    """All that a law may see: N uniform samples of n joints."""

    robot: Robot
    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad or m]
    v: Array  # (N, n) [rad/s or m/s]
    a: Array  # (N, n) [rad/s2 or m/s2]
    recorded: Array | None = None  # (N, n) measured torque [N.m or N], NaN where absent
    predicted: Array | None = None  # (N, n) torque [N.m or N] by the model at hand
    slow: Array | None = None  # (n,) [rad/s or m/s] slower, the direction of motion is not certain

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, which: slice) -> Motion:
        """Some of the samples."""
        signals = {key: getattr(self, key) for key in ("t", "q", "v", "a", "recorded", "predicted")}
        return replace(self, **{key: x[which] for key, x in signals.items() if x is not None})

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return float(self.t[1] - self.t[0]) if len(self.t) > 1 else 0.0

    @cached_property
    def configuration(self) -> Array:
        """(N, nq) as Pinocchio wants it [rad or m]."""
        return configuration(self.robot, self.q)

    @cached_property
    def rates(self) -> tuple[Array, Array]:
        """Model velocity and acceleration, (N, nv) each [rad/s, rad/s2]."""
        drive = self.robot.drive.T
        return self.v @ drive, self.a @ drive

    @cached_property
    def direction(self) -> Array:
        """(N, n) of motion [1]: the sign of the velocity, in proportion to it where it is slow."""
        return np.sign(self.v) if self.slow is None else np.clip(self.v / self.slow, -1, 1)

    @cached_property
    def load(self) -> Array:
        """(N, n) rigid-body torque of the description's inertials [N.m or N]."""
        return rigid_torque(self.robot, self.configuration, *self.rates)

    @cached_property
    def inertia(self) -> Array:
        """(N, n) diagonal of the joint-space mass matrix [kg.m2 or kg]."""
        return effective_inertia(self.robot, self.configuration)

    @cached_property
    def jacobian(self) -> Array:
        """(N, 3, n) of the last link's centre of mass, in the world's axes [m/rad or 1]."""
        return tip_jacobian(self.robot, self.configuration)

    @cached_property
    def sensitivity(self) -> Sensitivity:
        """Of the rigid-body torque to position, velocity and acceleration."""
        return sensitivity(self.robot, self.configuration, *self.rates)

    @cached_property
    def bodies(self) -> Array:
        """(N, n, nb, 10) regressor of all bodies [N.m or N per kg, kg.m, kg.m2]."""
        return body_regressor(self.robot, self.configuration, *self.rates)

    @cached_property
    def moved(self) -> Mask:
        """(n, nb) whether a joint moves a body."""
        return moved_bodies(self.robot)

    def coupled(self, joint: int) -> list[int]:
        """The joints whose torque the motion of one may change: those that move a body that it moves."""
        return np.flatnonzero(self.moved[:, self.moved[joint]].any(axis=1)).tolist()

    def body_columns(self, joint: int) -> Array:
        """(N, n, 10) regressor of the body that a joint moves [N.m or N per kg, kg.m, kg.m2]."""
        return np.asarray(self.bodies[:, :, own_body(self.robot, joint)])

    def gravity_torque(self, gravity: Array) -> Array:
        """(N, n) torque that holds the robot in a gravity field [N.m or N].

        Args:
            gravity: (3,) [m/s2].
        """
        return gravity_torque(self.robot, self.configuration, gravity)

    def shift(self, joint: int, change: Array, *, exactly: bool = False) -> Array:
        """Change of torque when the link of a joint moved at q + change, not at q: (N, n) [N.m or N].

        Args:
            joint: whose link moved otherwise.
            change: (N,) [rad or m].
            exactly: not to first order; of what is recorded, moved back, the change has the other sign.
        """
        first, second = _derivatives(change, self.dt)
        if exactly:
            one = np.eye(self.q.shape[1])[joint]
            back = [
                x - np.outer(d, one) for x, d in zip((self.q, self.v, self.a), (change, first, second), strict=True)
            ]
            return self.load - replace(self, q=back[0], v=back[1], a=back[2]).load
        rows, out = self.coupled(joint), np.zeros_like(self.q)
        along = Sensitivity(*(x[:, rows, joint] for x in self.sensitivity))
        out[:, rows] = (
            along.position * change[:, None] + along.velocity * first[:, None] + along.acceleration * second[:, None]
        )
        return out

    def at(self, joints: Sequence[int]) -> View:
        """What a law at these joints sees."""
        return MotionView(self, tuple(joints))


class MotionView:
    """Some joints of a motion; what is costly is computed when a law asks for it."""

    def __init__(self, whole: Motion, joints: tuple[int, ...], samples: Any = slice(None)) -> None:
        self.whole, self.joints, self.samples, self.dt = whole, joints, samples, whole.dt

    def _cut(self, signal: Array) -> Array:
        return np.asarray(signal[self.samples][..., list(self.joints)])

    @property
    def t(self) -> Array:  # (..., 1) [s]
        return np.asarray(self.whole.t[:, None][self.samples])

    @property
    def q(self) -> Array:
        return self._cut(self.whole.q)

    @property
    def v(self) -> Array:
        return self._cut(self.whole.v)

    @property
    def a(self) -> Array:
        return self._cut(self.whole.a)

    @property
    def direction(self) -> Array:
        return self._cut(self.whole.direction)

    @property
    def load(self) -> Array:
        return self._cut(self.whole.load)

    @property
    def inertia(self) -> Array:
        return self._cut(self.whole.inertia)

    @property
    def torque(self) -> Array:
        return self.load if self.whole.predicted is None else self._cut(self.whole.predicted)

    @property
    def recorded(self) -> Array:
        """Torque as measured, (..., m) [N.m or N].

        Raises:
            OptionError: the motion carries none.
        """
        if self.whole.recorded is None:
            raise OptionError("this law needs the measured torque; the motion carries none")
        return self._cut(self.whole.recorded)

    def __getitem__(self, i: Any) -> View:
        return MotionView(self.whole, self.joints, i)


def margin(band: Band, recorded_derivatives: bool = False) -> int:
    """Samples that `build_motion` consumes on either side."""
    return 0 if recorded_derivatives else len(band.position_taps) // 2 + HALF


def build_motion(
    robot: Robot,
    samples: Samples,
    band: Band,
    period: float,
    recorded_derivatives: bool = False,
    slow: Array | None = None,
) -> Motion:
    """The motion inside a stretch of samples: `margin` samples shorter on either side.

    Positions pass a symmetric FIR low-pass and nine-point differences; torque is left as recorded, since regressor
    columns and torque are filtered alike further on.

    Args:
        robot: gives the joints.
        samples: uniform; q (N, n) [rad or m], tau (N, n) [N.m or N].
        band: gives the position cut-off.
        period: of the samples [s].
        recorded_derivatives: take dq and ddq as recorded instead of differentiating q.
        slow: (n,) [rad/s or m/s] slower, the direction of motion is not certain.

    Raises:
        OptionError: recorded derivatives are asked for where the recording has none.
    """
    if recorded_derivatives:
        if samples.dq is None or samples.ddq is None:
            raise OptionError("recorded derivatives were asked for; the recording lacks dq_J or ddq_J columns")
        return Motion(robot, samples.t, samples.q, samples.dq, samples.ddq, samples.tau, slow=slow)
    smoothed = smooth(samples.q, band.position_taps)
    v, a = differentiate(smoothed, period)
    cut = margin(band)
    inner = slice(cut, len(samples.t) - cut)
    q = smoothed[HALF : len(smoothed) - HALF]
    return Motion(robot, samples.t[inner], q, v, a, samples.tau[inner], slow=slow)


def _derivatives(x: Array, dt: float) -> tuple[Array, Array]:
    """First and second derivatives by central differences, (N,); the ends repeat their neighbours."""
    first, second = np.gradient(x, dt), np.zeros_like(x)
    if len(x) > 2:
        second[1:-1] = (x[2:] - 2 * x[1:-1] + x[:-2]) / dt**2
        second[[0, -1]] = second[[1, -2]]
    return first, second
