"""The covariance that a model carries -> a prior of what is fitted; a fit -> the covariance of the extended model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..basis import build_base
from ..covariance import Covariance, base_covariance
from ..effects.law import coefficient_count
from ..model import Model
from ..regressor import labels
from ..types import INERTIAL, Array, Law
from .evidence import Evidence
from .found import Found
from .group import Group, drift, stated_friction
from .hypothesis import refits
from .linear import Known

WEAK = 1e-9  # of the largest variance, scaled: the least that a covariance is inverted with


def known_before(model: Model, groups: Sequence[Group]) -> Known | None:
    """What identification left open of a simulation, as a prior about what it states; None where it carries nothing.

    Friction changes from day to day: the variance of each law's number grows by the square of its usual drift. What the
    simulation does not have any more (a law that was taken out) does not count.

    Args:
        model: the simulation.
        groups: columns, as laid out.
    """
    if model.covariance is None:
        return None
    columns = _columns(model, groups)
    own = model.covariance
    there = np.array([label in columns for label in own.labels])
    rows = np.isfinite(own.std) & (np.abs(own.combination) @ there > 0)
    combination = own.combination[np.ix_(rows, there)]
    places = np.array([columns[label] for label, yes in zip(own.labels, there, strict=True) if yes], dtype=np.intp)
    spread = dict(_drifts(model, groups))
    change = np.array([spread.get(int(place), 0.0) for place in places])
    covariance = own.matrix[np.ix_(rows, rows)] + (combination * change**2) @ combination.T
    size = np.sqrt(np.diag(covariance))
    inverse = np.linalg.inv(covariance / size / size[:, None] + WEAK * np.eye(len(size))) / size / size[:, None]
    order = np.argsort(places)
    information = (combination.T @ inverse @ combination)[np.ix_(order, order)]
    return Known(places[order], information)


def covariance_after(model: Model, evidence: Evidence, found: Found, laws: Mapping[Group, tuple[Law, ...]]) -> Covariance:
    """The covariance of base parameters and laws of the extended simulation, from the fit that made it.

    Args:
        model: the extended simulation.
        evidence: rows.
        found: the selected laws.
        laws: of each selected hypothesis.
    """
    fit = evidence.fit(found.true, found.base, max(found.trust, 1.0))
    linear = [law for law in model.laws if _is_base_law(law)]
    base = build_base(model.robot, linear)
    names = [label.name for label in base.labels]
    place = {name: k for k, name in enumerate(names)}
    share = np.zeros((len(names), len(fit.which)))
    at = {int(column): k for k, column in enumerate(fit.which)}
    sources = [(name, column) for name, column in _columns(model, evidence.data.refitted).items()]
    for group, own in laws.items():
        sources += _of_laws(model, group, own)
    for name, column in sources:
        if name in place and column in at:
            share[place[name], at[column]] = 1.0
    mixed = base.combination @ share
    matrix = mixed @ fit.covariance @ mixed.T
    values = base.combination @ np.concatenate([model.inertials.ravel(), *(_coefficients(law) for law in linear)])
    lost = ~(np.diag(matrix) > 0)
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


def _drifts(model: Model, groups: Sequence[Group]) -> list[tuple[int, float]]:
    dry = stated_friction(model)
    return [
        (group.start + k, x)
        for group in groups
        if group.law is not None
        for k, x in enumerate(drift(group.law, float(dry[group.law.joints[0]])))
    ]


def _is_base_law(law: Law) -> bool:
    effect = law.effect
    plain = effect.scope == "joint" and not effect.shape(law.parameters)
    return plain and refits(law) and effect.coefficients(effect.example) == [effect.example[k] for k in effect.linear()]


def _coefficients(law: Law) -> Array:
    return np.array(law.effect.coefficients(law.parameters)[: coefficient_count(law)])


