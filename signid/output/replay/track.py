"""Motion of the recorded and the simulated robots, poses of their bodies, and residual torque of each simulation.

Position drives are simulated from their commands alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ...errors import OptionError, shorten
from ...model import Model, command_model
from ...recording.sampling import Sampling, samples, survey
from ...regression.bandwidth import Band, choose_band, lowpass
from ...regression.motion import Motion, build_motion, margin
from ...regression.session import longest_piece
from ...robot import configuration
from ...robot.dynamics import joint_of_row, own_row
from ...servo import plant
from ...servo.given import stated_servos
from ...servo.simulate import registered
from ...simulation.rollout import restrict_joints, roll_out
from ...types import Array, Frozen, Indices, Mask, Recording, Robot

DIVERGED_POSITION = 1e3  # [rad or m] position from which on a simulation has diverged
MAX_TIME_STEP = 2e-3  # maximum time step of the simulation [s]
DISPLAY_CUTOFF_SHARE = 0.4  # cut-off of the displayed residual, relative to the frame rate
STANDSTILL_NOISE_RATIO = 3.0  # velocity over its noise below which the direction of motion is uncertain


@dataclass(frozen=True, eq=False)
class Track(Frozen):
    """F frames of n joints, recorded and simulated by M models: original, extended."""

    t: Array  # (F,) time of the recording [s]
    recorded: Array  # (F, n) [rad or m]
    simulated: Array  # (M, F, n) [rad or m]; NaN outside of roll-outs
    apart: Mask  # (M, F) whether joints diverged
    window: Indices  # (F,) index of the roll-out of each frame, -1: none
    measured: Array  # (F, n) low-passed torque [N.m or N]; NaN where it was not recorded
    residual: Array  # (M, F, n) measured - predicted torque, low-passed [N.m or N]; NaN without recorded torque
    torque: Array  # (n,) root mean square of the measured torque [N.m or N]
    command: Array | None = None  # (F, n) [rad or m] of position drives, whose residual is one of position


class Surveyed(NamedTuple):
    """A recording, its sampling and the band of its motion."""

    recording: Recording
    sampling: Sampling
    band: Band
    measured: Mask  # (n,) whether torque was recorded


def track_of(models: Sequence[Model], recording: Recording, window: float, rate: float) -> Track:
    """Compute the motion of a recording and of roll-outs of one or two models.

    Consecutive windows [s] cover the recording; in each the simulated robots start from the measured state.

    Raises:
        RecordingError: the recording cannot be used, or is shorter than a window.
    """
    from scipy.ndimage import convolve1d

    read = surveyed(recording, models[0].robot)
    sampling, measured = read.sampling, read.measured
    known = [samples(recording, sampling, span, 0, sampling.length(span)) for span in sampling.spans]
    times, q = np.concatenate([x.t for x in known]), np.concatenate([x.q for x in known])
    t = times[0] + np.arange(int((times[-1] - times[0]) * rate * (1 + 1e-9)) + 1) / rate
    recorded = at_times(t, times, q)
    strayed = [_window_errors(read, models[k], models[k - 1], window, t) for k in range(len(models))]
    error, apart, windows = zip(*strayed, strict=True)
    torque = np.concatenate([x.tau for x in known])
    taps = lowpass(1 / sampling.period, min(read.band.cutoff, DISPLAY_CUTOFF_SHARE * rate))
    shown = np.full((1 + len(models), *recorded.shape), np.nan)  # measured torque and residuals, for display
    for motion, predicted in predictions(read, models):
        assert motion.recorded is not None, "a recording has torque"
        inside = (t >= motion.t[0]) & (t <= motion.t[-1])
        for row, x in enumerate((motion.recorded, *(motion.recorded - part for part in predicted))):
            calm = convolve1d(x, taps, axis=0, mode="mirror") if len(taps) > 1 else x
            shown[row, inside] = at_times(t[inside], motion.t, calm)
    return Track(
        t=t,
        recorded=recorded,
        simulated=recorded + np.stack(error),
        apart=np.stack(apart),
        window=windows[0],
        measured=shown[0],
        residual=shown[1:],
        torque=np.where(measured, np.sqrt(np.mean(np.where(measured, torque, 0.0) ** 2, axis=0)), np.nan),
    )


def surveyed(recording: Recording, robot: Robot) -> Surveyed:
    """Determine the sampling of a recording and the band of its motion.

    Raises:
        RecordingError: the recording cannot be used.
    """
    sampling = survey(recording, robot)
    band = choose_band([longest_piece((recording, sampling))], 1 / sampling.period)
    return Surveyed(recording, sampling, band, np.array([bool(column) for column in recording.columns["tau"]]))


def _window_errors(read: Surveyed, model: Model, other: Model, window: float, t: Array) -> tuple[Array, Mask, Indices]:
    """Simulated - recorded position (F, n), divergence (F,) and number (F,) of consecutive roll-outs.

    A diverged joint keeps its last position unless all joints diverged.
    """
    count = int(np.ceil(read.sampling.duration / window))  # enough that roll-outs do not leave gaps
    rolled = roll_out(model, read.recording, (window,), windows=count, band=read.band, step=MAX_TIME_STEP, beside=other)
    which = np.searchsorted(rolled.start, t, side="right") - 1
    age = t - rolled.start[which]
    which = np.where((which >= 0) & (age <= rolled.t[-1] + read.sampling.period), which, -1)
    measured = read.measured
    error, apart = np.full((len(t), len(measured)), np.nan), np.zeros(len(t), dtype=bool)
    ages = np.concatenate([[0.0], rolled.t])
    for w in np.unique(which[which >= 0]):
        frames = which == w
        path = np.concatenate([np.zeros((1, len(measured))), np.where(measured, rolled.error[w], 0.0)])
        lost = ~np.isfinite(path)
        last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(path))[:, None]), axis=0)
        held = np.take_along_axis(path, last, axis=0)
        held[lost[:, measured].all(axis=1)] = np.nan
        error[frames] = at_times(age[frames], ages, held)
        apart[frames] = np.interp(age[frames], ages, lost.any(axis=1)) > 0
    return error, apart, which


def predictions(read: Surveyed, models: Sequence[Model]) -> Iterator[tuple[Motion, list[Array]]]:
    """Motion of each stretch of a recording, and the torque (N, n) of each model there [N.m or N]."""
    slow = np.maximum(STANDSTILL_NOISE_RATIO * read.band.velocity_noise, 1e-12)
    for span in read.sampling.spans:
        if read.sampling.length(span) <= 2 * margin(read.band) + 1:
            continue
        piece = samples(read.recording, read.sampling, span, 0, read.sampling.length(span))
        robots = [build_motion(model.robot, piece, read.band, read.sampling.period, slow=slow) for model in models]
        yield robots[0], [model.inverse(motion) for model, motion in zip(models, robots, strict=True)]


def at_times(t: Array, known: Array, values: Array) -> Array:
    """Interpolate values: (N, n) [any unit] at times known: (N,) [s] linearly to times t: (F,) [s]."""
    return np.column_stack([np.interp(t, known, x) for x in values.T])


def poses(robot: Robot, q: Array, bodies: Sequence[int]) -> Array:
    """Compute position [m] and quaternion x, y, z, w [1] of bodies in the world, (F, len(bodies), 7).

    The positions q: (F, n) [rad or m] may be NaN; bodies are named by the joints of the model that carry them.
    """
    model, data = robot.model, robot.model.createData()
    out = np.full((len(q), len(bodies), 7), np.nan)
    known = np.isfinite(q).all(axis=1)
    for frame, where in zip(np.flatnonzero(known), configuration(robot, q[known]), strict=True):
        pin.forwardKinematics(model, data, where)
        out[frame] = [pin.SE3ToXYZQUAT(data.oMi[body]) for body in bodies]
    return out


def movers(robot: Robot, bodies: Sequence[int]) -> list[int]:
    """Index of the joint that moves each body, or its parent if the body's joint is held; -1: base."""
    model, moving = robot.model, [-1] * robot.model.njoints
    for joint in range(1, model.njoints):
        item = model.joints[joint]
        felt = np.abs(robot.drive[item.idx_v : item.idx_v + item.nv]).max(axis=0)
        moving[joint] = int(np.argmax(felt)) if felt.any() else moving[model.parents[joint]]
    return [moving[body] for body in bodies]


def axis(robot: Robot, joint: int) -> tuple[int, Array, bool]:
    """The body that a joint moves, its axis in the body frame, (3,) [1], and whether it is prismatic."""
    row = own_row(robot, joint)
    body = joint_of_row(robot.model, row)
    return body, *_along(robot.model, body, row)


def own_axis(robot: Robot, body: int) -> tuple[Array, bool]:
    """The axis of a joint of the model in its frame, (3,) [1], and whether it is prismatic."""
    return _along(robot.model, body, robot.model.joints[body].idx_v)


def _along(model: Any, body: int, row: int) -> tuple[Array, bool]:
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    column = np.reshape(pin.getJointJacobian(model, data, body, pin.LOCAL), (6, model.nv))[:, row]
    slides = not column[3:].any()
    along = column[:3] if slides else column[3:]
    return along / np.linalg.norm(along), slides


def commands_only(recording: Recording) -> bool:
    """Whether a recording has commanded positions and no torque."""
    return any(recording.columns.get("q_des", ())) and not any(recording.columns["tau"])


def with_drives(model: Model, recording: Recording) -> tuple[Model, Sequence[str]]:
    """The model of the recorded joints with drives where commands are recorded, its own or stated ones; notes.

    Raises:
        OptionError: no commanded joint has a drive.
    """
    servos = {**stated_servos(model.robot), **model.servos}
    commanded = {joint for joint, x in zip(recording.joints, recording.columns["q_des"], strict=True) if x}
    kept = {joint: servo for joint, servo in servos.items() if joint in commanded}
    if not kept:
        raise OptionError(
            f"{model.robot.name} has no position drive of {shorten(sorted(commanded))}, which the recording commands; "
            f"give the model.json of signid identify, or state kp below [joint.J.servo] in actuators.toml"
        )
    restricted, notes = restrict_joints(model, [recording])
    free = [joint for joint in restricted.robot.joints if joint not in kept]
    follow = [f"{shorten(free)} without a drive follow the recorded motion"] if free else []
    driven, left = command_model(restricted, kept)
    return driven, [*notes, *left, *follow]


def follow_commands(models: Sequence[Model], recording: Recording, window: float | None, rate: float) -> Track:
    """Compute the recorded and commanded motion, and that of closed loops of one or two models.

    The simulations begin in the measured state, and return to it after each window [s]; None: never. The residual is
    the error of the position.

    Raises:
        RecordingError: the recording cannot be used.
    """
    robot = replace(models[0].robot, servo=registered(models[0].robot, models[0].servos))
    grid = plant.servo_grid(recording, robot)
    elapsed = np.asarray(np.arange(len(grid)) * grid.step, np.float64)
    t = np.arange(int(elapsed[-1] * rate * (1 + 1e-9)) + 1) / rate
    recorded = at_times(t, elapsed, grid.q)
    driven = np.array([joint in models[0].servos for joint in grid.joints])
    paths = np.empty((len(models), *recorded.shape))
    for path, model in zip(paths, models, strict=True):
        with np.errstate(all="ignore"):
            q = plant.roll_out(model, model.servos, grid, window)
        near = np.all(np.abs(q) < DIVERGED_POSITION, axis=1, keepdims=True)
        path[:] = at_times(t, elapsed, np.where(near, q, np.nan))
    row = np.minimum(np.searchsorted(elapsed, t + 1e-9, side="right") - 1, len(grid) - 1)
    size = np.maximum(np.std(recorded, axis=0), 1e-9)
    return Track(
        t=np.asarray(grid.origin + t),
        recorded=recorded,
        simulated=paths,
        apart=np.asarray(~np.isfinite(paths).all(axis=2)),
        window=np.zeros(len(t), int) if window is None else np.floor(t / window + 1e-9).astype(int),
        measured=np.full_like(recorded, np.nan),
        residual=np.where(driven, recorded - paths, np.nan),
        torque=np.where(driven, size, np.nan),
        command=np.where(driven, grid.command[row], np.nan),
    )
