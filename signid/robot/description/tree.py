"""Links and joints of a URDF, checked individually and for forming one tree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from math import inf, nan
from typing import Any, NamedTuple

from ...errors import RobotError, shorten
from .document import Axis, Mimic, children
from .limits import bounded, check_count, check_names, not_negative

Vector = tuple[float, float, float]
MOVING = ("revolute", "continuous", "prismatic")
HELD = ("floating", "planar")
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_KINDS = (*MOVING, *HELD, "fixed")
_BEYOND = 1e6  # [rad or m] limits from here on count as no limits
_ZERO = (0.0, 0.0, 0.0)


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
    moving = [element for element in children(robot, "joint") if element.get("type") in MOVING]
    check_count(len(children(robot, "link")), len(moving))
    links = [_link(element) for element in children(robot, "link")]
    joints = tuple(_joint(element) for element in children(robot, "joint"))
    check_names(joint=[joint.name for joint in joints], link=[name for name, _ in links])
    return Tree(robot.get("name") or fallback, dict(links), joints, _root([name for name, _ in links], joints))


def _root(links: list[str], joints: tuple[Joint, ...]) -> str:
    known = set(links)
    for what, given in (("links", links), ("joints", [joint.name for joint in joints])):
        for twice in _repeated(given):
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


def _link(element: Any) -> tuple[str, Inertial | None]:
    name = _name(element, "link")
    stated, where = _child(element, "inertial"), f"link {name!r}"
    if stated is None:
        return name, None
    moments = tuple(_number(_child(stated, "inertia"), key, where, 0.0) for key in MOMENTS)
    mass = _number(_child(stated, "mass"), "value", where, 0.0)
    return name, Inertial(mass, _pose(stated, where), moments)


def _joint(element: Any) -> Joint:
    name = _name(element, "joint")
    where, kind = f"joint {name!r}", element.get("type")
    if kind not in _KINDS:
        stated = f"has the unknown type {kind!r}" if kind else "has no type"
        raise RobotError(f"{where} {stated}; expected one of {', '.join(_KINDS)}")
    parent, child = (_end(element, end, where) for end in ("parent", "child"))
    pose = _pose(element, where)
    if kind not in MOVING:
        return Joint(name, kind, parent, child, pose, Axis(name))
    direction = _vector(_child(element, "axis"), "xyz", where, (1.0, 0.0, 0.0))
    if not any(direction):
        raise RobotError(f"{where} has the axis 0 0 0; give it a direction")
    return Joint(name, kind, parent, child, pose, _axis(element, name, kind), direction)


def _end(element: Any, end: str, where: str) -> str:
    for found in children(element, end):
        if found.get("link"):
            return str(found.get("link"))
    raise RobotError(f"{where} has no {end} link; add <{end} link=...>")


def _axis(element: Any, name: str, kind: str) -> Axis:
    """Limits, friction and mimic element; missing limits and limits of zero are none."""
    where, limit, dynamics = f"joint {name!r}", _child(element, "limit"), _child(element, "dynamics")
    lower, upper, velocity, effort = (
        _number(limit, key, where, 0.0, finite=False) for key in ("lower", "upper", "velocity", "effort")
    )
    limited = kind != "continuous" and lower < upper
    return Axis(
        name,
        prismatic=kind == "prismatic",
        lower=lower if limited and lower > -_BEYOND else -inf,
        upper=upper if limited and upper < _BEYOND else inf,
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
    return Pose(_vector(origin, "xyz", where, _ZERO), _vector(origin, "rpy", where, _ZERO))


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
