"""Export of a model as MJCF, the format of MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ...model import Model
from ...robot import configuration
from ...robot.configuration import is_plain
from ...robot.dynamics import joint_of_row, own_row
from ...types import Array, Law, Robot
from .beyond import BODIES, Exported, commented, fixed_note, held, lacking, summed
from .bodies import LEAST, PossibleBodies, Principal, possible_bodies, quaternion
from .shapes import Shapes, read_shapes, words

_NUMBERS = {"damping": "viscous_friction", "frictionloss": "coulomb_friction", "armature": "armature"}
_DENSITY = 2700.0  # density at which a payload is drawn [kg/m3]


class _AxisPlace(NamedTuple):
    """A joint axis: its row in the model, and its pose in the body."""

    row: int
    name: str
    slide: bool
    at: Array  # (3,) [m]
    direction: Array  # (3,) [1]


class _Place(NamedTuple):
    """A body: parent joint of the model, pose in the parent at zero, and axes."""

    parent: int
    pose: Any  # pin.SE3
    axes: tuple[_AxisPlace, ...]


class _Follower(NamedTuple):
    """A mimic joint: position = offset + scale * position of the leader."""

    name: str
    leader: str
    offset: float
    scale: float


def write_mjcf(model: Model, package_dirs: Sequence[str | Path] = ()) -> Exported:
    """Write MJCF with bodies, joints, gravity, ranges, armature, friction and springs, and a motor per joint.

    Mimic joints become equality constraints. Shapes are visual only: mass comes from inertials, and nothing collides.

    Raises:
        RobotError: no physically consistent bodies, as MuJoCo requires, give the torque of the model.
    """
    from lxml import etree

    robot, bodies, follow = model.robot, possible_bodies(model), _followers(model.robot)
    shapes = read_shapes(robot, package_dirs)
    root = etree.Element("mujoco", model=robot.name)
    etree.SubElement(root, "compiler", angle="radian", autolimits="true")
    gravity = words(model.bodies().gravity.linear)
    etree.SubElement(root, "option", gravity=gravity, integrator="implicitfast")
    default = etree.SubElement(root, "default")
    etree.SubElement(default, "geom", contype="0", conaffinity="0", group="2")
    _each(etree.SubElement(root, "asset"), "mesh", shapes.meshes)
    _tree(etree.SubElement(root, "worldbody"), model, shapes, bodies)
    ties = [{"joint1": f.name, "joint2": f.leader, "polycoef": words([f.offset, f.scale, 0, 0, 0])} for f in follow]
    _each(etree.SubElement(root, "equality"), "joint", ties)
    _each(etree.SubElement(root, "actuator"), "motor", _motors(model))
    notes = [*_notes(model, follow, bodies), *shapes.notes]
    if notes:
        root.insert(0, etree.Comment("\n    " + "\n    ".join(commented(notes).splitlines()) + "\n  "))
    etree.indent(root)
    return Exported(str(etree.tostring(root, encoding="unicode")) + "\n", tuple(notes))


def mjcf_laws(model: Model) -> list[Law]:
    """Laws of a model that its MJCF holds."""
    whole = [law for law in model.laws if law.effect.name in (*BODIES, "base_tilt", "torque_saturation")]
    return [*held(model, _NUMBERS.values()), *(law for law in _springs(model) if _stiffness(model, law)[0] > 0), *whole]


def _each(parent: Any, tag: str, entries: Sequence[dict[str, str]]) -> None:
    """Add elements to a parent, or remove the parent if there are none."""
    from lxml import etree

    for entry in entries:
        etree.SubElement(parent, tag, entry)
    if not entries:
        parent.getparent().remove(parent)


def _tree(world: Any, model: Model, shapes: Shapes, bodies: PossibleBodies) -> None:
    from lxml import etree

    robot, nodes = model.robot, [world]
    _each_shape(world, shapes, 0)
    for i, (place, link, body) in enumerate(zip(_places(robot), robot.links, bodies.links, strict=True), 1):
        pose = {"pos": words(place.pose.translation), "quat": words(quaternion(place.pose.rotation))}
        node = etree.SubElement(nodes[place.parent], "body", name=link, **pose)
        etree.SubElement(node, "inertial", _inertial(body))
        for axis in place.axes:
            etree.SubElement(node, "joint", _joint(model, axis))
        _each_shape(node, shapes, i)
        nodes.append(node)
    for k, (law, body) in enumerate(bodies.loads):
        at = nodes[joint_of_row(robot.model, own_row(robot, law.joints[0]))]
        node = etree.SubElement(at, "body", name=_free_name(robot, "payload" if k == 0 else f"payload_{k + 1}"))
        etree.SubElement(node, "inertial", _inertial(body))
        radius = (3 * body.mass / (4 * np.pi * _DENSITY)) ** (1 / 3)
        etree.SubElement(node, "geom", type="sphere", size=words([radius]), pos=words(body.centre), rgba="0.9 0.6 0 1")


def _each_shape(node: Any, shapes: Shapes, joint: int) -> None:
    from lxml import etree

    for tag, entry in shapes.at.get(joint, ()):
        etree.SubElement(node, tag, entry)


def _free_name(robot: Robot, name: str) -> str:
    return name if name not in robot.links else _free_name(robot, name + "_")


def _inertial(body: Principal) -> dict[str, str]:
    pose = {"pos": words(body.centre), "quat": words(body.quaternion)}
    return {**pose, "mass": repr(body.mass), "diaginertia": words(body.moments)}


def _joint(model: Model, axis: _AxisPlace) -> dict[str, str]:
    robot = model.robot
    stated = {"name": axis.name, "type": "slide" if axis.slide else "hinge", "axis": words(axis.direction)}
    if np.any(axis.at):
        stated["pos"] = words(axis.at)
    if axis.name not in robot.joints:
        return stated
    j = robot.index(axis.name)
    ends = robot.lower[j], robot.upper[j]
    if np.isfinite(ends).all():
        stated["range"] = words(ends)
    for key, effect in _NUMBERS.items():
        value = summed(model, effect)[j]
        if value > 0:
            stated[key] = repr(float(value))
    stiffness, rest = next((_stiffness(model, law) for law in _springs(model) if law.joints == (j,)), (0.0, 0.0))
    if stiffness > 0:
        stated |= {"stiffness": repr(stiffness), "springref": repr(rest)}
    return stated


def _springs(model: Model) -> list[Law]:
    return [law for law in model.laws if law.effect.name == "spring"]


def _stiffness(model: Model, law: Law) -> tuple[float, float]:
    """Total stiffness [N.m/rad or N/m] and rest position [rad or m] of all springs at the joint of a law."""
    each = [(x.parameters["stiffness"], x.parameters["rest"]) for x in _springs(model) if x.joints == law.joints]
    total = float(sum(k for k, _ in each))
    return total, float(sum(k * rest for k, rest in each)) / total if total else 0.0


def _motors(model: Model) -> list[dict[str, str]]:
    """A motor per joint, limited by the effort limit and by torque saturation."""
    robot, limit = model.robot, model.robot.effort_limit.copy()
    for law in model.laws:
        if law.effect.name == "torque_saturation":
            limit[list(law.joints)] = np.minimum(limit[list(law.joints)], law.parameters["limit"])
    return [
        {"name": joint, "joint": joint, **({"forcerange": words([-most, most])} if np.isfinite(most) else {})}
        for joint, most in zip(robot.joints, limit.tolist(), strict=True)
    ]


def _notes(model: Model, follow: Sequence[_Follower], bodies: PossibleBodies) -> list[str]:
    robot = model.robot
    notes = fixed_note(robot, "they are rigid in the MJCF")
    if beyond := lacking(robot, model.laws, mjcf_laws(model)):
        notes.append(f"an MJCF cannot hold {beyond}")
    if np.isfinite(robot.velocity_limit).any():
        notes.append("an MJCF cannot hold velocity limits")
    ends = zip(robot.joints, np.isfinite(robot.lower), np.isfinite(robot.upper), strict=True)
    if half := [joint for joint, low, high in ends if low != high]:
        notes.append(f"an MJCF cannot hold a range with one end: {', '.join(half)}")
    if follow:
        each = ", ".join(f"{f.name} of {f.leader}" for f in follow)
        notes.append(f"mimic joints are equality constraints, which are slightly compliant in MuJoCo: {each}")
    notes += bodies.notes
    if empty := [link for link, body in zip(robot.links, bodies.links, strict=True) if body.mass <= LEAST]:
        notes.append(f"massless links get {LEAST:g} kg, since MuJoCo rejects zero mass: {', '.join(empty)}")
    return notes


def _places(robot: Robot) -> list[_Place]:
    """List the bodies of the model; held joints are part of the pose of their body."""
    at_zero = configuration(robot, np.zeros(len(robot.joints)))
    leaders = {own_row(robot, j): name for j, name in enumerate(robot.joints)}
    found = []
    for i in range(1, robot.model.njoints):
        pose, frames = robot.model.jointPlacements[i], []
        for joint, before in _parts(robot.model.joints[i]):
            pose = pose * before
            state = joint.createData()
            joint.calc(state, at_zero)
            if robot.drive[joint.idx_v : joint.idx_v + joint.nv].any():
                frames.append((joint.idx_v, pose, np.asarray(state.S, float).reshape(6, -1)[:, 0]))
            else:
                pose = pose * state.M
        name = str(robot.model.names[i])
        axes = [_axis(leaders.get(row, name), row, pose.actInv(frame), axis) for row, frame, axis in frames]
        found.append(_Place(int(robot.model.parents[i]), pose, tuple(axes)))
    return found


def _followers(robot: Robot) -> list[_Follower]:
    """List the mimic joints."""
    own = {own_row(robot, j) for j in range(len(robot.joints))}
    return [
        _Follower(axis.name, robot.joints[j], float(robot.rest[axis.row]), float(robot.drive[axis.row, j]))
        for place in _places(robot)
        for axis in place.axes
        if axis.row not in own
        for j in np.flatnonzero(robot.drive[axis.row])[:1]
    ]


def _parts(joint: Any) -> list[tuple[Any, Any]]:
    """Parts of a composite joint with their relative placements, or the joint itself."""
    if joint.shortname() != "JointModelComposite" or not is_plain(joint):
        return [(joint, pin.SE3.Identity())]
    whole = joint.extract()
    return list(zip(whole.joints, whole.jointPlacements, strict=True))


def _axis(name: str, row: int, frame: Any, motion: Array) -> _AxisPlace:
    slide = bool(np.any(motion[:3]))
    return _AxisPlace(row, name, slide, frame.translation, frame.rotation @ (motion[:3] if slide else motion[3:]))
