"""Inertials that are refitted -> the links whose correction is beyond any tolerance."""

from __future__ import annotations

import numpy as np

from ...types import INERTIAL
from ..data.column_groups import Group
from ..data.whitened_rows import columns_of
from ..evidence.bayes_factors import TRUST
from ..evidence.posterior_odds import Judge
from ..evidence.selection import Found

BEYOND = 30.0  # squared deviations of the ten numbers of a link, at twice the usual tolerance


def strained_links(judge: Judge, state: Found) -> dict[int, float]:
    """The joints that move them, and by how much each is beyond, where inertials are not trusted at all [1].

    Args:
        judge: library and evidence.
        state: what is taken for true.
    """
    if judge.evidence.informed or judge.evidence.trust(state.true, state.base) == 0:
        return {}
    fit = judge.evidence.fit(state.true, state.base, TRUST[-1])
    bodies = [group for group in judge.evidence.data.refitted if group.bodies]
    step = fit.value[np.isin(fit.which, columns_of(bodies))]
    deviation = np.concatenate([group.deviation for group in bodies])
    far = np.sum((step / TRUST[-1] / deviation).reshape(-1, len(INERTIAL)) ** 2, axis=1)
    return {j: float(far[body]) for j, body in enumerate(judge.carried) if far[body] > BEYOND}


def relieved(judge: Judge, state: Found, rest: Found, group: Group) -> set[int]:
    """The joints whose links are strained without a hypothesis of bodies, and not with it.

    Args:
        judge: library and evidence.
        state: the selected laws.
        rest: the same without the hypothesis.
        group: the hypothesis.
    """
    strained = strained_links(judge, rest).keys() if group.claim.bodies else set()
    return strained - strained_links(judge, state).keys() if strained else set()
