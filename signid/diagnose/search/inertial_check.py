"""Inertials that are refitted -> the links whose correction is beyond any tolerance."""

from __future__ import annotations

import numpy as np

from ...types import INERTIAL
from ..data.column_groups import Group
from ..data.whitened_rows import columns_of
from ..evidence.selection import Selection
from ..evidence.thresholds import INERTIAL_SCALES

BEYOND = 30.0  # squared deviations of the ten numbers of a link, at twice the usual tolerance


def inertial_violations(state: Selection) -> dict[int, float]:
    """The joints that move them, and by how much each is beyond, where inertials are not trusted at all [1].

    Args:
        state: the selected laws.
    """
    if state.evidence.informed or state.evidence.prior_scale(state.selected, state.dispersion) == 0:
        return {}
    fit = state.evidence.fit(state.selected, state.dispersion, INERTIAL_SCALES[-1])
    bodies = [group for group in state.data.refitted if group.bodies]
    step = fit.value[np.isin(fit.which, columns_of(bodies))]
    deviation = np.concatenate([group.deviation for group in bodies])
    far = np.sum((step / INERTIAL_SCALES[-1] / deviation).reshape(-1, len(INERTIAL)) ** 2, axis=1)
    return {j: float(far[body]) for j, body in enumerate(state.posterior.carried) if far[body] > BEYOND}


def relieved(state: Selection, rest: Selection, group: Group) -> set[int]:
    """The joints whose links are strained without a hypothesis of bodies, and not with it.

    Args:
        state: the selected laws.
        rest: the same without the hypothesis.
        group: the hypothesis.
    """
    strained = inertial_violations(rest).keys() if group.claim.bodies else set()
    return strained - inertial_violations(state).keys() if strained else set()
