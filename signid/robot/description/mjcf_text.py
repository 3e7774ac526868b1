"""MJCF as text: includes resolved and checked, bodies and joints named, numbers and counts bounded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...errors import RobotError
from .document import parse
from .limits import MOST_BYTES, bounded, check_count, check_names, not_negative, read_bytes
from .sandbox import may_read

MOST_INCLUDES, DEPTH = 500, 20  # files of one description, nested includes
UNREAD = ("composite", "attach", "flexcomp", "flex", "plugin")  # elements of bodies that need files or other physics
APART = (  # sections without influence on rigid-body dynamics; they refer to files
    *("asset", "visual", "sensor", "keyframe", "contact", "actuator", "tendon", "deformable", "extension", "custom"),
    *("size", "statistic"),
)
FRICTION = ("damping", "frictionloss", "armature")
NUMBERS = (
    "pos quat axisangle xyaxes zaxis euler axis ref springref stiffness damping frictionloss armature margin "
    "mass density diaginertia fullinertia size fromto shellinertia"
).split()  # attributes of bodies, joints, inertials and geometry


@dataclass
class _Included:
    files: int = 0
    bytes: int = 0
    text: dict[Path, str] = field(default_factory=dict)


def included(root: Any, folder: Path, text: str) -> str:
    """Resolve the includes of an MJCF tree in place and return its text.

    Raises:
        RobotError: a file lies outside the folder or cannot be read, or there are too many.
    """
    from lxml import etree

    if next(root.iter("include"), None) is None:
        return text
    _include(root, folder, 0, _Included())
    return str(etree.tostring(root, encoding="unicode"))


def dynamics_text(root: Any) -> tuple[str, list[str]]:
    """Text of an MJCF for MuJoCo, without the sections that refer to files, and a note on each loss.

    Unnamed bodies and joints get names. The tree is changed.

    Raises:
        RobotError: the file has a name, number or count that is not accepted, or an element that is not read.
    """
    from lxml import etree

    for node in below_world(root, UNREAD):
        advice = "give the compiled model as saved by MuJoCo"
        raise RobotError(f"the file uses <{node.tag}>, which signid does not read; {advice}")
    bodies, joints = below_world(root, ("body",)), below_world(root, ("joint", "freejoint"))
    check_count(sum(map(_copies, bodies)), sum(_copies(joint) for joint in joints if joint.tag == "joint"), "bodies")
    check_names(joint=[node.get("name") for node in joints], body=[node.get("name") for node in bodies])
    _bound(root)
    notes = list(_name(root))
    ignored = sum(len(node) for node in root.iterchildren("tendon"))
    if ignored:
        notes.append(f"{ignored} tendons are ignored, with their springs and dampers")
    for node in [child for child in root if child.tag in APART]:
        root.remove(node)
    return str(etree.tostring(root, encoding="unicode")), notes


def below_world(root: Any, kinds: tuple[str, ...]) -> list[Any]:
    """Elements with the given tags in the world, in the order of the file."""
    return [node for world in root.iter("worldbody") for node in world.iter(*kinds)]


def _include(element: Any, folder: Path, depth: int, seen: _Included) -> None:
    """Replace each <include> by the content of its file."""
    for node in list(element.iter("include")):
        path = folder / (node.get("file") or "")
        seen.files += 1
        if depth > DEPTH:
            raise RobotError(f"{path.name} includes itself; remove that <include>")
        if not may_read(path, [folder]):
            raise RobotError(f"the included file {path} lies outside the folder of the description; move it inside")
        part = _part(path, seen)
        if seen.files > MOST_INCLUDES or seen.bytes > MOST_BYTES:
            most = f"more than {MOST_INCLUDES} files or {MOST_BYTES / 1e6:.0f} MB"
            raise RobotError(f"the file includes {most}; give the description of one robot")
        _include(part, folder, depth + 1, seen)
        place = node.getparent()
        where = place.index(node)
        place[where : where + 1] = list(part)


def _part(path: Path, seen: _Included) -> Any:
    """Tree of an included file, whose text is read once."""
    try:
        if path not in seen.text:
            seen.text[path] = read_bytes(path).decode("utf-8-sig")
        seen.bytes += len(seen.text[path])
        return parse(seen.text[path])
    except (OSError, UnicodeDecodeError):
        raise RobotError(f"the included file {path} cannot be read; place it where <include> points") from None
    except RobotError as error:
        raise RobotError(f"included file {path.name}: {error}") from None


def _copies(node: Any) -> int:
    """Number of copies of an element that <replicate> makes."""
    copies = 1
    for above in node.iterancestors("replicate"):
        try:
            copies *= max(int(above.get("count", "1")), 1)
        except ValueError:
            raise RobotError(f"a <replicate> has count={above.get('count')!r}; expected a whole number") from None
    return copies


def _bound(root: Any) -> None:
    """Check the magnitude of the numbers that shape the dynamics, in place: negligible ones become 0."""
    for node in root.iter("body", "joint", "inertial", "geom"):
        for key in (key for key in NUMBERS if node.get(key)):
            stated = f"a <{node.tag}> has {key}={node.get(key)!r}"
            words = node.get(key).split()
            node.set(key, " ".join(_bounded(word, stated, key in FRICTION) for word in words))


def _bounded(word: str, stated: str, positive: bool) -> str:
    try:
        number = float(word)
    except ValueError:
        raise RobotError(f"{stated}; expected finite numbers") from None
    if positive:
        not_negative(number, stated)
    return word if bounded(number, stated) else "0"


def _name(root: Any) -> Iterator[str]:
    """Name all unnamed bodies and joints."""
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
