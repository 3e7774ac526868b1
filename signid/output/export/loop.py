"""Start of exported position drives: first state of a recording, and the commands in force before it."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import RecordingError, one_line, shorten
from ...model import Model, with_servos
from ...recording import Recordings, as_recording
from ...robot import resting
from ...servo.fit.start import first_state
from ...servo.plant import servo_grid, servo_grids
from ...servo.plant.course import motion_of
from ...servo.plant.grid import command_speed, commands_at, held_before
from ...servo.validate import prepared_model
from ...servos import Servo, ServoGrid
from ...types import Array, Frozen
from .bodies import Exported, words

_START_TEXT = """
# Start of {name}: init_state=InitialStateCfg(**START). HELD are the commands in force before the first one
# [rad or m]; a delay buffer is full of the first command that it gets after a reset, so give it these once
# (Isaac Lab: positions_delay_buffer.compute; mjlab: apply_delay) before the first step.
START = {{"joint_pos": {q}, "joint_vel": {v}}}
HELD = {held}
"""


@dataclass(frozen=True, eq=False)
class Loop(Frozen):
    """A recording of n joints from whose first row exported drives start."""

    model: Model  # of these joints, with its drives
    written: Model  # of all joints, as exports hold it
    grid: ServoGrid
    q: Array  # (n,) [rad or m] at the first row
    v: Array  # (n,) [rad/s or m/s]
    held: dict[str, float]  # command before the first row, by driven joint [rad or m]
    notes: tuple[str, ...]


def loop_of(model: Model, recording: Recordings) -> Loop:
    """A recording as the closed loop of a model starts and commands it.

    No simulator has friction per motor torque: exports hold dry friction of its mean over the recording instead.

    Raises:
        OptionError: the model has no drive of a joint that the recording commands.
        RecordingError: the recording cannot be used.
    """
    recording = as_recording(recording, model.robot, "export")
    if not any(recording.columns.get("q_des", ())):
        raise RecordingError(
            f"{recording.path or 'the recording'} has no q_des_J, so no drive can start from it; add it"
        )
    driven, robot, flags, notes = prepared_model(model.robot.name, model, [recording], None)
    grid = servo_grid(recording, robot)
    motion = motion_of(grid)
    held, dry = dict[str, float](), dict[str, Servo]()
    for j, joint in enumerate(grid.joints):
        if servo := driven.servos.get(joint):
            held[joint] = held_before(grid, j)
            if servo.load_friction > 0:
                command = commands_at(grid, j, servo.kd_on, servo.delay, servo.profile_speed, 1)
                torque = servo.kp * (command[0] - motion.q[:, j]) + servo.kd * (command[1] - motion.v[:, j])
                mean = float(np.mean(np.abs(np.clip(torque, -servo.effort_limit, servo.effort_limit))))
                level = servo.coulomb_friction + servo.load_friction * mean
                dry[joint] = servo.with_(load_friction=0.0, coulomb_friction=level)
    notes = [*flags, *notes]
    at = [j for j, joint in enumerate(grid.joints) if joint in driven.servos]
    conditions = {  # that no exported drive knows
        "firmware gain": bool((grid.gain[at] != 1).any()),
        "supply voltage": bool((grid.voltage[:, at] != 1).any()),
        "torque off": bool((grid.on[:, at] < 0.5).any()),
        "feed-forward torque": grid.feed_forward is not None and bool(grid.feed_forward[:, at].any()),
    }
    if differing := [name for name, differs in conditions.items() if differs]:
        notes.append(f"the drives do not have the {' and '.join(differing)} of the recording")
    if dry:
        notes.append(
            f"dry friction of {shorten(list(dry))} has load_friction in it, at the mean torque of the recording"
        )
    if len(servo_grids(recording, robot)) > 1:
        notes.append("only the longest stretch of the recording without gaps is written")
    written = with_servos(model, {**model.servos, **dry}, complete=True) if dry else model
    return Loop(driven, written, grid, *first_state(driven, grid), held, tuple(notes))


def with_loop(kind: str, made: Exported, loop: Loop) -> Exported:
    """An export of drives that states the start of a recording.

    An MJCF gets a keyframe; files of Isaac Lab and mjlab get START and HELD.
    """
    if kind != "mjcf":
        names = [re.escape(joint) for joint in loop.grid.joints]
        states = {"q": zip(names, loop.q, strict=True), "v": zip(names, loop.v, strict=True), "held": loop.held.items()}
        written = {
            key: json.dumps({name: float(f"{x:.6g}") for name, x in values}, ensure_ascii=False, indent=4)
            for key, values in states.items()
        }
        text = _START_TEXT.format(name=_log_name(loop), **written)
        return replace(made, text=made.text + text, notes=(*made.notes, *loop.notes))
    note = (
        f"the keyframe start is the state of {_log_name(loop)} at its first row; it does not hold the commands before "
        f"it: call mj_initCtrlHistory with its ctrl"
    )
    from lxml import etree

    root: Any = etree.fromstring(made.text)
    recorded = dict(zip(loop.grid.joints, zip(loop.q, loop.v, strict=True), strict=True))
    state = {joint: (x, 0.0) for joint, x in resting(loop.written.robot).items()} | recorded
    for tie in root.iterfind("equality/joint"):
        offset, scale, *_ = map(float, tie.get("polycoef").split())
        q, v = state[tie.get("joint2")]
        state[tie.get("joint1")] = (offset + scale * q, scale * v)
    q, v = zip(*(state.get(joint.get("name"), (0.0, 0.0)) for joint in root.iterfind("worldbody//joint")), strict=True)
    inputs = [item.get("name") for item in root.find("actuator") if item.get("input") != "none"]
    speeds = {f"{joint}_speed": command_speed(loop.grid, j)[0] for j, joint in enumerate(loop.grid.joints)}
    control = [(speeds | loop.held).get(name, 0.0) for name in inputs]
    key = etree.SubElement(etree.SubElement(root, "keyframe"), "key")
    for name, values in {"name": "start", "qpos": words(q), "qvel": words(v), "ctrl": words(control)}.items():
        key.set(name, values)
    etree.indent(root)
    return replace(
        made, text=str(etree.tostring(root, encoding="unicode")) + "\n", notes=(*made.notes, note, *loop.notes)
    )


def _log_name(loop: Loop) -> str:
    return one_line(Path(loop.grid.path).name) or "the recording"
