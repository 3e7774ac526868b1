"""Export of a model as MJCF, the format of MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...model import Model
from ...robot.dynamics import joint_of_row, own_row
from ...types import Law, Robot
from .beyond import BODIES, Exported, commented, fixed_note, held, lacking, summed
from .inertial import LEAST, Principal
from .places import AxisPlace, Follower, followers, places
from .possible import PossibleBodies, possible_bodies
from .shapes import Shapes, quaternion, read_shapes, words

_NUMBERS = {"damping": "viscous_friction", "frictionloss": "coulomb_friction", "armature": "armature"}
_DENSITY = 2700.0  # density at which a payload is drawn [kg/m3]


def write_mjcf(model: Model, package_dirs: Sequence[str | Path] = ()) -> Exported:
    """Write MJCF with bodies, joints, gravity, ranges, armature, friction and springs, and a motor per joint.

    Mimic joints become equality constraints. Shapes are visual only: mass comes from inertials, and nothing collides.

    Args:
        model: rigid bodies and laws.
        package_dirs: folders to search for meshes.

    Raises:
        RobotError: no physically consistent bodies, as MuJoCo requires, give the torque of the model.
    """
    from lxml import etree

    robot, bodies, follow = model.robot, possible_bodies(model), followers(model.robot)
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
    for i, (place, link, body) in enumerate(zip(places(robot), robot.links, bodies.links, strict=True), 1):
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


def _joint(model: Model, axis: AxisPlace) -> dict[str, str]:
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


def _notes(model: Model, follow: Sequence[Follower], bodies: PossibleBodies) -> list[str]:
    robot = model.robot
    notes = fixed_note(robot, "they are rigid in the MJCF")
    if beyond := lacking(robot, model.laws, mjcf_laws(model)):
        notes.append(f"an MJCF cannot hold {beyond}")
    if np.isfinite(robot.velocity_limit).any():
        notes.append("an MJCF cannot hold velocity limits")
    if half := [
        x for x, *ends in zip(robot.joints, robot.lower, robot.upper, strict=True) if np.isfinite(ends).sum() == 1
    ]:
        notes.append(f"an MJCF cannot hold a range with one end: {', '.join(half)}")
    if follow:
        each = ", ".join(f"{f.name} of {f.leader}" for f in follow)
        notes.append(f"mimic joints are equality constraints, which are slightly compliant in MuJoCo: {each}")
    notes += bodies.notes
    if empty := [link for link, body in zip(robot.links, bodies.links, strict=True) if body.mass <= LEAST]:
        notes.append(f"massless links get {LEAST:g} kg, since MuJoCo rejects zero mass: {', '.join(empty)}")
    return notes
