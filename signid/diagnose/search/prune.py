"""Backward elimination: drop selected laws that do not improve the extended simulation on the training rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...deadline import time_is_up
from ...regression.projection import least_squares
from ...regression.session import Session
from ...types import Array, Law
from ..data.column_groups import Group
from ..data.dataset import Dataset
from ..data.whitened_rows import columns_of
from ..evidence.selection import Selection
from ..extend.extend import extend, has_possible_numbers, read_laws
from ..extend.holdout import residual_rows
from .admissible import resolved_violations
from .stepwise import SEARCH
from .thresholds import SIGNIFICANT_CHI2


def prune(dataset: Dataset, session: Session, selection: Selection) -> Selection:
    """Drop laws with impossible or insignificant numbers, and laws that increase the training residual.

    The residual is that of the extended simulation, since laws change each other's torque.
    """
    selection = _significant(_possible(selection))
    while selection.selected and not time_is_up(SEARCH):
        worst, harm = max(_training_harm(dataset, session, selection).items(), key=lambda item: item[1])
        if harm <= 0:
            return selection
        selection = selection.without(worst)
    return selection


def _possible(selection: Selection) -> Selection:
    """Drop laws whose numbers became impossible beside the others, the least probable first."""
    while selection.selected:
        fit = selection.fit()
        wrong = [group for group in selection.selected if not has_possible_numbers(group, fit.value[fit.place(group)])]
        if not wrong:
            break
        selection = selection.without(min(wrong, key=lambda group: selection.log_odds[group]))
    return selection


def _significant(selection: Selection) -> Selection:
    """Drop insignificant laws; a body change stays if a link would violate its tolerance without it."""
    while selection.selected:
        fit = selection.fit()
        value, covariance, chi2 = fit.value, fit.covariance, dict[Group, float]()
        for group in selection.selected:
            own = fit.place(group)
            theta, spread = value[own], covariance[own, own]
            size = np.sqrt(np.diag(spread))
            turned = least_squares(spread / size / size[:, None], theta / size, 1e-8)
            chi2[group] = float(turned @ (theta / size)) / group.size
        least = min(chi2, key=lambda group: chi2[group])
        rest = selection.without(least)
        if chi2[least] > SIGNIFICANT_CHI2 or resolved_violations(selection, rest, least):
            break
        selection = rest
    return selection


def _training_harm(dataset: Dataset, session: Session, selection: Selection) -> dict[Group, float]:
    """Increase of the squared training residual by each law, over the irreducible variance [1]."""
    evidence, tried = selection.evidence, list[tuple[float, dict[Group, float]]]()
    whole = evidence.fit(selection.selected, selection.dispersion, selection.prior_scale)
    alone = whole.restricted(np.isin(whole.which, columns_of(selection.selected)))
    for fit, refitted in ((whole, evidence.data.refitted), (alone, ())):
        laws = {group: read_laws(group, fit.value[fit.place(group)]) for group in selection.selected}
        model = extend(dataset.model, refitted, fit, laws, session.task.base)
        rows = residual_rows(session.task, model, session.train)
        noise = rows.irreducible_std(dataset.noise, 1)
        with_all = _square(rows.residual / noise)
        without = {group: rows.residual + _torque(dataset, own) for group, own in laws.items()}
        tried.append((with_all, {group: with_all - _square(rest / noise) for group, rest in without.items()}))
    return min(tried, key=lambda one: one[0])[1]


def _torque(dataset: Dataset, laws: Sequence[Law]) -> Array:
    """(M, n) [N.m or N] torque of some laws."""
    torque = np.zeros_like(dataset.table.residual)
    for law in laws:
        for j, x in dataset.torque(law).items():
            torque[:, j] += x
    return torque


def _square(x: Array) -> float:
    return float(np.nansum(x**2))
