"""Evidence -> corrections that let the model explain the torque far better, found one after another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..deadline import time_is_up
from ..types import Array, Frozen, Indices, Mask
from .correction import Correction
from .evidence import Evidence, Signals
from .fits import Columns, fit_joints, unexplained
from .lag import LATE, lag_table

SEARCH = "the search for gross faults"
WELL, CLOSELY = 0.05, 0.01  # unexplained share of the variance that passes for a good fit, and that settles ties
WORTH, NEARLY = 0.8, 0.3  # nats of unexplained variance that a claim needs; by which a rival may do less
LEFT, BETTER = 0.35, 0.5  # unexplained at most afterwards, and at most that share of what it was, on some joint
WORSE = 0.25  # of the variance that is left more on any joint: the correction is none
AGREE = 0.8  # of the blocks
WEAK, STEADY = 0.03, 0.05  # of the second strongest torque's deviation, of the joint's rms torque: less tells nothing
WIDE = 2 * np.pi  # of a travel: less are radians, or a motion of a few degrees
UNITS = {"degrees": np.pi / 180, "revolutions": 2 * np.pi, "millimetres": 1e-3}


class Trial(NamedTuple):
    """A correction that is tried."""

    kind: str
    joints: tuple[int, ...]
    correction: Correction


@dataclass(frozen=True, eq=False)
class Claim(Frozen):
    """A correction that is worth it."""

    kind: str
    joints: tuple[int, ...]
    correction: Correction  # with those before it
    nats: float  # by which unexplained variance falls, its logarithms summed over the joints
    before: float  # [1] unexplained share of the variance, mean over the joints whose torque it betters
    after: float  # [1]
    agreement: float  # [1] share of the blocks in which it does better
    rivals: tuple[Trial, ...] = ()  # that do as well


class Evaluated(NamedTuple):
    """A trial and what it leaves unexplained."""

    trial: Trial
    left: Array  # (n,) [1]
    rank: tuple[float, float]  # the smaller the better


def informative_torques(x: Signals, signed: Mask) -> Mask:
    """(n,) whether a joint's torque is recorded with its sign and strong enough to tell anything.

    Args:
        x: as recorded.
        signed: (n,) whether torque is recorded, with its sign.
    """
    size = np.where(signed, np.std(x.torque, axis=0), 0.0)
    strong = np.sort(size)[-2:][0] if len(size) > 2 else size.max(initial=0.0)
    rms = np.sqrt(np.mean(x.torque**2, axis=0))
    return np.asarray(signed & (size > 0) & (size >= WEAK * strong) & (size >= STEADY * rms))


def search(evidence: Evidence, told: Mask) -> list[Claim]:
    """All claims, in the order of their worth.

    Args:
        evidence: the recordings.
        told: (n,) joints whose torque tells something.
    """
    claims: list[Claim] = []
    done = Correction.none(len(told))
    for _ in range(2 * len(told)):
        if time_is_up(SEARCH, answer=False):
            break
        claim = _next(evidence, done, told)
        if claim is None:
            break
        claims, done = [*claims, claim], claim.correction
    return claims


def _next(evidence: Evidence, done: Correction, told: Mask) -> Claim | None:
    before = _left(evidence, done)
    if _nats(before, told) - told.sum() * np.log(WELL) < WORTH:
        return None
    judged = []
    for trial in _trials(evidence, done, told[list(done.tau_from)]):
        if time_is_up(SEARCH, answer=False):
            return None
        left = _left(evidence, trial.correction)
        if np.any((left - before)[evidence.signed] > WORSE) or not _betters_all(trial, done, told, before, left):
            continue
        judged.append(Evaluated(trial, left, (_nats(left, told), _nats(left, told, CLOSELY))))
    if not judged:
        return None
    judged.sort(key=lambda j: (round(j.rank[0], 1), j.rank[1]))
    best, gained = judged[0], _nats(before, told) - judged[0].rank[0]
    if best.trial.kind == "lag" and np.abs(best.trial.correction.lag - done.lag).max() < LATE:
        return None
    betters = np.flatnonzero(told & (best.left <= BETTER * before))
    if gained < WORTH or not np.any(best.left[betters] <= LEFT):
        return None
    agreement = _agreement(evidence, done, best.trial.correction, betters)
    if agreement < AGREE:
        return None
    rivals = (j.trial for j in judged[1:] if j.rank[0] - best.rank[0] < NEARLY and j.rank[1] - best.rank[1] < NEARLY)
    shares = float(before[betters].mean()), float(best.left[betters].mean())
    return Claim(*best.trial, gained, *shares, agreement, tuple(rivals))


def _left(evidence: Evidence, correction: Correction) -> Array:
    """(n,) [1] unexplained shares of the torques' variances, each in the place of its column of the recording."""
    out = np.empty(len(correction.tau_from))
    out[list(correction.tau_from)] = unexplained(evidence.corrected(correction))
    return out


def _betters_all(trial: Trial, done: Correction, told: Mask, before: Array, left: Array) -> bool:
    """Whether an exchange does good to every torque of its joints that tells anything; of one alone it is chance."""
    columns = [k for k in (done.tau_from[j] for j in trial.joints) if told[k]]
    return "order" not in trial.kind or all(left[k] <= max(before[k], WELL) for k in columns)


def _trials(evidence: Evidence, done: Correction, told: Mask) -> Iterator[Trial]:
    n, prismatic = len(told), evidence.robot.prismatic
    for i in range(n):
        if told[i]:
            yield Trial("torque sign", (i,), done.scale((i,), torque=-1))
        yield Trial("position sign", (i,), done.scale((i,), position=-1))
        yield Trial("axis", (i,), done.scale((i,), position=-1, torque=-1))
    order = _best_order(evidence.corrected(done), told)
    moved = tuple(i for i in range(n) if order[i] != i)
    if len(moved) > 2:
        yield Trial("torque order", moved, done.exchange(order, torques=True))
    for i, j in combinations(range(n), 2):
        swapped = tuple(j if k == i else i if k == j else k for k in range(n))
        if told[i] and told[j]:
            yield Trial("torque order", (i, j), done.exchange(swapped, torques=True))
        yield Trial("position order", (i, j), done.exchange(swapped, positions=True))
        yield Trial("joint order", (i, j), done.exchange(swapped, positions=True, torques=True))
    for unit, scale in UNITS.items():
        which = tuple(np.flatnonzero(prismatic == (unit == "millimetres")).tolist())
        for joints in sorted({which, *((j,) for j in which)} - {()}):
            if unit != "degrees" or np.ptp(evidence.q[:, list(joints)], axis=0).max() > WIDE:
                yield Trial(unit, joints, done.scale(joints, position=scale))
    yield from _lags(evidence, done, told)


def _best_order(x: Signals, told: Mask) -> tuple[int, ...]:
    """Whose torque each joint's is, by what the joints' columns explain of the torques, whatever their sign."""
    from scipy.optimize import linear_sum_assignment  # here, because it takes longer to import than all other checks

    left = np.where(np.eye(len(told)), 0.0, 2.0)
    for i in np.flatnonzero(told):
        columns = Columns(x, int(i))
        for j in np.flatnonzero(told):
            left[i, j] = min(columns.fit(sign * x.torque[:, j]).unexplained for sign in (1, -1))
    return tuple(linear_sum_assignment(left)[1].tolist())


def _lags(evidence: Evidence, done: Correction, told: Mask) -> Iterator[Trial]:
    lags, left = lag_table(evidence, done)
    for joints in sorted({tuple(range(len(told))), *((j,) for j in np.flatnonzero(told).tolist())}):
        own = left[:, [j for j in joints if told[j]]]
        best = int(np.argmin(np.log(np.maximum(own, CLOSELY)).sum(axis=1)))
        if lags[best]:
            yield Trial("lag", joints, done.earlier(joints, float(lags[best])))


def _nats(left: Array, told: Mask, floor: float = WELL) -> float:
    return float(np.sum(np.log(np.maximum(left[told], floor))))


def _agreement(evidence: Evidence, before: Correction, after: Correction, columns: Indices) -> float:
    """[1] share of the blocks in which a correction leaves less of some columns of torque."""
    old, new = (fit_joints(evidence.corrected(c)) for c in (before, after))
    blocks = np.unique(evidence.block)
    size = [np.zeros(len(blocks)), np.zeros(len(blocks))]
    for total, fits, correction in zip(size, (old, new), (before, after), strict=True):
        for j in (correction.tau_from.index(k) for k in columns):
            square = fits[j].residual ** 2 / fits[j].power
            total += [square[evidence.block == k].sum() for k in blocks]
    return float(np.mean(size[1] < size[0]))
