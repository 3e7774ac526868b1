"""What a demonstration conceals: physics of which the simulation is told nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ...effects import EFFECTS
from ...model import Model
from ...regression.motion import Motion
from ...robot.dynamics import joint_of_row, own_row
from ...types import Array, Indices, Law, Robot

TOGETHER = (  # one after the other, seed by seed
    ("spring", "viscous_friction", "coulomb_friction"),
    ("base_tilt", "spring", "coulomb_friction"),
    ("payload", "coulomb_friction"),
    ("armature", "viscous_friction"),
    ("payload", "spring"),
    ("viscous_friction", "spring"),
    ("base_tilt", "viscous_friction"),
    ("payload", "viscous_friction", "coulomb_friction"),
    ("spring", "armature"),
    ("base_tilt", "coulomb_friction"),
)
SIZE, PAYLOAD = (0.15, 0.3), (0.4, 0.8)  # of how much the torque varies of the joint that feels a law most
WEAK = 0.02  # of the largest joint torque: joints with less are left alone
SPATIAL = 3  # joints from which on the laws of bodies differ from each other and from those of joints
TILT, MOST_TILT = 0.05, 0.1  # [rad] in which a tilt is linear, and the largest
ASIDE = 0.03  # [m] that a payload is off the tip
ASTRAY = 0.3  # [rad or m] between where a spring rests and the middle of the motion
DIGITS = 2  # of what is concealed


class _Scene(NamedTuple):
    """The simulation along a motion, its torque (N, n), how much that varies (n,) [N.m or N], and where it is much."""

    known: Model
    motion: Motion
    torque: Array
    scale: Array
    strong: Indices  # joints


def conceal(known: Model, motion: Motion, seed: int) -> tuple[Law, ...]:
    """Laws at random joints with random numbers, each large enough to matter along a motion.

    No law is concealed that the simulation has at the same joint with another number.

    Args:
        known: the simulation.
        motion: gives sizes.
        seed: of all that is random.
    """
    torque, rng = known.inverse(motion), np.random.default_rng(seed)
    scale = np.std(torque, axis=0)
    scene = _Scene(known, motion, torque, scale, np.flatnonzero(scale >= least(known.robot, scale)))
    possible = [names for names in TOGETHER if all(_places(scene, name) for name in names)]
    laws: list[Law] = []
    for name in possible[seed % len(possible)]:
        taken, places = [law.joints for law in laws], _places(scene, name)
        joints = rng.choice([place for place in places if place not in taken] or places)
        laws.append(_sized(scene, name, tuple(joints.tolist()), rng))
    return tuple(laws)


def least(robot: Robot, size: Array) -> Array:
    """What is little beside the largest of all joints of the same kind, (n,).

    Args:
        robot: gives n joints.
        size: (n,) of their torques [N.m or N].
    """
    most = [float(np.max(size[robot.prismatic == kind], initial=0.0)) for kind in (False, True)]
    return WEAK * np.where(robot.prismatic, most[1], most[0])


def _places(scene: _Scene, name: str) -> list[tuple[int, ...]]:
    """The joints of a law, wherever the robot can have it and the simulation has not."""
    effect, n = EFFECTS[name], len(scene.scale)
    if effect.scope in ("robot", "tip"):
        return [tuple(range(n)) if effect.scope == "robot" else (n - 1,)] if n >= SPATIAL else []
    known = [law.joints for law in scene.known.laws if law.effect.name == name and any(law.parameters.values())]
    first = int(name == "armature")  # at the first joint it is the same as inertia of the link
    return [(j,) for j in scene.strong.tolist() if (j,) not in known and j >= first]


def _sized(scene: _Scene, name: str, joints: tuple[int, ...], rng: np.random.Generator) -> Law:
    """A law whose torque has a random share of that of the joint that feels it most."""
    known, effect, shape = scene.known, EFFECTS[name], _shape(scene, name, joints, rng)
    unit = Law(effect, joints, shape)
    added = Model(known.robot, known.inertials, (*known.laws, unit)).inverse(scene.motion) - scene.torque
    size = np.max(np.std(added[:, scene.strong], axis=0) / scene.scale[scene.strong])
    factor = rng.uniform(*PAYLOAD if name == "payload" else SIZE) / size
    factor = min(factor, MOST_TILT / TILT) if name == "base_tilt" else factor
    numbers = {key: x if key == "rest" else factor * x for key, x in shape.items()}
    return Law(effect, joints, {key: float(f"{x:.{DIGITS}g}") for key, x in numbers.items()})


def _shape(scene: _Scene, name: str, joints: tuple[int, ...], rng: np.random.Generator) -> Mapping[str, float]:
    """The numbers of a law of any size."""
    if name == "payload":
        centre = _tip(scene.known.robot, joints[0]) + rng.uniform(-ASIDE, ASIDE, 3)
        return {"mass": 1.0, **{f"first_moment_{axis}": float(x) for axis, x in zip("xyz", centre, strict=True)}}
    if name == "base_tilt":
        way = rng.uniform(0, 2 * np.pi)
        return {"x": TILT * np.cos(way), "y": TILT * np.sin(way)}
    if name == "spring":
        middle = float(np.mean(scene.motion.q[:, joints[0]]))
        return {"stiffness": 1.0, "rest": middle + rng.uniform(-ASTRAY, ASTRAY)}
    return dict.fromkeys(EFFECTS[name].parameters, 1.0)


def _tip(robot: Robot, joint: int) -> Any:
    """The frame farthest out on the body that a joint moves, (3,) [m] in that of the joint."""
    body = joint_of_row(robot.model, own_row(robot, joint))
    ends = [frame.placement.translation for frame in robot.model.frames if frame.parentJoint == body]
    return max(ends, key=np.linalg.norm)
