"""Least squares by singular values, and what columns leave of torque."""

from __future__ import annotations

import numpy as np

from ..types import Array

RANK = 1e-9  # of the largest singular value, columns scaled


def least_squares(columns: Array, target: Array, least: float | None = None) -> Array:
    """(k,) or (k, m) the shortest of the least-squares solutions.

    LAPACK's divide-and-conquer SVD does not converge for some matrices that are all right; QR iteration does.

    Args:
        columns: (N, k) [any unit].
        target: (N,) or (N, m) [any unit].
        least: of the largest singular value [1]: smaller ones count as zero; None: rounding of the matrix's size.

    Source: Anderson et al., LAPACK Users' Guide, SIAM 1999, section 2.3.2 (GELSD and GELSS).
    """
    try:
        return np.asarray(np.linalg.lstsq(columns, target, rcond=least)[0])
    except np.linalg.LinAlgError:
        from scipy.linalg import lstsq  # here, because it is hardly ever needed

        rounding = float(np.finfo(np.float64).eps) * max(columns.shape)
        return np.asarray(lstsq(columns, target, cond=least or rounding, lapack_driver="gelss")[0])


def leave(target: Array, columns: Array) -> Array:
    """The part of a target that no combination of columns makes, (N,) or (N, m) as the target.

    Args:
        target: (N,) or (N, m) [N.m or N].
        columns: (N, k) [any unit]; columns of zeros do not count.
    """
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0] / size[size > 0]
    return np.asarray(target - scaled @ least_squares(scaled, target, RANK))
