"""An MJCF tree made ready for Pinocchio: includes in their places, all named, only what has a part in the dynamics."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

from ...errors import RobotError, shorten
from .document import parse
from .sandbox import may_read

_KEPT = ("body", "joint", "freejoint", "inertial", "geom")  # of what stands in a body
_UNREAD = ("frame", "replicate", "composite", "attach", "flexcomp")  # these would make bodies of their own
_DEPTH = 20  # of includes in includes


def included(root: Any, folder: Path, text: str) -> str:
    """The text of an MJCF file after the files that it includes were put into its tree.

    Raises:
        RobotError: when an included file cannot be read.
    """
    if next(root.iter("include"), None) is None:
        return text
    _include(root, folder, 0)
    return _text(root)


def prepare(root: Any) -> list[str]:
    """Change the tree of an MJCF file in place; a note on each thing that the dynamics lose by it.

    Raises:
        RobotError: when the file uses what Pinocchio would get wrong.
    """
    notes = [*_name(root), *_prune(root), *_fix(root)]
    _check_classes(root)
    return notes


def _check_classes(root: Any) -> None:
    known = {"main", *(node.get("class") for node in root.iter("default"))}
    for node in below_world(root, _KEPT):
        for name in (node.get("class"), node.get("childclass")):
            if name and name not in known:
                raise RobotError(
                    f"a <{node.tag}> is of the class {name!r}, which the file does not have; add its <default>"
                )


def _text(root: Any) -> str:
    from lxml import etree

    return str(etree.tostring(root, encoding="unicode"))


def _include(element: Any, folder: Path, depth: int) -> None:
    """Put the content of included files in the place of each <include>."""
    for node in list(element.iter("include")):
        path = folder / (node.get("file") or "")
        if depth > _DEPTH:
            raise RobotError(f"{path.name} includes itself; remove that <include>")
        if not may_read(path, [folder]):
            raise RobotError(f"the included file {path} lies outside the folder of the description; put it inside")
        try:
            part = parse(path.read_text("utf-8-sig"))
        except (OSError, UnicodeDecodeError):
            raise RobotError(f"the included file {path} cannot be read; put it where <include> says") from None
        except RobotError as error:
            raise RobotError(f"included file {path.name}: {error}") from None
        _include(part, folder, depth + 1)
        place = node.getparent()
        where = place.index(node)
        place[where : where + 1] = list(part)


def _name(root: Any) -> Iterator[str]:
    """Give a name to every body and joint that has none: Pinocchio would leave it out."""
    used = {node.get("name") for node in root.iter("body", "joint", "freejoint")}
    numbered = 0
    for kinds, stem in ((("joint", "freejoint"), "joint"), (("body",), "body")):
        unnamed = [node for node in below_world(root, kinds) if not node.get("name")]
        for number, node in enumerate(below_world(root, kinds), 1):
            if not node.get("name"):
                name = f"{stem}_{number}"
                while name in used:
                    name += "_"
                node.set("name", name)
                used.add(name)
        numbered += len(unnamed) if stem == "joint" else 0
    names = [node.get("name") for node in below_world(root, ("joint", "freejoint"))]
    for name in names:
        if names.count(name) > 1:
            raise RobotError(f"the file has two joints named {name!r}; give each its own name")
    if numbered:
        yield f"{numbered} joints have no name; they are called joint_1, joint_2 ... by their place in the file"


def below_world(root: Any, kinds: tuple[str, ...]) -> list[Any]:
    """Elements of those tags in the world, in the order of the file."""
    return [node for world in root.iter("worldbody") for node in world.iter(*kinds)]


def _prune(root: Any) -> Iterator[str]:
    """Drop what has no part in the dynamics; geometry counts only where a body states no inertial."""
    for node in below_world(root, _UNREAD):
        raise RobotError(f"the file uses <{node.tag}>, which signid does not read; let MuJoCo save the compiled model")
    if compiler_setting(root, "coordinate") == "global":
        raise RobotError("the file uses global coordinates; let MuJoCo 2.3.3 or older load and save it")
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
        for key in ("material", "contype", "conaffinity", "group"):  # Pinocchio weighs no geometry without contact
            node.attrib.pop(key, None)
    if lost:
        yield f"no mass is read from the meshes of {shorten(sorted(set(lost)))}; state an <inertial> there"


def _fix(root: Any) -> Iterator[str]:
    """Hold free bodies where the file puts them, and let one body carry all: Pinocchio reads only the first."""
    free = [node for node in below_world(root, ("freejoint", "joint")) if "free" in (node.get("type"), node.tag[:4])]
    for node in free:
        yield f"body {node.getparent().get('name')} is free; it is held fixed where the file puts it"
        node.getparent().remove(node)
    for world in root.iterchildren("worldbody"):
        carrier = deepcopy(world)
        carrier.tag = "body"
        carrier.set("name", "world body")
        for child in list(world):
            world.remove(child)
        world.append(carrier)


def compiler_setting(root: Any, key: str, default: str = "") -> str:
    """A setting of the compiler, the last one stated."""
    return str(([default] + [node.get(key) for node in root.iterchildren("compiler") if node.get(key)])[-1])


def joint_attribute(root: Any, node: Any, key: str, default: str) -> str:
    """An attribute of a joint, from its class where it does not state one itself."""
    if node.get(key):
        return str(node.get(key))
    near = (above.get("childclass") for above in node.iterancestors("body") if above.get("childclass"))
    name = node.get("class") or next(near, None)
    classes = [x for x in root.iter("default") if x.get("class") == name] if name else []
    for group in [*classes, *(y for x in classes for y in x.iterancestors("default")), *root.iterchildren("default")]:
        for stated in group.iterchildren("joint"):
            if stated.get(key):
                return str(stated.get(key))
    return default
