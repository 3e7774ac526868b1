"""Locate the mesh files of a description, within the folders it may read."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote

from .description.sandbox import may_read
from .locate import examples_share

_PACKAGE, _FILE = ("package://", "model://"), "file://"


def find_mesh(name: str, description: str, package_dirs: Sequence[str | Path] = ()) -> Path | None:
    """File of a mesh; None if there is none.

    Files outside the description's folder, a package, or `package_dirs` are never returned. Packages are searched in
    `package_dirs`, in ROS_PACKAGE_PATH, above the description and in example-robot-data.

    Args:
        name: package://PACKAGE/PATH, file://PATH, or a path relative to the description.
        description: path of the description, empty if unknown.
        package_dirs: packages, or folders that contain packages.
    """
    package = next((head for head in _PACKAGE if name.startswith(head)), None)
    try:
        if package is not None:
            return _in_package(unquote(name.removeprefix(package)), description, package_dirs)
        return _beside(Path(unquote(name.removeprefix(_FILE))), description, package_dirs)
    except (OSError, ValueError):  # a name too long for the file system, or with a null character
        return None


def _in_package(inside: str, description: str, package_dirs: Sequence[str | Path]) -> Path | None:
    package, _, rest = inside.partition("/")
    if ".." in Path(inside).parts or package in ("", "."):
        return None
    for root in _roots(description, package_dirs):
        if (root / inside).is_file():
            return root / inside
        if root.name == package and (root / rest).is_file():
            return root / rest
    return None


def _roots(description: str, package_dirs: Sequence[str | Path]) -> Iterator[Path]:
    yield from map(Path, package_dirs)
    yield from (Path(folder) for folder in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if folder)
    if description:
        yield from Path(description).resolve().parents[:-1]
    yield from _examples()


def _beside(path: Path, description: str, package_dirs: Sequence[str | Path]) -> Path | None:
    near = Path(description).parent if description else None
    place = path if path.is_absolute() else near and near / path
    folders = [*package_dirs, *_examples(), *([near] if near else [])]
    return place if place and may_read(place, folders) and place.is_file() else None


def _examples() -> list[Path]:
    share = examples_share()
    return [share] if share else []
