"""Shapes of a robot's bodies, from its description or generated from its joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...errors import shorten
from ...robot.description.document import children, parse
from ...robot.meshes import find_mesh
from ...types import Array, Robot
from ..geometry import origin, vector
from .poses import own_axis
from .solids import Triangles, between, box, capsule, cylinder, joined, share, simplify

MOST = 300_000  # maximum number of triangles per robot
THICK, TAPER = 0.055, 0.93  # radius of the first generated link over the reach; radius of each link over the previous
DRUM = 1.16  # radius and half-length of a joint's cylinder over the radius of its link
SHORT = 1e-6  # length below which a vector counts as zero [m]


class Look(NamedTuple):
    """Shapes of a robot."""

    bodies: dict[int, Triangles]  # by joint of the model, 0: base; in the joint frame
    notes: tuple[str, ...]


def look(robot: Robot, package_dirs: Sequence[str | Path] = ()) -> Look:
    """Collect visual shapes, or collision shapes, or generated capsules if neither can be read."""
    parts: dict[int, list[Triangles]] = {}
    missing: dict[int, list[str]] = {}
    if robot.kind == "urdf":
        for body, found, lost in _stated(robot, package_dirs):
            parts.setdefault(body, []).extend(found)
            missing.setdefault(body, []).extend(lost)
    known = {body: joined(some) for body, some in parts.items() if some}
    bare = {body: shape for body, shape in _generated(robot).items() if body not in known}
    plain = {body: shape for body, shape in bare.items() if not known or missing.get(body)}  # others: none on purpose
    lost = list(dict.fromkeys(name for names in missing.values() for name in names))
    notes = [f"meshes missing or unreadable: {shorten(lost, 4)}"] if lost else []
    drawn = [str(robot.model.names[body]) for body in plain if body]
    notes += [f"drawn as capsules, since no shape is known: links moved by {shorten(drawn, 4)}"] if drawn else []
    bodies = dict(sorted({**known, **plain}.items()))
    keep = share([len(shape.faces) for shape in bodies.values()], MOST)
    return Look({body: simplify(bodies[body], most) for body, most in zip(bodies, keep, strict=True)}, tuple(notes))


def reach(robot: Robot) -> float:
    """Approximate reach of the robot [m]: the longest path along its joints."""
    model, far = robot.model, np.zeros(robot.model.njoints)
    for joint in range(1, model.njoints):
        step = float(np.linalg.norm(model.jointPlacements[joint].translation))
        far[joint] = far[model.parents[joint]] + step
        if _leaf(model, joint) and model.inertias[joint].mass > 0:
            far[joint] += 2 * float(np.linalg.norm(model.inertias[joint].lever))
    return float(far.max()) or 1.0


def _leaf(model: Any, joint: int) -> bool:
    return joint not in list(model.parents)[1:]


def _stated(robot: Robot, package_dirs: Sequence[str | Path]) -> Iterator[tuple[int, list[Triangles], list[str]]]:
    """Yield the carrying joint, the shapes and the missing meshes of each link."""
    import pinocchio as pin

    for link in children(parse(robot.document), "link"):
        place = robot.model.getFrameId(link.get("name"), pin.FrameType.BODY)
        if place >= robot.model.nframes:
            continue
        frame, lost = robot.model.frames[place], list[str]()
        for kind in ("visual", "collision"):
            found = []
            for element in children(link, kind):
                shape = _shape(element, robot, package_dirs, lost)
                if shape is not None:
                    put = frame.placement * origin(element)
                    found.append(shape.moved(put.rotation, put.translation))
            if found:
                break
        yield frame.parentJoint, found, lost


def _shape(element: Any, robot: Robot, package_dirs: Sequence[str | Path], lost: list[str]) -> Triangles | None:
    for geometry in children(element, "geometry"):
        for item in geometry:
            if item.tag == "mesh":
                name = item.get("filename") or ""
                path = find_mesh(name, robot.path, package_dirs)
                mesh = None if path is None else _read_mesh(path, vector(item.get("scale"), 3, 1.0))
                lost += [Path(name).name] if mesh is None else []
                return mesh
            radius, length = (vector(item.get(key), 1)[0] for key in ("radius", "length"))
            if item.tag == "box":
                return box(vector(item.get("size"), 3))
            if item.tag == "cylinder":
                return cylinder(radius, length)
            if item.tag in ("sphere", "capsule"):
                return capsule(radius, length)
    return None


def _generated(robot: Robot) -> dict[int, Triangles]:
    """Capsules from each joint to its children, thinner towards the tip, and a cylinder around each axis."""
    model, parts = robot.model, dict[int, list[Triangles]]()
    radius = np.full(model.njoints, THICK * reach(robot))
    for joint in range(1, model.njoints):
        before, end = model.parents[joint], model.jointPlacements[joint].translation
        radius[joint] = TAPER * radius[before]
        parts.setdefault(before, []).append(between(np.zeros(3), end, radius[before]))
        own = parts.setdefault(joint, [])
        along, slides = own_axis(robot, joint)
        if not slides:
            side = DRUM * radius[joint] * along
            own.append(between(-side, side, DRUM * radius[joint], round_ends=False))
        if _leaf(model, joint):
            lever = model.inertias[joint].lever if model.inertias[joint].mass > 0 else np.zeros(3)
            tip = 2 * lever if np.linalg.norm(lever) > SHORT else np.zeros(3)
            own.append(between(np.zeros(3), tip, radius[joint]))
    return {body: joined(some) for body, some in sorted(parts.items())}


def _read_mesh(path: Path, scale: Array) -> Triangles | None:
    """Triangles of an STL, OBJ, Collada or other mesh file with merged vertices; None if unreadable."""
    import coal

    try:
        found = coal.MeshLoader(coal.BV_AABB).load(str(path), np.abs(scale))
        triangles = map(found.tri_indices, range(found.num_tris))
        vertices, faces = np.array(found.vertices()), np.array([(f[0], f[1], f[2]) for f in triangles])
    except Exception:  # coal raises unrelated types
        return None
    if not len(faces) or not np.isfinite(vertices).all():
        return None
    mirrored = np.prod(scale) < 0
    return Triangles(vertices * np.sign(scale), faces[:, ::-1] if mirrored else faces)
