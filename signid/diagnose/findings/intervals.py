"""Standard deviations of the numbers of the selected laws."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
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
from ..search.contributions import measure_contributions
from ..search.stepwise import inflated_dispersion
from .thresholds import BLOCK_PERIODS, MOST_PARTS

STEP = 1e-3  # of the central differences, over the number [1]
LEAST_STEP, LEAST_SHAPE_STEP = 1e-3, 1e-6  # size that a coefficient, a shape counts as at least in that step [its unit]
UNIDENTIFIABLE = 1e-8  # share of a number's sum of squares that nothing else makes, below which its std is infinite [1]
LEVEL = 0.975  # quantile at the upper end of a 95 % interval
RIDGE = 1e-10  # over the diagonal of the normal equations [1]
FACTOR = ""  # key of the one unknown factor of a law whose numbers are all scaled by it [1]
Number = tuple[Law, str]  # a law and the key of one of its numbers


class _NumberModel(NamedTuple):
    """Linear model of all numbers of all laws, beside the refitted columns."""

    slopes: dict[int, Array]  # per joint (M, d) whitened change of torque with each number [1 per unit of the number]
    beside: Fitted  # the refitted columns
    beside_precision: Array  # (k, k) prior precision of these [1 per coefficient, squared]
    precision: Array  # (d, d) prior precision of the numbers [1 per unit of each, squared]
    dispersion: Array  # (n,) variance of the whitened residual [1]


def standard_deviations(
    dataset: Dataset, selection: Selection, laws: Mapping[Group, tuple[Law, ...]]
) -> dict[Group, list[dict[str, float]]]:
    """Standard deviation of every number of each law, shapes included, with everything else fitted beside.

    Model error repeats with the motion and biases numbers more than white noise. Therefore the jackknife over parts of
    the recordings counts where it gives the larger deviation.

    Args:
        dataset: motions and rows.
        selection: the selected laws.
        laws: laws of each hypothesis, with all their numbers.

    Source: Bell and McCaffrey, Bias reduction in standard errors for linear regression with multi-stage samples,
    Survey Methodology 28(2), 2002 (the jackknife over clusters, and Student's t).
    """
    selection = replace(selection, prior_scale=selection.evidence.distance(selection.selected, selection.dispersion))
    numbers = {group: _numbers(group, own) for group, own in laws.items()}
    some = any(numbers.values())
    std = iter(_deviations(dataset, selection, _number_model(dataset, selection, laws, numbers)) if some else ())
    return {group: list(_by_key(group, own, std)) for group, own in laws.items()}


def _numbers(group: Group, own: Sequence[Law]) -> list[Number]:
    """Unknown numbers of the laws of a hypothesis."""
    if group.claim.scaled:
        return [(law, FACTOR) for law in own]
    return [(law, key) for law in own for key in law.parameters]


def _by_key(group: Group, own: Sequence[Law], std: Iterator[float]) -> Iterator[dict[str, float]]:
    """Standard deviations of the laws of a hypothesis by key, from those of its unknown numbers in order."""
    for law in own:
        if group.claim.scaled:
            factor = float(next(std))
            yield {key: factor * abs(x) for key, x in law.parameters.items()}
        else:
            yield {key: float(next(std)) for key in law.parameters}


def _deviations(dataset: Dataset, selection: Selection, model: _NumberModel) -> Array:
    """(d,) standard deviations [units of the numbers]; infinite for an unidentifiable number."""
    data, beside, dispersion = selection.data, model.beside, model.dispersion
    own, _, across = data.products(beside.which, dispersion, model.slopes)
    below = beside.forward(across)
    free = own - below.T @ below
    information = free + model.precision
    size = np.sqrt(np.maximum(np.diag(own + model.precision), 1e-300))
    covariance = np.linalg.pinv(information / size / size[:, None], rcond=1e-8, hermitian=True) / size / size[:, None]
    variance = np.maximum(np.diag(covariance), _variance_over_parts(dataset, selection, model))
    identifiable = np.diag(free) > UNIDENTIFIABLE * np.diag(own)
    return np.asarray(np.where(identifiable, np.sqrt(np.maximum(variance, 0)), np.inf))


def _variance_over_parts(dataset: Dataset, selection: Selection, model: _NumberModel) -> Array:
    """(d,) jackknife variance of each number over parts of the recordings [its unit, squared]; 0 for a single part."""
    part, d = _parts(dataset), len(model.precision)
    count = int(part.max()) + 1
    if count < 2:
        return np.zeros(d)
    residual = measure_contributions(
        selection.evidence, selection.selected, selection.dispersion, selection.prior_scale
    ).residual
    square = np.zeros((count, d + len(model.beside.which), d + len(model.beside.which)))
    right = np.zeros(square.shape[:2])
    for j in range(selection.data.joints):
        here, beside = selection.data.chosen(j, model.beside.which)
        x = np.column_stack([model.slopes.get(j, np.zeros((len(part), d))), beside]) / np.sqrt(model.dispersion[j])
        at = np.concatenate([np.arange(d), d + np.flatnonzero(here)])
        for k in range(count):
            own = x[part == k]
            square[k][np.ix_(at, at)] += own.T @ own
            right[k][at] += own.T @ residual[j][part == k] / np.sqrt(model.dispersion[j])
    return jackknife_variance(square, right, block_diag(model.precision, model.beside_precision), d)


def jackknife_variance(square: Array, right: Array, precision: Array, first: int) -> Array:
    """(d,) jackknife variance of the first d coefficients of a linear model over c parts of its rows.

    Scaled by Student's t over the normal quantile, since there are few parts.

    Args:
        square: (c, k, k) Gram of each part [1 per coefficient, squared].
        right: (c, k) right side of each part, about the coefficients of all rows [1 per coefficient].
        precision: (k, k) of the prior [1 per coefficient, squared].
        first: number d.
    """
    whole = square.sum(axis=0) + precision
    size = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    ridge = RIDGE * np.eye(len(size))
    steps = [
        np.linalg.solve((whole - x) / size / size[:, None] + ridge, y / size)[:first]
        for x, y in zip(square, right, strict=True)
    ]
    count = len(square)
    ratio = float(stdtrit(count - 1, LEVEL)) / TWO_SIDED
    return np.asarray(ratio**2 * (count - 1) * np.var(np.array(steps) / size[:first], axis=0))


def _parts(dataset: Dataset) -> Indices:
    """(M',) part of each whitened row; rows at the same phase of a periodic motion are of the same part."""
    table, length = dataset.table, BLOCK_PERIODS / dataset.task.band.cutoff
    place = table.t.copy()
    for k, period in enumerate(dataset.periods):
        own = table.recording == k
        place[own] = place[own] if period is None else place[own] % period
    order = dataset.noise.coefficients.shape[1]
    rows = np.column_stack([table.recording, place // length])[order:][has_full_window(table.piece, order)]
    block = np.unique(rows, axis=0, return_inverse=True)[1].ravel()
    count = int(block.max()) + 1
    return np.asarray(block * min(MOST_PARTS, count) // count)


def _number_model(
    dataset: Dataset,
    selection: Selection,
    laws: Mapping[Group, tuple[Law, ...]],
    numbers: Mapping[Group, Sequence[Number]],
) -> _NumberModel:
    """Derivatives of torque with respect to all numbers, and priors where the torque is linear in them."""
    dispersion, evidence = inflated_dispersion(selection), selection.evidence
    keys = [one for own in numbers.values() for one in own]
    slopes = {j: x for j, x in dataset.whitening(_slopes(dataset, keys)).items() if x.any()}
    beside, own_precision = _beside(selection, [law for own in laws.values() for law in own], dispersion)
    precision, at, refitted = np.zeros((len(keys), len(keys))), 0, columns_of(evidence.refitted(selection.prior_scale))
    for group, own in laws.items():
        count, linear = len(numbers[group]), all(set(law.effect.linear()) == set(law.parameters) for law in own)
        if linear and count == group.size and not group.claim.scaled:
            whole = evidence.precision((group,), np.ones(len(refitted) + count), selection.prior_scale)
            precision[at : at + count, at : at + count] = whole[-count:, -count:]
        at += count
    return _NumberModel(slopes, beside, own_precision, precision, dispersion)


def _beside(selection: Selection, laws: list[Law], dispersion: Array) -> tuple[Fitted, Array]:
    """Fit of the refitted columns and its prior precision, without stated laws whose numbers are part of these laws."""
    held = {(name, law.joints) for law in laws for name in (law.effect.name, *law.effect.contains)}
    evidence = selection.evidence
    refitted = evidence.refitted(selection.prior_scale)
    kept = np.isin(
        columns_of(refitted),
        columns_of([g for g in refitted if g.law is None or (g.law.effect.name, g.law.joints) not in held]),
    )
    which = columns_of(refitted)[kept]
    gram = total(evidence.data.gram(which), dispersion, (len(which), evidence.data.count))[:, which]
    whole = np.zeros(len(kept))
    whole[kept] = np.diag(gram)
    precision = evidence.precision((), whole, selection.prior_scale)[np.ix_(kept, kept)]
    right = (evidence.data.right[:, which] / dispersion[:, None]).sum(0)
    return solve(which, gram, right, precision), precision


def _slopes(dataset: Dataset, keys: list[Number]) -> dict[int, Array]:
    """Per joint, (M, d) derivative of the torque with respect to each number [torque per unit of the number]."""
    made = []
    for piece in dataset.pieces:
        whole = np.zeros((dataset.table.joints, len(piece.motion), len(keys)))
        for i, (law, key) in enumerate(keys):
            step = STEP * (1.0 if key == FACTOR else max(abs(law.parameters[key]), _least_size(law, key)))
            ahead, behind = (_moved(law, key, s) for s in (step, -step))
            rows = torque_of(ahead, piece.motion)
            for j, y in torque_of(behind, piece.motion).items():
                whole[j, :, i] = (rows[j] - y) / (2 * step)
        made.append(dict(enumerate(whole)))
    return dataset.thinned(made)


def _moved(law: Law, key: str, step: float) -> Law:
    """Law with one number, or the factor of all numbers, changed by a step."""
    changed = {k: x * (1 + step) for k, x in law.parameters.items()}
    return replace(law, parameters=changed if key == FACTOR else {**law.parameters, key: law.parameters[key] + step})


def _least_size(law: Law, key: str) -> float:
    kind = law.effect.parameters[key]
    return LEAST_STEP if isinstance(kind, Coefficient) else LEAST_SHAPE_STEP
