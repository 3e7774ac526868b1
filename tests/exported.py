"""Models to export, and their behaviour in MuJoCo."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import ModuleType, SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from toys import joint, link, toy

from signid.effects.naming import parse_law
from signid.model import Model, stated_inertials, stated_laws
from signid.regression.motion import Motion
from signid.robot import load_robot
from signid.types import Array, Robot

COUNT = 40
BODY = (
    '<inertial><origin xyz="0.1 -0.05 0.2" rpy="0.3 0.2 0.1"/><mass value="2"/>'
    '<inertia ixx="0.03" ixy="0.002" ixz="-0.001" iyy="0.02" iyz="0.003" izz="0.025"/></inertial>'
)


def gripper() -> Robot:
    """A slide, an unlimited hinge, and a hinge that follows it with ratio 2 and offset 0.1, at odd angles."""
    place = '<origin xyz="0.1 0.2 0.3" rpy="0.5 -0.4 0.3"/>'
    limit = place + '<limit lower="-0.4" upper="0.5" effort="30" velocity="4"/>'
    follow = limit + '<mimic joint="turn" multiplier="-2" offset="0.1"/>'
    return toy(
        *(link(name, BODY) for name in "abcd"),
        joint("slide", "a", "b", "prismatic", limit, "0.6 0 0.8"),
        joint("turn", "b", "c", "continuous", place, "0 0.8 0.6"),
        joint("finger", "c", "d", "revolute", follow, "1 0 0"),
    )


def model_of(robot: Robot | str, *laws: str) -> Model:
    robot = load_robot(robot) if isinstance(robot, str) else robot
    added = tuple(parse_law(text, robot) for text in laws)
    return Model(robot, stated_inertials(robot), (*stated_laws(robot), *added))


def states(robot: Robot, seed: int = 0) -> Motion:
    rng = np.random.default_rng(seed)
    q, v, a = rng.uniform(-2, 2, (3, COUNT, len(robot.joints)))
    return Motion(robot, np.arange(COUNT) * 0.1, q, v, a)


def mujoco_torque(text: str, motion: Motion, names: Sequence[str]) -> Array:
    """Inverse dynamics without constraints (N, n), dry friction added as the file states it [N.m or N].

    Args:
        text: MJCF.
        motion: of the joints that move by themselves.
        names: of the joints of the robot's model, row by row.
    """
    there = mujoco.MjModel.from_xml_string(text)
    there.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, robot = mujoco.MjData(there), motion.robot
    rows = [(there.joint(name), k) for k, name in enumerate(names) if name]
    assert len(rows) == there.nv
    found = []
    for q, v, a in zip(motion.q, motion.v, motion.a, strict=True):
        torque = np.zeros(len(names))
        for joint_, k in rows:
            data.qpos[joint_.qposadr] = robot.drive[k] @ q + robot.rest[k]
            data.qvel[joint_.dofadr], data.qacc[joint_.dofadr] = robot.drive[k] @ v, robot.drive[k] @ a
        mujoco.mj_inverse(there, data)
        for joint_, k in rows:
            dry = there.dof_frictionloss[joint_.dofadr] * np.sign(data.qvel[joint_.dofadr])
            torque[k] = (data.qfrc_inverse[joint_.dofadr] + dry)[0]
        found.append(robot.drive.T @ torque)
    return np.array(found)


def executed(text: str, module: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Names of an exported Python file, with configurations as their class names and arguments."""

    class Anything(ModuleType):
        def __getattr__(self, kind: str) -> Any:
            return lambda **numbers: SimpleNamespace(kind=kind, **numbers)

    monkeypatch.setitem(sys.modules, module.split(".")[0], ModuleType(module.split(".")[0]))
    monkeypatch.setitem(sys.modules, module, Anything(module))
    found: dict[str, Any] = {}
    exec(compile(text, "exported.py", "exec"), found)
    return found
