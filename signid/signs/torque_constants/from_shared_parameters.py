"""Factors of signed currents -> torque constants, from the base parameters that joints share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...estimation.least_squares import estimate
from ...regression.factors import Factors, JointFactors
from ...types import Array, BaseMap, Estimate, Frozen, Indices, Mask

GRID = np.geomspace(1e-4, 1e4, 81)  # of the ratio that makes both sides count alike
TOLD = 1e-12  # of the largest: columns that count less in a joint's torque are not shared
RIDGE = 1e-9  # of a scaled Gram matrix
EXACT = 1e-6  # of the torque's power: no residual counts as smaller
APART = 3.0  # factor between two starts that are not the same
ROUNDS, STEP, SETTLED = 15, 0.7, 1e-4  # of Gauss-Newton: at most; largest and smallest step of a logarithm
NUDGE = 1e-3  # of a logarithm of a constant, to see what it does to the base parameters
ASTRAY = 0.1  # standard deviations: where the last step is longer, nothing is told


@dataclass(frozen=True, eq=False)
class Constants(Frozen):
    """Torque constants of n joints, as logarithms, and how far they are told."""

    log: Array  # (n,) of [N.m/A or N/A]
    covariance: Array  # (n, n) [1] relative; 0 where the constant is known, inf or large where nothing is told

    @property
    def std(self) -> Array:
        """(n,) relative standard deviations [1]."""
        return np.sqrt(np.diag(self.covariance))


def share_constants(factors: Factors, base: BaseMap, unknown: Mask) -> Constants:
    """Torque constants K of some joints from those of the others: torque / K is what was recorded.

    Least squares over K and base parameters, each joint's residual in the unit that was recorded (else small K would
    make small residuals). Gauss-Newton: the logarithm of a constant is one more parameter, whose column is the torque
    that the model predicts. It starts from a search over one joint after the other, that whose constant is told best
    first.

    Args:
        factors: of n joints, in torque or, where the constant is unknown, in A; one joint at least is known.
        base: what the columns are.
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
        value, step = found.value[:rank], np.clip(found.value[rank:], -STEP, STEP)
        log[free] += step
        covariance[np.ix_(free, free)] = found.covariance[rank:, rank:]
        if np.abs(step).max() < SETTLED:
            break
    astray = free[np.abs(step) > np.maximum(ASTRAY * np.sqrt(np.diag(covariance)[free]), SETTLED)]
    covariance[astray, astray] = np.inf
    return Constants(log, covariance)


def widen_estimate(found: Estimate, factors: Factors, base: BaseMap, covariance: Array, whiten: bool) -> Estimate:
    """The estimate with the uncertainty that constants add, which many base parameters have in common.

    Args:
        found: from the factors, with the constants taken to be exact.
        factors: of n joints, in torque.
        base: what the columns are.
        covariance: (n, n) [1] of the logarithms of the constants.
        whiten: as for the estimate.
    """
    turns = constant_sensitivity(found, factors, base, np.diag(covariance) > 0, whiten)
    return replace(found, covariance=found.covariance + turns @ covariance @ turns.T)


def constant_sensitivity(found: Estimate, factors: Factors, base: BaseMap, joints: Mask, whiten: bool) -> Array:
    """Derivative (b, n) [units of base] of base parameters with respect to the logarithms of torque constants.

    Args:
        found: estimate from the factors.
        factors: of n joints, in torque.
        base: the base parameters.
        joints: (n,) joints to differentiate for; columns of others are zero.
        whiten: as for the estimate.
    """
    turns = np.zeros((base.rank, len(joints)))
    for j in np.flatnonzero(joints).tolist():
        nudged = _scaled(factors, NUDGE * np.eye(len(joints))[j])
        turns[:, j] = (estimate(nudged, base, found.value, whiten).value - found.value) / NUDGE
    return turns


def move(joint: JointFactors, columns: Array, scale: float = 1.0) -> JointFactors:
    """Factors of a joint over other columns.

    Args:
        joint: over m columns.
        columns: (m, k) the new ones as combinations of the old [units of new over old].
        scale: of the torque.
    """
    m, k = columns.shape
    copies = (joint.grams.shape[1] - 1) // max(m, 1)  # with instruments two, else one
    turn = np.zeros((copies * m + 1, copies * k + 1))
    turn[:-1, :-1], turn[-1, -1] = np.kron(np.eye(copies), columns), scale
    own = turn[-m - 1 :, -k - 1 :]
    whole = own.T @ joint.whole @ own
    return replace(joint, grams=turn.T @ joint.grams @ turn, whole=whole, total=scale * joint.total)


def _recorded(factors: Factors) -> Mask:
    return np.array([joint.counts[0] > 0 for joint in factors.joints])


def _scaled(factors: Factors, log: Array) -> Factors:
    """In torque, with these constants."""
    joints = zip(factors.joints, factors.columns, np.exp(log).tolist(), strict=True)
    moved = tuple(move(joint, np.eye(len(seen)), scale) for joint, seen, scale in joints)
    return replace(factors, joints=moved, sample=None)


def _with_gains(factors: Factors, value: Array, free: Indices, rank: int) -> Factors:
    """With one more column for each free joint: minus the torque predicted, which a larger constant adds to."""
    joints, columns = list(factors.joints), list(factors.columns)
    for i, j in enumerate(free.tolist()):
        seen = columns[j]
        joints[j] = move(joints[j], np.column_stack([np.eye(len(seen)), -value[seen]]))
        columns[j] = np.append(seen, rank + i)
    return replace(factors, joints=tuple(joints), columns=tuple(columns))


class _Best(NamedTuple):
    gram: Array  # (b + 1, b + 1) of all joints that are scaled, with the one tried
    log: float  # of its constant
    clear: float  # by how much any other would explain less, in variance units


def _start(factors: Factors, free: Indices, rank: int) -> Array:
    """(k,) logarithms of the constants, found one after the other."""
    grams = [_gram(joint, seen, rank) for joint, seen in zip(factors.joints, factors.columns, strict=True)]
    told = np.sum([gram for j, gram in enumerate(grams) if j not in free], axis=0)
    found: dict[int, float] = {}
    while len(found) < len(free):
        trials = {j: _try(told, grams[j]) for j in free.tolist() if j not in found}
        j = max(trials, key=lambda j: trials[j].clear)
        told, found[j] = trials[j].gram, trials[j].log
    return np.array([found[j] for j in free.tolist()])


def _gram(joint: JointFactors, seen: Indices, rank: int) -> Array:
    """(b + 1, b + 1) of [all columns, torque], in variance units of what the joint by itself leaves unexplained."""
    own = joint.grams[0][-len(seen) - 1 :, -len(seen) - 1 :]
    power = float(own[-1, -1])
    variance = max(power - _explained(own), EXACT * power, 1e-300) / max(joint.counts[0], 1)
    wide, at = np.zeros((rank + 1, rank + 1)), np.append(seen, rank)
    wide[np.ix_(at, at)] = own / variance
    return wide


def _explained(gram: Array) -> float:
    """What the columns explain of the torque's power."""
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    unit = gram / np.outer(size, size)
    lower = np.linalg.cholesky(unit[:-1, :-1] + RIDGE * np.eye(len(gram) - 1))
    return float(np.sum(np.linalg.solve(lower, unit[:-1, -1]) ** 2) * gram[-1, -1])


def _try(told: Array, gram: Array) -> _Best:
    """The constant with which one more joint, and those that are scaled already, are explained best."""
    here, there = np.diag(told)[:-1], np.diag(gram)[:-1]
    both = (here > TOLD * here.max(initial=0.0)) & (there > TOLD * there.max(initial=0.0))
    middle = float(np.median(np.sqrt(here[both] / there[both]))) if both.any() else 1.0
    inverse = np.concatenate([-middle * GRID[::-1], middle * GRID])  # 1 / K; below 0 the signs are all the other way
    scaled = [told + gram * np.outer(x, x) for x in (np.append(np.full(len(gram) - 1, k), 1.0) for k in inverse)]
    explained = np.array([_explained(g) for g in scaled])
    best = int(np.argmax(explained))
    apart = np.abs(np.log(np.abs(inverse / inverse[best]))) > np.log(APART)
    clear = float(explained[best] - explained[apart].max())
    return _Best(scaled[best], float(-np.log(np.abs(inverse[best]))), clear)
