"""Export of a model as the robot's URDF: inertials and friction are replaced, every other byte is unchanged."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from ...errors import RobotError
from ...model import Model, stated_inertials
from ...robot import described_gravity
from ...robot.document import without_declaration
from ...types import Array, Robot
from .bodies import FRICTION_LAWS, Exported, about_centre, fixed_note, summed

_XML_TAG = re.compile(r"""<[^"'>]*(?:"[^"]*"[^"'>]*|'[^']*'[^"'>]*)*>""")
_INERTIA_ATTRIBUTES = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))


_Friction = tuple[float, float]  # damping [N.m.s/rad or N.s/m] and friction [N.m or N] of a joint; NaN: unchanged


class _Element(NamedTuple):
    """A link or joint of the robot, or a direct child of one, at characters start..stop."""

    tag: str
    name: str
    start: int
    inside: int  # end of the opening tag
    stop: int
    attributes: Mapping[str, str]
    children: list[_Element]


class _Edit(NamedTuple):
    start: int
    stop: int
    text: str


def write_urdf(model: Model) -> Exported:
    """Write the robot's URDF with the model's inertials, damping and friction.

    Unchanged links are kept byte for byte. Friction that the model lacks is removed.
    """
    robot = model.robot
    bodies = model.whole_inertials()
    same = np.all(np.isclose(bodies, stated_inertials(robot), rtol=1e-12, atol=1e-15), axis=1, keepdims=True)
    friction = (np.maximum(0.0, np.nan_to_num(summed(model, name))) for name in FRICTION_LAWS)
    text = urdf_with(robot, np.where(same, np.nan, bodies), *friction)
    notes = fixed_note(robot, "they move in the URDF")
    if not np.allclose(model.bodies().gravity.linear, described_gravity(robot), atol=1e-12):
        gravity = " ".join(repr(float(x)) for x in model.bodies().gravity.linear)
        notes.append(f"the gravity of the model is {gravity} m/s2")
    return Exported(text, tuple(notes))


def urdf_with(
    robot: Robot, bodies: Array, viscous_friction: Array | None = None, coulomb_friction: Array | None = None
) -> str:
    """Return the robot's URDF with new inertials and friction; comments, order, meshes and unknown tags are kept.

    The inertial of a moving link includes the links attached by fixed joints, whose inertials become a comment.

    Args:
        robot: robot loaded from a URDF or xacro file.
        bodies: (nb, 10) [kg, kg.m, kg.m2] inertial parameters about the joint frame of each link of `robot.links`, in
            Pinocchio's order; a row with NaN leaves the links of that body unchanged.
        viscous_friction: (n,) [N.m.s/rad or N.s/m] damping of the joints; NaN leaves a joint unchanged.
        coulomb_friction: (n,) [N.m or N] friction of the joints; NaN leaves a joint unchanged.

    Raises:
        RobotError: the robot was not loaded from a URDF, an array has a wrong shape, or a body cannot be written.
    """
    if robot.kind != "urdf":
        raise RobotError(f"export to URDF needs a URDF; {robot.name} was loaded from {robot.kind.upper()}")
    nothing = np.full(len(robot.joints), np.nan)
    viscous = nothing if viscous_friction is None else np.asarray(viscous_friction, float)
    coulomb = nothing if coulomb_friction is None else np.asarray(coulomb_friction, float)
    bodies = np.asarray(bodies, float)
    expected = ((len(robot.links), 10), nothing.shape, nothing.shape)
    if (bodies.shape, viscous.shape, coulomb.shape) != expected:
        raise RobotError(f"export of {robot.name} needs arrays of shapes {expected} for bodies and friction")
    text, elements = robot.document, _elements(robot.document)
    inertials = dict(zip(robot.links, bodies, strict=True))
    friction = dict[str, _Friction]()
    for name, joint in list(zip(robot.model.names, robot.model.joints, strict=True))[1:]:
        leads = np.flatnonzero(robot.drive[joint.idx_v])
        if name in robot.joints:
            friction[name] = (viscous[robot.index(name)], coulomb[robot.index(name)])
        elif len(leads):  # a mimic joint, whose leader includes its friction
            friction[name] = (0.0 * viscous[leads[0]], 0.0 * coulomb[leads[0]])
    edits = [*_inertial_edits(text, elements, inertials), *_friction_edits(text, elements, friction)]
    for edit in sorted(edits, reverse=True):
        text = text[: edit.start] + edit.text + text[edit.stop :]
    return text


def _elements(text: str) -> list[_Element]:
    """Links and joints of the robot with their children and character positions."""
    data = without_declaration(text).encode()
    character = np.cumsum(np.frombuffer(data, np.uint8) & 0xC0 != 0x80) - 1  # index of the character of each byte
    stack, elements = list[_Element](), list[_Element]()
    parser = expat.ParserCreate("utf-8")

    def start(tag: str, attributes: dict[str, str]) -> None:
        at = int(character[parser.CurrentByteIndex])
        opening = _XML_TAG.match(text, at)
        assert opening is not None, "expat reports the start of a tag"
        stack.append(_Element(tag, attributes.get("name", ""), at, opening.end(), 0, attributes, []))

    def end(_: str) -> None:
        element = stack.pop()
        closed = text[element.inside - 2] == "/"
        stop = element.inside if closed else text.index(">", int(character[parser.CurrentByteIndex])) + 1
        if len(stack) == 1:
            elements.append(element._replace(stop=stop))
        elif len(stack) == 2:
            stack[-1].children.append(element._replace(stop=stop))

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(data, True)
    return [element for element in elements if element.tag in ("link", "joint")]


def _inertial_edits(text: str, elements: list[_Element], inertials: Mapping[str, Array]) -> Iterator[_Edit]:
    above: dict[str, str] = {}
    for held in elements:
        ends = {child.tag: child.attributes.get("link", "") for child in held.children}
        if held.tag == "joint" and held.attributes.get("type") == "fixed":
            above[ends.get("child", "")] = ends.get("parent", "")
    carrier = {element.name: element.name for element in elements if element.tag == "link"}
    for rigid in carrier:
        while carrier[rigid] in above:
            carrier[rigid] = above[carrier[rigid]]
    for link in (element for element in elements if element.tag == "link"):
        name = carrier.get(link.name, "")
        if name not in inertials or np.isnan(inertials[name]).any():
            continue
        stated = [child for child in link.children if child.tag == "inertial"]
        if name == link.name:
            body = about_centre(inertials[name])
            if body is None:
                raise RobotError(f"the inertial of link {name} cannot be written: it needs finite numbers and a mass")
            mass, centre, inertia = body
            xyz = quoteattr(" ".join(repr(float(x) + 0.0) for x in centre))
            moments = " ".join(f"{key}={_quoted(inertia[i, j])}" for key, i, j in _INERTIA_ATTRIBUTES)
            lines = [
                f'  <origin xyz={xyz} rpy="0 0 0"/>',
                f"  <mass value={_quoted(mass)}/>",
                f"  <inertia {moments}/>",
            ]
            yield _inserted(text, link, stated[0] if stated else None, ["<inertial>", *lines, "</inertial>"])
        else:
            remark = f"<!-- inertial included in that of {re.sub('-(?=-)', '- ', name)} -->"
            yield from (_Edit(child.start, child.stop, remark) for child in stated[:1])


def _friction_edits(text: str, elements: list[_Element], friction: Mapping[str, _Friction]) -> Iterator[_Edit]:
    for joint in (element for element in elements if element.tag == "joint"):
        viscous, coulomb = friction.get(joint.name, (np.nan, np.nan))
        values = {key: x for key, x in (("damping", viscous), ("friction", coulomb)) if not np.isnan(x)}
        if not values:
            continue
        stated = next((child for child in joint.children if child.tag == "dynamics"), None)
        if stated is None and any(values.values()):
            tag = f"<dynamics {' '.join(f'{key}={_quoted(x)}' for key, x in values.items())}/>"
            yield _inserted(text, joint, None, [tag])
        elif stated is not None:
            opening = text[stated.start : stated.inside]
            for key, value in values.items():
                known = re.search(rf"""\s{key}\s*=\s*("[^"]*"|'[^']*')""", opening)
                end = re.search(r"\s*/?>$", opening)
                assert end is not None, "a tag ends in > or />"
                if known:
                    opening = opening[: known.start(1)] + _quoted(value) + opening[known.end(1) :]
                else:
                    opening = f"{opening[: end.start()]} {key}={_quoted(value)}{opening[end.start() :]}"
            yield _Edit(stated.start, stated.inside, opening)


def _inserted(text: str, parent: _Element, stated: _Element | None, lines: list[str]) -> _Edit:
    """Replace an element by lines, or insert them as first child of its parent, indented accordingly."""
    margin, newline = _margin(text, parent.start), "\r\n" if "\r\n" in text else "\n"
    inside = [stated] if stated else parent.children
    inner = next((_margin(text, child.start) for child in inside), margin + "  ")
    block = (newline + inner).join(lines)
    if stated:
        return _Edit(stated.start, stated.stop, block)
    if text[parent.inside - 2] == "/":  # <link name="x"/>
        opening = text[parent.start : parent.inside - 2].rstrip() + ">"
        return _Edit(parent.start, parent.stop, f"{opening}{newline}{inner}{block}{newline}{margin}</{parent.tag}>")
    return _Edit(parent.inside, parent.inside, f"{newline}{inner}{block}")


def _margin(text: str, at: int) -> str:
    """Indentation of an element that starts its line; else empty."""
    before = text[text.rfind("\n", 0, at) + 1 : at]
    return before if not before.strip() else ""


def _quoted(value: float) -> str:
    return quoteattr(repr(float(value) + 0.0))
