"""Random laws that a demonstration conceals from the simulation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ...effects import EFFECTS
from ...model import Model
from ...regression.motion import Motion
from ...robot.dynamics import joint_of_row, own_row
from ...types import Array, Indices, Law, Robot

TOGETHER = (  # combinations of effects, chosen by the seed
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
SIZE, PAYLOAD = (0.15, 0.3), (0.4, 0.8)  # range of a law's torque over the std of the joint torque
WEAK = 0.02  # joints with less than this share of the largest joint torque get no law
SPATIAL = 3  # minimum number of joints for laws of bodies to be distinguishable
TILT, MOST_TILT = 0.05, 0.1  # tilt at which the size is evaluated, and largest tilt [rad]
ASIDE = 0.03  # largest offset of a payload from the tip, per axis [m]
REST_OFFSET = 0.3  # largest offset of a spring's rest position from the mean position [rad or m]
DIGITS = 2  # significant digits of the concealed parameters


class _Scene(NamedTuple):
    """The simulation along a motion: torque (N, n), its standard deviation (n,) [N.m or N], and the strong joints."""

    known: Model
    motion: Motion
    torque: Array
    scale: Array
    strong: Indices  # joints


def conceal(known: Model, motion: Motion, seed: int) -> tuple[Law, ...]:
    """Draw laws at random joints with random parameters, each with a relevant torque along a motion.

    Laws that the simulation already states at the same joint are not drawn.
    """
    torque, rng = known.inverse(motion), np.random.default_rng(seed)
    scale = np.std(torque, axis=0)
    scene = _Scene(known, motion, torque, scale, np.flatnonzero(scale >= weak_torque(known.robot, scale)))
    possible = [names for names in TOGETHER if all(_places(scene, name) for name in names)]
    laws: list[Law] = []
    for name in possible[seed % len(possible)]:
        taken, places = [law.joints for law in laws], _places(scene, name)
        joints = rng.choice([place for place in places if place not in taken] or places)
        laws.append(_sized(scene, name, tuple(joints.tolist()), rng))
    return tuple(laws)


def weak_torque(robot: Robot, size: Array) -> Array:
    """Torque below which a joint is weak, (n,) [N.m or N], from the strongest joint of the same kind.

    size: (n,) torque of each joint [N.m or N].
    """
    most = [float(np.max(size[robot.prismatic == kind], initial=0.0)) for kind in (False, True)]
    return WEAK * np.where(robot.prismatic, most[1], most[0])


def _places(scene: _Scene, name: str) -> list[tuple[int, ...]]:
    """Joints where a law is possible and not yet stated by the simulation."""
    effect, n = EFFECTS[name], len(scene.scale)
    if effect.scope in ("robot", "tip"):
        return [tuple(range(n)) if effect.scope == "robot" else (n - 1,)] if n >= SPATIAL else []
    known = [law.joints for law in scene.known.laws if law.effect.name == name and any(law.parameters.values())]
    first = int(name == "armature")  # at the first joint it is equivalent to link inertia
    return [(j,) for j in scene.strong.tolist() if (j,) not in known and j >= first]


def _sized(scene: _Scene, name: str, joints: tuple[int, ...], rng: np.random.Generator) -> Law:
    """A law whose torque is a random share of the torque of the joint most affected."""
    known, effect, shape = scene.known, EFFECTS[name], _shape(scene, name, joints, rng)
    unit = Law(effect, joints, shape)
    added = Model(known.robot, known.inertials, (*known.laws, unit)).inverse(scene.motion) - scene.torque
    size = np.max(np.std(added[:, scene.strong], axis=0) / scene.scale[scene.strong])
    factor = rng.uniform(*PAYLOAD if name == "payload" else SIZE) / size
    factor = min(factor, MOST_TILT / TILT) if name == "base_tilt" else factor
    numbers = {key: x if key == "rest" else factor * x for key, x in shape.items()}
    return Law(effect, joints, {key: float(f"{x:.{DIGITS}g}") for key, x in numbers.items()})


def _shape(scene: _Scene, name: str, joints: tuple[int, ...], rng: np.random.Generator) -> Mapping[str, float]:
    """Parameters of a law, before scaling."""
    if name == "payload":
        centre = _tip(scene.known.robot, joints[0]) + rng.uniform(-ASIDE, ASIDE, 3)
        return {"mass": 1.0, **{f"first_moment_{axis}": float(x) for axis, x in zip("xyz", centre, strict=True)}}
    if name == "base_tilt":
        way = rng.uniform(0, 2 * np.pi)
        return {"x": TILT * np.cos(way), "y": TILT * np.sin(way)}
    if name == "spring":
        middle = float(np.mean(scene.motion.q[:, joints[0]]))
        return {"stiffness": 1.0, "rest": middle + rng.uniform(-REST_OFFSET, REST_OFFSET)}
    return dict.fromkeys(EFFECTS[name].parameters, 1.0)


def _tip(robot: Robot, joint: int) -> Any:
    """Position of the outermost frame on the body that a joint moves, (3,) [m] in the joint frame."""
    body = joint_of_row(robot.model, own_row(robot, joint))
    ends = [frame.placement.translation for frame in robot.model.frames if frame.parentJoint == body]
    return max(ends, key=np.linalg.norm)
