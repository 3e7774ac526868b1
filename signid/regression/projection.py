"""Least squares by singular values, and the residual of a projection onto columns."""

from __future__ import annotations

import numpy as np

from ..types import Array

SINGULAR_VALUE_TOLERANCE = 1e-9  # [1] smallest singular value that counts, over the largest, columns scaled


def least_squares(columns: Array, target: Array, least: float | None = None) -> Array:
    """Least-squares solution of minimum norm for columns (N, k) [any] and target (N,) or (N, m) [any]: (k,) or (k, m).

    LAPACK's divide-and-conquer SVD fails to converge for some regular matrices; then QR iteration is used. Singular
    values below `least` [1] of the largest do not count; None: machine precision times matrix size.

    Source: Anderson et al., LAPACK Users' Guide, SIAM 1999, section 2.3.2 (GELSD and GELSS).
    """
    try:
        return np.asarray(np.linalg.lstsq(columns, target, rcond=least)[0])
    except np.linalg.LinAlgError:
        from scipy.linalg import lstsq  # slow to import and rarely needed

        rounding = float(np.finfo(np.float64).eps) * max(columns.shape)
        return np.asarray(lstsq(columns, target, cond=least or rounding, lapack_driver="gelss")[0])


def leave(target: Array, columns: Array) -> Array:
    """Residual of the least-squares fit of columns (N, k) [any unit] to a target (N,) or (N, m) [N.m or N].

    Columns of zeros are ignored.
    """
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0] / size[size > 0]
    return np.asarray(target - scaled @ least_squares(scaled, target, SINGULAR_VALUE_TOLERANCE))
