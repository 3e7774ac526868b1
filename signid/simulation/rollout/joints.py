"""Restriction of a model to the joints of recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...effects.base import BodyLaw
from ...errors import RecordingError
from ...model import Model
from ...recording import same_joints
from ...robot import hold, resting
from ...types import Law, Recording


def restrict_joints(model: Model, recordings: Sequence[Recording]) -> tuple[Model, tuple[str, ...]]:
    """Hold the joints that recordings lack, as identification does; with notes on the laws that are left out.

    Raises:
        RecordingError: the recordings have a joint that the model lacks or holds.
    """
    joints, robot = same_joints(recordings), model.robot
    beyond = [joint for joint in joints if joint not in robot.joints]
    if beyond:
        raise RecordingError(
            f"the recordings have {', '.join(beyond)}, which the model of {robot.name} lacks or holds; "
            f"give a model of these joints"
        )
    if joints != tuple(joint for joint in robot.joints if joint in joints):
        raise RecordingError(
            f"the recordings have another order of joints than the model of {robot.name}; read them for its robot"
        )
    if joints == robot.joints:
        return model, ()
    moving = hold(robot, resting(robot, but=joints))
    held = [law for law in model.laws if not {robot.joints[j] for j in law.joints} & set(joints)]
    fixed = tuple(law for law in held if isinstance(law.effect, BodyLaw))
    inertials = replace(model, laws=fixed).whole_inertials()
    kept, notes = list[Law](), list[str]()
    for law in (law for law in model.laws if law not in held):
        left = tuple(joints.index(robot.joints[j]) for j in law.joints if robot.joints[j] in joints)
        if law.effect.scope == "pair" and len(left) < 2:
            notes.append(f"{law.effect.name} is left out: one of its joints is held")
        else:
            kept.append(replace(law, joints=left))
    marks = {joint: marks for joint, marks in model.marks.items() if joint in joints}
    return Model(moving, inertials, tuple(kept), marks=marks), tuple(notes)
