"""Standard deviations of the numbers of the selected laws, and the covariance of the extended simulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from ...estimation.repeats import jackknife_variance
from ...model import Model
from ...regression.base_parameters import Covariance, base_covariance, build_base
from ...robot.dynamics import own_body
from ...types import INERTIAL, Array, Coefficient, Indices, Law
from ..data.dataset import Dataset, Fitted, columns_of, solve
from ..data.hypotheses import is_refitted
from ..data.motions import torque_of
from ..data.noise import has_full_window
from ..data.rows import Group
from ..evidence.prior import law_parameter_columns, parameter_columns
from ..evidence.selection import Selection
from ..search.contributions import measure_contributions
from ..search.stepwise import inflated_dispersion
from ..thresholds import BLOCK_PERIODS, MAX_JACKKNIFE_PARTS
from .held_out_selection import ExtendedSimulation

DIFFERENCE_STEP = 1e-3  # of the central differences, over the number [1]
MIN_COEFFICIENT_SIZE, MIN_SHAPE_SIZE = 1e-3, 1e-6  # in that step [its unit]
MIN_OWN_SHARE = 1e-8  # share of a number's sum of squares that nothing else makes, below which its std is infinite [1]
FACTOR_KEY = ""  # key of the one unknown factor of a law whose numbers are all scaled by it [1]
LawNumber = tuple[Law, str]  # a law and the key of one of its numbers


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

    Source: Bell and McCaffrey, Bias reduction in standard errors for linear regression with multi-stage samples,
    Survey Methodology 28(2), 2002 (the jackknife over clusters, and Student's t).
    """
    selection = replace(selection, prior_scale=selection.evidence.distance(selection.selected, selection.dispersion))
    numbers = {
        group: [(law, key) for law in own for key in ((FACTOR_KEY,) if group.claim.scaled else law.parameters)]
        for group, own in laws.items()
    }
    some = any(numbers.values())
    std = iter(_deviations(dataset, selection, _number_model(dataset, selection, laws, numbers)) if some else ())
    return {group: list(_by_key(group, own, std)) for group, own in laws.items()}


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
    variance = _with_gains(covariance, across, selection, beside)
    variance = np.maximum(variance, _variance_over_parts(dataset, selection, model))
    identifiable = np.diag(free) > MIN_OWN_SHARE * np.diag(own)
    return np.asarray(np.where(identifiable, np.sqrt(np.maximum(variance, 0)), np.inf))


def _with_gains(covariance: Array, across: Array, selection: Selection, beside: Fitted) -> Array:
    """(d,) variances of numbers, covariance (d, d), with gains beside them as uncertain as their prior.

    across: (k, d) products of the columns beside and of the numbers [1 per coefficient of each].
    """
    prior = selection.data.gains
    at, d = prior.among(beside.which), len(covariance)
    inverse = beside.backward(beside.forward(np.eye(len(beside.which))[:, at]))
    turn = np.vstack([np.eye(d), -inverse.T @ across])
    whole = turn @ covariance @ turn.T
    whole[d:, d:] += inverse[at]
    return np.diag(prior.widened(whole, d + np.arange(len(at))))[:d]


def _variance_over_parts(dataset: Dataset, selection: Selection, model: _NumberModel) -> Array:
    """(d,) jackknife variance of each number over parts of the recordings [its unit, squared]; 0 for a single part."""
    part, d = _parts(dataset), len(model.precision)
    if not part.any():
        return np.zeros(d)
    count, own = int(part.max()) + 1, selection
    residual = measure_contributions(own.evidence, own.selected, own.dispersion, own.prior_scale).residual
    square = np.zeros((count, d + len(model.beside.which), d + len(model.beside.which)))
    right = np.zeros(square.shape[:2])
    for j in range(selection.data.joints):
        here, beside = selection.data.chosen(j, model.beside.which)
        x = np.column_stack([model.slopes.get(j, np.zeros((len(part), d))), beside]) / np.sqrt(model.dispersion[j])
        at = np.append(np.arange(d), d + np.flatnonzero(here))
        for k in range(count):
            rows = x[part == k]
            square[k][np.ix_(at, at)] += rows.T @ rows
            right[k][at] += rows.T @ residual[j][part == k] / np.sqrt(model.dispersion[j])
    return jackknife_variance(square, right, block_diag(model.precision, model.beside_precision), d)


def _parts(dataset: Dataset) -> Indices:
    """(M',) part of each whitened row; rows at the same phase of a periodic motion are of the same part."""
    table, length = dataset.table, BLOCK_PERIODS / dataset.task.band.cutoff
    place = table.since_origin()
    for k, period in enumerate(dataset.periods):
        own = table.recording == k
        place[own] = place[own] if period is None else place[own] % period
    order = dataset.noise.coefficients.shape[1]
    rows = np.column_stack([table.recording, place // length])[order:][has_full_window(table.piece, order)]
    block = np.unique(rows, axis=0, return_inverse=True)[1].ravel()
    count = int(block.max()) + 1
    return np.asarray(block * min(MAX_JACKKNIFE_PARTS, count) // count)


def _number_model(
    dataset: Dataset,
    selection: Selection,
    laws: Mapping[Group, tuple[Law, ...]],
    numbers: Mapping[Group, Sequence[LawNumber]],
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
    evidence, refitted = selection.evidence, selection.evidence.refitted(selection.prior_scale)
    others = [g for g in refitted if g.law is None or (g.law.effect.name, g.law.joints) not in held]
    which, kept = columns_of(others), np.isin(columns_of(refitted), columns_of(others))
    gram = np.tensordot(1 / dispersion, evidence.data.squares(range(evidence.data.joints), which), axes=1)
    whole = np.zeros(len(kept))
    whole[kept] = np.diag(gram)
    precision = evidence.precision((), whole, selection.prior_scale)[np.ix_(kept, kept)]
    right = (evidence.data.right[:, which] / dispersion[:, None]).sum(0)
    return solve(which, gram, right, precision), precision


def _slopes(dataset: Dataset, keys: list[LawNumber]) -> dict[int, Array]:
    """Per joint, (M, d) derivative of the torque with respect to each number [torque per unit of the number]."""
    made = []
    for piece in dataset.pieces:
        whole = np.zeros((dataset.table.joints, len(piece.motion), len(keys)))
        for i, (law, key) in enumerate(keys):
            step = DIFFERENCE_STEP * _size(law, key)
            ahead, behind = (_moved(law, key, s) for s in (step, -step))
            rows = torque_of(ahead, piece.motion)
            for j, y in torque_of(behind, piece.motion).items():
                whole[j, :, i] = (rows[j] - y) / (2 * step)
        made.append(dict(enumerate(whole)))
    return dataset.thinned(made)


def _moved(law: Law, key: str, step: float) -> Law:
    """Law with one number, or the factor of all numbers, changed by a step."""
    scaled = {k: x * (1 + step) for k, x in law.parameters.items()}
    return replace(law, parameters=scaled if key == FACTOR_KEY else {**law.parameters, key: law.parameters[key] + step})


def _size(law: Law, key: str) -> float:
    """Size that a number counts as in the step of its difference [its unit]."""
    if key == FACTOR_KEY:
        return 1.0
    least = MIN_COEFFICIENT_SIZE if isinstance(law.effect.parameters[key], Coefficient) else MIN_SHAPE_SIZE
    return max(abs(law.parameters[key]), least)


def extended_covariance(model: Model, selection: Selection, extended: ExtendedSimulation) -> Covariance:
    """Covariance of base parameters and laws of the extended simulation, about its own numbers.

    For numbers that keep their stated values, the square of the step that the fit would have made is added.
    """
    evidence = selection.evidence
    fit = replace(selection, prior_scale=max(selection.prior_scale, 1.0)).reported()
    linear = [law for law in model.laws if _is_base_law(law)]
    base = build_base(model.robot, linear)
    place = {label.name: k for k, label in enumerate(base.labels)}
    numbers = [(group, own) for group, own in extended.laws.items() if not group.claim.bodies]
    stated = parameter_columns(model, evidence.data.refitted).items()
    sources = [*stated, *(one for group, own in numbers for one in law_parameter_columns(model, group, own))]
    at = {int(column): k for k, column in enumerate(fit.which)}
    share = np.zeros((len(place), len(fit.which)))
    for name, column in sources:
        if name in place and column in at:
            share[place[name], at[column]] = 1.0
    for group in (group for group in extended.laws if group.claim.bodies):
        body = own_body(model.robot, group.claim.laws[0].joints[0]) + 1
        for name, row in zip(INERTIAL, group.claim.numbers, strict=False):
            share[place[f"{name}_{body}"], fit.place(group)] = row
    mixed = base.combination @ share
    moved = np.isin(fit.which, columns_of([*selection.selected, *extended.refitted]))
    step = mixed @ np.where(moved, 0.0, fit.value)
    matrix = mixed @ fit.covariance @ mixed.T + np.outer(step, step)
    coefficients = [x for law in linear for x in law.effect.coefficients(law.parameters)]
    values = base.combination @ np.concatenate([model.inertials.ravel(), coefficients])
    lost = np.diag(matrix) <= 0
    matrix[lost, lost] = np.inf
    return base_covariance(base, values, matrix)


def _is_base_law(law: Law) -> bool:
    """Whether a law is linear in its numbers, so that these are base parameters."""
    effect = law.effect
    if effect.scope != "joint" or effect.shape(law.parameters) or not is_refitted(law):
        return False
    return bool(effect.coefficients(effect.example) == [effect.example[key] for key in effect.linear()])
