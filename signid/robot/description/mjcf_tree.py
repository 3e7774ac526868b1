"""Prepare an MJCF tree for Pinocchio: resolve includes, name all elements, keep only those of the dynamics."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

from ...errors import RobotError, shorten
from .document import parse
from .limits import CARRIER, read_bytes
from .sandbox import may_read

_KEPT = ("body", "joint", "freejoint", "inertial", "geom")  # elements of a body that are kept
_UNREAD = ("frame", "replicate", "composite", "attach", "flexcomp")  # unsupported elements that create bodies
_CONTACT = ("contype", "conaffinity", "group")  # Pinocchio ignores the mass of geometry without contact
_DEPTH = 20  # maximum depth of nested includes


def included(root: Any, folder: Path, text: str) -> str:
    """Resolve the includes of an MJCF tree in place and return its text."""
    from lxml import etree

    if next(root.iter("include"), None) is None:
        return text
    _include(root, folder, 0)
    return str(etree.tostring(root, encoding="unicode"))


def prepare(root: Any) -> list[str]:
    """Simplify an MJCF tree in place; return a note on each loss.

    Raises:
        RobotError: the file uses elements that Pinocchio reads incorrectly.
    """
    notes = [*_name(root), *_prune(root), *_fix(root)]
    known = {"main", *(node.get("class") for node in root.iter("default"))}
    for node in below_world(root, _KEPT):
        for name in (node.get("class"), node.get("childclass")):
            if name and name not in known:
                fault = "which the file does not define; add its <default>"
                raise RobotError(f"a <{node.tag}> has the class {name!r}, {fault}")
    return notes


def _include(element: Any, folder: Path, depth: int) -> None:
    """Replace each <include> by the content of its file."""
    for node in list(element.iter("include")):
        path = folder / (node.get("file") or "")
        if depth > _DEPTH:
            raise RobotError(f"{path.name} includes itself; remove that <include>")
        if not may_read(path, [folder]):
            raise RobotError(f"the included file {path} lies outside the folder of the description; move it inside")
        try:
            part = parse(read_bytes(path).decode("utf-8-sig"))
        except (OSError, UnicodeDecodeError):
            raise RobotError(f"the included file {path} cannot be read; place it where <include> points") from None
        except RobotError as error:
            raise RobotError(f"included file {path.name}: {error}") from None
        _include(part, folder, depth + 1)
        place = node.getparent()
        where = place.index(node)
        place[where : where + 1] = list(part)


def _name(root: Any) -> Iterator[str]:
    """Name all unnamed bodies and joints, which Pinocchio would ignore."""
    used = {node.get("name") for node in root.iter("body", "joint", "freejoint")}
    numbered = sum(not node.get("name") for node in below_world(root, ("joint", "freejoint")))
    for kinds in (("joint", "freejoint"), ("body",)):
        for number, node in enumerate(below_world(root, kinds), 1):
            if not node.get("name"):
                name = f"{kinds[0]}_{number}"
                while name in used:
                    name += "_"
                node.set("name", name)
                used.add(name)
    names = [node.get("name") for node in below_world(root, ("joint", "freejoint"))]
    for name in names:
        if names.count(name) > 1:
            raise RobotError(f"the file has two joints named {name!r}; give each its own name")
    if numbered:
        yield f"{numbered} joints have no name; they are named joint_1, joint_2 ... in the order of the file"


def below_world(root: Any, kinds: tuple[str, ...]) -> list[Any]:
    """Elements with the given tags in the world, in the order of the file."""
    return [node for world in root.iter("worldbody") for node in world.iter(*kinds)]


def _prune(root: Any) -> Iterator[str]:
    """Remove elements without influence on the dynamics; geometry counts only for bodies without inertial."""
    for node in below_world(root, _UNREAD):
        advice = "give the compiled model as saved by MuJoCo"
        raise RobotError(f"the file uses <{node.tag}>, which signid does not read; {advice}")
    if compiler_setting(root, "coordinate") == "global":
        raise RobotError("the file uses global coordinates; load and save it with MuJoCo 2.3.3 or older")
    everywhere = compiler_setting(root, "inertiafromgeom") == "true"
    lost = []
    for world in root.iter("worldbody"):
        for node in [child for child in world if child.tag != "body"]:
            world.remove(node)
    for body in below_world(root, ("body",)):
        stated = body.find("inertial") is not None and not everywhere
        for node in list(body):
            if node.tag not in _KEPT or (node.tag == "geom" and stated):
                body.remove(node)
            elif node.tag == "geom" and node.get("mesh"):
                lost.append(body.get("name"))
                body.remove(node)
    for node in root.iter("geom"):
        for key in ("material", *_CONTACT):
            node.attrib.pop(key, None)
    if lost:
        yield f"the mass of the meshes of {shorten(sorted(set(lost)))} is not computed; add an <inertial> there"


def _fix(root: Any) -> Iterator[str]:
    """Fix free bodies at their initial pose, and put all bodies below one: Pinocchio reads only the first."""
    free = [node for node in below_world(root, ("freejoint", "joint")) if "free" in (node.get("type"), node.tag[:4])]
    for node in free:
        yield f"body {node.getparent().get('name')} is free; it is held fixed at the pose of the file"
        node.getparent().remove(node)
    for world in root.iterchildren("worldbody"):
        carrier = deepcopy(world)
        carrier.tag = "body"
        carrier.set("name", CARRIER)
        for child in list(world):
            world.remove(child)
        world.append(carrier)


def compiler_setting(root: Any, key: str, default: str = "") -> str:
    """Setting of the compiler; the last one counts."""
    return str(([default] + [node.get(key) for node in root.iterchildren("compiler") if node.get(key)])[-1])


def joint_attribute(root: Any, node: Any, key: str, default: str) -> str:
    """Attribute of a joint, by default from its class."""
    near = (above.get("childclass") for above in node.iterancestors("body") if above.get("childclass"))
    name = node.get("class") or next(near, None)
    classes = [x for x in root.iter("default") if x.get("class") == name] if name else []
    groups = [*classes, *(y for x in classes for y in x.iterancestors("default")), *root.iterchildren("default")]
    stated = (joint.get(key) for joint in (node, *(x for group in groups for x in group.iterchildren("joint"))))
    return str(next(filter(None, stated), default))
