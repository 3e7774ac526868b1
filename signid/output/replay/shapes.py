"""Triangles of a robot's bodies, from its description or generated from its joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...errors import shorten
from ...robot.document import children, parse
from ...robot.locate import find_mesh
from ...types import Array, Indices, Robot
from ..geometry import origin, vector
from .track import own_axis

MAX_TRIANGLES = 300_000  # maximum number of triangles per robot
FIRST_RADIUS_SHARE, RADIUS_RATIO = 0.055, 0.93  # first radius over the reach; each radius over the previous
DRUM_RADIUS_RATIO = 1.16  # radius and half-length of a joint's cylinder over the radius of its link
ZERO_LENGTH = 1e-6  # length below which a vector counts as zero [m]
CIRCLE_SIDES = 24  # number of sides of round solids
CELL_BISECTIONS = 12  # number of bisections of the cell size of a simplification
MIN_CELL_SHARE = 1e-3  # smallest cell size, relative to the mesh


class Triangles(NamedTuple):
    """k vertices and m triangles, counter-clockwise from outside."""

    vertices: Array  # (k, 3) [m]
    faces: Indices  # (m, 3)

    def moved(self, rotation: Array, translation: Array) -> Triangles:
        """Apply rotation (3, 3) [1], then translation (3,) [m]."""
        return Triangles(self.vertices @ rotation.T + translation, self.faces)


class Look(NamedTuple):
    """Shapes of a robot."""

    bodies: dict[int, Triangles]  # by joint of the model, 0: base; in the joint frame
    notes: tuple[str, ...]


def look(robot: Robot, package_dirs: Sequence[str | Path] = ()) -> Look:
    """Collect visual shapes, or collision shapes, or generated capsules if neither can be read."""
    parts: dict[int, list[Triangles]] = {}
    missing: dict[int, list[str]] = {}
    if robot.kind == "urdf":
        for body, shapes, lost in _stated(robot, package_dirs):
            parts.setdefault(body, []).extend(shapes)
            missing.setdefault(body, []).extend(lost)
    known = {body: joined(shapes) for body, shapes in parts.items() if shapes}
    bare = {body: shape for body, shape in _generated(robot).items() if body not in known}
    plain = {body: shape for body, shape in bare.items() if not known or missing.get(body)}  # others: none on purpose
    lost = list(dict.fromkeys(name for names in missing.values() for name in names))
    notes = [f"meshes missing or unreadable: {shorten(lost, 4)}"] if lost else []
    drawn = [str(robot.model.names[body]) for body in plain if body]
    notes += [f"drawn as capsules, since no shape is known: links moved by {shorten(drawn, 4)}"] if drawn else []
    bodies = dict(sorted({**known, **plain}.items()))
    keep = share([len(shape.faces) for shape in bodies.values()], MAX_TRIANGLES)
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
            shapes = []
            for element in children(link, kind):
                shape = _shape(element, robot, package_dirs, lost)
                if shape is not None:
                    put = frame.placement * origin(element)
                    shapes.append(shape.moved(put.rotation, put.translation))
            if shapes:
                break
        yield frame.parentJoint, shapes, lost


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
    radius = np.full(model.njoints, FIRST_RADIUS_SHARE * reach(robot))
    for joint in range(1, model.njoints):
        before, end = model.parents[joint], model.jointPlacements[joint].translation
        radius[joint] = RADIUS_RATIO * radius[before]
        parts.setdefault(before, []).append(between(np.zeros(3), end, radius[before]))
        solids = parts.setdefault(joint, [])
        along, slides = own_axis(robot, joint)
        if not slides:
            side = DRUM_RADIUS_RATIO * radius[joint] * along
            solids.append(between(-side, side, DRUM_RADIUS_RATIO * radius[joint], round_ends=False))
        if _leaf(model, joint):
            lever = model.inertias[joint].lever if model.inertias[joint].mass > 0 else np.zeros(3)
            tip = 2 * lever if np.linalg.norm(lever) > ZERO_LENGTH else np.zeros(3)
            solids.append(between(np.zeros(3), tip, radius[joint]))
    return {body: joined(solids) for body, solids in sorted(parts.items())}


def _read_mesh(path: Path, scale: Array) -> Triangles | None:
    """Triangles of an STL, OBJ, Collada or other mesh file with merged vertices; None if unreadable."""
    import coal

    try:
        mesh = coal.MeshLoader(coal.BV_AABB).load(str(path), np.abs(scale))
        triangles = map(mesh.tri_indices, range(mesh.num_tris))
        vertices, faces = np.array(mesh.vertices()), np.array([(f[0], f[1], f[2]) for f in triangles])
    except Exception:  # coal raises unrelated types
        return None
    if not len(faces) or not np.isfinite(vertices).all():
        return None
    mirrored = np.prod(scale) < 0
    return Triangles(vertices * np.sign(scale), faces[:, ::-1] if mirrored else faces)


def box(size: Array) -> Triangles:
    """Box of size (3,) [m]."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Triangles(corners * size, np.array([f for a, b, c, d in sides for f in ((a, b, c), (a, c, d))]))


def cylinder(radius: float, length: float) -> Triangles:
    """Cylinder with flat ends [m]."""
    return _turned(np.array([0.0, radius, radius, 0.0]), np.array([-0.5, -0.5, 0.5, 0.5]) * length)


def capsule(radius: float, length: float) -> Triangles:
    """Cylinder with hemispherical ends; a sphere if the length is zero [m]."""
    bend = np.linspace(0, np.pi / 2, CIRCLE_SIDES // 4 + 1)
    r, z = radius * np.sin(bend), length / 2 + radius * np.cos(bend)
    cut = 1 if length == 0 else 0
    return _turned(np.append(r, r[::-1][cut:]), np.append(-z, z[::-1][cut:]))


def between(start: Array, end: Array, radius: float, round_ends: bool = True) -> Triangles:
    """Capsule or cylinder between two points; start: (3,) [m], end: (3,) [m]."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length if length > 0 else np.array([0.0, 0.0, 1.0])
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    side /= np.linalg.norm(side)
    solid = capsule(radius, length) if round_ends else cylinder(radius, length)
    return solid.moved(np.column_stack([side, np.cross(along, side), along]), (start + end) / 2)


def joined(parts: list[Triangles]) -> Triangles:
    """Concatenate meshes."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return Triangles(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))


def _turned(r: Array, z: Array) -> Triangles:
    """Surface of revolution of a profile r (k,), z (k,) [m] about z, from pole to pole."""
    angle = 2 * np.pi * np.arange(CIRCLE_SIDES) / CIRCLE_SIDES
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    rings = [np.column_stack([a * circle, np.full(CIRCLE_SIDES, h)]) for a, h in zip(r, z, strict=True)]
    i, after = np.arange(CIRCLE_SIDES), (np.arange(CIRCLE_SIDES) + 1) % CIRCLE_SIDES
    faces = []
    for k in range(len(r) - 1):
        low, high = k * CIRCLE_SIDES, (k + 1) * CIRCLE_SIDES
        faces += [np.column_stack([low + i, low + after, high + after])] if r[k] > 0 else []
        faces += [np.column_stack([low + i, high + after, high + i])] if r[k + 1] > 0 else []
        if r[k] == 0:
            faces[-1] = np.column_stack([low + i, high + after, high + i])
    return Triangles(np.concatenate(rings), np.concatenate(faces))


def simplify(mesh: Triangles, max_faces: int) -> Triangles:
    """Simplify a mesh to a maximum number of triangles, by vertex clustering on a grid.

    Source: Rossignac, Borrel, Multi-resolution 3D approximations for rendering complex scenes, 1993.
    """
    if len(mesh.faces) <= max_faces:
        return mesh
    size = float(np.ptp(mesh.vertices, axis=0).max())
    fine, coarse = np.log(MIN_CELL_SHARE * size), np.log(size)
    best = _clustered(mesh, size)
    for _ in range(CELL_BISECTIONS):
        middle = (fine + coarse) / 2
        candidate = _clustered(mesh, float(np.exp(middle)))
        if len(candidate.faces) > max_faces:
            fine = middle
        else:
            coarse, best = middle, candidate
    return best


def share(counts: list[int], total: int) -> list[int]:
    """Distribute a maximum number of triangles over meshes; the largest are reduced first."""
    left, keep = total, [0] * len(counts)
    for rank, k in enumerate(sorted(range(len(counts)), key=lambda k: counts[k])):
        keep[k] = min(counts[k], left // (len(counts) - rank))
        left -= keep[k]
    return keep


def _clustered(mesh: Triangles, cell: float) -> Triangles:
    place = np.floor((mesh.vertices - mesh.vertices.min(axis=0)) / cell).astype(np.int64)
    _, group = np.unique(place @ np.array([1, 1 << 20, 1 << 40]), return_inverse=True)
    count = np.bincount(group)
    centres: Array = np.column_stack([np.bincount(group, x) / count for x in mesh.vertices.T])
    faces = group[mesh.faces]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[whole]
    turn = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3  # canonical order, to find duplicates
    return Triangles(centres, np.unique(np.take_along_axis(faces, turn, axis=1), axis=0))
