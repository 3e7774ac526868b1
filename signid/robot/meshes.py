"""Where the meshes of a description lie."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

from ..types import Robot


def mesh_folders(robot: Robot, package_dirs: Sequence[str | Path] = ()) -> list[Path]:
    """Where packages with meshes may lie: as given, above the description, and where example-robot-data has its own."""
    above = list(Path(robot.path).resolve().parents) if robot.path else []
    spec = find_spec("pinocchio")
    share = [Path(spec.origin).parents[4] / "share"] if spec is not None and spec.origin else []
    return [*map(Path, package_dirs), *above, *share]


def find_mesh(name: str, folders: Sequence[Path]) -> Path | None:
    """The file that a description calls by a path or by package://, file:// or model://; None where there is none."""
    parts = urlsplit(name) if "://" in name else None
    if parts is None:
        options = [folder / name for folder in folders]
    elif parts.scheme == "file":
        options = [Path(unquote(parts.netloc + parts.path))]
    else:
        package, inside = unquote(parts.netloc), unquote(parts.path).lstrip("/")
        options = [folder / package / inside for folder in folders]
        options += [folder / inside for folder in folders if folder.name == package]
    try:
        return next((path.resolve() for path in options if path.is_file()), None)
    except OSError:  # a name too long for the file system
        return None
