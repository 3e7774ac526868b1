"""Input files of a simulation: desired motions and recorded torque."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from ...errors import RecordingError
from ...recording.columns import assign_columns
from ...recording.source import Source, open_source
from ...types import Array, Recording, Robot, Trajectory
from .control import Torques

FEWEST = 4  # smallest number of rows of a motion
START = 0.05  # [s] beginning of a recording that gives the initial velocity


def read_motion(source: Source, robot: Robot) -> Trajectory:
    """Read a desired motion with columns t, q_J and optionally dq_J and ddq_J, of some joints.

    Missing velocities and accelerations are those of a cubic spline. Time starts at 0 in the first row.

    Args:
        source: file, or arrays by column name [s, rad or m, rad/s or m/s, rad/s2 or m/s2].
        robot: robot with the joints.

    Raises:
        RecordingError: the file or its columns cannot be used; the sentence says why.
    """
    opened = open_source(source)
    found = assign_columns(opened, None, robot)
    joints = [j for j in range(len(robot.joints)) if found.column("q", j)]
    if not found.column("t", 0) or not joints:
        raise RecordingError(f"{opened.name} is not a motion; give columns t and q_J, such as q_{robot.joints[0]}")

    def read(kind: str) -> Array | None:
        names = [found.column(kind, j) for j in joints]
        return np.array(found.table.read(names, 0, found.table.rows)) if all(names) else None

    t, q, v, a = found.table.read([found.column("t", 0)], 0, found.table.rows)[:, 0], read("q"), read("dq"), None
    assert q is not None, "joints are those with positions"
    if v is not None:
        a = read("ddq")
    _check(opened.name, t, *(x for x in (q, v, a) if x is not None))
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
    _check(name, samples.t, np.nan_to_num(samples.tau), samples.q[:1])
    t = samples.t - samples.t[0]
    torque = np.column_stack([np.interp(t, t[h], x[h]) for h, x in zip(have.T, samples.tau.T, strict=True)])
    if samples.dq is not None and np.isfinite(samples.dq[0]).all():
        return Torques(t, torque, samples.q[0], samples.dq[0])
    near = max(FEWEST, int(np.searchsorted(t, START)))
    first = np.isfinite(samples.q[:near]).all(1)
    v = np.polynomial.polynomial.polyfit(t[:near][first], samples.q[:near][first], min(3, int(first.sum()) - 1))[1]
    return Torques(t, torque, samples.q[0], v)


def _check(name: str, t: Array, *values: Array) -> None:
    if len(t) < FEWEST:
        raise RecordingError(f"{name} has {len(t)} rows; give at least {FEWEST}")
    for x in (t[:, None], *values):
        if not np.isfinite(x).all():
            row = int(np.flatnonzero(~np.isfinite(x).all(1))[0]) + 1
            raise RecordingError(f"{name} has a missing or infinite number in row {row}; complete or remove that row")
    if not np.all(np.diff(t) > 0):
        row = int(np.flatnonzero(np.diff(t) <= 0)[0]) + 2
        raise RecordingError(f"{name}: time does not increase in row {row}; sort the rows by t, one per instant")
