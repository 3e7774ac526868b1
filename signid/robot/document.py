"""Description files: text and XML tree, without external references and entities, and the common result of readers."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from math import inf, isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import CONTROL, RobotError, one_line, readable, shorten
from . import sandbox

if TYPE_CHECKING:
    import pinocchio as pin

_XML_DECLARATION = re.compile(r"\s*<\?xml\s[^>]*\?>")
_TRIANGLE_TOLERANCE = 1e-6  # tolerance of the triangle inequality for rounded numbers [share of the largest moment]
CONDITION_TEXTS = {  # condition -> text for one link and for several that violate it
    "mass": ("has an inertia without a positive mass", "have an inertia without a positive mass"),
    "positive": ("has an inertia that is not positive definite", "have inertias that are not positive definite"),
    "triangle": (
        "has an inertia that violates the triangle inequality",
        "have inertias that violate the triangle inequality",
    ),
}
_USD = (".usd", ".usda", ".usdc", ".usdz")
_ADVICE = {
    "sdf": "the file is SDF; signid reads URDF, xacro and MJCF, so convert it first",
    "mujocoinclude": "the file is a part of an MJCF file; give the file that includes it",
    "COLLADA": "the file is a mesh; give the URDF, xacro or MJCF file that uses it",
}
MAX_MAGNITUDE = 1e9  # magnitude of a mass, length, inertia, multiplier or friction [SI units]
MIN_MAGNITUDE = 1e-100  # numbers below count as 0; products of smaller ones underflow
MAX_LINKS = 1000
MAX_MOVING_JOINTS = 120  # moving joints of a file; base parameters of 120 joints need 20 s
MAX_FILE_BYTES = 100_000_000  # of a file
UNIVERSE = "universe"  # name of the fixed joint and frame of every model of Pinocchio
RESERVED_NAMES = {"joint": (UNIVERSE,), "body": (UNIVERSE,), "link": ()}


@dataclass(frozen=True)
class Document:
    """Text and tree of a URDF (xacro expanded) or MJCF file, and the digest of the file itself."""

    path: str  # empty if the text is not from a file
    stem: str  # default name of the robot
    text: str
    root: Any  # lxml element
    sha256: str


class Mimic(NamedTuple):
    """position = multiplier * position of the joint + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Axis:
    """One degree of freedom of the model, in [rad, N.m], or [m, N] if prismatic; NaN where not stated."""

    name: str
    row: int = -1  # index in the velocity of the model, -1 before that is built
    prismatic: bool = False
    lower: float = -inf
    upper: float = inf
    velocity: float = inf
    effort: float = inf
    viscous: float = nan
    coulomb: float = nan
    armature: float = nan
    spring: tuple[float, float] = (0.0, 0.0)  # stiffness [N.m/rad or N/m], rest position [rad or m]
    mimic: Mimic | None = None


@dataclass(frozen=True)
class Draft:
    """Checked description: the model and its degrees of freedom in the order of the file."""

    name: str
    model: pin.Model
    axes: tuple[Axis, ...]
    links: tuple[str, ...]  # link that each joint of the model moves
    document: str
    kind: str  # "urdf" or "mjcf"
    notes: tuple[str, ...] = ()
    still: frozenset[str] = frozenset()  # immobile joints: fixed, or held at neutral


def read_document(
    path: Path, package_dirs: Sequence[str | Path] = (), arguments: Mapping[str, str] | None = None
) -> Document:
    """Read a description file and expand xacro, with values of its arguments by name.

    Raises:
        RobotError: unreadable file, or neither URDF, xacro nor MJCF; arguments that are not those of the file.
    """
    if path.suffix.lower() in _USD:
        raise RobotError("USD is out of scope; give the URDF, xacro or MJCF file of the robot")
    try:
        data = read_bytes(path)
    except OSError as error:
        raise RobotError(f"the file cannot be read ({error.strerror}); check the file and its permissions") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RobotError(f"the file is not UTF-8 text (byte {error.start}); save it as UTF-8") from None
    root = parse(text)
    # namespaces of tags in use: unused declarations often remain after an expansion
    tags = [element.tag for element in root.iter() if isinstance(element.tag, str) and element.tag[0] == "{"]
    if path.suffix == ".xacro" or any("xacro" in tag.partition("}")[0] for tag in tags):
        macros = [str(element.get("name")) for element in root.iter() if str(element.tag).endswith("}macro")]
        given = [str(path.absolute()), *(str(Path(folder).absolute()) for folder in package_dirs)]
        late = f"xacro cannot expand it in {sandbox.MAX_SECONDS} s; check for endless macros"
        with tempfile.TemporaryDirectory() as scratch:
            Path(scratch, sandbox.ARGUMENTS_FILE).write_text(json.dumps(dict(arguments or {})), encoding="utf-8")
            text = restricted(scratch, given, path.absolute().parent, "xacro cannot expand it", late)
        root = parse(text)
        if macros and root.find("link") is None:
            advice = "give the file that includes it and uses them"
            raise RobotError(f"the file defines macros ({shorten(macros, 4)}) and has no link of its own; {advice}")
    elif arguments:
        raise RobotError(
            f"the file is no xacro file, so it has no argument {next(iter(arguments))!r}; leave --xacro out"
        )
    if local(root) not in ("robot", "mujoco"):
        other = f"the file has <{local(root)}> as its root; a URDF or xacro starts with <robot>, an MJCF with <mujoco>"
        raise RobotError(_ADVICE.get(local(root), other))
    return Document(str(path), readable(path.name.partition(".")[0]), text, root, sha256(data).hexdigest())


def parse(text: str) -> Any:
    """Parse an XML text and return its root element.

    Raises:
        RobotError: the text is empty, not XML, or declares a document type.
    """
    from lxml import etree

    if not text.strip():
        raise RobotError("the file is empty; give a URDF, xacro or MJCF file")
    strict, data = _parser(), without_declaration(text).encode()
    try:
        root = etree.fromstring(data, strict)
    except etree.XMLSyntaxError as error:
        if any(entry.domain_name != "NAMESPACE" for entry in strict.error_log):
            if text.lstrip().startswith("{"):
                commands = "diagnose, validate, simulate, replay, export and watch"
                raise RobotError(f"the file is JSON, not a description; {commands} take a model.json") from None
            raise RobotError(f"the file is not valid XML: {str(error.msg).splitlines()[0]}") from None
        root = etree.fromstring(data, _parser(recover=True))  # tags with an undeclared prefix
    if root.getroottree().docinfo.doctype:
        raise RobotError("the file declares a document type, which could load other files; remove the <!DOCTYPE ...>")
    return root


def without_declaration(text: str) -> str:
    """Text with blanks in place of <?xml ...?>, whose version or encoding is wrong in many files."""
    declared = _XML_DECLARATION.match(text)
    return re.sub(r"\S", " ", declared.group()) + text[declared.end() :] if declared else text


def children(element: Any, tag: str) -> list[Any]:
    """Direct children of a tag, without those with a prefix (`drake:joint`)."""
    return [child for child in element if local(child) == tag]


def local(element: Any) -> str:
    """Tag without its default namespace; empty for comments and tags with a prefix."""
    if not isinstance(element.tag, str) or element.prefix:
        return ""
    return str(element.tag.rpartition("}")[2])


def _parser(recover: bool = False) -> Any:
    from lxml import etree

    return etree.XMLParser(encoding="utf-8", resolve_entities=False, no_network=True, load_dtd=False, recover=recover)


def restricted(scratch: str, arguments: Sequence[str], folder: str | Path, fault: str, late: str) -> str:
    """Output of the restricted process.

    Args:
        scratch: the folder in which it may write.
        arguments: path of a xacro file and folders of packages, or an empty path for the MJCF in `scratch`.
        folder: working directory.
        fault: beginning of the message if the process fails.
        late: message if it takes too long.

    Raises:
        RobotError: the process fails.
    """
    command = [sys.executable, "-P", "-X", "utf8", str(Path(sandbox.__file__).absolute()), scratch, *arguments]
    there = {**os.environ, "TMPDIR": scratch, "OPENBLAS_NUM_THREADS": "1", "MUJOCO_GL": "disable"}
    try:
        done = subprocess.run(command, cwd=folder, env=there, capture_output=True, timeout=sandbox.MAX_SECONDS)
    except subprocess.TimeoutExpired:
        raise RobotError(late) from None
    if done.returncode:
        lines = done.stderr.decode("utf-8", "replace").split("\n")  # the reason is the last one, after warnings
        reason = one_line(lines[-1])
        if reason and done.returncode == sandbox.SENTENCE_CODE:
            raise RobotError(reason)
        raise RobotError(f"{fault}: {reason or 'it needs too much time or memory'}")
    return done.stdout.decode("utf-8")


def massless_note(bodies: Mapping[str, float]) -> tuple[str, ...]:
    """At most one sentence on moving links without mass; `bodies` maps links to masses [kg]."""
    missing = [name for name, mass in bodies.items() if mass == 0]
    return _sentence(missing, "moves but carries no mass", "move but carry no mass")


def impossible_notes(stated: Mapping[str, tuple[float, ArrayLike]]) -> tuple[str, ...]:
    """One sentence for each condition of physical inertials that links violate.

    `stated` maps links to their mass [kg] and inertia about the centre of mass, (3, 3) [kg.m2].
    """
    faults = {name: inertial_fault(*inertial) for name, inertial in stated.items()}
    links = {kind: [name for name, fault in faults.items() if fault == kind] for kind in CONDITION_TEXTS}
    return tuple(note for kind, texts in CONDITION_TEXTS.items() for note in _sentence(links[kind], *texts))


def inertial_fault(mass: float, inertia: ArrayLike) -> str:
    """Violated condition ("mass", "positive", "triangle" or "") of a mass [kg] and its central inertia [kg.m2]."""
    if mass < 0:
        return "mass"
    principal = np.linalg.eigvalsh(np.asarray(inertia, float))
    if mass == 0:
        return "mass" if np.abs(principal).max() > 0 else ""
    if principal[0] <= 0:
        return "positive"
    return "triangle" if principal[2] * (1 - _TRIANGLE_TOLERANCE) > principal[0] + principal[1] else ""


def _sentence(links: list[str], singular: str, plural: str) -> tuple[str, ...]:
    if not links:
        return ()
    return (f"link {links[0]} {singular}" if len(links) == 1 else f"links {shorten(links)} {plural}",)


def bounded(value: float, stated: str) -> float:
    """The number, 0 if it is negligible; `stated` begins the message: "link 'a' has mass='1e300'".

    Raises:
        RobotError: the number is not finite or too large.
    """
    if not isfinite(value):
        raise RobotError(f"{stated}; expected a finite number")
    if abs(value) > MAX_MAGNITUDE:
        raise RobotError(f"{stated}; expected a number up to {MAX_MAGNITUDE:.0e}, in SI units")
    return 0.0 if abs(value) < MIN_MAGNITUDE else value


def not_negative(value: float, stated: str) -> float:
    """The number of a friction, damping or armature, also NaN; `stated` begins the message.

    Raises:
        RobotError: the number is negative.
    """
    if value < 0:
        raise RobotError(f"{stated}, and would drive the joint; expected 0 or more")
    return value


def check_count(links: int, joints: int, noun: str = "links") -> None:
    """Check the number of links, or bodies, and of moving joints.

    Raises:
        RobotError: there are more than can be processed in reasonable time.
    """
    if links > MAX_LINKS:
        raise RobotError(f"the file has more than {MAX_LINKS} {noun}; give the description of one robot")
    if joints > MAX_MOVING_JOINTS:
        advice = "give the description of one robot, or declare some of its joints fixed"
        raise RobotError(f"the file has {joints} moving joints, more than {MAX_MOVING_JOINTS}; {advice}")


def check_names(**names: Iterable[str | None]) -> None:
    """Check names by what they name ("joint", "body", "link") before Pinocchio reads them.

    Raises:
        RobotError: a name is reserved, and would damage Pinocchio's memory, or has control characters.
    """
    for what, mine in names.items():
        for name in mine:
            if CONTROL.search(name or ""):
                shown = f"a {what} is named {one_line(name or '')!r}, with a line end or another control character"
                raise RobotError(f"{shown}; give it a name of one line")
            if name in RESERVED_NAMES[what]:
                raise RobotError(f"a {what} is named {name!r}, which Pinocchio uses itself; give it another name")


def read_bytes(path: Path) -> bytes:
    """Content of a regular file.

    Raises:
        OSError: unreadable file.
        RobotError: a device or pipe, or a file that is too large.
    """
    if path.exists() and not path.is_file():
        raise RobotError("it is no regular file; give a URDF, xacro or MJCF file")
    if path.exists() and path.stat().st_size > MAX_FILE_BYTES:
        raise RobotError(f"it has more than {MAX_FILE_BYTES / 1e6:.0f} MB; give the description of one robot")
    return path.read_bytes()
