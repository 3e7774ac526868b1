"""Text and XML tree of a description file; external references and entities are not resolved."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from ...errors import RobotError
from . import sandbox

_DECLARATION = re.compile(r"\s*<\?xml\s[^>]*\?>")
_ADVICE = {
    "sdf": "the file is SDF; signid reads URDF, xacro and MJCF, so convert it first",
    "mujocoinclude": "the file is a part of an MJCF file; give the file that includes it",
    "COLLADA": "the file is a mesh; give the URDF, xacro or MJCF file that uses it",
}


@dataclass(frozen=True)
class Document:
    """Text and tree of a URDF (xacro expanded) or MJCF file, and the digest of the file itself."""

    path: str  # empty if the text is not from a file
    stem: str  # default name of the robot
    text: str
    root: Any  # lxml element
    sha256: str


def read_document(path: Path, package_dirs: Sequence[str | Path] = ()) -> Document:
    """Read a description file and expand xacro.

    Raises:
        RobotError: unreadable file, or neither URDF, xacro nor MJCF.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RobotError(f"the file cannot be read ({error.strerror}); check the file and its permissions") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RobotError(f"the file is not UTF-8 text (byte {error.start}); save it as UTF-8") from None
    root = parse(text)
    if path.suffix == ".xacro" or any("xacro" in namespace for namespace in _namespaces(root)):
        text = _expand(path, package_dirs)
        root = parse(text)
    if local(root) not in ("robot", "mujoco"):
        other = f"the file has <{local(root)}> as its root; a URDF or xacro starts with <robot>, an MJCF with <mujoco>"
        raise RobotError(_ADVICE.get(local(root), other))
    return Document(str(path), path.name.partition(".")[0], text, root, sha256(data).hexdigest())


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
            raise RobotError(f"the file is not valid XML: {str(error.msg).splitlines()[0]}") from None
        root = etree.fromstring(data, _parser(recover=True))  # tags with an undeclared prefix
    if root.getroottree().docinfo.doctype:
        raise RobotError("the file declares a document type, which could load other files; remove the <!DOCTYPE ...>")
    return root


def without_declaration(text: str) -> str:
    """Text with blanks in place of <?xml ...?>, whose version or encoding is wrong in many files."""
    declared = _DECLARATION.match(text)
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


def _namespaces(root: Any) -> set[str]:
    """Namespaces of the tags in use; unused declarations often remain after an expansion."""
    return {tag.tag.partition("}")[0] for tag in root.iter() if isinstance(tag.tag, str) and tag.tag[0] == "{"}


def _expand(path: Path, package_dirs: Sequence[str | Path]) -> str:
    """Expand a xacro file; packages are searched above the file and in `package_dirs`."""
    with tempfile.TemporaryDirectory() as scratch:
        given = [str(path.absolute()), scratch, *(str(Path(folder).absolute()) for folder in package_dirs)]
        command = [sys.executable, "-P", "-X", "utf8", str(Path(sandbox.__file__).absolute()), *given]
        beside, there = path.absolute().parent, {**os.environ, "TMPDIR": scratch}
        try:
            done = subprocess.run(command, cwd=beside, env=there, capture_output=True, timeout=sandbox.SECONDS)
        except subprocess.TimeoutExpired:
            raise RobotError(f"xacro cannot expand it in {sandbox.SECONDS} s; check for endless macros") from None
    if done.returncode:
        reason = done.stderr.decode("utf-8", "replace").strip() or "it needs too much time or memory"
        raise RobotError(f"xacro cannot expand it: {reason}")
    return done.stdout.decode("utf-8")
