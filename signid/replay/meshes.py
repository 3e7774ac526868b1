"""Meshes of a description: where their files are, and their triangles."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from ..robot.sandbox import may_read
from ..types import Array
from .solids import Triangles

PACKAGE, FILE = ("package://", "model://"), "file://"


def find_mesh(name: str, description: str, package_dirs: Sequence[str | Path] = ()) -> Path | None:
    """The file that a description means; None where there is none.

    A path leads to no file outside the description's folder, a package, or one of `package_dirs`.
    Packages are looked for in `package_dirs`, in ROS_PACKAGE_PATH, above the description and in example-robot-data.

    Args:
        name: package://PACKAGE/PATH, file://PATH, or a path beside the description.
        description: path of the description, empty where it is not known.
        package_dirs: folders that hold packages, or are one.
    """
    package = next((head for head in PACKAGE if name.startswith(head)), None)
    if package is None:
        path = Path(unquote(name.removeprefix(FILE)))
        near = Path(description).parent if description else None
        place = path if path.is_absolute() else near and near / path
        folders = [*package_dirs, *_examples(), *([near] if near else [])]
        return place if place and may_read(place, folders) and place.is_file() else None
    inside = name.removeprefix(package)
    folder, _, rest = inside.partition("/")
    if ".." in Path(inside).parts or folder in ("", "."):
        return None
    for root in _roots(description, package_dirs):
        if (root / inside).is_file():
            return root / inside
        if root.name == folder and (root / rest).is_file():
            return root / rest
    return None


def read_mesh(path: Path, scale: Array) -> Triangles | None:
    """The triangles of an STL, OBJ, Collada or other mesh file, corners that coincide joined; None where it is unread.

    Args:
        path: of the file.
        scale: (3,) [1], negative where it mirrors.
    """
    import coal

    try:
        found = coal.MeshLoader(coal.BV_AABB).load(str(path), np.abs(scale))
        triangles = map(found.tri_indices, range(found.num_tris))
        vertices, faces = np.array(found.vertices()), np.array([(f[0], f[1], f[2]) for f in triangles])
    except Exception:  # coal's are of no family
        return None
    if not len(faces) or not np.isfinite(vertices).all():
        return None
    mirrored = np.prod(scale) < 0
    return Triangles(vertices * np.sign(scale), faces[:, ::-1] if mirrored else faces)


def _roots(description: str, package_dirs: Sequence[str | Path]) -> Iterator[Path]:
    yield from map(Path, package_dirs)
    yield from (Path(folder) for folder in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if folder)
    if description:
        yield from Path(description).resolve().parents[:-1]
    yield from _examples()


def _examples() -> list[Path]:
    """Where example-robot-data lies."""
    spec = find_spec("pinocchio")
    return [] if spec is None or spec.origin is None else [Path(spec.origin).parents[4] / "share"]
