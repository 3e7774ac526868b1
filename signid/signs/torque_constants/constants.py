"""Torque constants from the base parameters that joints share, and from the inertials of the description."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...estimation.least_squares import estimate
from ...model import stated_inertials
from ...regression.factors import Factors, JointFactors
from ...regression.rows import Task
from ...types import Array, BaseMap, Estimate, Frozen, Indices, Mask
from ..thresholds import INERTIAL_ERROR, UNKNOWN_CONSTANT

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
FLAT = 30.0  # [log] standard deviation of an uninformative constant: thirteen decades
EXACT_STD = 1e-4  # [log] standard deviation of an exact constant; keeps matrices regular


@dataclass(frozen=True, eq=False)
class Constants(Frozen):
    """Torque constants of n joints, as logarithms with their covariance."""

    log: Array  # (n,) logarithms of constants in [N.m/A or N/A]
    covariance: Array  # (n, n) of the logarithms [1]; 0: known constant; inf or large: unidentifiable
    described: bool = False  # whether the description was needed
    settled: bool = True  # whether signs and constants no longer changed in the last round

    @property
    def std(self) -> Array:
        """(n,) relative standard deviations [1]."""
        return np.sqrt(np.diag(self.covariance))


def share_constants(factors: Factors, base: BaseMap, unknown: Mask) -> Constants:
    """Torque constants K of the joints `unknown` (n,) from those of the others, at least one; torque / K was recorded.

    Gauss-Newton over K and base parameters, with each joint's residual in its recorded unit, since small K would
    otherwise make small residuals. The logarithm of a constant is one more parameter, whose column is the predicted
    torque. The start is a grid search over one joint after the other, the best identifiable constant first.

    Source: Gautier, Vandanjon, Presse, IEEE ICRA 1994 (drive gains beside inertial parameters).
    """
    n, rank = len(unknown), base.rank
    free = np.flatnonzero(unknown & np.array([joint.counts[0] > 0 for joint in factors.joints]))
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
    """Add the uncertainty of torque constants to an estimate; covariance (n, n) [1] is that of their logarithms."""
    slopes = constant_sensitivity(found, factors, base, np.diag(covariance) > 0, whiten)
    return replace(found, covariance=found.covariance + slopes @ covariance @ slopes.T)


def constant_sensitivity(found: Estimate, factors: Factors, base: BaseMap, joints: Mask, whiten: bool) -> Array:
    """Derivative (b, n) [units of base] of base parameters by the logarithms of constants; zero for other joints."""
    slopes = np.zeros((base.rank, len(joints)))
    for j in np.flatnonzero(joints).tolist():
        moved = _scaled(factors, DIFFERENCE * np.eye(len(joints))[j])
        slopes[:, j] = (estimate(moved, base, found.value, whiten).value - found.value) / DIFFERENCE
    return slopes


def move(joint: JointFactors, columns: Array, scale: float = 1.0) -> JointFactors:
    """Factors of a joint over k combinations of its m columns (m, k) [units of new over old], with scaled torque."""
    m, k = columns.shape
    copies = (joint.grams.shape[1] - 1) // max(m, 1)  # two with instruments, else one
    turn = np.zeros((copies * m + 1, copies * k + 1))
    turn[:-1, :-1], turn[-1, -1] = np.kron(np.eye(copies), columns), scale
    own = turn[-m - 1 :, -k - 1 :]
    whole = own.T @ joint.whole @ own
    return replace(joint, grams=turn.T @ joint.grams @ turn, whole=whole, total=scale * joint.total)


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


def describe_constants(task: Task, factors: Factors) -> Constants:
    """Torque constants of n joints, each alone, from the rigid-body torque of the stated inertials.

    The recorded currents of a joint are regressed on that torque and on the joint's laws. The covariance includes noise
    and the error of the description; it is infinite where the torque is indistinguishable from the laws.
    """
    stated = stated_inertials(task.robot)
    bodies = task.base.combination[:, : stated.size]
    rigid, n = bodies @ stated.ravel(), len(factors.joints)
    log, noise, off = np.zeros(n), np.full(n, np.inf), np.zeros((n, stated.size))
    for j, (joint, seen) in enumerate(zip(factors.joints, factors.columns, strict=True)):
        laws = [k for k, label in enumerate(task.base.labels) if label.law is not None and label.joint == j]
        columns = np.column_stack([rigid[seen], task.base.combination[seen][:, laws]])
        if not joint.counts[0] or not rigid[seen].any():
            continue
        one = replace(factors, joints=(move(joint, columns),), columns=(np.arange(len(laws) + 1),), sample=None)
        found = estimate(one, task.base, np.zeros(len(laws) + 1))
        inverse, std = float(found.value[0]), float(np.sqrt(found.covariance[0, 0]))
        if inverse > 0 and std < UNKNOWN_CONSTANT * inverse:
            log[j], noise[j] = -np.log(inverse), std / inverse
            off[j] = _share(joint.grams[0][-len(seen) - 1 : -1, -len(seen) - 1 : -1], columns, bodies[seen])
    off *= INERTIAL_ERROR * np.concatenate([_sizes(body) for body in stated])
    return Constants(log, off @ off.T + np.diag(noise**2))


def combine(relative: Constants, described: Constants, known: Mask) -> Constants:
    """Combine relative constants from shared parameters with those from the description, weighted by their covariances.

    If the descriptions of several joints disagree by more than their covariance, it is inflated. The constant of joints
    `known` (n,) is exactly 1.
    """
    log, before = relative.log.copy(), relative.covariance.copy()
    lost = ~(relative.std < UNKNOWN_CONSTANT)
    before[lost], before[:, lost] = 0.0, 0.0
    before += FLAT**2 * (1.0 + np.diag(lost))
    at = np.flatnonzero(known | np.isfinite(described.std))
    if not len(at):
        return Constants(log, before)
    stated = np.where(known | known[:, None], EXACT_STD**2 * np.eye(len(log)), described.covariance)[np.ix_(at, at)]
    difference = np.where(known, 0.0, described.log)[at] - np.where(lost, 0.0, log)[at]
    log[lost] = 0.0
    shared = before[np.ix_(at, at)]
    freedom = max(int(np.sum(~lost[at])) - 1, 1)
    chi2 = float(difference @ np.linalg.solve(shared + stated, difference)) / freedom
    gain = np.linalg.solve(shared + max(chi2, 1.0) * stated, before[at]).T
    return Constants(log + gain @ difference, before - gain @ before[at])


def _share(gram: Array, columns: Array, bodies: Array) -> Array:
    """Relative change (10 nb,) of the regressed torque with each inertial parameter [1 over its unit]."""
    normal = columns.T @ gram @ columns
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-10, hermitian=True) / np.outer(size, size)
    return np.asarray(inverse[0] @ columns.T @ gram @ bodies)


def _sizes(body: Array) -> Array:
    """Scales (10,) of the inertial parameters of a body: those of its mass at its radius of gyration."""
    mass, second = body[0], max((body[4] + body[6] + body[9]) / 2, 0.0)
    return np.array([mass, *[np.sqrt(max(mass * second, 0.0))] * 3, *[second] * 6])
