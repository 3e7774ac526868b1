"""Shapes of a robot for MJCF, from its URDF; meshes if they are found and readable by MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ...errors import shorten
from ...robot.document import children, parse
from ...robot.locate import find_mesh
from ...types import Array, Robot
from ..geometry import origin, vector
from .bodies import quaternion

_MAX_STL_FACES, _STL_HEADER_BYTES, _STL_FACE_BYTES = 200_000, 84, 50  # limit of MuJoCo, and sizes [bytes]


@dataclass(frozen=True)
class Shapes:
    """Meshes, and geoms and sites of fixed links by the model's joints (0: world)."""

    meshes: list[dict[str, str]] = field(default_factory=list)
    at: dict[int, list[tuple[str, dict[str, str]]]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def read_shapes(robot: Robot, package_dirs: Sequence[str | Path]) -> Shapes:
    """Read the visual shapes of the URDF, or the collision shapes if MuJoCo cannot read the former."""
    if robot.kind != "urdf":
        return Shapes(notes=["shapes, actuators and sensors of the original MJCF are left out"])
    found, root = Shapes(), parse(robot.document)
    reader = _Reader(robot.path, package_dirs, root, found.meshes)
    links = {link.get("name"): link for link in children(root, "link")}
    for frame in (x for x in robot.model.frames if x.type == pin.FrameType.BODY and x.name in links):
        here = found.at.setdefault(int(frame.parentJoint), [])
        if frame.parentJoint and frame.name not in robot.links:
            here.append(("site", {"name": str(frame.name), **pose_words(frame.placement)}))
        here += [("geom", geom) for geom in reader.geoms(links[frame.name], frame.placement)]
    if reader.missing:
        missing = shorten(reader.missing)
        found.notes.append(f"no shapes for {missing}: their meshes are missing or not readable by MuJoCo")
    return found


def copied(meshes: list[dict[str, str]], folder: str) -> dict[str, Path]:
    """Refer to meshes by names below a folder beside the MJCF; return the sources by these names."""
    names: dict[str, str] = {}  # path below the folder, by source
    for mesh in meshes:
        if mesh["file"] not in names:
            source, taken = Path(mesh["file"]), set(names.values())
            ends = (f"_{k}" if k > 1 else "" for k in count(1))
            names[mesh["file"]] = next(
                name for end in ends if (name := f"{folder}/{source.stem}{end}{source.suffix}") not in taken
            )
        mesh["file"] = names[mesh["file"]]
    return {name: Path(source) for source, name in names.items()}


class _Reader:
    """Reader of link geometry that collects meshes."""

    def __init__(self, path: str, package_dirs: Sequence[str | Path], root: Any, meshes: list[dict[str, str]]) -> None:
        self.path, self.package_dirs, self.meshes = path, package_dirs, meshes
        self.colours = {m.get("name"): m for m in children(root, "material")}
        self.missing: list[str] = []

    def geoms(self, link: Any, placement: Any) -> list[dict[str, str]]:
        """Geoms of a link in the frame of its joint."""
        stated = [[self._geom(x, placement) for x in children(link, tag)] for tag in ("visual", "collision")]
        shown = next((kind for kind in stated if kind and all(kind)), next((kind for kind in stated if any(kind)), []))
        if any(stated) and not any(shown):
            self.missing.append(str(link.get("name")))
        return [geom for geom in shown if geom]

    def _geom(self, element: Any, placement: Any) -> dict[str, str]:
        """Geom of an element; empty if MuJoCo has none for it."""
        pose = pose_words(placement * origin(element))
        for shape in (x for g in children(element, "geometry") for x in g if isinstance(x.tag, str)):
            if size := self._shape(shape):
                return {**size, **pose, **self._colour(element)}
        return {}

    def _shape(self, shape: Any) -> dict[str, str]:
        kind = shape.tag.rpartition("}")[2]
        if kind == "mesh":
            return self._mesh(shape)
        if kind == "box":
            return _solid(kind, vector(shape.get("size"), 3) / 2)
        radius, length = vector(shape.get("radius"), 1), vector(shape.get("length"), 1)
        return _solid(kind, {"sphere": radius}.get(kind, np.append(radius, length / 2)))

    def _mesh(self, shape: Any) -> dict[str, str]:
        path = find_mesh(shape.get("filename") or "", self.path, self.package_dirs)
        if path is None or not _readable(path):
            return {}
        scale = words(vector(shape.get("scale"), 3, 1.0))
        entry = {"file": path.resolve().as_posix(), "scale": scale, "inertia": "shell"}
        names = {tuple(known[key] for key in entry): known["name"] for known in self.meshes}
        if tuple(entry.values()) not in names:
            self.meshes.append({"name": f"{path.stem}_{len(self.meshes) + 1}", **entry})
        return {"type": "mesh", "mesh": names.get(tuple(entry.values()), self.meshes[-1]["name"])}

    def _colour(self, element: Any) -> dict[str, str]:
        for material in children(element, "material"):
            for stated in (material, self.colours.get(material.get("name"))):
                for colour in children(stated, "color") if stated is not None else ():
                    return {"rgba": words(np.clip(vector(colour.get("rgba"), 4, 1.0), 0, 1))}
        return {}


def words(numbers: ArrayLike) -> str:
    """Format numbers as an attribute, with all digits."""
    return " ".join(repr(float(x) + 0.0) for x in np.asarray(numbers, float))


def pose_words(placement: Any) -> dict[str, str]:
    """Position and orientation (pin.SE3) as attributes."""
    return {"pos": words(placement.translation), "quat": words(quaternion(placement.rotation))}


def _solid(kind: str, size: Array) -> dict[str, str]:
    known = kind in ("box", "sphere", "cylinder", "capsule") and (size > 0).all()
    return {"type": kind, "size": words(size)} if known else {}


def _readable(path: Path) -> bool:
    """Whether MuJoCo can read a mesh: OBJ, or binary STL up to its limit of faces."""
    if path.suffix.lower() != ".stl":
        return path.suffix.lower() == ".obj"
    with path.open("rb") as file:
        head = file.read(_STL_HEADER_BYTES)
    count = int.from_bytes(head[80:], "little")
    return 0 < count <= _MAX_STL_FACES and path.stat().st_size == _STL_HEADER_BYTES + _STL_FACE_BYTES * count
