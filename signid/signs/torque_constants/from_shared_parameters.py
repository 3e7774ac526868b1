"""Torque constants from signed currents, by the base parameters that joints share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...estimation.least_squares import estimate
from ...regression.factors import Factors, JointFactors
from ...types import Array, BaseMap, Estimate, Frozen, Indices, Mask

GRID = np.geomspace(1e-4, 1e4, 81)  # [median ratio of the shared columns] values of 1/K tried as start; heuristic
SHARED = 1e-12  # [largest entry of the Gram matrix] columns that are smaller in a joint's torque are not shared
RIDGE = 1e-9  # [unit diagonal of a Gram matrix] regularisation
EXACT = 1e-6  # [power of the torque] smallest residual; rounding
DISTINCT = 3.0  # [1] factor between two different starts; heuristic
ROUNDS = 15  # [iterations] of Gauss-Newton, at most; heuristic
LONGEST_STEP = 0.7  # [log] of a constant in one iteration: a factor of 2; heuristic
SETTLED = 1e-4  # [log] step at which Gauss-Newton ends; heuristic
DIFFERENCE = 1e-3  # [log] of a constant, in finite differences of the base parameters; heuristic
DIVERGED = 0.1  # [standard deviations] a longer last step makes the constant unknown; heuristic


@dataclass(frozen=True, eq=False)
class Constants(Frozen):
    """Torque constants of n joints, as logarithms with their covariance."""

    log: Array  # (n,) logarithms of constants in [N.m/A or N/A]
    covariance: Array  # (n, n) of the logarithms [1]; 0: known constant; inf or large: unidentifiable

    @property
    def std(self) -> Array:
        """(n,) relative standard deviations [1]."""
        return np.sqrt(np.diag(self.covariance))


def share_constants(factors: Factors, base: BaseMap, unknown: Mask) -> Constants:
    """Torque constants K of some joints from those of the others; torque / K was recorded.

    Gauss-Newton over K and base parameters, with each joint's residual in its recorded unit, since small K would
    otherwise make small residuals. The logarithm of a constant is one more parameter, whose column is the predicted
    torque. The start is a grid search over one joint after the other, the best identifiable constant first.

    Args:
        factors: factors of n joints, in torque or, where the constant is unknown, in A; at least one joint is known.
        base: base map.
        unknown: (n,) joints whose constant is unknown.

    Source: Gautier, Vandanjon, Presse, IEEE ICRA 1994 (drive gains beside inertial parameters).
    """
    n, rank = len(unknown), base.rank
    free = np.flatnonzero(unknown & _recorded(factors))
    log, step = np.zeros(n), np.zeros(len(free))
    log[free] = _start(factors, free, rank)
    value = estimate(_scaled(factors, log), base, np.zeros(rank)).value
    covariance = np.zeros((n, n))
    for _ in range(ROUNDS if len(free) else 0):
        found = estimate(_with_gains(_scaled(factors, log), value, free, rank), base, np.zeros(rank + len(free)))
        value, step = found.value[:rank], np.clip(found.value[rank:], -LONGEST_STEP, LONGEST_STEP)
        log[free] += step
        covariance[np.ix_(free, free)] = found.covariance[rank:, rank:]
        if np.abs(step).max() < SETTLED:
            break
    diverged = free[np.abs(step) > np.maximum(DIVERGED * np.sqrt(np.diag(covariance)[free]), SETTLED)]
    covariance[diverged, diverged] = np.inf
    return Constants(log, covariance)


def widen_estimate(found: Estimate, factors: Factors, base: BaseMap, covariance: Array, whiten: bool) -> Estimate:
    """Add the uncertainty of torque constants to the covariance of an estimate.

    Args:
        found: estimate from the factors, with exact constants.
        factors: factors of n joints, in torque.
        base: base map.
        covariance: (n, n) of the logarithms of the constants [1].
        whiten: whether the estimate whitens residuals.
    """
    slopes = constant_sensitivity(found, factors, base, np.diag(covariance) > 0, whiten)
    return replace(found, covariance=found.covariance + slopes @ covariance @ slopes.T)


def constant_sensitivity(found: Estimate, factors: Factors, base: BaseMap, joints: Mask, whiten: bool) -> Array:
    """Derivative (b, n) [units of base] of base parameters with respect to the logarithms of torque constants.

    Args:
        found: estimate from the factors.
        factors: factors of n joints, in torque.
        base: base map.
        joints: (n,) joints to differentiate for; columns of others are zero.
        whiten: whether the estimate whitens residuals.
    """
    slopes = np.zeros((base.rank, len(joints)))
    for j in np.flatnonzero(joints).tolist():
        moved = _scaled(factors, DIFFERENCE * np.eye(len(joints))[j])
        slopes[:, j] = (estimate(moved, base, found.value, whiten).value - found.value) / DIFFERENCE
    return slopes


def move(joint: JointFactors, columns: Array, scale: float = 1.0) -> JointFactors:
    """Factors of a joint over other columns.

    Args:
        joint: factors over m columns.
        columns: (m, k) new columns as combinations of the old ones [units of new over old].
        scale: factor of the torque.
    """
    m, k = columns.shape
    copies = (joint.grams.shape[1] - 1) // max(m, 1)  # two with instruments, else one
    turn = np.zeros((copies * m + 1, copies * k + 1))
    turn[:-1, :-1], turn[-1, -1] = np.kron(np.eye(copies), columns), scale
    own = turn[-m - 1 :, -k - 1 :]
    whole = own.T @ joint.whole @ own
    return replace(joint, grams=turn.T @ joint.grams @ turn, whole=whole, total=scale * joint.total)


def _recorded(factors: Factors) -> Mask:
    return np.array([joint.counts[0] > 0 for joint in factors.joints])


def _scaled(factors: Factors, log: Array) -> Factors:
    """Factors in torque, with constants exp(log)."""
    joints = zip(factors.joints, factors.columns, np.exp(log).tolist(), strict=True)
    moved = tuple(move(joint, np.eye(len(seen)), scale) for joint, seen, scale in joints)
    return replace(factors, joints=moved, sample=None)


def _with_gains(factors: Factors, value: Array, free: Indices, rank: int) -> Factors:
    """Factors with one more column for each free joint: minus the predicted torque, the derivative by log K."""
    joints, columns = list(factors.joints), list(factors.columns)
    for i, j in enumerate(free.tolist()):
        seen = columns[j]
        joints[j] = move(joints[j], np.column_stack([np.eye(len(seen)), -value[seen]]))
        columns[j] = np.append(seen, rank + i)
    return replace(factors, joints=tuple(joints), columns=tuple(columns))


class _Best(NamedTuple):
    """Best constant of one more joint."""

    gram: Array  # (b + 1, b + 1) of all joints that are scaled, with the one tried
    log: float  # of its constant
    margin: float  # of the explained power over any distinct constant [squared standard deviations]


def _start(factors: Factors, free: Indices, rank: int) -> Array:
    """(k,) logarithms of the constants, found one after the other, the clearest first."""
    grams = [_gram(joint, seen, rank) for joint, seen in zip(factors.joints, factors.columns, strict=True)]
    total = np.sum([gram for j, gram in enumerate(grams) if j not in free], axis=0)
    found: dict[int, float] = {}
    while len(found) < len(free):
        trials = {j: _try(total, grams[j]) for j in free.tolist() if j not in found}
        j = max(trials, key=lambda j: trials[j].margin)
        total, found[j] = trials[j].gram, trials[j].log
    return np.array([found[j] for j in free.tolist()])


def _gram(joint: JointFactors, seen: Indices, rank: int) -> Array:
    """Gram matrix (b + 1, b + 1) of [all columns, torque], over the variance of the joint's own residual."""
    own = joint.grams[0][-len(seen) - 1 :, -len(seen) - 1 :]
    power = float(own[-1, -1])
    variance = max(power - _explained(own), EXACT * power, 1e-300) / max(joint.counts[0], 1)
    wide, at = np.zeros((rank + 1, rank + 1)), np.append(seen, rank)
    wide[np.ix_(at, at)] = own / variance
    return wide


def _explained(gram: Array) -> float:
    """Power of the torque that the columns explain."""
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    unit = gram / np.outer(size, size)
    lower = np.linalg.cholesky(unit[:-1, :-1] + RIDGE * np.eye(len(gram) - 1))
    return float(np.sum(np.linalg.solve(lower, unit[:-1, -1]) ** 2) * gram[-1, -1])


def _try(total: Array, gram: Array) -> _Best:
    """Constant with which one more joint, and those that are scaled already, are explained best."""
    here, there = np.diag(total)[:-1], np.diag(gram)[:-1]
    both = (here > SHARED * here.max(initial=0.0)) & (there > SHARED * there.max(initial=0.0))
    middle = float(np.median(np.sqrt(here[both] / there[both]))) if both.any() else 1.0
    inverse = np.concatenate([-middle * GRID[::-1], middle * GRID])  # 1 / K; negative: all signs inverted
    scaled = [total + gram * np.outer(x, x) for x in (np.append(np.full(len(gram) - 1, k), 1.0) for k in inverse)]
    explained = np.array([_explained(g) for g in scaled])
    best = int(np.argmax(explained))
    apart = np.abs(np.log(np.abs(inverse / inverse[best]))) > np.log(DISTINCT)
    margin = float(explained[best] - explained[apart].max())
    return _Best(scaled[best], float(-np.log(np.abs(inverse[best]))), margin)
