"""Model discrepancy: torque of a joint that no law of the library makes, as a random function of the joint's state.

recorded - predicted = laws + d(q, v, load, direction) + noise, per joint, with d a zero-mean Gaussian process of size s
and stationary kernel. d is written by F random Fourier features, d = Z w with w ~ N(0, s^2 I), of covariance s^2 Z Z'
has rank 2 F, and rows are whitened by a projection:

    (I + s^2 Z Z')^-1/2 = I - U (I - (I + D^2)^-1/2) U',    s Z = U D V' (singular values D).

s maximises the marginal likelihood of the rows with everything that is fitted integrated out.

Source: Kennedy, O'Hagan, Bayesian calibration of computer models, J. R. Statist. Soc. B 63(3), 2001 (discrepancy);
Gelman, Bayesian Analysis 1(3), 2006 (half-Cauchy prior of its size);
Rahimi, Recht, Random features for large-scale kernel machines, NIPS 2007 (features).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve

from ..residual import leave
from ..types import Array
from .table import Table

FEATURES = 40  # F random frequencies
LENGTHS = (1.5, 0.6)  # of the kernel, in standard deviations of each variable: half of the frequencies each
SEED = 0  # of the frequencies
TURN = 0.1  # of the rms velocity: width of the change of direction
SIZES = (0.0, 0.001, 0.002, 0.004, 0.008, 0.015, 0.03, 0.06, 0.12, 0.25)  # of s, as shares of the joint's rms torque
USUAL = 0.02  # scale of the half-Cauchy prior of the size, as a share of the joint's rms torque
ROUNDS = 3  # of expectation and maximisation, from the variance of the size before
RIDGE = 1e-10  # of the scaled normal equations
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
        white: (M, f) [1 / N.m] the f = 2 F features in units of the noise.
        size: of the discrepancy [N.m or N].
    """
    basis, singular, _ = np.linalg.svd(size * white, full_matrices=False)
    return Projection(basis, 1 - 1 / np.sqrt(1 + singular**2))


class Likeliest(NamedTuple):
    """Noise and discrepancy of one joint, and what is fitted under them."""

    size: float  # of the discrepancy [N.m or N]
    variance: float  # of the noise, over what it was presumed to be [1]
    value: Array  # (k + 2 F,) or (k,) [of each coefficient] posterior mean, without features if there is no discrepancy
    used: float  # rows that the fit uses up, its effective number of parameters
    log: float  # log density of the rows


def likeliest(white: Array, fitted: Array, precision: Array, residual: Array, scale: float) -> Likeliest:
    """The likeliest size of the discrepancy and variance of the noise, everything that is fitted integrated out.

    Args:
        white: (M, f) [1 / N.m] the f = 2 F features in units of the noise.
        fitted: (M, k) columns that are fitted [1 per coefficient].
        precision: (k, k) [1 per coefficient, squared] of their prior.
        residual: (M,) [1].
        scale: rms torque of the joint [N.m or N].

    Source: Dempster, Laird, Rubin, J. R. Statist. Soc. B 39(1), 1977 (the variance, by expectation and maximisation).
    """
    columns = np.column_stack([fitted, white])
    gram, right, square = columns.T @ columns, columns.T @ residual, float(residual @ residual)
    k, rows = fitted.shape[1], max(int(np.count_nonzero(residual)), 1)
    flat = np.where(np.diag(precision) > 0, 0.0, FLAT * np.maximum(np.diag(gram)[:k], 1e-12))
    found, variance = list[Likeliest](), 1.0
    for share in SIZES:
        used = slice(0, k if share == 0 else len(gram))
        prior = np.diag(np.full(len(gram), (max(share, 1e-9) * scale) ** -2.0))
        prior[:k, :k] = precision + np.diag(flat)
        own = gram[used, used], right[used], prior[used, used]
        for _ in range(ROUNDS):
            fit = _fit(*own, square, variance, rows)
            variance = max(fit.variance, 1e-12)
        found.append(_fit(*own, square, variance, rows)._replace(size=share * scale, variance=variance))
    return max(found, key=lambda one: one.log - float(np.log1p((one.size / (USUAL * scale)) ** 2)))


def _fit(gram: Array, right: Array, prior: Array, square: float, variance: float, rows: int) -> Likeliest:
    """At one variance of the noise: the fit, its log density, and the variance that its residual suggests."""
    whole = gram / variance + prior
    size = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    lower = np.linalg.cholesky(whole / size / size[:, None] + RIDGE * np.eye(len(whole)))
    factor = (lower, True)
    value = cho_solve(factor, right / variance / size) / size
    used = float(np.trace(cho_solve(factor, gram / variance / size / size[:, None])))
    rest = max(square - 2 * float(value @ right) + float(value @ gram @ value), 0.0)
    log = -(rest / variance + float(value @ prior @ value)) / 2 - rows / 2 * np.log(variance)
    log += np.linalg.slogdet(prior)[1] / 2 - float(np.sum(np.log(np.diag(lower)) + np.log(size)))
    return Likeliest(0.0, (rest + variance * used) / rows, value, used, log)


def _scaled(x: Array) -> Array:
    spread = float(np.std(x))
    return np.asarray((x - x.mean()) / (spread if spread > 0 else 1.0))
