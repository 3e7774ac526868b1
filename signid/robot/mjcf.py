"""Read MJCF: MuJoCo compiles it, and the model is built from the bodies and joints that it compiled."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from functools import lru_cache
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..errors import RobotError, shorten
from . import sandbox
from .document import (
    Axis,
    Document,
    Draft,
    Mimic,
    bounded,
    check_count,
    check_names,
    impossible_notes,
    massless_note,
    restricted,
)
from .mjcf_tree import MIN_INERTIAL, included, prepare_tree

if TYPE_CHECKING:
    import pinocchio as pin

_MOVING_KINDS = ("hinge", "slide")
_JOINT_NUMBERS = ("ref", "damping", "frictionloss", "armature", "stiffness", "springref")  # of a joint in an MJCF
_LINE_NUMBER = re.compile(r",? line -?\d+")  # of the text that MuJoCo reads, which is not that of the file


class _Body(NamedTuple):
    """A compiled body: pose in its parent, mass [kg], principal moments [kg.m2] and their frame in the body."""

    name: str
    parent: int  # 0: world
    pos: Sequence[float]
    quat: Sequence[float]  # w x y z, as `iquat`
    ipos: Sequence[float]
    iquat: Sequence[float]
    mass: float
    inertia: Sequence[float]
    gravcomp: float  # compensated share of its weight [1]


class _Joint(NamedTuple):
    """A compiled joint, in the frame of its body, in [rad, N.m] or [m, N]."""

    name: str
    kind: str  # "free", "ball", "slide" or "hinge"
    body: int
    pos: Sequence[float]
    axis: Sequence[float]
    ref: float  # position at which the bodies have the poses of the file
    range: Sequence[float]
    limited: bool
    effort: float | None
    damping: float
    frictionloss: float
    armature: float
    stiffness: float
    springref: float
    nonlinear: bool  # stiffness or damping of higher order


class _Compiled(NamedTuple):
    """A compiled file: bodies without the world, joints in the order of bodies, joint constraints."""

    bodies: tuple[_Body, ...]
    joints: tuple[_Joint, ...]
    ties: tuple[tuple[int, int, list[float]], ...]  # joints (the second one may be -1), polynomial
    gravity: list[float]  # [m/s2]
    medium: bool  # density, viscosity or wind


def read_mjcf(document: Document) -> Draft:
    """Read an MJCF file; free bases are held fixed.

    Raises:
        RobotError: MuJoCo cannot compile the file, or there is no hinge or slide.
    """
    root, folder = deepcopy(document.root), Path(document.path).parent
    text = included(root, folder, document.text)
    source = prepare_tree(root, folder if document.path else None)
    content = json.loads(_run_cached(source.text) if not source.files else _run_compiler(source.text, source.files))
    for what, parts in (("body", content["bodies"]), ("joint", content["joints"])):
        for part in parts:
            for key, value in part.items():
                stated = f"{what} {part['name']!r} has {key}={value!r}"
                if key not in ("name", "kind", "range", "effort"):
                    _ = [bounded(float(number), stated) for number in np.atleast_1d(value)]
                elif key in ("range", "effort") and np.isnan(np.array(value, float)).any() and value is not None:
                    raise RobotError(f"{stated}; expected numbers")
    for _, _, polynomial in content["ties"]:
        _ = [bounded(number, f"a joint constraint has polycoef={polynomial}") for number in polynomial]
    _ = [bounded(number, f"gravity is {content['gravity']}") for number in content["gravity"]]
    for body in content["bodies"]:
        body["mass"], *body["inertia"] = (0.0 if x <= MIN_INERTIAL else x for x in (body["mass"], *body["inertia"]))
    compiled = _Compiled(
        tuple(_Body(**body) for body in content["bodies"]),
        tuple(_Joint(**joint) for joint in content["joints"]),
        tuple((first, second, polynomial) for first, second, polynomial in content["ties"]),
        content["gravity"],
        content["medium"],
    )
    moving = [joint for joint in compiled.joints if joint.kind in _MOVING_KINDS]
    check_count(len(compiled.bodies), len(moving), "bodies")
    check_names(joint=[joint.name for joint in compiled.joints], body=[body.name for body in compiled.bodies])
    if not moving:
        raise RobotError("the file has no moving joint (hinge or slide): nothing to identify")
    compiled, unnamed = _name_all(compiled)
    model, links, rows = _build(compiled)
    mimics: dict[str, Mimic] = {}  # linear constraints between two joints: q - ref = p0 + p1 (q2 - ref2)
    linear = [tie for tie in compiled.ties if tie[1] >= 0 and not any(tie[2][2:])]
    for follower, leader, (constant, scale, *_) in linear:
        joint, leading = compiled.joints[follower], compiled.joints[leader]
        mimics[joint.name] = Mimic(leading.name, scale, constant + joint.ref - scale * leading.ref)
    axes = [_mjcf_axis(joint, rows[i], mimics.get(joint.name)) for i, joint in enumerate(compiled.joints) if i in rows]
    name = root.get("model") or document.stem
    moved = dict(zip(links, list(model.inertias)[1:], strict=True))
    return Draft(
        name=name,
        model=model,
        axes=tuple(axes),
        links=links,
        document=_mjcf_text(name, compiled, root) if source.files else text,
        kind="mjcf",
        notes=(
            *unnamed,
            *source.notes,
            *_mjcf_notes(compiled, len(compiled.ties) - len(linear) + source.ignored),
            *massless_note({name: body.mass for name, body in moved.items()}),
            *impossible_notes({name: (body.mass, body.inertia) for name, body in moved.items()}),
        ),
        still=frozenset(joint.name for joint in compiled.joints if joint.kind == "ball"),
    )


def _run_compiler(text: str, files: Mapping[str, bytes]) -> str:
    with tempfile.TemporaryDirectory() as scratch:
        for name, data in {**files, sandbox.MODEL_FILE: text.encode()}.items():
            Path(scratch, name).write_bytes(data)
        late = f"MuJoCo cannot compile it in {sandbox.MAX_SECONDS} s; give fewer or smaller meshes"
        try:
            return restricted(scratch, [""], scratch, "MuJoCo cannot compile it", late).split("\n")[-1]
        except RobotError as error:
            raise RobotError(_LINE_NUMBER.sub("", str(error))) from None


@lru_cache(maxsize=64)
def _run_cached(text: str) -> str:
    return _run_compiler(text, {})


def _name_all(compiled: _Compiled) -> tuple[_Compiled, list[str]]:
    """Name all unnamed bodies and joints, and say so of joints."""
    used = {*(body.name for body in compiled.bodies), *(joint.name for joint in compiled.joints)}

    def name(kind: str, number: int, stated: str) -> str:
        if stated:
            return stated
        new = f"{kind}_{number}"
        while new in used:
            new += "_"
        used.add(new)
        return new

    joints = tuple(x._replace(name=name("joint", i, x.name)) for i, x in enumerate(compiled.joints, 1))
    bodies = tuple(x._replace(name=name("body", i, x.name)) for i, x in enumerate(compiled.bodies, 1))
    unnamed = sum(not joint.name for joint in compiled.joints)
    note = f"{unnamed} joints have no name; they are named joint_1, joint_2 ... in the order of the file"
    return compiled._replace(bodies=bodies, joints=joints), [note] if unnamed else []


def _build(compiled: _Compiled) -> tuple[pin.Model, tuple[str, ...], dict[int, int]]:
    """Build the model; return the link that each joint moves, and the row of each hinge and slide by its number."""
    import pinocchio as pin

    model = pin.Model()
    model.gravity.linear = np.array(compiled.gravity)
    place, links, rows = [(0, pin.SE3.Identity())], list[str](), dict[int, int]()
    for number, body in enumerate(compiled.bodies, 1):
        parent, above = place[body.parent]
        pose = above * _se3(body.pos, body.quat)
        joints = [i for i, joint in enumerate(compiled.joints) if joint.body == number and joint.kind in _MOVING_KINDS]
        if joints:
            axes = [compiled.joints[i] for i in joints]
            name = axes[0].name if len(axes) == 1 else f"Composite_{axes[0].name}"
            parent = model.addJoint(parent, *_joint_model(axes, pose), name)
            model.addJointFrame(parent)
            pose = _offset(axes[-1].pos).inverse()
            links.append(body.name)
            rows |= {i: model.joints[parent].idx_v + k for k, i in enumerate(joints)}
        rotation = _se3(body.ipos, body.iquat).rotation
        inertia = pin.Inertia(body.mass, np.array(body.ipos), rotation @ np.diag(body.inertia) @ rotation.T)
        model.appendBodyToJoint(parent, inertia, pose)
        model.addBodyFrame(body.name, parent, pose, -1)
        place.append((parent, pose))
    return model, tuple(links), rows


def _joint_model(axes: Sequence[_Joint], pose: pin.SE3) -> tuple[Any, pin.SE3]:
    """Joint of Pinocchio for the joints of a body, and its placement; `pose` is that of the body in the parent."""
    import pinocchio as pin

    whole, before = pin.JointModelComposite(), pose
    for joint in axes:
        shift = np.array(joint.axis) * -joint.ref  # back from the position of the file [rad or m]
        motion = pin.SE3(np.eye(3), shift) if joint.kind == "slide" else pin.SE3(pin.exp3(shift), np.zeros(3))
        before = before * _offset(joint.pos) * motion
        kind = "Revolute" if joint.kind == "hinge" else "Prismatic"
        letter = next((x for x, unit in zip("XYZ", np.eye(3), strict=True) if np.array_equal(unit, joint.axis)), "")
        unaligned = () if letter else (np.array(joint.axis),)
        part = getattr(pin, f"JointModel{kind[0]}{letter}" if letter else f"JointModel{kind}Unaligned")(*unaligned)
        if len(axes) == 1:
            return part, before
        whole.addJoint(part, before)
        before = _offset(joint.pos).inverse()
    return whole, pin.SE3.Identity()


def _offset(position: Sequence[float]) -> pin.SE3:
    return _se3(position, (1.0, 0.0, 0.0, 0.0))


def _se3(position: Sequence[float], quaternion: Sequence[float]) -> pin.SE3:
    """Pose of a position [m] and a quaternion w x y z."""
    import pinocchio as pin

    w, x, y, z = quaternion
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(position))


def _mjcf_axis(joint: _Joint, row: int, mimic: Mimic | None) -> Axis:
    lower, upper = joint.range if joint.limited else (-inf, inf)
    return Axis(
        name=joint.name,
        row=row,
        prismatic=joint.kind == "slide",
        lower=lower,
        upper=upper,
        effort=inf if joint.effort is None else joint.effort,
        viscous=joint.damping,
        coulomb=joint.frictionloss,
        armature=joint.armature,
        spring=(joint.stiffness, joint.springref),
        mimic=mimic,
    )


def _mjcf_notes(compiled: _Compiled, constraints: int) -> Iterator[str]:
    """Notes on what the file states and the model does not contain."""
    for joint in compiled.joints:
        if joint.kind == "free":
            yield f"body {compiled.bodies[joint.body - 1].name} is free; it is held fixed at the pose of the file"
    if constraints:
        what = "they are not linear between two joints, as those that close loops"
        yield f"{constraints} equality constraints are ignored: {what}"
    if still := [joint.name for joint in compiled.joints if joint.kind == "ball"]:
        yield f"held fixed at neutral: {shorten(still)}"
    if carried := [body.name for body in compiled.bodies if body.gravcomp and body.mass]:
        yield f"gravcomp of {shorten(carried)} is ignored: torque here includes the weight that MuJoCo compensates"
    if curved := [joint.name for joint in compiled.joints if joint.nonlinear]:
        yield f"stiffness and damping of higher order are ignored: {shorten(curved)}"
    if sprung := [joint.name for joint in compiled.joints if joint.stiffness and joint.kind in _MOVING_KINDS]:
        yield f"joint springs are laws of the simulation: {shorten(sprung)}"
    if compiled.medium:
        yield "forces of the medium (density, viscosity, wind) are ignored"


def _mjcf_text(name: str, compiled: _Compiled, source: Any) -> str:
    """MJCF of the compiled bodies and joints, with the time step of its source, which needs no other file."""
    from lxml import etree

    root = etree.Element("mujoco", {"model": name})
    etree.SubElement(root, "compiler", {"angle": "radian"})
    steps = [("timestep", x) for node in source.iter("option") if (x := node.get("timestep"))]
    etree.SubElement(root, "option", {"gravity": _words(compiled.gravity), **dict(steps)})
    nodes = [etree.SubElement(root, "worldbody")]
    for body in compiled.bodies:
        pose = {"name": body.name, "pos": _words(body.pos), "quat": _words(body.quat), "gravcomp": repr(body.gravcomp)}
        node = etree.SubElement(nodes[body.parent], "body", pose)
        nodes.append(node)
        if body.mass:
            inertial = {"pos": body.ipos, "quat": body.iquat, "mass": [body.mass], "diaginertia": body.inertia}
            etree.SubElement(node, "inertial", {key: _words(value) for key, value in inertial.items()})
    for joint in compiled.joints:
        stated = {"name": joint.name, "type": joint.kind}
        if joint.kind in _MOVING_KINDS:
            stated |= {key: _words(getattr(joint, key)) for key in ("pos", "axis", "range")}
            stated |= {key: repr(getattr(joint, key)) for key in _JOINT_NUMBERS}
            stated["limited"] = str(joint.limited).lower()
            effort = {} if joint.effort is None else {"actuatorfrcrange": f"{-joint.effort!r} {joint.effort!r}"}
            stated |= effort
        etree.SubElement(nodes[joint.body], "joint", stated)
    ties = etree.SubElement(root, "equality")
    for first, second, polynomial in compiled.ties:
        leader = {} if second < 0 else {"joint2": compiled.joints[second].name}
        follower = {"joint1": compiled.joints[first].name}
        etree.SubElement(ties, "joint", {**follower, **leader, "polycoef": _words(polynomial)})
    etree.indent(root)
    return str(etree.tostring(root, encoding="unicode"))


def _words(numbers: Sequence[float]) -> str:
    return " ".join(map(repr, numbers))
