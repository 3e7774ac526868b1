"""Rigid bodies of a model in simulator coordinates: one per joint, and one more per elastic joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ...effects.base import TransmissionLaw
from ...errors import OptionError
from ...model import Model
from ...robot import configuration, weld
from ...robot.dynamics import joint_of_row, own_row
from ...types import Array, Frozen, Indices, Law, Robot

BOUNDED = {"RUBX": pin.JointModelRX, "RUBY": pin.JointModelRY, "RUBZ": pin.JointModelRZ}


@dataclass(frozen=True, eq=False)
class PlantBodies(Frozen):
    """Bodies with c coordinates: one per joint, and the deflection of each elastic joint.

    Model position = drive @ coordinates + rest. If the coordinates are those of the model, drive is the identity.
    """

    model: Any  # pin.Model with the rotors' armature
    motor: Indices  # (n,) coordinate of each joint
    soft: Indices  # (k,) elastic joints
    flex: Indices  # (k,) coordinates of their deflections
    drive: Array  # (nv, c) [1]
    rest: Array  # (nv,) [rad or m]
    tip: int  # joint of the model that carries the last link
    centre: Array  # (3,) centre of mass of the last link, in that joint's frame [m]

    @property
    def plain(self) -> bool:
        """Whether the coordinates are those of the model."""
        nv, count = self.drive.shape
        return nv == count and np.array_equal(self.drive, np.eye(nv)) and not self.rest.any()


def build_bodies(model: Model) -> PlantBodies:
    """Bodies of a model with its body laws; each joint with a transmission law is split into motor and link side.

    Raises:
        OptionError: a transmission law acts at a joint that others follow, or whose motor has no armature.
    """
    robot, whole, elastic = model.robot, model.bodies(), model.of(TransmissionLaw)
    soft = [law.joints[0] for law in elastic]
    _check(robot, whole, elastic)
    kept, rows = _without_held(robot, whole)
    parted, motor_rows, flex_rows = _part(kept, [int(np.flatnonzero(robot.drive[rows][:, j])[0]) for j in soft])
    drive = np.zeros((parted.nv, len(robot.joints) + len(soft)))
    drive[motor_rows, : len(robot.joints)] = robot.drive[rows]
    drive[flex_rows, len(robot.joints) + np.arange(len(soft))] = 1
    rest = np.zeros(parted.nv)
    rest[motor_rows] = robot.rest[rows]
    order = np.arange(drive.shape[1])
    if parted.nv == len(order) and np.array_equal(np.sort(drive, axis=None)[-len(order) :], np.ones(len(order))):
        order = drive.argmax(axis=1)  # coordinates in the order of the model's own
    place = np.argsort(order)
    n = len(robot.joints)
    last = own_row(robot, n - 1)
    tip = flex_rows[soft.index(n - 1)] if n - 1 in soft else motor_rows[rows.tolist().index(last)]
    return PlantBodies(
        parted,
        place[:n],
        np.array(soft, dtype=np.intp),
        place[n:],
        drive[:, order],
        rest,
        joint_of_row(parted, tip),
        whole.inertias[joint_of_row(whole, last)].lever,
    )


def _check(robot: Robot, model: Any, elastic: Sequence[Law]) -> None:
    for law in elastic:
        joint, rows = robot.joints[law.joints[0]], np.flatnonzero(robot.drive[:, law.joints[0]])
        if len(rows) > 1:
            raise OptionError(
                f"{law.effect.name} cannot act at {joint}, since other joints follow it; simulate without that law"
            )
        if not model.armature[rows[0]] > 0:
            raise OptionError(
                f"{law.effect.name} at {joint} needs the inertia of the motor: add armature@{joint}:inertia=0.1, "
                f"or state it in an actuators file"
            )
    if len({law.joints for law in elastic}) < len(elastic):
        raise OptionError("two transmission laws act at one joint; give at most one per joint")


def _without_held(robot: Robot, model: Any) -> tuple[Any, Indices]:
    """Model without held joints, and the velocity indices of the remaining joints."""
    spans = [(i, j.idx_v, j.nv) for i, j in enumerate(list(model.joints)[1:], 1)]
    held = [i for i, row, nv in spans if not robot.drive[row : row + nv].any()]
    rows = np.array([r for i, row, nv in spans if i not in held for r in range(row, row + nv)], dtype=np.intp)
    armature = model.armature.copy()
    if held:
        model = weld(model, held, configuration(robot, np.zeros(len(robot.joints))))
    model.armature = armature[rows]
    return model, rows


def _part(model: Any, soft: Sequence[int]) -> tuple[Any, list[int], list[int]]:
    """Model with an additional joint behind each of some joints, and the indices of the motor and the flex joints."""
    new, ids = pin.Model(), [0]
    new.gravity = model.gravity
    motor, flex = [0] * model.nv, dict[int, int]()
    for i in range(1, model.njoints):
        joint = _bounded(model.joints[i])
        at = new.addJoint(ids[model.parents[i]], joint, model.jointPlacements[i], model.names[i])
        row = model.joints[i].idx_v
        for k in range(model.joints[i].nv):
            motor[row + k] = new.joints[at].idx_v + k
        if row in soft:
            at = new.addJoint(at, joint, pin.SE3.Identity(), model.names[i] + "_flex")
            flex[row] = new.joints[at].idx_v
        new.appendBodyToJoint(at, model.inertias[i], pin.SE3.Identity())
        ids.append(at)
    armature = np.zeros(new.nv)
    armature[motor] = model.armature
    new.armature = armature
    return new, motor, [flex[row] for row in soft]


def _bounded(joint: Any) -> Any:
    """The joint with its angle as configuration, if that was cosine and sine."""
    if joint.nq == joint.nv:
        return joint
    name = joint.shortname().removeprefix("JointModel")
    if name in BOUNDED:
        return BOUNDED[name]()
    return pin.JointModelRevoluteUnaligned(joint.extract().axis)
