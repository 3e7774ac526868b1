"""Laws that are selected -> the standard deviation of each of their numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from ...parameters import TWO_SIDED
from ...types import Array, Coefficient, Indices, Law
from ..data.column_groups import Group
from ..data.dataset import Dataset
from ..data.motions import torque_of
from ..data.noise import has_full_window
from ..data.normal_equations import Fitted, solve
from ..data.whitened_rows import columns_of, total
from ..evidence.selection import Selection
from ..search.contributions import measure_sizes
from ..search.stepwise import inflated_dispersion

STEP = 1e-3  # of a number, for derivatives
UNTOLD = 1e-8  # share of a number's torque that nothing else makes: less does not tell it
BLOCK, PARTS = 8.0, 10  # periods of the cut-off in which the motion becomes another; parts at most
LEVEL = 0.975  # of the distribution that intervals end at
RIDGE = 1e-10  # of the diagonal
FACTOR = ""  # the number of a law of which one factor of all numbers is unknown [1 of its value]
Number = tuple[Law, str]  # one of the numbers of a law


class Asked(NamedTuple):
    """All numbers of all laws, beside what is refitted."""

    slopes: dict[int, Array]  # per joint (M, d) [1 per unit of each number] whitened
    beside: Fitted
    beside_precision: Array  # (k, k) [1 per coefficient, squared] of the prior
    precision: Array  # (d, d) [1 per unit of each number, squared] of the prior
    dispersion: Array  # (n,) [1]


def deviations(
    dataset: Dataset, found: Selection, laws: Mapping[Group, tuple[Law, ...]]
) -> dict[Group, list[dict[str, float]]]:
    """Standard deviation of every number of each law, shapes too, while everything else is fitted beside.

    Model error that the discrepancy does not cover repeats with the motion: where numbers vary more when parts of the
    recordings are left out than white rows would let them, the larger deviation holds.

    Args:
        dataset: gives the motions.
        found: the selected laws.
        laws: of each hypothesis, with all their numbers.

    Source: Bell and McCaffrey, Bias reduction in standard errors for linear regression with multi-stage samples,
    Survey Methodology 28(2), 2002 (the jackknife over clusters, and Student's t).
    """
    found = replace(found, prior_scale=found.evidence.distance(found.selected, found.dispersion))
    numbers = {group: _numbers(group, own) for group, own in laws.items()}
    some = any(numbers.values())
    std = iter(_spreads(dataset, found, _asked(dataset, found, laws, numbers)) if some else ())
    return {group: list(_of_each(group, own, std)) for group, own in laws.items()}


def _numbers(group: Group, own: Sequence[Law]) -> list[Number]:
    """What is unknown of some laws."""
    if group.claim.scaled:
        return [(law, FACTOR) for law in own]
    return [(law, key) for law in own for key in law.parameters]


def _of_each(group: Group, own: Sequence[Law], std: Iterator[float]) -> Iterator[dict[str, float]]:
    """Standard deviations of all numbers of some laws, from those of what is unknown of them."""
    for law in own:
        if group.claim.scaled:
            factor = float(next(std))
            yield {key: factor * abs(x) for key, x in law.parameters.items()}
        else:
            yield {key: float(next(std)) for key in law.parameters}


def _spreads(dataset: Dataset, found: Selection, asked: Asked) -> Array:
    """(d,) standard deviations [units of the numbers]."""
    data, beside, dispersion = found.data, asked.beside, asked.dispersion
    own, _, across = data.products(beside.which, dispersion, asked.slopes)
    below = beside.forward(across)
    free = own - below.T @ below
    information = free + asked.precision
    size = np.sqrt(np.maximum(np.diag(own + asked.precision), 1e-300))
    covariance = np.linalg.pinv(information / size / size[:, None], rcond=1e-8, hermitian=True) / size / size[:, None]
    variance = np.maximum(np.diag(covariance), _jackknifed(dataset, found, asked))
    told = np.diag(free) > UNTOLD * np.diag(own)
    return np.asarray(np.where(told, np.sqrt(np.maximum(variance, 0)), np.inf))


def _jackknifed(dataset: Dataset, found: Selection, asked: Asked) -> Array:
    """(d,) variance of each number [its unit, squared], from what it becomes without one part of the recordings.

    Student's t instead of the normal distribution, since there are few parts.
    """
    part, d = _parts(dataset), len(asked.precision)
    count = int(part.max()) + 1
    if count < 2:
        return np.zeros(d)
    rest = measure_sizes(found.evidence, found.selected, found.dispersion, found.prior_scale).rest
    square = np.zeros((count, d + len(asked.beside.which), d + len(asked.beside.which)))
    right = np.zeros(square.shape[:2])
    for j in range(found.data.joints):
        here, beside = found.data.chosen(j, asked.beside.which)
        x = np.column_stack([asked.slopes.get(j, np.zeros((len(part), d))), beside]) / np.sqrt(asked.dispersion[j])
        at = np.concatenate([np.arange(d), d + np.flatnonzero(here)])
        for k in range(count):
            own = x[part == k]
            square[k][np.ix_(at, at)] += own.T @ own
            right[k][at] += own.T @ rest[j][part == k] / np.sqrt(asked.dispersion[j])
    whole = square.sum(axis=0)
    whole[:d, :d] += asked.precision
    whole[d:, d:] += asked.beside_precision
    size = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    ridge = RIDGE * np.eye(len(size))
    steps = [
        np.linalg.solve((whole - x) / size / size[:, None] + ridge, y / size)[:d]
        for x, y in zip(square, right, strict=True)
    ]
    wide = float(stdtrit(count - 1, LEVEL)) / TWO_SIDED
    return np.asarray(wide**2 * (count - 1) * np.var(np.array(steps) / size[:d], axis=0))


def _parts(dataset: Dataset) -> Indices:
    """(M',) which part a whitened row is of: of a motion that repeats, rows at the same place in it are of one."""
    table, length = dataset.table, BLOCK / dataset.task.band.cutoff
    place = table.t.copy()
    for k, period in enumerate(dataset.periods):
        own = table.recording == k
        place[own] = place[own] if period is None else place[own] % period
    order = dataset.noise.coefficients.shape[1]
    rows = np.column_stack([table.recording, place // length])[order:][has_full_window(table.piece, order)]
    block = np.unique(rows, axis=0, return_inverse=True)[1].ravel()
    count = int(block.max()) + 1
    return np.asarray(block * min(PARTS, count) // count)


def _asked(
    dataset: Dataset,
    found: Selection,
    laws: Mapping[Group, tuple[Law, ...]],
    numbers: Mapping[Group, Sequence[Number]],
) -> Asked:
    dispersion, evidence, keys = (
        inflated_dispersion(found),
        found.evidence,
        [one for own in numbers.values() for one in own],
    )
    slopes = {j: x for j, x in dataset.whiten(_slopes(dataset, keys)).items() if x.any()}
    beside, own_precision = _beside(found, [law for own in laws.values() for law in own], dispersion)
    precision, at, refitted = np.zeros((len(keys), len(keys))), 0, columns_of(evidence.refitted(found.prior_scale))
    for group, own in laws.items():
        count, linear = len(numbers[group]), all(set(law.effect.linear()) == set(law.parameters) for law in own)
        if linear and count == group.size and not group.claim.scaled:
            whole = evidence.precision((group,), np.ones(len(refitted) + count), found.prior_scale)
            precision[at : at + count, at : at + count] = whole[-count:, -count:]
        at += count
    return Asked(slopes, beside, own_precision, precision, dispersion)


def _beside(found: Selection, laws: list[Law], dispersion: Array) -> tuple[Fitted, Array]:
    """All that is refitted, but these laws and plain ones that they contain: their numbers are in those of the laws.

    And its prior precision.
    """
    held = {(name, law.joints) for law in laws for name in (law.effect.name, *law.effect.contains)}
    evidence = found.evidence
    refitted = evidence.refitted(found.prior_scale)
    kept = np.isin(
        columns_of(refitted),
        columns_of([g for g in refitted if g.law is None or (g.law.effect.name, g.law.joints) not in held]),
    )
    which = columns_of(refitted)[kept]
    gram = total(evidence.data.gram(which), dispersion, (len(which), evidence.data.count))[:, which]
    whole = np.zeros(len(kept))
    whole[kept] = np.diag(gram)
    precision = evidence.precision((), whole, found.prior_scale)[np.ix_(kept, kept)]
    right = (evidence.data.right[:, which] / dispersion[:, None]).sum(0)
    return solve(which, gram, right, precision), precision


def _slopes(dataset: Dataset, keys: list[Number]) -> dict[int, Array]:
    """Per joint, (M, d) change of torque with each number [torque per unit of the number]."""
    made = []
    for piece in dataset.pieces:
        whole = np.zeros((dataset.table.joints, len(piece.motion), len(keys)))
        for i, (law, key) in enumerate(keys):
            step = STEP * (1.0 if key == FACTOR else max(abs(law.parameters[key]), _least(law, key)))
            ahead, behind = (_moved(law, key, s) for s in (step, -step))
            rows = torque_of(ahead, piece.motion)
            for j, y in torque_of(behind, piece.motion).items():
                whole[j, :, i] = (rows[j] - y) / (2 * step)
        made.append(dict(enumerate(whole)))
    return dataset.thinned(made)


def _moved(law: Law, key: str, step: float) -> Law:
    changed = {k: x * (1 + step) for k, x in law.parameters.items()}
    return replace(law, parameters=changed if key == FACTOR else {**law.parameters, key: law.parameters[key] + step})


def _least(law: Law, key: str) -> float:
    kind = law.effect.parameters[key]
    return 1e-3 if isinstance(kind, Coefficient) else 1e-6
