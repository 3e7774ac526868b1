"""The covariance that a model carries -> a prior of what is fitted; a fit -> the covariance of the extended model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...effects.law import coefficient_count
from ...model import Model
from ...regression.base_parameters import build_base
from ...regression.covariance import Covariance, base_covariance
from ...regression.regressor import labels
from ...robot.dynamics import carried
from ...types import INERTIAL, Array, Law
from ..data.column_groups import Group
from ..data.hypotheses import refits
from ..data.whitened_rows import columns_of
from ..findings.held_out_selection import Extended
from .bayes_factors import Evidence
from .linear_model import Known
from .selection import Found

WEAK = 1e-9  # of the largest variance, scaled: the least that a covariance is inverted with


def known_before(model: Model, groups: Sequence[Group]) -> Known | None:
    """What identification left open of a simulation, as a prior about what it states; None where it carries nothing.

    What the simulation does not have any more (a law that was taken out) is zero, not unknown.

    Args:
        model: the simulation.
        groups: columns, as laid out.
    """
    if model.covariance is None:
        return None
    columns = _columns(model, groups)
    own = model.covariance
    there = np.array([label in columns for label in own.labels])
    rows = np.isfinite(own.std)
    combination = own.combination[np.ix_(rows, there)]
    places = np.array([columns[label] for label, yes in zip(own.labels, there, strict=True) if yes], dtype=np.intp)
    covariance = own.matrix[np.ix_(rows, rows)]
    size = np.sqrt(np.diag(covariance))
    inverse = np.linalg.inv(covariance / size / size[:, None] + WEAK * np.eye(len(size))) / size / size[:, None]
    order = np.argsort(places)
    information = (combination.T @ inverse @ combination)[np.ix_(order, order)]
    return Known(places[order], information)


def covariance_after(model: Model, evidence: Evidence, found: Found, extended: Extended) -> Covariance:
    """The covariance of base parameters and laws of the extended simulation, about what it states.

    Where numbers were not refitted though the recordings would have moved them, the square of that step is added.

    Args:
        model: the extended simulation.
        evidence: rows.
        found: the selected laws.
        extended: what was handed out.
    """
    fit = evidence.fit(found.true, found.base, max(found.trust, 1.0))
    linear = [law for law in model.laws if _is_base_law(law)]
    base = build_base(model.robot, linear)
    place = {label.name: k for k, label in enumerate(base.labels)}
    sources = list(_columns(model, evidence.data.refitted).items())
    for group, own in extended.laws.items():
        if not group.claim.bodies:
            sources += _of_laws(model, group, own)
    at = {int(column): k for k, column in enumerate(fit.which)}
    share = np.zeros((len(place), len(fit.which)))
    for name, column in sources:
        if name in place and column in at:
            share[place[name], at[column]] = 1.0
    for group in (group for group in extended.laws if group.claim.bodies):
        body, numbers = carried(model.robot, group.claim.laws[0].joints[0]) + 1, group.claim.numbers
        for name, row in zip(INERTIAL, numbers, strict=False):
            share[place[f"{name}_{body}"], fit.place(group)] = row
    mixed = base.combination @ share
    matrix = mixed @ fit.covariance @ mixed.T
    moved = np.isin(fit.which, columns_of([*found.true, *extended.refitted]))
    step = mixed @ np.where(moved, 0.0, fit.value)
    matrix = matrix + np.outer(step, step)
    values = base.combination @ np.concatenate([model.inertials.ravel(), *(_coefficients(law) for law in linear)])
    lost = np.diag(matrix) <= 0
    matrix[lost, lost] = np.inf
    return base_covariance(base, values, matrix)


def _columns(model: Model, groups: Sequence[Group]) -> dict[str, int]:
    """Where the coefficient of each standard parameter stands among the columns that are refitted."""
    out, body = dict[str, int](), 0
    for group in groups:
        if group.bodies:
            body += 1
            out |= {f"{name}_{body}": group.start + k for k, name in enumerate(INERTIAL)}
        elif group.law is not None:
            out |= dict(_of_laws(model, group, (group.law,)))
    return out


def _of_laws(model: Model, group: Group, own: Sequence[Law]) -> list[tuple[str, int]]:
    names = [label.name for label in labels(model.robot, own)[10 * len(model.robot.links) :]]
    return [(name, group.start + k) for k, name in enumerate(names[: group.size])]


def _is_base_law(law: Law) -> bool:
    effect = law.effect
    plain = effect.scope == "joint" and not effect.shape(law.parameters)
    return plain and refits(law) and effect.coefficients(effect.example) == [effect.example[k] for k in effect.linear()]


def _coefficients(law: Law) -> Array:
    return np.array(law.effect.coefficients(law.parameters)[: coefficient_count(law)])
