"""Prepare an MJCF tree for MuJoCo's compiler: resolve includes, read meshes, keep only what shapes the dynamics."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from ..errors import RobotError, shorten
from .document import MAX_FILE_BYTES, bounded, check_count, not_negative, parse, read_bytes
from .sandbox import may_read

_COMPILER_KEYS = (
    "angle autolimits balanceinertia boundinertia boundmass eulerseq inertiafromgeom inertiagrouprange settotalmass"
).split()  # attributes of <compiler> that shape the dynamics
_MEDIUM_KEYS = ("gravity", "density", "viscosity", "wind")  # attributes of <option> that do
_PLACE_TAGS = ("body", "frame", "replicate", "attach")  # elements that create or place bodies
_KEPT_TAGS = (*_PLACE_TAGS, "joint", "freejoint", "inertial", "geom")
_DEFAULT_TAGS = ("default", "joint", "geom", "mesh", "equality")  # elements of a <default> that are kept
_ASSET_KEYS = ("material", "hfield")  # attributes of geometry that refer to removed assets
_DEFORMABLE_TAGS = ("composite", "flexcomp")  # elements that create deformable bodies
_NUMBER_KEYS = (
    "pos quat axisangle xyaxes zaxis euler axis ref springref stiffness damping frictionloss armature margin "
    "mass density diaginertia fullinertia size fromto"
).split()  # attributes of bodies, joints, inertials and geometry
_FRICTION_KEYS = ("damping", "frictionloss", "armature")
_DEPTH = 20  # maximum depth of nested files
_MAX_FILES = 500  # maximum number of included and attached files
_MAX_ELEMENTS = 100_000  # maximum number of elements of the world, with those that are replicated
MIN_INERTIAL = 2e-15  # [kg, kg.m2] what MuJoCo gets in place of zero mass and inertia, which it rejects


@dataclass
class Source:
    """An MJCF text for MuJoCo's compiler, and the files that it refers to, by name."""

    text: str = ""
    files: dict[str, bytes] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    ignored: int = 0  # constraints that are not between joints
    read: int = 0  # number of files read
    size: int = 0  # of these files [bytes]


def included(root: Any, folder: Path, text: str) -> str:
    """Resolve the includes of an MJCF tree in place and return its text."""
    from lxml import etree

    if next(root.iter("include"), None) is None:
        return text
    _include(root, folder, Source(), 0)
    text = str(etree.tostring(root, encoding="unicode"))
    parse(text)  # rejects what has become too deep
    return text


def prepare_tree(root: Any, folder: Path | None) -> Source:
    """Write an MJCF tree without includes for the compiler; it is changed.

    Meshes and attached models are read below `folder`, the place of the file; None if it has none.

    Raises:
        RobotError: too many or too large elements, or elements that are not read.
    """
    source = Source()
    text, counts = _dynamic_part(root, folder, source, 0)
    check_count(counts["body"], counts["joint"], "bodies")
    if sum(counts.values()) > _MAX_ELEMENTS:
        raise RobotError(f"the world has more than {_MAX_ELEMENTS} elements; give the description of one robot")
    source.text = text
    return source


def _include(element: Any, folder: Path, source: Source, depth: int) -> None:
    """Replace each <include> by the content of its file."""
    for node in list(element.iter("include")):
        part = _read_tree(node, folder, source, depth, "included")
        _include(part, folder, source, depth + 1)
        place = node.getparent()
        if place is None:
            raise RobotError("the file is an <include> itself; give the file that it includes")
        where = place.index(node)
        place[where : where + 1] = list(part)


def _read_tree(node: Any, folder: Path, source: Source, depth: int, how: str) -> Any:
    """Tree of the file that an element refers to."""
    path = folder / (node.get("file") or "")
    if depth > _DEPTH:
        raise RobotError(f"{path.name} is more than {_DEPTH} files deep, or includes itself; remove that <{node.tag}>")
    source.read += 1
    if source.read > _MAX_FILES:
        raise RobotError(f"the file includes more than {_MAX_FILES} files; give the description of one robot")
    if not may_read(path, [folder]):
        raise RobotError(f"the {how} file {path} lies outside the folder of the description; move it inside")
    try:
        return parse(_read_limited(path, source).decode("utf-8-sig"))
    except (OSError, UnicodeDecodeError):
        raise RobotError(f"the {how} file {path} cannot be read; place it where <{node.tag}> points") from None
    except RobotError as error:
        raise RobotError(f"{how} file {path.name}: {error}") from None


def _read_limited(path: Path, source: Source) -> bytes:
    """Content of a file; the sum of all is limited as that of one."""
    data = read_bytes(path)
    source.size += len(data)
    if source.size > MAX_FILE_BYTES:
        raise RobotError(f"its files have more than {MAX_FILE_BYTES / 1e6:.0f} MB; give the description of one robot")
    return data


def _dynamic_part(root: Any, folder: Path | None, source: Source, depth: int) -> tuple[str, Counter[str]]:
    """Text of a file without what does not shape the dynamics, and the number of its elements by tag."""
    from lxml import etree

    settings = _last_attributes(root, "compiler", (*_COMPILER_KEYS, "meshdir", "assetdir", "strippath"))
    # numbers that shape the dynamics: negligible ones become 0
    for node in root.iter("body", "frame", "replicate", "joint", "inertial", "geom"):
        for key in (key for key in _NUMBER_KEYS if node.get(key)):
            stated = f"a <{node.tag}> has {key}={node.get(key)!r}"
            words = node.get(key).split()
            node.set(key, " ".join(_check_number(word, stated, key in _FRICTION_KEYS) for word in words))
    for world in root.iterchildren("worldbody"):
        for node in world.iter(*_DEFORMABLE_TAGS):
            raise RobotError(f"the file uses <{node.tag}>, which makes deformable bodies; give a file of rigid ones")
    if _last_attributes(root, "compiler", ("coordinate",)).get("coordinate") == "global":
        raise RobotError("the file uses global coordinates; load and save it with MuJoCo 2.3.3 or older")
    bare = etree.Element("mujoco", {"model": root.get("model") or "robot"})
    kept = {key: settings[key] for key in _COMPILER_KEYS if key in settings}
    etree.SubElement(bare, "compiler", kept | {key: _min_inertial(kept, key) for key in ("boundmass", "boundinertia")})
    option = etree.SubElement(bare, "option", _last_attributes(root, "option", _MEDIUM_KEYS))
    option.extend([flag for node in root.iterchildren("option") for flag in node.iterchildren("flag")])
    for node in root.iterchildren("default"):
        _prune_class(node)
        bare.append(node)
    worlds = list(root.iterchildren("worldbody"))
    for world in worlds:
        _prune(world, True, settings.get("inertiafromgeom") == "true")
    models = _attached_models(root, bare, folder, source, depth)
    lost = _meshes(root, bare, worlds, settings, folder, source)
    if lost:
        source.notes.append(f"the mass of the meshes of {lost} is not computed; add an <inertial> there")
    bare.extend(worlds)
    ties = [node for group in root.iterchildren("equality") for node in group.iterchildren("*")]
    source.ignored += sum(node.tag != "joint" and node.get("active") != "false" for node in ties)
    if tendons := sum(len(group) for group in root.iterchildren("tendon")):
        source.notes.append(f"{tendons} tendons are ignored, with their stiffness, damping and friction")
    etree.SubElement(bare, "equality").extend([node for node in ties if node.tag == "joint"])
    counts = sum((_count_elements(world, models) for world in worlds), Counter[str]())
    return str(etree.tostring(bare, encoding="unicode")), counts


def _last_attributes(root: Any, tag: str, keys: tuple[str, ...]) -> dict[str, str]:
    """Attributes of a section; the last one counts."""
    return {key: node.get(key) for node in root.iterchildren(tag) for key in keys if node.get(key)}


def _min_inertial(settings: dict[str, str], key: str) -> str:
    """Lower bound of masses or inertias: that of the file, or one that counts as none."""
    stated = settings.get(key, "0")
    try:
        return stated if not float(stated) < MIN_INERTIAL else repr(MIN_INERTIAL)
    except ValueError:
        return stated


def _check_number(word: str, stated: str, positive: bool) -> str:
    try:
        number = float(word)
    except ValueError:
        return word  # MuJoCo rejects it
    if positive:
        not_negative(number, stated)
    return word if bounded(number, stated) else "0"


def _prune_class(node: Any) -> None:
    for child in list(node):
        if child.tag not in _DEFAULT_TAGS:
            node.remove(child)
        elif child.tag == "default":
            _prune_class(child)
        else:
            _remove_plugins(child)


def _remove_plugins(node: Any) -> None:
    """Remove plug-ins, and references to removed assets."""
    for child in list(node):
        node.remove(child)
    for key in _ASSET_KEYS:
        node.attrib.pop(key, None)


def _prune(node: Any, stated: bool, everywhere: bool) -> None:
    """Remove elements without influence on the dynamics; geometry counts only for bodies without inertial."""
    for child in list(node):
        if child.tag not in _KEPT_TAGS or (child.tag == "geom" and stated):
            node.remove(child)
        elif child.tag == "body":
            _prune(child, child.find("inertial") is not None and not everywhere, everywhere)
        elif child.tag in ("frame", "replicate"):
            _prune(child, stated, everywhere)
        else:
            _remove_plugins(child)


def _attached_models(root: Any, bare: Any, folder: Path | None, source: Source, depth: int) -> dict[str, Counter[str]]:
    """Prepare the models that a file attaches; return the number of their elements by name and tag."""
    from lxml import etree

    counts: dict[str, Counter[str]] = {}
    for node in (node for group in root.iterchildren("asset") for node in group.iterchildren("model")):
        if folder is None:
            raise RobotError("the description attaches other files; give it as a file")
        part, place = _read_tree(node, folder, source, depth, "attached"), (folder / (node.get("file") or "")).parent
        _include(part, place, source, depth + 1)
        part = parse(etree.tostring(part, encoding="unicode"))  # rejects what has become too deep
        name, file = node.get("name") or part.get("model") or "", f"model_{source.read}.xml"
        text, counts[name] = _dynamic_part(part, place, source, depth + 1)
        source.files[file] = text.encode()
        etree.SubElement(etree.SubElement(bare, "asset"), "model", {"name": name, "file": file})
    return counts


def _meshes(
    root: Any, bare: Any, worlds: list[Any], settings: dict[str, str], folder: Path | None, source: Source
) -> str:
    """Read the meshes that give mass; return names of bodies with missing ones, whose geometry is removed."""
    from lxml import etree

    used = [geom for world in worlds for geom in world.iter("geom") if geom.get("mesh")]
    known, wanted = set[str](), {geom.get("mesh") for geom in used}
    for node in (node for group in root.iterchildren("asset") for node in group.iterchildren("mesh")):
        name, file = node.get("name") or Path(node.get("file") or "").stem, node.get("file")
        if name not in wanted:
            continue
        if file:
            data = _mesh(file, settings, folder, source)
            if data is None:
                continue
            node.set("file", f"mesh_{len(source.files)}{Path(file).suffix.lower()}")
            source.files[node.get("file")] = data
        node.set("name", name)
        _remove_plugins(node)
        etree.SubElement(bare, "asset").append(node)
        known.add(name)
    lost = set[str]()
    for geom in used:
        geom.attrib.update({"contype": "0", "conaffinity": "0"})  # MuJoCo then needs no convex hull
        if geom.get("mesh") not in known:
            lost.add(next(geom.iterancestors("body")).get("name") or "a body without a name")
            geom.getparent().remove(geom)
    return shorten(sorted(lost)) if lost else ""


def _mesh(file: str, settings: dict[str, str], folder: Path | None, source: Source) -> bytes | None:
    """Content of a mesh; None if it is missing or outside of the folder."""
    if folder is None:
        return None
    below = Path(file).name if settings.get("strippath") == "true" else file
    path = folder / settings.get("meshdir", settings.get("assetdir", "")) / below
    try:
        return _read_limited(path, source) if may_read(path, [folder]) else None
    except OSError:
        return None


def _count_elements(node: Any, models: dict[str, Counter[str]]) -> Counter[str]:
    """Number of elements by tag, with those that are replicated and attached."""
    total: Counter[str] = Counter()
    for child in node:
        times = 1
        if child.tag == "replicate":
            with suppress(ValueError):  # MuJoCo rejects it
                count = float(child.get("count") or 0)
                times = int(count) if isfinite(count) and count > 0 else 1
        inside = models.get(child.get("model"), Counter()) if child.tag == "attach" else _count_elements(child, models)
        total[child.tag] += 1
        for tag, number in inside.items():
            total[tag] += times * number
    return total
