"""Where the meshes of a description lie."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote

from .sandbox import may_read

PACKAGE, FILE = ("package://", "model://"), "file://"


def mesh_folders(description: str, package_dirs: Sequence[str | Path] = ()) -> list[Path]:
    """Where packages with meshes may lie: as given, in ROS_PACKAGE_PATH, above the description, in example-robot-data.

    Args:
        description: path of the description, empty where it is not known.
        package_dirs: folders that hold packages, or are one.
    """
    stated = [Path(folder) for folder in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if folder]
    above = list(Path(description).resolve().parents)[:-1] if description else []
    return [*map(Path, package_dirs), *stated, *above, *_examples()]


def find_mesh(name: str, description: str, package_dirs: Sequence[str | Path] = ()) -> Path | None:
    """The file that a description means; None where there is none.

    A path leads to no file outside the description's folder, a package, or one of `package_dirs`.

    Args:
        name: package://PACKAGE/PATH, file://PATH, or a path beside the description.
        description: path of the description, empty where it is not known.
        package_dirs: folders that hold packages, or are one.
    """
    try:
        return next((path for path in _meant(name, description, package_dirs) if path.is_file()), None)
    except (OSError, ValueError):  # a name that no file system takes
        return None


def _meant(name: str, description: str, package_dirs: Sequence[str | Path]) -> list[Path]:
    """Files that a name may stand for, none that a description may not read."""
    package = next((head for head in PACKAGE if name.startswith(head)), None)
    if package is None:
        near = [Path(description).parent] if description else []
        path = Path(unquote(name.removeprefix(FILE)))
        places = [path] if path.is_absolute() else [folder / path for folder in near]
        return [place for place in places if may_read(place, [*package_dirs, *_examples(), *near])]
    inside = name.removeprefix(package)
    folder, _, rest = inside.partition("/")
    if ".." in Path(inside).parts or folder in ("", "."):
        return []
    roots = mesh_folders(description, package_dirs)
    return [place for root in roots for place in (root / inside, *([root / rest] if root.name == folder else []))]


def _examples() -> list[Path]:
    """Where example-robot-data lies."""
    spec = find_spec("pinocchio")
    return [] if spec is None or spec.origin is None else [Path(spec.origin).parents[4] / "share"]
