"""Triangle meshes of boxes, cylinders, spheres and capsules, centred and along z."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Array, Indices

ROUND = 24  # number of sides of round solids


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
    """Capsule or cylinder from one point to another.

    Args:
        start: (3,) [m].
        end: (3,) [m].
        radius: radius [m].
        round_ends: capsule instead of cylinder.
    """
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
    rings = [
        np.column_stack([a * np.cos(angle), a * np.sin(angle), np.full(ROUND, h)]) for a, h in zip(r, z, strict=True)
    ]
    i, after = np.arange(ROUND), (np.arange(ROUND) + 1) % ROUND
    faces = []
    for k in range(len(r) - 1):
        low, high = k * ROUND, (k + 1) * ROUND
        faces += [np.column_stack([low + i, low + after, high + after])] if r[k] > 0 else []
        faces += [np.column_stack([low + i, high + after, high + i])] if r[k + 1] > 0 else []
        if r[k] == 0:
            faces[-1] = np.column_stack([low + i, high + after, high + i])
    return Triangles(np.concatenate(rings), np.concatenate(faces))
