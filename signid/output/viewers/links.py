"""Content of a log: links of a robot as a tree of frames, signals over time, and remarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ...robot import configuration
from ...robot.joints import root_link
from ...types import Array, Frozen, Robot

QUANTITIES = ("effort", "position", "velocity")  # of a signal


class Pose(NamedTuple):
    """Pose of a link in the frame of another."""

    parent: str
    child: str
    translation: list[float]  # [m]
    rotation: list[float]  # quaternion x, y, z, w


class Links:
    """Tree of the links of a URDF; each link that a joint moves has its pose in the link before it."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.data, self.root = robot, robot.model.createData(), root_link(robot)
        frames = robot.model.frames
        self.moving: list[tuple[int, int]] = []  # frames of the link before and of the link
        still: list[tuple[int, int]] = []
        for k, frame in enumerate(frames):
            before = frame.parentFrame
            while before and frames[before].type != pin.FrameType.BODY:
                before = frames[before].parentFrame
            if before and frame.type == pin.FrameType.BODY:
                (still if frames[before].parentJoint == frame.parentJoint else self.moving).append((before, k))
        self.fixed = self._poses(np.zeros(len(robot.joints)), still)

    def poses(self, q: Array) -> list[Pose]:
        """Poses of the links that joints move at positions q: (n,) [rad or m]."""
        return self._poses(q, self.moving)

    def _poses(self, q: Array, pairs: Sequence[tuple[int, int]]) -> list[Pose]:
        pin.framesForwardKinematics(self.robot.model, self.data, configuration(self.robot, q[None])[0])
        frames, placed, found = self.robot.model.frames, self.data.oMf, []
        for before, k in pairs:
            pose = placed[before].actInv(placed[k])
            turn: Any = pin.Quaternion(pose.rotation).coeffs()
            found.append(Pose(frames[before].name, frames[k].name, pose.translation.tolist(), turn.tolist()))
        return found


@dataclass(frozen=True, eq=False)
class Signal(Frozen):
    """One kind of signal of n joints at N instants; None: the signal has no such quantity."""

    topic: str
    joints: tuple[str, ...]
    t: Array  # (N,) [s], as in the recording
    position: Array | None = None  # (N, n) [rad or m]
    velocity: Array | None = None  # (N, n) [rad/s or m/s]
    effort: Array | None = None  # (N, n) [N.m or N]; NaN where torque was not recorded
    drawn: bool = False  # whether its positions move the links


class Remark(NamedTuple):
    """A line of text: an event of a watch, a verdict or a finding."""

    t: float  # [s]
    sentence: str
    warning: bool
    document: str = ""  # JSON of an event


class Head(NamedTuple):
    """Robot, title and notes of a log."""

    robot: str
    title: str
    dated: bool = False  # whether time stamps count from 1970
    notes: Sequence[str] = ()
