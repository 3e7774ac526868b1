"""Whitening of rows against coloured noise and model discrepancy, torque of a joint that no law explains.

Per joint, y = X a + S b + d(q, v, load, direction) + e, where d is a zero-mean Gaussian process of size s with a
stationary kernel. With F random frequencies, d = Z w with w ~ N(0, s^2 I): the covariance s^2 Z Z' has rank 2 F, and
rows are whitened by a projection:

    (I + s^2 Z Z')^-1/2 = I - U (I - (I + D^2)^-1/2) U',    s Z = U D V' (singular values D).

s maximises the marginal likelihood of the rows; all fitted coefficients are integrated out.

Source: Kennedy, O'Hagan, Bayesian calibration of computer models, J. R. Statist. Soc. B 63(3), 2001 (discrepancy);
Gelman, Bayesian Analysis 1(3), 2006 (half-Cauchy prior of its size);
Rahimi, Recht, Random features for large-scale kernel machines, NIPS 2007 (features).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from ...regression.projection import leave
from ...types import Array, Frozen, Mask
from .noise import Noise, has_full_window, whiten
from .rows import RowTable
from .thresholds import DIRECTION_WIDTH, DISCREPANCY_LENGTHS, DISCREPANCY_SCALE, FLAT_PRECISION

FREQUENCY_COUNT = 40  # F, number of random frequencies. Heuristic
FEATURE_SEED = 0  # seed of the random frequencies

# [1] grid of s, as a share of the joint's rms torque. Heuristic
DISCREPANCY_GRID = (0.0, 0.001, 0.002, 0.004, 0.008, 0.015, 0.03, 0.06, 0.12, 0.25)
GRID_STRIDE = 3  # every 3rd size of the grid is evaluated first
EM_STEPS = 8  # steps of expectation and maximisation, from a variance of 1. Heuristic
PRIOR_ROOT_RIDGE = 1e-10  # [1] added to the diagonal of the scaled precision, so that it can be factored


class Projection(NamedTuple):
    """Whitening of rows against the discrepancy of one joint: (I + s^2 Z Z')^-1/2."""

    basis: Array  # (M, k) [1] U, orthonormal columns
    shrinkage: Array  # (k,) [1] 1 - (1 + D^2)^-1/2 of each direction

    def __call__(self, x: Array) -> Array:
        """(M, c) [1] rows x (M, c) [1] in units of the noise, after whitening."""
        return np.asarray(x - self.basis @ (self.shrinkage[:, None] * (self.basis.T @ x)))


def features(table: RowTable, joint: int) -> Array:
    """(M, 2 F) [1] Z: random Fourier features of a joint's state, orthogonal to linear functions of it.

    Scaled such that the squares of a row sum to 1 on average.

    Source: Rahimi, Recht, NIPS 2007; Plumlee, J. Am. Stat. Assoc. 112, 2017 (the orthogonal process).
    """
    v = table.v[:, joint]
    turn = DIRECTION_WIDTH * max(float(np.sqrt(np.mean(v**2))), 1e-12)
    state = [table.q[:, joint], v, table.predicted[:, joint]]
    x = np.column_stack([*(_standardised(one) for one in state), np.tanh(v / turn)])
    rng = np.random.default_rng(FEATURE_SEED)
    frequency = rng.standard_normal((x.shape[1], FREQUENCY_COUNT)) / np.resize(DISCREPANCY_LENGTHS, FREQUENCY_COUNT)
    angle = x @ frequency
    linear = np.column_stack([np.ones(len(x)), x])
    beyond = leave(np.column_stack([np.cos(angle), np.sin(angle)]), linear)
    return np.asarray(beyond / max(float(np.sqrt(np.sum(beyond**2) / len(beyond))), 1e-12))


def project(white: Array, size: float) -> Projection:
    """Whitening against a discrepancy of some size [N.m or N]; white (M, f) [1 / N.m] is Z in units of the noise."""
    basis, singular, _ = np.linalg.svd(size * white, full_matrices=False)
    return Projection(basis, 1 - 1 / np.sqrt(1 + singular**2))


class NoiseEstimate(NamedTuple):
    """Noise variance and discrepancy of one joint, and the fit under them."""

    size: float  # size s of the discrepancy [N.m or N]
    variance: float  # c, variance of the noise over the presumed one [1]
    value: Array  # (k + 2 F,) or (k,) [unit of each coefficient] posterior mean of a, b and w; without w if s = 0
    used: float  # effective number of parameters of the fit
    log: float  # log marginal likelihood of the rows, with the prior of s, up to a constant [-]


def estimate_discrepancy(white: Array, fitted: Array, precision: Array, residual: Array, scale: float) -> NoiseEstimate:
    """Estimate the size of the discrepancy and the variance of the noise by maximum marginal likelihood.

    In units of the noise, white (M, f) [1 / N.m] is Z, f = 2 F, and residual (M,) [1] is y. The columns X and S of the
    fit are fitted (M, k) [1 per coefficient], their precision (k, k) [1 per coefficient, squared] is L. The scale is
    the rms torque of the joint [N.m or N].

    Source: Dempster, Laird, Rubin, J. R. Statist. Soc. B 39(1), 1977 (expectation and maximisation for the
    variance); Gelman, Bayesian Analysis 1(3), 2006 (prior of s).
    """
    columns = np.column_stack([fitted, white])
    gram, right, square = columns.T @ columns, columns.T @ residual, float(residual @ residual)
    k, rows = fitted.shape[1], max(int(np.count_nonzero(residual)), 1)
    flat = np.where(np.diag(precision) > 0, 0.0, FLAT_PRECISION * np.maximum(np.diag(gram)[:k], 1e-12))
    prior_root = _prior_root(precision + np.diag(flat))

    def at(share: float) -> NoiseEstimate:
        used = slice(0, k if share == 0 else len(gram))
        root = block_diag(prior_root, share * scale * np.eye(len(gram) - k))[used, used]
        whole = _maximise_variance(root.T @ gram[used, used] @ root, root.T @ right[used], square, rows)
        log = whole.log - float(np.log1p((share / DISCREPANCY_SCALE) ** 2))
        return whole._replace(size=share * scale, value=root @ whole.value, log=log)

    return _maximise(at)


def _maximise(at: Callable[[float], NoiseEstimate]) -> NoiseEstimate:
    """Highest point of the size grid: a coarse search, then an ascent over neighbours."""
    found = {k: at(DISCREPANCY_GRID[k]) for k in range(0, len(DISCREPANCY_GRID), GRID_STRIDE)}
    while True:
        best = max(found, key=lambda k: found[k].log)
        near = [k for k in (best - 1, best + 1) if 0 <= k < len(DISCREPANCY_GRID) and k not in found]
        if not near:
            return found[best]
        found |= {k: at(DISCREPANCY_GRID[k]) for k in near}


def _prior_root(precision: Array) -> Array:
    """(k, k) [unit of each coefficient] root R of a prior covariance: a = R u with u ~ N(0, I)."""
    size = np.sqrt(np.maximum(np.diag(precision), 1e-300))
    lower = np.linalg.cholesky(precision / size / size[:, None] + PRIOR_ROOT_RIDGE * np.eye(len(precision)))
    return np.asarray(np.linalg.inv(lower).T / size[:, None])


def _maximise_variance(gram: Array, right: Array, square: float, rows: int) -> NoiseEstimate:
    """Maximise the marginal likelihood over the noise variance, for coefficients of unit prior."""
    eigen, vectors = np.linalg.eigh(gram)
    eigen, turned, variance = np.maximum(eigen, 0.0), vectors.T @ right, 1.0
    for last in (*[False] * EM_STEPS, True):
        value, kept = turned / (eigen + variance), eigen / (eigen + variance)
        rest, used = max(square - float(value @ (2 * turned - eigen * value)), 0.0), float(kept.sum())
        if not last:
            variance = max((rest + variance * used) / rows, 1e-12)
    log = -(rest / variance + float(value @ value) + float(np.sum(np.log1p(eigen / variance)))) / 2
    return NoiseEstimate(0.0, variance, vectors @ value, used, log - rows / 2 * float(np.log(variance)))


def _standardised(x: Array) -> Array:
    spread = float(np.std(x))
    return np.asarray((x - x.mean()) / (spread if spread > 0 else 1.0))


@dataclass(frozen=True, eq=False)
class Whitening(Frozen):
    """Whitening of rows against coloured noise and model discrepancy, joint by joint."""

    table: RowTable
    noise: Noise
    _projections: dict[int, Projection | None] = field(default_factory=dict, init=False)

    def local(self, columns: Mapping[int, Array]) -> dict[int, Array]:
        """Whiten columns (M, k) [torque per coefficient] of each joint against coloured noise alone."""
        noise, piece = self.noise, self.table.piece
        return {
            j: whiten(x, noise.coefficients[j], float(noise.innovation[j]), piece) * self._weight[:, j, None]
            for j, x in columns.items()
        }

    def __call__(self, columns: Mapping[int, Array]) -> dict[int, Array]:
        """Whitened columns (M, k) [torque per coefficient] of each joint, against noise and discrepancy."""
        local = self.local(columns)
        return {j: x if (onto := self._projection(j)) is None else onto(x) for j, x in local.items()}

    def log_scale(self, joint: int) -> float:
        """Log determinant of the whitening of a joint's rows [-]."""
        weight, projection = self._weight[:, joint], self._projection(joint)
        counted = weight[weight > 0]
        own = float(np.sum(np.log(counted))) - len(counted) * float(np.log(self.noise.innovation[joint]))
        return own if projection is None else own + float(np.sum(np.log1p(-projection.shrinkage)))

    @cached_property
    def _weight(self) -> Array:
        """(M', n) [1] weights of whitened rows."""
        return weights(self.table, self.noise)

    def _projection(self, joint: int) -> Projection | None:
        if joint not in self._projections:
            size = float(self.noise.discrepancy[joint])
            white = self.local({joint: features(self.table, joint)})[joint] if size > 0 else None
            self._projections[joint] = None if white is None else project(white, size)
        return self._projections[joint]


def moving(table: RowTable, order: int) -> Mask:
    """(M, n) whitened rows whose whole window is in motion."""
    still = np.asarray(np.array([table.at_rest[order - k : len(table) - k] for k in range(order + 1)]).any(axis=0))
    return np.asarray(~still[has_full_window(table.piece, order)])


def weights(table: RowTable, noise: Noise) -> Array:
    """(M, n) [1] weights of whitened rows: reduced near velocity reversals, zero at rest."""
    order = noise.coefficients.shape[1]
    unsure = np.max([table.reversal_std[order - k : len(table) - k] for k in range(order + 1)], axis=0)
    weight = 1 / np.sqrt(1 + (np.maximum(noise.reversal_scale, 1) * unsure / noise.saturated_floor) ** 2)
    return np.asarray(weight[has_full_window(table.piece, order)] * moving(table, order))
