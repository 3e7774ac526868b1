"""What moves a simulated robot: a controller that follows a motion, or torque that was recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from ...effects.base import BodyLaw
from ...errors import InputError, OptionError
from ...model import Model
from ...regression.motion import Motion
from ...robot import configuration
from ...robot.dynamics import mass_matrices
from ...types import Array, Frozen, Trajectory

BANDWIDTH, DAMPING = 6.0, 0.9  # [Hz] and [1] of the position loop, where no gains are given
PLACES = 10  # of a motion, that the inertia felt is taken from
MASSLESS = 1e-12  # share of the largest inertia below which there is none


class Drive(Protocol):
    """What decides on torque, over K instants of n joints."""

    def start(self) -> tuple[Array, Array]:
        """Position and velocity to begin with, (n,) each [rad, rad/s]."""
        ...

    def plan(self, t: Array) -> Plan:
        """What is known of the instants t (K,) [s] beforehand."""
        ...


@dataclass(frozen=True, eq=False)
class Plan(Frozen):
    """Command = torque + stiffness * (desired - q) + damping * (speed - v)."""

    torque: Array  # (K, n) [N.m or N]
    desired: Array  # (K, n) [rad or m]
    speed: Array  # (K, n) [rad/s or m/s]
    stiffness: Array  # (n,) [N.m/rad or N/m]
    damping: Array  # (n,) [N.m.s/rad or N.s/m]


@dataclass(frozen=True, eq=False)
class Tracking(Frozen):
    """Proportional and derivative control about a motion, with the known bodies' torque ahead."""

    known: Model  # whose rigid bodies and rotors the controller knows
    trajectory: Trajectory
    stiffness: Array  # (n,) [N.m/rad or N/m]
    damping: Array  # (n,) [N.m.s/rad or N.s/m]
    feed_forward: float = 1.0  # share of the known torque [1]

    def start(self) -> tuple[Array, Array]:
        """The first desired position and velocity, (n,) each [rad, rad/s]."""
        return self.trajectory.q[0], self.trajectory.v[0]

    def plan(self, t: Array) -> Plan:
        """The motion and the torque ahead.

        Args:
            t: (K,) [s].
        """
        q, v, a = sampled(self.trajectory, t)
        torque = np.zeros_like(q)
        if self.feed_forward:
            torque = self.feed_forward * _bodies(self.known).inverse(Motion(self.known.robot, t, q, v, a))
        return Plan(torque, q, v, self.stiffness, self.damping)


@dataclass(frozen=True, eq=False)
class Torques(Frozen):
    """Torque that is given, whatever the robot does; held from one instant to the next."""

    t: Array  # (N,) [s]
    torque: Array  # (N, n) [N.m or N]
    q: Array  # (n,) to begin with [rad or m]
    v: Array  # (n,) to begin with [rad/s or m/s]

    def start(self) -> tuple[Array, Array]:
        """Position and velocity to begin with, (n,) each [rad, rad/s]."""
        return self.q, self.v

    def plan(self, t: Array) -> Plan:
        """The torque at instants, by linear interpolation.

        Args:
            t: (K,) [s].
        """
        torque = np.column_stack([np.interp(t, self.t, column) for column in self.torque.T])
        zero = np.zeros_like(torque)
        return Plan(torque, zero, zero, zero[0], zero[0])


def track(
    known: Model,
    trajectory: Trajectory,
    *,
    bandwidth: float = BANDWIDTH,
    damping: float = DAMPING,
    gains: tuple[Array, Array] | None = None,
    feed_forward: float = 1.0,
) -> Tracking:
    """A controller for a motion; without gains, each joint answers like a mass on a damped spring.

    Args:
        known: the model whose bodies and rotors the controller knows.
        trajectory: motion of all n joints.
        bandwidth: natural frequency of the position loop [Hz].
        damping: of the position loop, 1 where it does not overshoot.
        gains: stiffness (n,) [N.m/rad] and damping (n,) [N.m.s/rad] instead.
        feed_forward: share of the known torque that is applied ahead.

    Raises:
        InputError: the trajectory is of other joints.
        OptionError: a gain is negative.
    """
    robot = known.robot
    if trajectory.joints != robot.joints:
        raise InputError(f"the motion is of {', '.join(trajectory.joints)}; {robot.name} has {', '.join(robot.joints)}")
    if not (bandwidth > 0 and damping >= 0):
        raise OptionError(f"bandwidth {bandwidth:g} Hz and damping {damping:g}; both must be positive")
    if gains is None:
        inertia, w = _effective_inertia(known, trajectory), 2 * np.pi * bandwidth
        gains = inertia * w**2, 2 * damping * inertia * w
    stiffness, rate = (np.broadcast_to(np.asarray(x, float), (len(robot.joints),)) for x in gains)
    if not (np.all(stiffness >= 0) and np.all(rate >= 0)):
        raise OptionError("a gain of the controller is negative; give gains of zero or more")
    return Tracking(known, trajectory, stiffness, rate, feed_forward)


def sampled(trajectory: Trajectory, t: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration (K, n) of a trajectory; before and after it the robot rests [rad, rad/s].

    Args:
        trajectory: N instants.
        t: (K,) [s].
    """
    if np.array_equal(t, trajectory.t):
        return trajectory.q, trajectory.v, trajectory.a
    inside = np.clip(t, trajectory.t[0], trajectory.t[-1])
    spline = CubicHermiteSpline(trajectory.t, trajectory.q, trajectory.v)
    resting = (t != inside)[:, None]
    q, v = spline(inside), np.where(resting, 0.0, spline(inside, 1))
    a = np.where(resting, 0.0, CubicSpline(trajectory.t, trajectory.a)(inside))
    return q, v, a


def _bodies(model: Model) -> Model:
    return Model(model.robot, model.inertials, tuple(model.of(BodyLaw)))


def _effective_inertia(known: Model, trajectory: Trajectory) -> Array:
    """(n,) [kg.m2 or kg] that a joint's motor feels while the others give way: harmonic mean along a motion.

    Gains in proportion to it stay stable where axes of joints come to lie on one line and inertias nearly cancel.
    """
    few = trajectory.q[:: max(1, len(trajectory.q) // PLACES)]
    robot, bodies = known.robot, known.bodies()
    data = bodies.createData()
    mass = mass_matrices(bodies, data, configuration(robot, few), robot.drive)
    sizes, directions = np.linalg.eigh(mass)
    weak = sizes[:, 0] <= MASSLESS * sizes[:, -1]
    if weak.any():
        joint = robot.joints[int(np.abs(directions[weak.argmax(), :, 0]).argmax())]
        raise OptionError(
            f"joint {joint} of {robot.name} moves nothing that has mass; state the inertials of its links, or its "
            f"armature in an actuators file, or hold it with --lock"
        )
    return np.asarray(1 / np.linalg.inv(mass).diagonal(axis1=1, axis2=2).mean(0))
