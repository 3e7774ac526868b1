"""Symmetric 4x4 matrices as ten coordinates with the same norm (Frobenius)."""

from __future__ import annotations

import numpy as np

from ...types import Array, pseudo_inertia

_PAIRS = np.tril_indices(4)
BASIS = np.zeros((10, 4, 4))
BASIS[np.arange(10), _PAIRS[0], _PAIRS[1]] = BASIS[np.arange(10), _PAIRS[1], _PAIRS[0]] = np.where(
    _PAIRS[0] == _PAIRS[1], 1.0, 0.5**0.5
)


def pack(matrix: Array) -> Array:
    """Coordinates (..., 10) of symmetric matrices: matrix (..., 4, 4) [any]."""
    return np.asarray(np.einsum("aij,...ij->...a", BASIS, matrix))


def unpack(packed: Array) -> Array:
    """Symmetric matrices (n, 4, 4) from ten coordinates each: packed (10 n,) or (n, 10) [any]."""
    return np.asarray(np.tensordot(packed.reshape(-1, 10), BASIS, 1))


def congruence(factor: Array) -> Array:
    """Matrices (n, 10, 10) of the maps S -> factor S factor' between packed matrices, factor (n, 4, 4) [any]."""
    flat = BASIS.reshape(10, 16)
    kronecker = np.einsum("nik,njl->nijkl", factor, factor).reshape(-1, 16, 16)
    return np.asarray(flat @ kronecker @ flat.T)


def diagonal(blocks: Array, rest: Array) -> Array:
    """Block-diagonal matrix (10 n + k, 10 n + k) of blocks (n, 10, 10) [any] and single entries rest (k,) [any]."""
    bodies = 10 * len(blocks)
    matrix = np.diag(np.concatenate([np.zeros(bodies), rest]))
    for i, block in zip(range(0, bodies, 10), blocks, strict=True):
        matrix[i : i + 10, i : i + 10] = block
    return matrix


TO_INERTIAL: Array = np.linalg.inv(np.column_stack([pack(pseudo_inertia(e)) for e in np.eye(10)]))
"""Map (10, 10) from a packed pseudo-inertia to ten inertial parameters in Pinocchio's order."""

IDENTITY = pack(np.eye(4))
"""Packed identity matrix (10,)."""
