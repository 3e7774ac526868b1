"""Drives of a simulated robot: a controller that follows a motion, or given torque, and their input files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from ...effects.base import BodyLaw
from ...errors import InputError, OptionError, RecordingError, unexpected
from ...model import Model, ModelSource, as_model, torque_model
from ...recording.columns import assign_columns
from ...recording.mapping import read_map
from ...recording.source import Source, open_source
from ...regression.motion import Motion
from ...robot import configuration
from ...robot.dynamics import mass_matrices
from ...typed import typed
from ...types import Array, Frozen, Recording, Robot, Trajectory

LOOP_BANDWIDTH, LOOP_DAMPING = 6.0, 0.9  # [Hz], [1] default natural frequency and damping ratio of the position loop
INERTIA_POSITIONS = 10  # positions of a motion at which the inertia is computed
MIN_INERTIA_RATIO = 1e-12  # [1] inertia over the largest one, below which a joint moves no mass
MIN_MOTION_ROWS = 4  # smallest number of rows of a motion
MAX_SI_NUMBER, MIN_TIME_STEP = 1e12, 1e-12  # largest number in SI units; shortest step of time [s]
START_DURATION = 0.05  # [s] beginning of a recording that gives the initial velocity


class Drive(Protocol):
    """Source of the torque command of n joints."""

    def start(self) -> tuple[Array, Array]:
        """Initial position and velocity, (n,) each [rad, rad/s]."""
        ...

    def plan(self, t: Array) -> Plan:
        """Plan of the command at instants t (K,) [s]."""
        ...


@dataclass(frozen=True, eq=False)
class Plan(Frozen):
    """Plan of a command: torque + stiffness * (desired - q) + damping * (speed - v)."""

    torque: Array  # (K, n) [N.m or N]
    desired: Array  # (K, n) [rad or m]
    speed: Array  # (K, n) [rad/s or m/s]
    stiffness: Array  # (n,) [N.m/rad or N/m]
    damping: Array  # (n,) [N.m.s/rad or N.s/m]


@dataclass(frozen=True, eq=False)
class Tracking(Frozen):
    """Proportional and derivative control about a motion, with feed-forward torque of the known bodies."""

    known: Model  # model of the controller: rigid bodies and rotors
    trajectory: Trajectory
    stiffness: Array  # (n,) [N.m/rad or N/m]
    damping: Array  # (n,) [N.m.s/rad or N.s/m]
    feed_forward: float = 1.0  # share of the known torque [1]

    def start(self) -> tuple[Array, Array]:
        """First desired position and velocity, (n,) each [rad, rad/s]."""
        return self.trajectory.q[0], self.trajectory.v[0]

    def plan(self, t: Array) -> Plan:
        """Desired motion and feed-forward torque at t (K,) [s]."""
        q, v, a = sampled(self.trajectory, t)
        torque = np.zeros_like(q)
        if self.feed_forward:
            bodies = Model(self.known.robot, self.known.inertials, tuple(self.known.of(BodyLaw)))
            torque = self.feed_forward * bodies.inverse(Motion(self.known.robot, t, q, v, a))
        return Plan(torque, q, v, self.stiffness, self.damping)


@dataclass(frozen=True, eq=False)
class Torques(Frozen):
    """Given torque without feedback, held from one instant to the next."""

    t: Array  # (N,) [s]
    torque: Array  # (N, n) [N.m or N]
    q: Array  # (n,) initial position [rad or m]
    v: Array  # (n,) initial velocity [rad/s or m/s]

    def start(self) -> tuple[Array, Array]:
        """Initial position and velocity, (n,) each [rad, rad/s]."""
        return self.q, self.v

    def plan(self, t: Array) -> Plan:
        """Torque at t (K,) [s], by linear interpolation."""
        torque = np.column_stack([np.interp(t, self.t, column) for column in self.torque.T])
        zero = np.zeros_like(torque)
        return Plan(torque, zero, zero, zero[0], zero[0])


@typed
def track(
    known: ModelSource,
    trajectory: Trajectory,
    *,
    bandwidth: float = LOOP_BANDWIDTH,
    damping: float = LOOP_DAMPING,
    gains: tuple[Array, Array] | None = None,
    feed_forward: float = 1.0,
) -> Tracking:
    """Controller that follows a motion; the default gains make each joint a damped oscillator.

    >>> drive = signid.track("3r", signid.excite("3r", kind="random").trajectory, bandwidth=4.0)

    Args:
        known: model of the controller: rigid bodies and rotors.
        trajectory: motion of all n joints.
        bandwidth: natural frequency of the position loop [Hz].
        damping: damping ratio of the position loop, 1 for critical damping.
        gains: stiffness (n,) [N.m/rad] and damping (n,) [N.m.s/rad], instead of the default ones.
        feed_forward: share of the known torque that is applied as feed-forward.

    Raises:
        InputError: the trajectory is of other joints.
        OptionError: a gain is negative, bandwidth or damping are invalid, or the motion is no Trajectory.
    """
    known = torque_model(as_model(known, "track"))
    robot = known.robot
    if not isinstance(trajectory, Trajectory):
        raise unexpected("track", "a Trajectory", trajectory, "signid.excite(robot).trajectory")
    if trajectory.joints != robot.joints:
        raise InputError(
            f"the motion is of {', '.join(trajectory.joints)}, but {robot.name} has {', '.join(robot.joints)}; "
            f"give a motion of these joints"
        )
    if not (bandwidth > 0 and damping >= 0):
        raise OptionError(f"the bandwidth is {bandwidth:g} Hz and the damping {damping:g}; give positive numbers")
    if gains is None:
        inertia, w = _effective_inertia(known, trajectory), 2 * np.pi * bandwidth
        gains = inertia * w**2, 2 * damping * inertia * w
    stiffness, rate = (np.broadcast_to(np.asarray(x, float), (len(robot.joints),)) for x in gains)
    if not (np.all(stiffness >= 0) and np.all(rate >= 0)):
        raise OptionError("a gain of the controller is negative; give gains of zero or more")
    return Tracking(known, trajectory, stiffness, rate, feed_forward)


def sampled(trajectory: Trajectory, t: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration (K, n) at t (K,) [s] of a trajectory, outside of which the robot rests."""
    if np.array_equal(t, trajectory.t):
        return trajectory.q, trajectory.v, trajectory.a
    inside = np.clip(t, trajectory.t[0], trajectory.t[-1])
    spline = CubicHermiteSpline(trajectory.t, trajectory.q, trajectory.v)
    resting = (t != inside)[:, None]
    q, v = spline(inside), np.where(resting, 0.0, spline(inside, 1))
    a = np.where(resting, 0.0, CubicSpline(trajectory.t, trajectory.a)(inside))
    return q, v, a


def _effective_inertia(known: Model, trajectory: Trajectory) -> Array:
    """Effective inertia (n,) [kg.m2 or kg] of each joint with the others free: harmonic mean along a motion.

    Gains proportional to it stay stable where joint axes are aligned and inertias nearly cancel.
    """
    few = trajectory.q[:: max(1, len(trajectory.q) // INERTIA_POSITIONS)]
    robot, bodies = known.robot, known.bodies()
    data = bodies.createData()
    mass = mass_matrices(bodies, data, configuration(robot, few), robot.drive)
    sizes, directions = np.linalg.eigh(mass)
    weak = sizes[:, 0] <= MIN_INERTIA_RATIO * sizes[:, -1]
    if weak.any():
        joint = robot.joints[int(np.abs(directions[weak.argmax(), :, 0]).argmax())]
        raise OptionError(
            f"joint {joint} of {robot.name} moves no mass; state the inertials of its links, or its armature in an "
            f"actuators file, or hold it with --lock"
        )
    return np.asarray(1 / np.linalg.inv(mass).diagonal(axis1=1, axis2=2).mean(0))


def read_motion(source: Source, robot: Robot) -> Trajectory:
    """Read a desired motion with columns t, q_J and optionally dq_J and ddq_J, of some joints.

    Missing velocities and accelerations are those of a cubic spline. Time starts at 0 in the first row.

    Raises:
        RecordingError: the file or its columns cannot be used; the sentence says why.
    """
    opened = open_source(source)
    found = assign_columns(opened, read_map(None), robot)
    joints = [j for j in range(len(robot.joints)) if found.column("q", j)]
    if not found.column("t", 0) or not joints:
        raise RecordingError(f"{opened.name} is not a motion; give columns t and q_J, such as q_{robot.joints[0]}")

    def read(kind: str) -> Array | None:
        names = [found.column(kind, j) for j in joints]
        return np.array(found.table.read(names, 0, found.table.rows)) if all(names) else None

    t, q, v = found.table.read([found.column("t", 0)], 0, found.table.rows)[:, 0], read("q"), read("dq")
    assert q is not None, "joints are those with positions"
    a = None if v is None else read("ddq")
    _check_times(opened.name, t, *(x for x in (q, v, a) if x is not None))
    t = t - t[0]
    if v is None:
        v, a = CubicSpline(t, q)(t, 1), CubicSpline(t, q)(t, 2)
    if a is None:
        a = CubicSpline(t, v)(t, 1)
    return Trajectory(tuple(robot.joints[j] for j in joints), t, q, v, a)


def recorded_torques(recording: Recording) -> Torques:
    """Torque of a recording, to be played back from its initial position and velocity.

    Missing torque is interpolated. Time starts at 0 in the first row.

    Raises:
        RecordingError: a joint has no torque, or its sign is lost.
    """
    name = recording.path or "the recording"
    if not recording.signed.all():
        raise RecordingError(
            f"{name} has torque without its sign, which cannot be played back; recover the signs first"
        )
    samples = recording.read()
    have = np.isfinite(samples.tau)
    if lacking := [joint for joint, seen in zip(recording.joints, have.T, strict=True) if not seen.any()]:
        raise RecordingError(f"{name} has no torque of {', '.join(lacking)}; add it, or remove the joint's position")
    _check_times(name, samples.t, np.nan_to_num(samples.tau), samples.q[:1])
    t = samples.t - samples.t[0]
    torque = np.column_stack([np.interp(t, t[h], x[h]) for h, x in zip(have.T, samples.tau.T, strict=True)])
    if samples.dq is not None and np.isfinite(samples.dq[0]).all():
        return Torques(t, torque, samples.q[0], samples.dq[0])
    near = max(MIN_MOTION_ROWS, int(np.searchsorted(t, START_DURATION)))
    first = np.isfinite(samples.q[:near]).all(1)
    v = np.polynomial.polynomial.polyfit(t[:near][first], samples.q[:near][first], min(3, int(first.sum()) - 1))[1]
    return Torques(t, torque, samples.q[0], v)


def _check_times(name: str, t: Array, *values: Array) -> None:
    if len(t) < MIN_MOTION_ROWS:
        raise RecordingError(f"{name} has {len(t)} rows; give at least {MIN_MOTION_ROWS}")
    for x in (t[:, None], *values):
        usable = (np.abs(x) <= MAX_SI_NUMBER).all(1)
        if not usable.all():
            row = int(np.flatnonzero(~usable)[0]) + 1
            raise RecordingError(
                f"{name} has no number, or one beyond {MAX_SI_NUMBER:.0e}, in row {row}; complete or remove that row"
            )
    if not np.all(np.diff(t) > MIN_TIME_STEP):
        row = int(np.flatnonzero(np.diff(t) <= MIN_TIME_STEP)[0]) + 2
        raise RecordingError(f"{name}: time does not increase in row {row}; sort the rows by t, one per instant")
