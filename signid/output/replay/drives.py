"""Motion of joints with position drives: recorded, commanded, and simulated from the commands alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...errors import OptionError, shorten
from ...model import Model, command_model
from ...servo.given import stated_servos
from ...servo.plant import roll_out, servo_grid
from ...servo.simulate import registered
from ...servos import ServoGrid
from ...simulation.rollout import restrict_joints
from ...types import Array, Mask, Recording
from .track import Track, at_times

DIVERGED_POSITION = 1e3  # [rad or m] position from which on a simulation has diverged


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
    grid = servo_grid(recording, robot)
    elapsed = np.asarray(np.arange(len(grid)) * grid.step, np.float64)
    t = np.arange(int(elapsed[-1] * rate * (1 + 1e-9)) + 1) / rate
    recorded = at_times(t, elapsed, grid.q)
    driven = np.array([joint in models[0].servos for joint in grid.joints])
    simulated, apart = zip(*(_simulated(model, grid, window, t, elapsed) for model in models), strict=True)
    paths = np.stack(simulated)
    row = np.minimum(np.searchsorted(elapsed, t + 1e-9, side="right") - 1, len(grid) - 1)
    size = np.maximum(np.std(recorded, axis=0), 1e-9)
    return Track(
        t=np.asarray(grid.origin + t),
        recorded=recorded,
        simulated=paths,
        apart=np.stack(apart),
        window=np.zeros(len(t), int) if window is None else np.floor(t / window + 1e-9).astype(int),
        measured=np.full_like(recorded, np.nan),
        residual=np.where(driven, recorded - paths, np.nan),
        torque=np.where(driven, size, np.nan),
        command=np.where(driven, grid.command[row], np.nan),
    )


def _simulated(model: Model, grid: ServoGrid, window: float | None, t: Array, elapsed: Array) -> tuple[Array, Mask]:
    """Positions (F, n) [rad or m] of the closed loop at the frames, and whether it has diverged (F,)."""
    with np.errstate(all="ignore"):
        q = roll_out(model, model.servos, grid, window)
    near = np.all(np.abs(q) < DIVERGED_POSITION, axis=1, keepdims=True)
    path = at_times(t, elapsed, np.where(near, q, np.nan))
    return path, np.asarray(~np.isfinite(path).all(axis=1))
