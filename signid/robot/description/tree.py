"""Links and joints of a URDF, checked individually and for forming one tree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Any

from ...errors import RobotError, shorten
from .document import children
from .draft import Mimic

Vector = tuple[float, float, float]
MOVING = ("revolute", "continuous", "prismatic")
HELD = ("floating", "planar")
_KINDS = (*MOVING, *HELD, "fixed")
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
MOST = 1000  # maximum number of links
_BEYOND = 1e6  # [rad or m] limits from here on count as no limits


@dataclass(frozen=True)
class Pose:
    """Pose of a frame in its parent: position [m] and roll, pitch, yaw [rad]."""

    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Inertial:
    """Mass [kg], pose of the centre of mass, and ixx ixy ixz iyy iyz izz about it [kg.m2]."""

    mass: float
    pose: Pose
    moments: tuple[float, ...]

    @property
    def matrix(self) -> tuple[Vector, Vector, Vector]:
        """Inertia (3, 3) [kg.m2]."""
        xx, xy, xz, yy, yz, zz = self.moments
        return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


@dataclass(frozen=True)
class Link:
    """A link and its first <inertial>, if any."""

    name: str
    inertial: Inertial | None


@dataclass(frozen=True)
class Joint:
    """A joint as stated by the file; NaN friction where not stated."""

    name: str
    kind: str
    parent: str
    child: str
    pose: Pose
    axis: Vector = (1.0, 0.0, 0.0)
    lower: float = -inf
    upper: float = inf
    velocity: float = inf
    effort: float = inf
    viscous: float = nan
    coulomb: float = nan
    mimic: Mimic | None = None


@dataclass(frozen=True)
class Tree:
    """Links and joints in the order of the file."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    root: str


def read_tree(robot: Any, fallback: str) -> Tree:
    """Read the tree of a <robot> element.

    Args:
        robot: the element.
        fallback: name of the robot if the file has none.

    Raises:
        RobotError: invalid name, number or tree.
    """
    if len(children(robot, "link")) > MOST:
        raise RobotError(f"the file has more than {MOST} links; give the description of one robot")
    links = tuple(_link(element) for element in children(robot, "link"))
    joints = tuple(_joint(element) for element in children(robot, "joint"))
    return Tree(robot.get("name") or fallback, links, joints, _root(links, joints))


def _root(links: tuple[Link, ...], joints: tuple[Joint, ...]) -> str:
    names = [link.name for link in links]
    for what, given in (("links", names), ("joints", [joint.name for joint in joints])):
        for twice in _repeated(given):
            raise RobotError(f"the file has two {what} named {twice!r}; give each its own name")
    known = set(names)
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in known:
                raise RobotError(f"joint {joint.name!r} refers to a link {link!r} that the file does not have")
    for child in _repeated([joint.child for joint in joints]):
        raise RobotError(f"link {child!r} is the child of two joints; a URDF must be a tree")
    roots = [link.name for link in links if link.name not in {joint.child for joint in joints}]
    if not links:
        raise RobotError("the file has no link, and so no moving joint; give the complete description")
    if not roots:
        raise RobotError("the file has joints in a circle and no root link; a URDF must be a tree")
    if len(roots) > 1:
        raise RobotError(
            f"the file has {len(roots)} root links ({shorten(roots)}); connect them to one tree by fixed joints"
        )
    reached, parents = {roots[0]}, {joint.child: joint.parent for joint in joints}
    for link in names:
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


def _link(element: Any) -> Link:
    name = _name(element, "link")
    stated = children(element, "inertial")
    if not stated:
        return Link(name, None)
    where = f"link {name!r}"
    mass, inertia = children(stated[0], "mass"), children(stated[0], "inertia")
    moments = tuple(_number(inertia[0], key, where, 0.0) if inertia else 0.0 for key in _MOMENTS)
    kilograms = _number(mass[0], "value", where, 0.0) if mass else 0.0
    return Link(name, Inertial(kilograms, _pose(stated[0], where), moments))


def _joint(element: Any) -> Joint:
    name = _name(element, "joint")
    where, kind = f"joint {name!r}", element.get("type")
    if kind not in _KINDS:
        stated = f"has the unknown type {kind!r}" if kind else "has no type"
        raise RobotError(f"{where} {stated}; expected one of {', '.join(_KINDS)}")
    parent, child = (_end(element, end, where) for end in ("parent", "child"))
    pose = _pose(element, where)
    if kind not in MOVING:
        return Joint(name, kind, parent, child, pose)
    axis, limits = _axis(element, where), _limits(element, where, kind)
    return Joint(name, kind, parent, child, pose, axis, *limits, *_rest(element, where))


def _end(element: Any, end: str, where: str) -> str:
    for found in children(element, end):
        if found.get("link"):
            return str(found.get("link"))
    raise RobotError(f"{where} has no {end} link; add <{end} link=...>")


def _axis(element: Any, where: str) -> Vector:
    found = children(element, "axis")
    axis = _vector(found[0], "xyz", where, (1.0, 0.0, 0.0)) if found else (1.0, 0.0, 0.0)
    if not any(axis):
        raise RobotError(f"{where} has the axis 0 0 0; give it a direction")
    return axis


def _limits(element: Any, where: str, kind: str) -> tuple[float, float, float, float]:
    """Lower, upper, velocity and effort limit; missing values and zeros mean no limit."""
    found = children(element, "limit")
    if not found:
        return -inf, inf, inf, inf
    lower, upper = (_number(found[0], key, where, 0.0, finite=False) for key in ("lower", "upper"))
    velocity, effort = (abs(_number(found[0], key, where, 0.0, finite=False)) or inf for key in ("velocity", "effort"))
    if kind == "continuous" or not lower < upper:
        return -inf, inf, velocity, effort
    return (-inf if lower <= -_BEYOND else lower), (inf if upper >= _BEYOND else upper), velocity, effort


def _rest(element: Any, where: str) -> tuple[float, float, Mimic | None]:
    """Viscous and Coulomb friction, and the mimic element."""
    dynamics, mimic = children(element, "dynamics"), children(element, "mimic")
    friction = [_number(dynamics[0], key, where, nan) if dynamics else nan for key in ("damping", "friction")]
    if not mimic:
        return friction[0], friction[1], None
    followed = mimic[0].get("joint")
    if not followed:
        raise RobotError(f"{where} has a <mimic> without a joint; name the joint that it follows")
    scale = _number(mimic[0], "multiplier", where, 1.0), _number(mimic[0], "offset", where, 0.0)
    return friction[0], friction[1], Mimic(followed, *scale)


def _pose(element: Any, where: str) -> Pose:
    found = children(element, "origin")
    if not found:
        return Pose()
    zero = (0.0, 0.0, 0.0)
    return Pose(_vector(found[0], "xyz", where, zero), _vector(found[0], "rpy", where, zero))


def _name(element: Any, what: str) -> str:
    name: str = element.get("name") or ""
    if not name.strip():
        raise RobotError(f"the file has a {what} without a name in line {element.sourceline}; name it")
    return name


def _vector(element: Any, key: str, where: str, default: Vector) -> Vector:
    text = element.get(key)
    if text is None:
        return default
    values = [_float(word, key, where) for word in text.split()]
    if len(values) != 3:
        raise RobotError(f"{where} has {key}={text!r}; expected three numbers")
    return values[0], values[1], values[2]


def _number(element: Any, key: str, where: str, default: float, finite: bool = True) -> float:
    text = element.get(key)
    return default if text is None else _float(text, key, where, finite)


def _float(text: str, key: str, where: str, finite: bool = True) -> float:
    try:
        value = float(text.replace("_", "?"))
    except ValueError:
        hint = "; if this is xacro, rename the file to end in .xacro" if "$" in text else ""
        raise RobotError(f"{where} has {key}={text!r}; expected a number{hint}") from None
    if value != value or (finite and not isfinite(value)):
        raise RobotError(f"{where} has {key}={text!r}; expected a finite number")
    return value
