"""Model discrepancy: torque of a joint that no law of the library makes, as a random function of the joint's state.

recorded - predicted = laws + d(q, v, load, direction) + noise, per joint, with d a zero-mean Gaussian process of size s
and stationary kernel. d is written by F random Fourier features, d = Z w with w ~ N(0, s^2 I), so its covariance s^2 Z Z'
has rank 2 F, and rows are whitened by a projection:

    (I + s^2 Z Z')^-1/2 = I - U (I - (I + D^2)^-1/2) U',    s Z = U D V' (singular values D).

s maximises the marginal likelihood of the rows with everything that is fitted integrated out.

Source: Kennedy, O'Hagan, Bayesian calibration of computer models, J. R. Statist. Soc. B 63(3), 2001 (discrepancy);
Rahimi, Recht, Random features for large-scale kernel machines, NIPS 2007 (features).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..residual import leave
from ..types import Array
from .fitted import solve
from .table import Table

FEATURES = 40  # F random frequencies
LENGTHS = (1.5, 0.6)  # of the kernel, in standard deviations of each variable: half of the frequencies each
SEED = 0  # of the frequencies
TURN = 0.1  # of the rms velocity: width of the change of direction
SIZES = (0.0, 0.001, 0.002, 0.004, 0.008, 0.015, 0.03, 0.06, 0.12, 0.25)  # of s, as shares of the joint's rms torque
FLAT = 1e-6  # of the Gram's diagonal: prior precision of what is not known at all


class Projection(NamedTuple):
    """Whitening of rows against the discrepancy of one joint."""

    basis: Array  # (M, k) [1] orthonormal
    shrinkage: Array  # (k,) [1] share of each direction that is taken away

    def __call__(self, x: Array) -> Array:
        """Rows (M, c) [1] without what the discrepancy may make of them."""
        return np.asarray(x - self.basis @ (self.shrinkage[:, None] * (self.basis.T @ x)))


def features(table: Table, joint: int) -> Array:
    """(M, 2 F) [1] random Fourier features of a joint's state, mean square 1 over a row.

    Args:
        table: rows.
        joint: which.
    """
    v = table.v[:, joint]
    turn = TURN * max(float(np.sqrt(np.mean(v**2))), 1e-12)
    state = [table.q[:, joint], v, table.predicted[:, joint]]
    x = np.column_stack([*(_scaled(one) for one in state), np.tanh(v / turn)])
    rng = np.random.default_rng(SEED)
    frequency = rng.standard_normal((x.shape[1], FEATURES)) / np.resize(LENGTHS, FEATURES)
    angle = x @ frequency
    linear = np.column_stack([np.ones(len(x)), x])
    beyond = leave(np.column_stack([np.cos(angle), np.sin(angle)]), linear)
    return np.asarray(beyond / max(float(np.sqrt(np.sum(beyond**2) / len(beyond))), 1e-12))


def project(white: Array, size: float) -> Projection:
    """Whitening against a discrepancy.

    Args:
        white: (M, 2 F) features in units of the noise of a torque of 1 N.m [1 / N.m].
        size: of the discrepancy [N.m or N].
    """
    basis, singular, _ = np.linalg.svd(size * white, full_matrices=False)
    return Projection(basis, 1 - 1 / np.sqrt(1 + singular**2))


def discrepancy_size(white: Array, fitted: Array, precision: Array, residual: Array, scale: float) -> float:
    """The likeliest size s of the discrepancy [N.m or N], everything that is fitted integrated out.

    Args:
        white: (M, 2 F) features [1 / N.m] in units of the noise.
        fitted: (M, k) columns that are fitted [1 per coefficient].
        precision: (k, k) [1 per coefficient, squared] of their prior.
        residual: (M,) [1].
        scale: rms torque of the joint [N.m or N].
    """
    columns = np.column_stack([fitted, white])
    gram, right = columns.T @ columns, columns.T @ residual
    k, own = fitted.shape[1], gram[: fitted.shape[1], : fitted.shape[1]]
    flat = np.where(np.diag(precision) > 0, 0.0, FLAT * np.maximum(np.diag(own), 1e-12))
    told = []
    for share in SIZES:
        prior = np.zeros_like(gram)
        prior[:k, :k] = precision + np.diag(flat)
        used = slice(0, k if share == 0 else len(gram))
        prior[range(k, len(gram)), range(k, len(gram))] = (max(share, 1e-9) * scale) ** -2.0
        told.append(solve(np.arange(len(gram))[used], gram[used, used], right[used], prior[used, used]).log_evidence)
    return SIZES[int(np.argmax(told))] * scale


def _scaled(x: Array) -> Array:
    spread = float(np.std(x))
    return np.asarray((x - x.mean()) / (spread if spread > 0 else 1.0))
