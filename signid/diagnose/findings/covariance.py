"""Covariance of the base parameters and laws of the extended simulation."""

from __future__ import annotations

import numpy as np

from ...effects.law import coefficient_count
from ...model import Model
from ...regression.base_parameters import build_base
from ...regression.covariance import Covariance, base_covariance
from ...robot.dynamics import own_body
from ...types import INERTIAL, Array, Law
from ..data.hypotheses import is_refitted
from ..data.whitened_rows import columns_of
from ..evidence.prior import law_parameter_columns, parameter_columns
from ..evidence.selection import Selection
from .held_out_selection import ExtendedSimulation


def extended_covariance(model: Model, selection: Selection, extended: ExtendedSimulation) -> Covariance:
    """Covariance of base parameters and laws of the extended simulation, about its own numbers.

    For numbers that keep their stated values, the square of the step that the fit would have made is added.

    Args:
        model: the extended simulation.
        selection: the selected laws.
        extended: what the extended simulation contains.
    """
    evidence = selection.evidence
    fit = evidence.fit(selection.selected, selection.dispersion, max(selection.prior_scale, 1.0))
    linear = [law for law in model.laws if _is_base_law(law)]
    base = build_base(model.robot, linear)
    place = {label.name: k for k, label in enumerate(base.labels)}
    sources = list(parameter_columns(model, evidence.data.refitted).items())
    for group, own in extended.laws.items():
        if not group.claim.bodies:
            sources += law_parameter_columns(model, group, own)
    at = {int(column): k for k, column in enumerate(fit.which)}
    share = np.zeros((len(place), len(fit.which)))
    for name, column in sources:
        if name in place and column in at:
            share[place[name], at[column]] = 1.0
    for group in (group for group in extended.laws if group.claim.bodies):
        body, numbers = own_body(model.robot, group.claim.laws[0].joints[0]) + 1, group.claim.numbers
        for name, row in zip(INERTIAL, numbers, strict=False):
            share[place[f"{name}_{body}"], fit.place(group)] = row
    mixed = base.combination @ share
    matrix = mixed @ fit.covariance @ mixed.T
    moved = np.isin(fit.which, columns_of([*selection.selected, *extended.refitted]))
    step = mixed @ np.where(moved, 0.0, fit.value)
    matrix = matrix + np.outer(step, step)
    values = base.combination @ np.concatenate([model.inertials.ravel(), *(_coefficients(law) for law in linear)])
    lost = np.diag(matrix) <= 0
    matrix[lost, lost] = np.inf
    return base_covariance(base, values, matrix)


def _is_base_law(law: Law) -> bool:
    """Whether a law is linear in its numbers, so that these are base parameters."""
    effect = law.effect
    if effect.scope != "joint" or effect.shape(law.parameters) or not is_refitted(law):
        return False
    return bool(effect.coefficients(effect.example) == [effect.example[key] for key in effect.linear()])


def _coefficients(law: Law) -> Array:
    """Linear coefficients of a law."""
    return np.array(law.effect.coefficients(law.parameters)[: coefficient_count(law)])
