"""Fit of zeros: least squares over the errors of all loops, with the whole torque of the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from ...frozen import Frozen
from ...types import Array
from .load import FLOOR, Loads, unexplained
from .rows import RECORDINGS

WIDE = 1.8  # [rad] standard deviation of a zero of which nothing is known
ROBUST = 2.5  # standard deviations from which an error counts less
STEPS = 12  # most steps of a fit
BIAS = 0.02  # [rad] what filters and stops leave in zeros of simulated arms, beyond noise
SLOPE = 1e-4  # [rad] of the difference quotients


@dataclass(frozen=True, eq=False)
class ZeroFit(Frozen):
    """Signs and zeros of n joints, and their errors; zeros of joints that are not free are kept."""

    signs: Array  # (n,) [1]
    zeros: Array  # (n,) [rad or m]
    free: tuple[int, ...]
    squares: float  # half the squared errors over their noise, in nats
    std: Array  # (n,) [rad or m] 0 where not free

    @property
    def start(self) -> tuple[Array, Array, tuple[int, ...]]:
        """Signs (n,) [1], zeros (n,) [rad or m] and free joints, to start another fit from."""
        return self.signs, self.zeros, self.free

    @property
    def changed(self) -> int:
        """Number of zeros and signs that are not those of the description."""
        return len(self.free) + int((self.signs < 0).sum())


def fit_zeros(loads: Loads, noise: Array, signs: Array, zeros: Array, free: Sequence[int]) -> ZeroFit:
    """Fit the zeros of some joints.

    Args:
        loads: rows with their robot.
        noise: (n,) [rad or m] of each joint, of independent rows.
        signs: (n,) [1].
        zeros: (n,) [rad or m] to start from.
        free: the joints whose zeros are fitted.
    """
    rows, at = list(free), zeros.copy()

    def left(x: Array) -> Array:
        at[rows] = x
        load = loads.torque(signs, at)
        return np.concatenate([unexplained(line, load) / noise[line.joint] for line in loads.lines])

    std = np.zeros(len(zeros))
    if not rows:
        return ZeroFit(signs, zeros, (), 0.5 * float(np.sum(left(np.zeros(0)) ** 2)), std)
    found = least_squares(left, zeros[rows], method="trf", max_nfev=STEPS, ftol=1e-5, xtol=1e-4, diff_step=SLOPE)
    std[rows] = _std(loads, np.asarray(found.jac), np.asarray(found.fun))
    final = zeros.copy()
    final[rows] = (found.x + np.pi) % (2 * np.pi) - np.pi
    return ZeroFit(signs, final, tuple(sorted(rows)), float(found.cost), std)


def noise_of(loads: Loads, load: Array) -> Array:
    """Standard deviation (n,) [rad or m] of what a load (N, n) [N.m or N] leaves, of rows as if they were independent.

    Errors of neighbouring rows are alike: the variance of their sums over blocks counts.
    """
    noise = np.ones(len(loads.rows.joints))
    for line in loads.lines:
        left, block = unexplained(line, load), loads.rows.block[line.use]
        sums = np.bincount(block - block.min(), left)
        alike = max(float(np.sum(sums**2)) / max(float(np.sum(left**2)), FLOOR**2), 1.0)
        noise[line.joint] = np.sqrt(alike * np.mean(left**2)) + FLOOR
    return noise


def weighted(loads: Loads, load: Array) -> Loads:
    """The same with less weight for rows whose errors a load (N, n) [N.m or N] leaves far from the others."""
    weights = np.ones_like(loads.rows.q)
    for line in loads.lines:
        left = unexplained(line, load)
        usual = 1.48 * float(np.median(np.abs(left))) + FLOOR
        weights[line.use, line.joint] = 1 / (1 + (left / (ROBUST * usual)) ** 2)
    return replace(loads, weights=weights)


def _std(loads: Loads, jacobian: Array, left: Array) -> Array:
    """Standard deviations (k,) [rad] from the Jacobian (M, k) [1/rad] and errors (M,) [1].

    The largest of those of independent errors, of errors alike in blocks, and of errors alike in recordings.
    """
    bread = np.linalg.inv(jacobian.T @ jacobian + np.eye(jacobian.shape[1]) / WIDE**2)
    variances = [np.diag(bread)]
    several = len(np.unique(loads.rows.recording)) >= RECORDINGS
    for label in (loads.rows.block, *([loads.rows.recording] if several else [])):
        own = np.concatenate([label[line.use] for line in loads.lines])
        names, number = np.unique(own, return_inverse=True)
        pushes = np.zeros((len(names), jacobian.shape[1]))
        np.add.at(pushes, number, jacobian * left[:, None])
        spread = bread @ (pushes.T @ pushes) @ bread * len(names) / max(len(names) - 1, 1)
        variances.append(np.diag(spread))
    return np.asarray(np.sqrt(np.max(variances, axis=0) + BIAS**2))
