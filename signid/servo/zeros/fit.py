"""Fit of zeros: least squares over the errors of all loops, with the whole torque of the motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ...frozen import Frozen
from ...types import Array
from .rows import FLOOR, RECORDINGS, Loads, unexplained

UNKNOWN_ZERO_STD = 1.8  # [rad] standard deviation of a zero of which nothing is known
ROBUST = 2.5  # standard deviations from which an error counts less
STEPS = 12  # most steps of a fit
BIAS = 0.02  # [rad] what filters and stops leave in zeros of simulated arms, beyond noise
SLOPE = 1e-4  # [rad] of the difference quotients
POINTS = 2 * np.pi / 3 * np.arange(3)  # zeros at which the load is computed [rad]
SINGLE_ZEROS, PAIR_ZEROS = 48, 16  # zeros that are tried of one joint, and of each of two
STARTS, SWEEPS, IMPROVED_TRIALS = 6, 6, 2  # random starts; most turns of all joints; trials improved by two joints
SAVED = 1e-3  # sum of log rms that a move must save
ZeroStart = tuple[Array, Array, tuple[int, ...]]  # signs (n,) [1], zeros (n,) [rad or m] and free joints of a fit
MIN_LOG_SAVING = 0.1  # sum of log rms that one or two joints must save, for others to be tried


@dataclass(frozen=True, eq=False)
class ZeroFit(Frozen):
    """Signs and zeros of n joints, and their errors; zeros of joints that are not free are kept."""

    signs: Array  # (n,) [1]
    zeros: Array  # (n,) [rad or m]
    free: tuple[int, ...]
    squares: float  # half the squared errors over their noise, in nats
    std: Array  # (n,) [rad or m] 0 where not free

    @property
    def start(self) -> ZeroStart:
        """Start of another fit."""
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
    bread = np.linalg.inv(jacobian.T @ jacobian + np.eye(jacobian.shape[1]) / UNKNOWN_ZERO_STD**2)
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


class ZeroTrial(NamedTuple):
    """Signs and zeros of all joints."""

    score: float  # [1] sum over joints of the log rms of the residual
    signs: Array  # (n,) [1]
    zeros: Array  # (n,) [rad or m]


def search(loads: Loads, joints: Sequence[int], seed: int) -> list[ZeroTrial]:
    """Best signs and zeros of some joints, best first; random starts only if another zero saves enough."""
    rng, n = np.random.default_rng(seed), len(loads.rows.joints)
    moves, pairs = [(j,) for j in joints], list(combinations(joints, 2))
    load = loads.gravity(np.ones(n), np.zeros(n))[..., None]
    left = [np.mean(line.responses(line.of(load))[1] ** 2) for line in loads.lines]
    described = ZeroTrial(float(np.sum(0.5 * np.log(np.maximum(left, FLOOR**2)))), np.ones(n), np.zeros(n))
    found = [described, _descended(loads, described, moves), turned(loads, described, pairs)]
    if described.score - min(trial.score for trial in found) < MIN_LOG_SAVING:
        return _different(found)
    for _ in range(STARTS):
        signs, zeros = np.ones(n), np.zeros(n)
        signs[list(joints)] = rng.choice([1.0, -1.0], len(joints))
        zeros[list(joints)] = rng.uniform(-np.pi, np.pi, len(joints))
        found.append(_descended(loads, ZeroTrial(np.inf, signs, zeros), moves))
    best = _different(found)[:IMPROVED_TRIALS]
    found += [_descended(loads, turned(loads, trial, pairs), moves) for trial in best]
    return _different(found)


def turned(
    loads: Loads, trial: ZeroTrial, moves: Iterable[tuple[int, ...]], fixed: Mapping[int, float] | None = None
) -> ZeroTrial:
    """Best signs and zeros of the joints of each move in turn, the others as they are; `fixed`: signs that are kept."""
    for joints in moves:
        choices = [(fixed[j],) if fixed and j in fixed else (1.0, -1.0) for j in joints]
        for signs in product(*choices):
            best = best_zeros(loads, trial, joints, signs)
            trial = best if best.score < trial.score - SAVED else trial
    return trial


def mirrored(loads: Loads, trial: ZeroTrial, joints: Sequence[int]) -> ZeroTrial:
    """Best zeros with all signs turned: gravity of a planar arm is the same in a mirror."""
    fixed = {j: -trial.signs[j] for j in joints}
    signs, zeros = trial.signs.copy(), trial.zeros.copy()
    signs[list(joints)] *= -1
    zeros[list(joints)] *= -1
    return _descended(loads, ZeroTrial(np.inf, signs, zeros), [(j,) for j in joints], fixed)


def best_zeros(loads: Loads, trial: ZeroTrial, joints: tuple[int, ...], signs: tuple[float, ...]) -> ZeroTrial:
    """Best zeros on a grid of some joints with given signs."""
    own, rows = trial.signs.copy(), list(joints)
    own[rows] = signs
    at = []
    for turn in product(POINTS, repeat=len(rows)):
        zeros = trial.zeros.copy()
        zeros[rows] = turn
        at.append(loads.gravity(own, zeros))
    basis = np.stack(at, axis=2)  # (N, n, points)
    count = SINGLE_ZEROS if len(rows) == 1 else PAIR_ZEROS
    grid = 2 * np.pi / count * np.arange(count)
    weight = one = (1 + 2 * np.cos(grid[:, None] - POINTS)) / 3  # (grid, points)
    if len(rows) == 2:
        weight = np.einsum("ai,bj->abij", one, one).reshape(count**2, -1)
    score = np.zeros(len(weight))
    for line in loads.lines:
        left = np.mean(line.responses(weight @ line.of(basis))[1] ** 2, axis=1)
        score += 0.5 * np.log(np.maximum(left, FLOOR**2))
    k = int(np.argmin(score))
    zeros = trial.zeros.copy()
    zeros[rows] = grid[list(np.unravel_index(k, (count,) * len(rows)))]
    return ZeroTrial(float(score[k]), own, zeros)


def _descended(
    loads: Loads, trial: ZeroTrial, moves: Sequence[tuple[int, ...]], fixed: Mapping[int, float] | None = None
) -> ZeroTrial:
    for _ in range(SWEEPS):
        before, trial = trial.score, turned(loads, trial, moves, fixed)
        if not trial.score < before - SAVED:
            break
    return trial


def _different(trials: Sequence[ZeroTrial]) -> list[ZeroTrial]:
    """Trials in the order of their scores, without repetitions."""
    kept: list[ZeroTrial] = []
    for trial in sorted(trials, key=lambda one: one.score):
        near = (np.abs(np.exp(1j * trial.zeros) - np.exp(1j * other.zeros)).max() < 0.1 for other in kept)
        same = (np.array_equal(trial.signs, other.signs) for other in kept)
        if not any(a and b for a, b in zip(near, same, strict=True)):
            kept.append(trial)
    return kept
