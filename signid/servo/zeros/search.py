"""Search for signs and zeros: from many starts, one or two joints at a time, with gravity alone.

Gravity is linear in the sine and cosine of each position, so three zeros of a joint give its load at all of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from ...types import Array
from .load import FLOOR, Loads, responses

POINTS = 2 * np.pi / 3 * np.arange(3)  # zeros at which the load is computed [rad]
GRID, COARSE = 48, 16  # zeros that are tried of one joint, and of each of two
STARTS, SWEEPS, KEPT = 6, 6, 2  # random starts; most turns of all joints; trials that are improved by two joints
SAVED = 1e-3  # sum of log rms that a move must save
ENOUGH = 0.1  # sum of log rms that one or two joints must save, for others to be tried


class ZeroTrial(NamedTuple):
    """Signs and zeros of all joints."""

    score: float  # [1] sum over joints of the log rms of the residual
    signs: Array  # (n,) [1]
    zeros: Array  # (n,) [rad or m]


def search(loads: Loads, joints: Sequence[int], seed: int) -> list[ZeroTrial]:
    """Best signs and zeros of some joints, best first; random starts only if another zero saves enough."""
    rng, n = np.random.default_rng(seed), len(loads.rows.joints)
    moves, pairs = [(j,) for j in joints], list(combinations(joints, 2))
    described = ZeroTrial(_score(loads, np.ones(n), np.zeros(n)), np.ones(n), np.zeros(n))
    found = [described, _descended(loads, described, moves), turned(loads, described, pairs)]
    if described.score - min(trial.score for trial in found) < ENOUGH:
        return _different(found)
    for _ in range(STARTS):
        signs, zeros = np.ones(n), np.zeros(n)
        signs[list(joints)] = rng.choice([1.0, -1.0], len(joints))
        zeros[list(joints)] = rng.uniform(-np.pi, np.pi, len(joints))
        found.append(_descended(loads, ZeroTrial(np.inf, signs, zeros), moves))
    best = _different(found)[:KEPT]
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
    count = GRID if len(rows) == 1 else COARSE
    grid = 2 * np.pi / count * np.arange(count)
    weight = one = (1 + 2 * np.cos(grid[:, None] - POINTS)) / 3  # (grid, points)
    if len(rows) == 2:
        weight = np.einsum("ai,bj->abij", one, one).reshape(count**2, -1)
    score = np.zeros(len(weight))
    for line in loads.lines:
        left = responses(line, line.of(basis) @ weight.T)[1] / len(line.error)
        score += 0.5 * np.log(np.maximum(left, FLOOR**2))
    k = int(np.argmin(score))
    zeros = trial.zeros.copy()
    zeros[rows] = grid[list(np.unravel_index(k, (count,) * len(rows)))]
    return ZeroTrial(float(score[k]), own, zeros)


def _score(loads: Loads, signs: Array, zeros: Array) -> float:
    load = loads.gravity(signs, zeros)[..., None]
    left = [responses(line, line.of(load))[1][0] / len(line.error) for line in loads.lines]
    return float(np.sum(0.5 * np.log(np.maximum(left, FLOOR**2))))


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
