"""Files of meshes -> their triangles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...types import Array
from .solids import Triangles


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
