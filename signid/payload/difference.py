"""Two estimates of base parameters -> the ten numbers of the body that makes the difference, in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..regression.factors import Factors
from ..types import Array, BaseMap, Estimate, Frozen

CHANGE, LITTLE = 0.1, 0.01  # of friction or offset, and of the joint's rms torque: what may change from day to day
UNTOLD = 1e-8  # of the largest singular value of the scaled columns


@dataclass(frozen=True, eq=False)
class Difference(Frozen):
    """Base parameters with the load less those without: difference = columns @ load + noise."""

    columns: Array  # (b, 10) [units of base per unit of the load]
    value: Array  # (b,) [units of base]
    covariance: Array  # (b, b) [units of base] of noise, and of friction that may have changed; misfit counted
    load: Array  # (10,) [kg, kg.m, kg.m2] by generalised least squares
    spread: Array  # (10, 10) its covariance; infinite variance where nothing is told [products of the units]
    misfit: float  # at least 1
    drifted: float  # largest change of friction or offset [1]

    @property
    def estimate(self) -> Estimate:
        """The difference as an estimate of base parameters, its information that of all that is unknown."""
        size = np.sqrt(np.diag(self.covariance))
        information = np.linalg.inv(self.covariance / np.outer(size, size)) / np.outer(size, size)
        return Estimate(self.value, self.covariance, information, np.zeros(0), ())


def subtract(
    base: BaseMap, body: int, bare: Estimate, loaded: Estimate, factors: Factors, added: Array | None = None
) -> Difference:
    """What a body that is added to another explains of the difference of two estimates.

    All that is the robot's own is the same in both and falls out, but for friction and offsets, which may have changed
    by about a tenth.

    Args:
        base: of both.
        body: that carries the load.
        bare: without the load.
        loaded: with it.
        factors: of recordings without it; they give the size of torque and speed.
        added: (b, b) [units of base] covariance that widens the intervals but does not weight the fit: most of this
            error is equal with and without the load.

    Source: Khalil, Gautier, Lemoine, Identification of the payload inertial parameters of industrial manipulators, IEEE
    ICRA 2007.
    """
    told = np.isfinite(bare.std) & np.isfinite(loaded.std)
    rows, columns = np.flatnonzero(told), base.combination[:, 10 * body : 10 * body + 10]
    value, noise = loaded.value - bare.value, bare.covariance + loaded.covariance
    change, likely = _changes(base, bare, factors)
    covariance = np.where(np.outer(told, told), noise, 0.0) + (change * likely**2) @ change.T
    far = 1e3 * (np.abs(bare.value) + np.abs(loaded.value) + np.sqrt(np.diag(covariance)) + 1.0)
    covariance[~told] = covariance[:, ~told] = 0.0
    covariance[~told, ~told] = far[~told] ** 2
    root = np.linalg.cholesky(covariance)
    inverse, spread, rank = _solve(np.linalg.solve(root, columns))
    gain = inverse @ np.linalg.inv(root)
    load = gain @ value
    left = np.linalg.solve(root, value - columns @ load)
    misfit = max(1.0, float(left @ left) / max(len(rows) - rank, 1))
    back = np.linalg.solve(root.T, left)
    drifted = float(np.abs(likely * (change.T @ back)).max(initial=0.0))
    spread = misfit * spread
    if added is not None:
        known = np.where(np.isinf(np.diag(spread))[:, None], 0.0, gain)
        spread = spread + known @ np.where(np.outer(told, told), added, 0.0) @ known.T
    return Difference(columns, value, misfit * covariance, load, spread, misfit, drifted)


def _solve(columns: Array) -> tuple[Array, Array, int]:
    """Least squares of white rows: estimator (10, b), covariance of the ten parameters, rank."""
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 1e-300, size, np.inf)  # a column of zeros tells nothing
    left, s, right = np.linalg.svd(columns / size, full_matrices=False)
    told = s > UNTOLD * s[0]
    inverse = (right[told].T / s[told]) / size[:, None]
    spread = inverse @ inverse.T
    lost = (np.sum(right[~told] ** 2, axis=0) > 1e-8) | np.isinf(size)
    spread[lost, lost] = np.inf
    return inverse @ left[:, told].T, spread, int(told.sum())


def _changes(base: BaseMap, bare: Estimate, factors: Factors) -> tuple[Array, Array]:
    """Columns (b, l) of the coefficients that may have changed, and by how much they may (l,) [unit of each]."""
    speed = np.sqrt(np.diag(factors.velocity) / factors.rows)
    torque = [np.sqrt(joint.whole[-1, -1] / max(joint.rows, 1)) for joint in factors.joints]
    place = {int(k): row for row, k in enumerate(base.independent)}
    which, likely = [], []
    for k, label in enumerate(base.labels):
        if label.joint is not None and "kg" not in label.unit:  # a rotor does not change
            own = abs(bare.value[place[k]]) if k in place else 0.0
            natural = torque[label.joint] / (max(speed[label.joint], 0.05) if ".s/" in label.unit else 1.0)
            which.append(k)
            likely.append(max(CHANGE * own, LITTLE * natural))
    return base.combination[:, which], np.array(likely)
