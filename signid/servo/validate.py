"""Models with position drives and recordings -> how well closed loops from commands alone predict the positions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import OptionError, RecordingError, shorten
from ..faults.commands import audit_flags
from ..model import Model, ModelSource, command_model
from ..recording import Recordings, as_recordings, same_joints
from ..robot.load import state_actuators
from ..servos import ServoGrid
from ..simulation.rollout import restrict_joints
from ..typed import typed
from ..types import Input, Progress, Recording, Result, Robot
from ..validate.run import named_models
from .given import stated_servos
from .identify.fits import closed_loops
from .identify.result import ServoRollOut, ServoTrace
from .plant import servo_grids
from .simulate import registered

MAX_Q_DES = 10_000  # commanded position [rad or m]


@dataclass(frozen=True, eq=False)
class ServoValidatedModel(Result):
    """Closed loops of one model on all recordings, from commands alone."""

    name: str  # path of the model, or its given name
    model: Model  # with `servos`, restricted to the joints of the recordings
    rollout: ServoRollOut
    traces: tuple[ServoTrace, ...]  # one for each stretch of a recording without gaps


@dataclass(frozen=True, eq=False)
class ServoValidation(Result):
    """Comparison of models with position drives and recordings. `flags` name unreliable results."""

    models: tuple[ServoValidatedModel, ...]
    inputs: tuple[Input, ...]  # the recordings
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    seed: int


@typed
def validate_servos(
    models: ModelSource | Sequence[ModelSource] | Mapping[str, ModelSource],
    recordings: Recordings,
    *,
    actuators: str | Path | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> ServoValidation:
    """How well models with position drives predict recorded positions from the commands alone; nothing is fitted.

    Per joint: rms position error of closed loops over whole recordings, and restarted from the measured state every
    second.

    Args:
        models: one or several with `servos`, as `load_model` gives them, or robots whose actuators file states kp.
        recordings: with commanded positions q_des_J, of the same joints.
        actuators: TOML whose tables [recording."FILE NAME".JOINT] state firmware gains; None: those of the robots.
        seed: recorded in the result; nothing is random.
        progress: called with what is being done and the share of it that is done.

    Raises:
        OptionError: a model or a recording is missing, or a model has no drive of a commanded joint.
        RecordingError: a recording cannot be used; the sentence says which and why.
        RobotError: invalid actuators file.
    """
    named = named_models(models, "validate_servos")
    if not named:
        raise OptionError("no model was given; at least one is needed")
    first = next(iter(named.values()))
    given = as_recordings(recordings, first.robot, "validate_servos")
    if not given:
        raise OptionError("no recording was given; at least one is needed")
    need_commands(given)
    validated, flags, notes = list[ServoValidatedModel](), list(audit_flags(first.robot, given)), list[str]()
    for k, (name, model) in enumerate(named.items()):
        if progress is not None:
            progress(f"validating {name}", k / len(named))
        driven, robot, missing, remarks = prepared_model(name, model, given, actuators)
        notes += remarks
        flags += missing
        grids = [grid for recording in given for grid in servo_grids(recording, robot)]
        found = ServoValidatedModel(name, driven, *closed_loops(driven, driven.servos, grids))
        validated.append(found)
        flags += _flags(found, grids)
        worse = found.rollout.whole_rms > found.rollout.nominal_whole_rms
        if poor := [joint for joint, grows in zip(found.rollout.joints, worse, strict=True) if grows]:
            notes.append(f"{name} predicts {shorten(poor)} no better than q = q_des")
    return ServoValidation(
        models=tuple(validated),
        inputs=tuple(Input(r.path, r.sha256, "recording") for r in given),
        flags=tuple(dict.fromkeys(flags)),
        notes=tuple(dict.fromkeys(notes)),
        seed=seed,
    )


def need_commands(recordings: Sequence[Recording], moving: bool = False) -> None:
    """Reject recordings whose drives never hold a commanded position or, if `moving`, whose commands never change.

    Raises:
        RecordingError: no commanded position, too few rows, commands that are no numbers, or drives always off.
    """
    for recording in recordings:
        name, samples = recording.path or "the recording", recording.read()
        if samples.q_des is None:
            raise RecordingError(f"{name} has no commanded position; add columns q_des_J of the servo joints")
        if len(samples.t) < 2:
            raise RecordingError(f"{name} has {len(samples.t)} usable rows; record the robot in motion")
        if not np.isfinite(samples.q_des).any():
            raise RecordingError(f"{name} has commanded positions that are all empty or no numbers; check q_des_J")
        commanded = np.isfinite(samples.q_des).any(axis=0)
        on = None if samples.servo is None else samples.servo.on
        if on is not None and not (np.nan_to_num(on[:, commanded], nan=1.0) > 0).any():
            raise RecordingError(f"{name} has the drives off in all rows (on_J is 0); record with the drives on")
        if np.nanmax(np.abs(samples.q_des)) > MAX_Q_DES:
            raise RecordingError(f"{name} has commanded positions beyond {MAX_Q_DES} rad or m; check units of q_des_J")
    commands = (
        [x for recording in recordings if (q := recording.read().q_des) is not None for x in q.T] if moving else []
    )
    if moving and not any(np.ptp(x[np.isfinite(x)]) > 0 for x in commands if np.isfinite(x).any()):
        names = shorten([recording.path or "a recording" for recording in recordings])
        raise RecordingError(
            f"the commanded positions of {names} never change; record a motion that q_des_J commands, or check that "
            f"q_des_J is the command"
        )


def prepared_model(
    name: str, model: Model, recordings: Sequence[Recording], actuators: str | Path | None
) -> tuple[Model, Robot, list[str], list[str]]:
    """Model with drives of the joints of recordings, a robot that states their firmware gains, flags and notes.

    Raises:
        OptionError: the model has no drive of a commanded joint.
        RobotError: invalid actuators file.
    """
    servos = {**stated_servos(model.robot), **model.servos}
    commanded = [
        joint for joint in same_joints(recordings) if any(r.columns["q_des"][r.joints.index(joint)] for r in recordings)
    ]
    if not set(servos) & set(commanded):
        raise OptionError(
            f"{name} has no drive of {shorten(commanded)}, which the recordings command; identify it with signid "
            f"identify, or state kp below [joint.{commanded[0]}.servo] in actuators.toml"
        )
    restricted, notes = restrict_joints(model, recordings)
    kept = {joint: servo for joint, servo in servos.items() if joint in restricted.robot.joints}
    driven, left = command_model(restricted, kept)
    remarks = [f"{name}: {note}" for note in (*notes, *left)]
    robot = driven.robot if actuators is None else state_actuators(driven.robot, Path(actuators))
    stated = registered(robot, driven.servos)
    lacking = [joint for joint in driven.servos if "kp_register" not in stated[joint]]
    unknown = dict.fromkeys(joint for _, joint in robot.registers if joint in lacking)
    robot = replace(robot, servo=stated)
    flags = [
        f"{name} states no kp_register of {shorten(list(unknown))}, so the registers of the recordings do not count; "
        f"state kp_register below [joint.{joint}.servo] and identify again"
        for joint in list(unknown)[:1]
    ]
    return driven, robot, flags, remarks


def _flags(found: ServoValidatedModel, grids: Sequence[ServoGrid]) -> Iterator[str]:
    """Sentences on drives that are missing, and on simulations that diverge."""
    commanded = np.any([grid.driven for grid in grids], axis=0)
    pairs = zip(grids[0].joints, commanded, strict=True)
    if lacking := [joint for joint, driven in pairs if driven and joint not in found.model.servos]:
        yield f"{found.name} has no drive of {shorten(lacking)}: these joints follow the recorded motion"
    rms = np.maximum(found.rollout.whole_rms, found.rollout.one_second_rms)
    if diverged := [joint for joint, x in zip(found.rollout.joints, rms, strict=True) if np.isinf(x)]:
        yield f"the closed loop of {found.name} diverges at {shorten(diverged)}; check its kp, kd, delay and inertias"
