"""The selected laws -> what of it the extended simulation is better with, run as it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...deadline import time_is_up
from ...regression.projection import least_squares
from ...regression.session import Session
from ...types import Array, Law
from ..data.column_groups import Group
from ..data.dataset import Dataset
from ..data.motions import torque_rows
from ..data.whitened_rows import columns_of
from ..evidence.selection import Selection
from ..extend.extend import extend, has_possible_numbers, read_laws
from ..extend.holdout import residuals
from .inertial_check import relieved
from .stepwise import SEARCH

SEEN = 4.0  # squared standard deviations, for each number


def prune(dataset: Dataset, session: Session, found: Selection) -> Selection:
    """Without hypotheses of size zero, and those that make the extended simulation worse on what it was learned from.

    Columns are made with the simulation as it was given; a law of the load is another one once a payload is known.

    Args:
        dataset: motions and rows.
        session: recordings.
        found: the selected laws.
    """
    found = _distinct(_possible(found))
    while found.selected and not time_is_up(SEARCH):
        worst, harm = max(((g, h) for g, h in _harms(dataset, session, found).items()), key=lambda item: item[1])
        if harm <= 0:
            return found
        found = found.without(worst)
    return found


def _possible(found: Selection) -> Selection:
    """Without hypotheses whose numbers became impossible beside the others, the least likely first."""
    while found.selected:
        fit = found.fit()
        wrong = [group for group in found.selected if not has_possible_numbers(group, fit.value[fit.place(group)])]
        if not wrong:
            break
        found = found.without(min(wrong, key=lambda group: found.log_odds[group]))
    return found


def _distinct(found: Selection) -> Selection:
    """Without hypotheses whose numbers are not told from zero beside all others, the least told first.

    Bodies of links that would be strained without them are told by that, whatever the inertials' tolerance hides.
    """
    while found.selected:
        fit = found.fit()
        value, covariance, told = fit.value, fit.covariance, dict[Group, float]()
        for group in found.selected:
            own = fit.place(group)
            theta, spread = value[own], covariance[own, own]
            size = np.sqrt(np.diag(spread))
            turned = least_squares(spread / size / size[:, None], theta / size, 1e-8)
            told[group] = float(turned @ (theta / size)) / group.size
        least = min(told, key=lambda group: told[group])
        rest = found.without(least)
        if told[least] > SEEN or relieved(found, rest, least):
            break
        found = rest
    return found


def _harms(dataset: Dataset, session: Session, found: Selection) -> dict[Group, float]:
    """By how much each hypothesis's law makes the squared residual larger, over that of the simulation as given [1].

    In the better of two extended simulations: everything fitted again, or the laws alone.
    """
    evidence, tried = found.evidence, list[tuple[float, dict[Group, float]]]()
    whole = evidence.fit(found.selected, found.dispersion, found.prior_scale)
    alone = whole.restricted(np.isin(whole.which, columns_of(found.selected)))
    fits = ((whole, evidence.data.refitted), (alone, ()))
    for fit, refitted in fits:
        laws = {group: read_laws(group, fit.value[fit.place(group)]) for group in found.selected}
        flat = [law for own in laws.values() for law in own]
        model = extend(dataset.model, refitted, fit, flat, session.task.base)
        rows = residuals(session.task, model, session.train)
        noise = rows.irreducible_std(dataset.noise, 1)
        left = _square(rows.rest / noise)
        lacking = {group: rows.rest + _torque(dataset, own) for group, own in laws.items()}
        tried.append((left, {group: left - _square(rest / noise) for group, rest in lacking.items()}))
    return min(tried, key=lambda one: one[0])[1]


def _torque(dataset: Dataset, laws: Sequence[Law]) -> Array:
    """(M, n) [N.m or N] of some laws."""
    torque = np.zeros_like(dataset.table.residual)
    for law in laws:
        for j, x in torque_rows(dataset.thin, dataset.pieces, law).items():
            torque[:, j] += x
    return torque


def _square(x: Array) -> float:
    return float(np.nansum(x**2))
