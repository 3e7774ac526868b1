"""Read URDF: Pinocchio builds the model from links and joints alone, without meshes, materials or plug-in tags.

`urdf_from_dh` writes it from a table of Denavit-Hartenberg parameters.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import cos, inf, isfinite, nan, pi, sin
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike

from ..errors import RobotError, shorten
from ..typed import typed
from ..types import Array
from .document import (
    Axis,
    Document,
    Draft,
    Mimic,
    bounded,
    check_count,
    check_names,
    children,
    impossible_notes,
    massless_note,
    not_negative,
)

_LOOP_NAME = re.compile(r"loop|closure|closing|four[_-]?bar|4[_-]?bar|linkage|crank|coupler", re.IGNORECASE)
_MIMIC_NAME = re.compile(r"[_-]mimic(?![a-z])", re.IGNORECASE)  # in the name of a joint that follows another one
_LOOP_CONSEQUENCE = "a URDF file is a tree, so the loops are missing, and forces through them are not modelled"
Vector = tuple[float, float, float]
MOVING_KINDS = ("revolute", "continuous", "prismatic")
HELD_KINDS = ("floating", "planar")
MOMENT_KEYS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_JOINT_KINDS = (*MOVING_KINDS, *HELD_KINDS, "fixed")
_MAX_LIMIT = 1e6  # [rad or m] limits from here on count as no limits
_ZERO_VECTOR = (0.0, 0.0, 0.0)
_DIGITS = 12  # decimals of computed numbers, so that cos(pi/2) is 0


def read_urdf(document: Document) -> Draft:
    """Read a URDF; the base is held fixed.

    Raises:
        RobotError: the description is not a tree of links with at least one moving joint.
    """
    import pinocchio as pin

    tree = read_tree(document.root, document.stem)
    moving = [joint for joint in tree.joints if joint.kind in MOVING_KINDS]
    if not moving:
        raise RobotError("the file has no moving joint (revolute, continuous, prismatic): nothing to identify")
    try:
        model = pin.buildModelFromXML(_mechanism(tree))
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"Pinocchio cannot build it: {str(error).strip().splitlines()[-1]}") from None
    child = {joint.name: joint.child for joint in tree.joints}
    axes = []
    for axis in (joint.axis for joint in moving):
        known = axis.mimic if axis.mimic and axis.mimic.joint in child else None
        axes.append(replace(axis, row=model.joints[model.getJointId(axis.name)].idx_v, mimic=known))
    unnamed = () if document.root.get("name") else (f"the robot has no name; it is named {tree.name} after its file",)
    carried = _carriers(tree)
    mass = dict.fromkeys(carried.values(), 0.0)
    for link, inertial in tree.links.items():
        mass[carried[link]] += inertial.mass if inertial else 0.0
    massless = frozenset(link for link, name in carried.items() if name and mass[name] == 0)
    return Draft(
        name=tree.name,
        model=model,
        axes=tuple(axes),
        links=tuple(child[name] for name in list(model.names)[1:]),
        document=document.text,
        kind="urdf",
        notes=(*unnamed, *_joint_notes(tree, moving, child), *left_out_notes(document.root, massless)),
        still=frozenset(joint.name for joint in tree.joints if joint.kind not in MOVING_KINDS),
    )


def _mechanism(tree: Tree) -> str:
    """URDF text of links, inertials and joints alone, with placeholder limits."""
    lines = [f"<robot name={quoteattr(tree.name)}>"]
    for link, inertial in tree.links.items():
        content = ""
        if inertial is not None:
            moments = " ".join(f'{key}="{x!r}"' for key, x in zip(MOMENT_KEYS, inertial.moments, strict=True))
            content = f'{_origin(inertial.pose)}<mass value="{inertial.mass!r}"/><inertia {moments}/>'
            content = f"<inertial>{content}</inertial>"
        lines.append(f"<link name={quoteattr(link)}>{content}</link>")
    for joint in tree.joints:
        name, parent, child = (quoteattr(x) for x in (joint.name, joint.parent, joint.child))
        lines.append(
            f'<joint name={name} type="{joint.kind}">{_origin(joint.pose)}'
            f"<parent link={parent}/><child link={child}/>"
            f'<axis xyz="{_xyz_text(joint.direction)}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    return "\n".join([*lines, "</robot>"])


def _origin(pose: Pose) -> str:
    return f'<origin xyz="{_xyz_text(pose.xyz)}" rpy="{_xyz_text(pose.rpy)}"/>'


def _xyz_text(vector: tuple[float, float, float]) -> str:
    return " ".join(map(repr, vector))


def _joint_notes(tree: Tree, moving: list[Joint], known: Container[str]) -> Iterator[str]:
    """One sentence for each kind of defect of the moving joints and links."""
    mimics = [(joint.name, joint.axis.mimic.joint) for joint in moving if joint.axis.mimic]
    if stray := [f"{name} ({followed})" for name, followed in mimics if followed not in known]:
        yield f"treated as independent, because they mimic joints that do not exist: {shorten(stray)}"
    carried = _carriers(tree)
    bodies: dict[str, float] = {}
    stated: dict[str, tuple[float, Array]] = {}
    for link, inertial in tree.links.items():
        if name := carried.get(link):
            bodies[name] = bodies.get(name, 0.0) + (inertial.mass if inertial else 0.0)
            if inertial:
                stated[link] = inertial.mass, np.array(inertial.moments)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    yield from (massless_note(bodies) + impossible_notes(stated))
    if held := [f"{joint.name} ({joint.kind})" for joint in tree.joints if joint.kind in HELD_KINDS]:
        yield f"held fixed at neutral: {shorten(held)}"
    lacking = {
        "position": [x.name for x in moving if x.kind != "continuous" and x.axis.upper - x.axis.lower == inf],
        "velocity": [x.name for x in moving if x.axis.velocity == inf],
        "effort": [x.name for x in moving if x.axis.effort == inf],
    }
    yield from (f"no {what} limit is stated for {shorten(joints)}" for what, joints in lacking.items() if joints)


def _carriers(tree: Tree) -> dict[str, str | None]:
    """Moving link that each link is rigidly attached to (itself if it moves); None at the base."""
    below: dict[str, list[Joint]] = {}
    for joint in tree.joints:
        below.setdefault(joint.parent, []).append(joint)
    result: dict[str, str | None] = {tree.root: None}
    stack = [tree.root]
    while stack:
        parent = stack.pop()
        for joint in below.get(parent, ()):
            result[joint.child] = result[parent] if joint.kind == "fixed" else joint.child
            stack.append(joint.child)
    return result


def left_out_notes(robot: Any, massless: Collection[str]) -> Iterator[str]:
    """At most one sentence for each kind of content that the model lacks.

    `robot` is the <robot> element; `massless` are the links whose moving body has no mass.
    """
    bare = [link for link in children(robot, "link") if link.get("name") in massless and not children(link, "inertial")]
    if drawn := [link.get("name") for link in bare if children(link, "visual") or children(link, "collision")]:
        theirs = "the shape of link" if len(drawn) == 1 else "the shapes of links"
        gives = "gives" if len(drawn) == 1 else "give"
        yield f"{theirs} {shorten(drawn)} {gives} no mass and no inertia; add an <inertial> there"
    names = [*_loop_names(robot, "joint"), *_loop_names(robot, "link")]
    if names:
        be = "is part of a closed linkage by its name" if len(names) == 1 else "are parts of closed linkages by name"
        yield f"{shorten(names)} {be}; {_LOOP_CONSEQUENCE}"
    closing = [str(joint.get("name")) for part in children(robot, "gazebo") for joint in children(part, "joint")]
    if closing:
        yield f"left out, because only a <gazebo> element states them: joints {shorten(closing)}; {_LOOP_CONSEQUENCE}"


def _loop_names(robot: Any, tag: str) -> list[str]:
    """Joints, or links, whose names show a closed linkage; a joint *_mimic with a <mimic> follows another one here."""
    follow = {part.get("name") for part in children(robot, tag) if children(part, "mimic")}
    names = [part.get("name") or "" for part in children(robot, tag)]
    shown = [name for name in names if _LOOP_NAME.search(name) or (_MIMIC_NAME.search(name) and name not in follow)]
    return [f"{tag} {name}" for name in shown if tag == "joint" or not _MIMIC_NAME.search(name)]


class Pose(NamedTuple):
    """Pose of a frame in its parent: position [m] and roll, pitch, yaw [rad]."""

    xyz: Vector
    rpy: Vector


class Inertial(NamedTuple):
    """Mass [kg], pose of the centre of mass, and ixx ixy ixz iyy iyz izz about it [kg.m2]."""

    mass: float
    pose: Pose
    moments: tuple[float, ...]


class Joint(NamedTuple):
    """A joint as stated by the file."""

    name: str
    kind: str
    parent: str
    child: str
    pose: Pose
    axis: Axis  # without limits if it does not move
    direction: Vector = (1.0, 0.0, 0.0)


class Tree(NamedTuple):
    """Inertials of the links by name (the first one of each, if any) and joints, in the order of the file."""

    name: str
    links: Mapping[str, Inertial | None]
    joints: tuple[Joint, ...]
    root: str


def read_tree(robot: Any, fallback: str) -> Tree:
    """Read the tree of a <robot> element; `fallback` names the robot if the file does not.

    Raises:
        RobotError: invalid name, number or tree.
    """
    moving = [element for element in children(robot, "joint") if element.get("type") in MOVING_KINDS]
    check_count(len(children(robot, "link")), len(moving))
    links = [_urdf_link(element) for element in children(robot, "link")]
    joints = tuple(_urdf_joint(element) for element in children(robot, "joint"))
    check_names(joint=[joint.name for joint in joints], link=[name for name, _ in links])
    return Tree(robot.get("name") or fallback, dict(links), joints, _root([name for name, _ in links], joints))


def _root(links: list[str], joints: tuple[Joint, ...]) -> str:
    known = set(links)
    for what, names in (("links", links), ("joints", [joint.name for joint in joints])):
        for twice in _repeated(names):
            raise RobotError(f"the file has two {what} named {twice!r}; give each its own name")
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in known:
                raise RobotError(f"joint {joint.name!r} refers to a link {link!r} that the file does not have")
    for child in _repeated([joint.child for joint in joints]):
        raise RobotError(f"link {child!r} is the child of two joints; a URDF must be a tree")
    parents = {joint.child: joint.parent for joint in joints}
    roots = [link for link in links if link not in parents]
    if not links:
        raise RobotError("the file has no link, and so no moving joint; give the complete description")
    if not roots:
        raise RobotError("the file has joints in a circle and no root link; a URDF must be a tree")
    if len(roots) > 1:
        advice = "connect them to one tree by fixed joints"
        raise RobotError(f"the file has {len(roots)} root links ({shorten(roots)}); {advice}")
    reached = {roots[0]}
    for link in links:
        chain = []
        while link not in reached:
            if link in chain:
                raise RobotError(f"the file has joints in a circle through link {link!r}; a URDF must be a tree")
            chain.append(link)
            link = parents[link]
        reached.update(chain)
    return roots[0]


def _repeated(names: list[str]) -> Iterator[str]:
    return (name for name, count in Counter(names).items() if count > 1)


def _urdf_link(element: Any) -> tuple[str, Inertial | None]:
    name = _name(element, "link")
    stated, where = _child(element, "inertial"), f"link {name!r}"
    if stated is None:
        return name, None
    moments = tuple(_number(_child(stated, "inertia"), key, where, 0.0) for key in MOMENT_KEYS)
    mass = _number(_child(stated, "mass"), "value", where, 0.0)
    return name, Inertial(mass, _pose(stated, where), moments)


def _urdf_joint(element: Any) -> Joint:
    name = _name(element, "joint")
    where, kind = f"joint {name!r}", element.get("type")
    if kind not in _JOINT_KINDS:
        stated = f"has the unknown type {kind!r}" if kind else "has no type"
        raise RobotError(f"{where} {stated}; expected one of {', '.join(_JOINT_KINDS)}")
    parent, child = (_end_link(element, end, where) for end in ("parent", "child"))
    pose = _pose(element, where)
    if kind not in MOVING_KINDS:
        return Joint(name, kind, parent, child, pose, Axis(name))
    direction = _vector(_child(element, "axis"), "xyz", where, (1.0, 0.0, 0.0))
    if not any(direction):
        raise RobotError(f"{where} has the axis 0 0 0; give it a direction")
    return Joint(name, kind, parent, child, pose, _urdf_axis(element, name, kind), direction)


def _end_link(element: Any, end: str, where: str) -> str:
    for end_element in children(element, end):
        if end_element.get("link"):
            return str(end_element.get("link"))
    raise RobotError(f"{where} has no {end} link; add <{end} link=...>")


def _urdf_axis(element: Any, name: str, kind: str) -> Axis:
    """Limits, friction and mimic element; missing limits and limits of zero are none."""
    where, limit, dynamics = f"joint {name!r}", _child(element, "limit"), _child(element, "dynamics")
    lower, upper, velocity, effort = (
        _number(limit, key, where, 0.0, finite=False) for key in ("lower", "upper", "velocity", "effort")
    )
    limited = kind != "continuous" and lower < upper
    return Axis(
        name,
        prismatic=kind == "prismatic",
        lower=lower if limited and lower > -_MAX_LIMIT else -inf,
        upper=upper if limited and upper < _MAX_LIMIT else inf,
        velocity=abs(velocity) or inf,
        effort=abs(effort) or inf,
        viscous=_dissipative(dynamics, "damping", where),
        coulomb=_dissipative(dynamics, "friction", where),
        mimic=_mimic(_child(element, "mimic"), where),
    )


def _dissipative(element: Any, key: str, where: str) -> float:
    value = _number(element, key, where, nan)
    return not_negative(value, f"{where} has {key}={value:g}")


def _mimic(element: Any, where: str) -> Mimic | None:
    if element is None:
        return None
    if not element.get("joint"):
        raise RobotError(f"{where} has a <mimic> without a joint; name the joint that it follows")
    scale = _number(element, "multiplier", where, 1.0), _number(element, "offset", where, 0.0)
    return Mimic(element.get("joint"), *scale)


def _pose(element: Any, where: str) -> Pose:
    origin = _child(element, "origin")
    return Pose(_vector(origin, "xyz", where, _ZERO_VECTOR), _vector(origin, "rpy", where, _ZERO_VECTOR))


def _name(element: Any, what: str) -> str:
    name: str = element.get("name") or ""
    if not name.strip():
        raise RobotError(f"the file has a {what} without a name in line {element.sourceline}; name it")
    return name


def _child(element: Any, tag: str) -> Any:
    """First child of a tag, None if there is none."""
    return next(iter(children(element, tag)), None)


def _vector(element: Any, key: str, where: str, default: Vector) -> Vector:
    text = None if element is None else element.get(key)
    if text is None:
        return default
    values = [_float(word, key, where) for word in text.split()]
    if len(values) != 3:
        raise RobotError(f"{where} has {key}={text!r}; expected three numbers")
    return values[0], values[1], values[2]


def _number(element: Any, key: str, where: str, default: float, finite: bool = True) -> float:
    text = None if element is None else element.get(key)
    return default if text is None else _float(text, key, where, finite)


def _float(text: str, key: str, where: str, finite: bool = True) -> float:
    try:
        value = float(text.replace("_", "?"))
    except ValueError:
        hint = "; if this is xacro, rename the file to end in .xacro" if "$" in text else ""
        raise RobotError(f"{where} has {key}={text!r}; expected a number{hint}") from None
    if finite:
        return bounded(value, f"{where} has {key}={text!r}")
    if value != value:
        raise RobotError(f"{where} has {key}={text!r}; expected a number")
    return value


@dataclass(frozen=True)
class DHLink:
    """A joint and its link in standard Denavit-Hartenberg parameters.

    The pose of the link frame in the previous one is Rot_z(theta) Trans_z(d) Trans_x(a) Rot_x(alpha). The joint
    position adds to theta, or to d of a prismatic joint. Mass, centre and inertia are given in the link frame.
    """

    alpha: float  # [rad]
    a: float  # [m]
    d: float  # [m]
    theta: float = 0.0  # [rad]
    prismatic: bool = False
    mass: float = 0.0  # [kg]
    centre: Sequence[float] = (0.0, 0.0, 0.0)  # (3,) centre of mass [m]
    inertia: ArrayLike = (0.0, 0.0, 0.0)  # about the centre: (3,) principal, (6,) Ixx Ixy Iyy Ixz Iyz Izz, or (3, 3)
    box: Sequence[float] | None = None  # (3,) size of the visual box around the centre [m]
    lower: float = -pi  # [rad or m]
    upper: float = pi  # [rad or m]
    velocity: float = 10.0  # limit [rad/s or m/s]
    effort: float = 1000.0  # limit [N.m or N]


@typed
def urdf_from_dh(name: str, links: Sequence[DHLink]) -> str:
    """Generate the URDF of a serial robot.

    >>> urdf = signid.urdf_from_dh("arm", [signid.robot.DHLink(alpha=0.0, a=0.3, d=0.1, mass=1.0)])

    Joints are `joint_1`..., links `base_link`, `link_1`..., and `tool` at the last frame. A URDF joint moves about its
    own frame, so the frame of `link_i` is that of DH link i - 1, moved by the joint.

    Args:
        name: name of the robot.
        links: rows of the table, from the base.

    Raises:
        RobotError: no link, a number that is not finite, or an array of another shape.

    Source: Siciliano, Sciavicco, Villani, Oriolo, Robotics, 2009, section 2.8.2.
    """
    if not links:
        raise RobotError("the table of Denavit-Hartenberg parameters has no row; give at least one link")
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={quoteattr(name)}>", '  <link name="base_link"/>']
    origin, parent = _dh_origin((0.0, 0.0, 0.0), 0.0, 0.0), "base_link"
    for i, link in enumerate(links, 1):
        numbers = [link.alpha, link.a, link.d, link.theta, link.mass]
        shapes = [np.shape(link.centre) == (3,), link.box is None or np.shape(link.box) == (3,)]
        inertia = np.asarray(link.inertia, float)
        if not all(shapes) or inertia.shape not in ((3,), (6,), (3, 3)):
            raise RobotError(f"row {i} of the table: give 3 numbers for centre and box, and 3, 6 or 3 x 3 for inertia")
        if not np.isfinite([*numbers, *link.centre, *inertia.ravel(), *(link.box or ())]).all():
            raise RobotError(f"row {i} of the table has a number that is not finite; give finite numbers")
        if inertia.shape == (3, 3) and not np.allclose(inertia, inertia.T):
            raise RobotError(
                f"row {i} of the table has an inertia that is not symmetric; give a symmetric 3 x 3 matrix"
            )
        if not -inf <= link.lower < link.upper <= inf:
            raise RobotError(f"row {i} of the table has limits {link.lower} to {link.upper}; give the lower one first")
        limits = {"lower": link.lower, "upper": link.upper, "velocity": link.velocity, "effort": link.effort}
        stated = " ".join(f'{key}="{_text(value)}"' for key, value in limits.items() if isfinite(value))
        kind, more = "prismatic" if link.prismatic else "revolute", ('<axis xyz="0 0 1"/>', f"<limit {stated}/>")
        lines += [*_dh_joint(f"joint_{i}", kind, parent, f"link_{i}", origin, *more), *_dh_link(i, link)]
        origin, parent = _dh_origin(_translation(link), link.alpha, link.theta), f"link_{i}"
    tool = _dh_joint("tool_joint", "fixed", parent, "tool", origin)
    return "\n".join([*lines, *tool, '  <link name="tool"/>', "</robot>", ""])


def _dh_joint(name: str, kind: str, parent: str, child: str, origin: str, *more: str) -> list[str]:
    inside = [origin, f'<parent link="{parent}"/>', f'<child link="{child}"/>', *more]
    return [f'  <joint name="{name}" type="{kind}">', *(f"    {element}" for element in inside), "  </joint>"]


def _dh_link(i: int, link: DHLink) -> list[str]:
    """Link with inertial and box in the axes of the DH frame."""
    (ct, st), (ca, sa) = (cos(link.theta), sin(link.theta)), (cos(link.alpha), sin(link.alpha))
    rotation = np.array([[ct, -st * ca, st * sa], [st, ct * ca, -ct * sa], [0.0, sa, ca]])  # Rot_z(theta) Rot_x(alpha)
    centre = tuple(np.add(_translation(link), rotation @ np.asarray(link.centre, float)))
    origin = _dh_origin(centre, link.alpha, link.theta)
    inertia = np.asarray(link.inertia, float)
    if inertia.ndim == 1:  # principal moments, or six in Pinocchio's order
        inertia = np.diag(inertia) if len(inertia) == 3 else inertia[[[0, 1, 3], [1, 2, 4], [3, 4, 5]]]
    moments = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), inertia[np.triu_indices(3)], strict=True)
    six = " ".join(f'{key}="{_text(value)}"' for key, value in moments)
    parts = {"inertial": [origin, f'<mass value="{_text(link.mass)}"/>', f"<inertia {six}/>"]}
    if link.box is not None:
        parts["visual"] = [origin, f'<geometry><box size="{" ".join(map(_text, link.box))}"/></geometry>']
    lines = [f'  <link name="link_{i}">']
    for tag, inside in parts.items():
        lines += [f"    <{tag}>", *(f"      {element}" for element in inside), f"    </{tag}>"]
    return [*lines, "  </link>"]


def _translation(link: DHLink) -> tuple[float, float, float]:
    return link.a * cos(link.theta), link.a * sin(link.theta), link.d


def _dh_origin(xyz: Sequence[float], alpha: float, theta: float) -> str:
    """Origin element; roll and yaw of the URDF equal alpha and theta."""
    position = " ".join(_text(round(x, _DIGITS)) for x in xyz)
    return f'<origin xyz="{position}" rpy="{_text(alpha)} 0 {_text(theta)}"/>'


def _text(value: float) -> str:
    """Shortest text of a number without loss of precision."""
    return repr(float(value) + 0.0).removesuffix(".0")
