"""Triangle meshes: boxes, cylinders, spheres and capsules, centred and along z; simplification."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Array, Indices

ROUND = 24  # number of sides of round solids
HALVINGS = 12  # number of bisections of the cell size of a simplification
FINEST = 1e-3  # smallest cell size, relative to the mesh


class Triangles(NamedTuple):
    """k vertices and m triangles, counter-clockwise from outside."""

    vertices: Array  # (k, 3) [m]
    faces: Indices  # (m, 3)

    def moved(self, rotation: Array, translation: Array) -> Triangles:
        """Apply rotation (3, 3) [1], then translation (3,) [m]."""
        return Triangles(self.vertices @ rotation.T + translation, self.faces)


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
    bend = np.linspace(0, np.pi / 2, ROUND // 4 + 1)
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
    angle = 2 * np.pi * np.arange(ROUND) / ROUND
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    rings = [np.column_stack([a * circle, np.full(ROUND, h)]) for a, h in zip(r, z, strict=True)]
    i, after = np.arange(ROUND), (np.arange(ROUND) + 1) % ROUND
    faces = []
    for k in range(len(r) - 1):
        low, high = k * ROUND, (k + 1) * ROUND
        faces += [np.column_stack([low + i, low + after, high + after])] if r[k] > 0 else []
        faces += [np.column_stack([low + i, high + after, high + i])] if r[k + 1] > 0 else []
        if r[k] == 0:
            faces[-1] = np.column_stack([low + i, high + after, high + i])
    return Triangles(np.concatenate(rings), np.concatenate(faces))


def simplify(mesh: Triangles, most: int) -> Triangles:
    """Simplify a mesh to a maximum number of triangles, by vertex clustering on a grid.

    Source: Rossignac, Borrel, Multi-resolution 3D approximations for rendering complex scenes, 1993.
    """
    if len(mesh.faces) <= most:
        return mesh
    size = float(np.ptp(mesh.vertices, axis=0).max())
    fine, coarse = np.log(FINEST * size), np.log(size)
    best = _clustered(mesh, size)
    for _ in range(HALVINGS):
        middle = (fine + coarse) / 2
        found = _clustered(mesh, float(np.exp(middle)))
        if len(found.faces) > most:
            fine = middle
        else:
            coarse, best = middle, found
    return best


def share(counts: list[int], most: int) -> list[int]:
    """Distribute a maximum number of triangles over meshes; the largest are reduced first."""
    left, keep = most, [0] * len(counts)
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
