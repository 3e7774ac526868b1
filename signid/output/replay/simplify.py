"""Mesh simplification by vertex clustering on a grid."""

from __future__ import annotations

import numpy as np

from ...types import Array
from .solids import Triangles

HALVINGS = 12  # number of bisections of the cell size
FINEST = 1e-3  # smallest cell size, relative to the mesh


def simplify(mesh: Triangles, most: int) -> Triangles:
    """Simplify a mesh to a maximum number of triangles.

    Args:
        mesh: mesh.
        most: maximum number of triangles.

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
