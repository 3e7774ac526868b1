"""Links of a robot as a tree of frames, as /tf and URDF viewers have them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from ...robot import configuration
from ...robot.joints import root_link
from ...types import Array, Frozen, Robot
from ..replay.marks import Mark

WORLD = "world"  # frame above root links that are several, or not at the origin
STICK = 0.1  # [1] radius of a drawn link over its length
QUANTITIES = ("effort", "position", "velocity")  # of a signal


class Pose(NamedTuple):
    """Pose of a link in the frame of another."""

    parent: str
    child: str
    translation: list[float]  # [m]
    rotation: list[float]  # quaternion x, y, z, w


class Links:
    """Tree of the links; each link that a joint moves has its pose in the link before it."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.data = robot, robot.model.createData()
        frames = list(robot.model.frames)
        bodies = {frame.name: k for k, frame in enumerate(frames) if frame.type == pin.FrameType.BODY}
        names = [root_link(robot), *robot.links]
        own = [bodies.get(name) for name in names]  # frame of the link of each joint of the model
        self.moving: list[tuple[int, int]] = []  # frames of a link and of the one before it
        still: list[tuple[int, int]] = []
        for k in bodies.values():
            joint, before = frames[k].parentJoint, frames[k].parentFrame
            while before and frames[before].type != pin.FrameType.BODY:
                before = frames[before].parentFrame
            if not before and joint:  # MJCF has no frames between
                before = own[joint] if own[joint] not in (None, k) else own[robot.model.parents[joint]]
            (still if frames[before or 0].parentJoint == joint else self.moving).append((before or 0, k))
        pin.framesForwardKinematics(robot.model, self.data, configuration(robot, np.zeros((1, len(robot.joints))))[0])
        tops = [k for before, k in still if not before]
        lifted = len(tops) != 1 or not self.data.oMf[tops[0]].isIdentity(1e-9)
        self.root = WORLD if lifted else names[0]
        self.fixed = self._poses([pair for pair in still if pair[0] or lifted])

    def poses(self, q: Array) -> list[Pose]:
        """Poses of the links that joints move at positions q: (n,) [rad or m]."""
        pin.framesForwardKinematics(self.robot.model, self.data, configuration(self.robot, q[None])[0])
        return self._poses(self.moving)

    def _poses(self, pairs: Sequence[tuple[int, int]]) -> list[Pose]:
        frames, placed, found = self.robot.model.frames, self.data.oMf, []
        for before, k in pairs:
            pose = placed[before].actInv(placed[k])
            turn: Any = pin.Quaternion(pose.rotation).coeffs()
            parent = frames[before].name if before else self.root
            found.append(Pose(parent, frames[k].name, pose.translation.tolist(), turn.tolist()))
        return found


def drawn_urdf(links: Links) -> str:
    """The robot's URDF; of an MJCF a URDF of its links alone, as sticks between their frames."""
    robot = links.robot
    if robot.kind == "urdf":
        return robot.document
    poses = [*links.fixed, *links.poses(np.zeros(len(robot.joints)))]
    sticks: dict[str, list[str]] = {links.root: []}
    joints = []
    for k, (parent, child, way, turn) in enumerate(poses):
        sticks.setdefault(child, [])
        length = float(np.linalg.norm(way))
        if length > 0:
            x, y, z = way
            turned = (0.0, np.arccos(z / length), np.arctan2(y, x))
            pose = f'<origin xyz="{_words(np.array(way) / 2)}" rpy="{_words(turned)}"/>'
            solid = f'<geometry><cylinder radius="{STICK * length}" length="{length}"/></geometry>'
            sticks.setdefault(parent, []).append(f"<visual>{pose}{solid}</visual>")
        angles = pin.rpy.matrixToRpy(pin.Quaternion(np.array(turn)).matrix())
        stands = f'<origin xyz="{_words(way)}" rpy="{_words(angles)}"/>'
        ends = f"<parent link={quoteattr(parent)}/><child link={quoteattr(child)}/>"
        joints.append(f'<joint name="joint_{k + 1}" type="floating">{stands}{ends}</joint>')
    bodies = [f"<link name={quoteattr(name)}>{''.join(some)}</link>" for name, some in sticks.items()]
    return "\n".join([f"<robot name={quoteattr(robot.name)}>", *bodies, *joints, "</robot>"])


def _words(numbers: Iterable[float]) -> str:
    return " ".join(f"{x:.9g}" for x in numbers)


@dataclass(frozen=True, eq=False)
class Signal(Frozen):
    """One kind of signal of n joints at N instants; None: the signal has no such quantity."""

    topic: str
    curves: Mapping[str, tuple[str, ...]]  # place and name of the curves of each quantity in Rerun
    joints: tuple[str, ...]
    t: Array  # (N,) [s], as in the recording
    position: Array | None = None  # (N, n) [rad or m]
    velocity: Array | None = None  # (N, n) [rad/s or m/s]
    effort: Array | None = None  # (N, n) [N.m or N]; NaN where torque was not recorded
    drawn: bool = False  # whether its positions move the links


class Findings(NamedTuple):
    """Verdict and findings of a diagnosis."""

    t: float  # [s]
    verdict: str
    marks: Sequence[Mark]


class Arrow(NamedTuple):
    """Force on a link at a centre of mass, in the world."""

    tip: Array  # (3,) [m]
    way: Array | None  # (3,) from tail to tip [m]; None if the direction is unknown
    radius: float  # [m]
    ended: bool
    removed: bool  # whether no external force explains it


class Remark(NamedTuple):
    """An event of a watch."""

    t: float  # [s]
    sentence: str
    document: str  # JSON
    warning: bool
    arrow: Arrow | None = None


class Head(NamedTuple):
    """Robot, title and notes of a log."""

    robot: str
    title: str
    dated: bool = False  # whether time stamps count from 1970
    notes: Sequence[str] = ()
    identity: str | None = None  # None: any
