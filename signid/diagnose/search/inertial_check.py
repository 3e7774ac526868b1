"""Links whose refitted inertials are beyond any tolerance."""

from __future__ import annotations

import numpy as np

from ...types import INERTIAL
from ..data.column_groups import Group
from ..data.whitened_rows import columns_of
from ..evidence.selection import Selection
from ..evidence.thresholds import INERTIAL_SCALES
from .thresholds import INERTIAL_VIOLATION


def inertial_violations(selection: Selection) -> dict[int, float]:
    """Squared corrections of links beyond any tolerance, by the joint that moves the link [variances].

    Inertials are refitted at the largest prior scale. Empty where they are probably right, or where the model carries
    a covariance.

    Args:
        selection: the selected laws.
    """
    if selection.evidence.informed or selection.evidence.prior_scale(selection.selected, selection.dispersion) == 0:
        return {}
    fit = selection.evidence.fit(selection.selected, selection.dispersion, INERTIAL_SCALES[-1])
    bodies = [group for group in selection.data.refitted if group.bodies]
    step = fit.value[np.isin(fit.which, columns_of(bodies))]
    deviation = np.concatenate([group.deviation for group in bodies])
    chi2 = np.sum((step / INERTIAL_SCALES[-1] / deviation).reshape(-1, len(INERTIAL)) ** 2, axis=1)
    carried = selection.posterior.carried
    return {j: float(chi2[body]) for j, body in enumerate(carried) if chi2[body] > INERTIAL_VIOLATION}


def resolved_violations(selection: Selection, rest: Selection, group: Group) -> set[int]:
    """Joints whose links violate the tolerance without a body hypothesis and not with it.

    Args:
        selection: the selected laws.
        rest: the same without the hypothesis.
        group: columns of the hypothesis.
    """
    violated = inertial_violations(rest).keys() if group.claim.bodies else set()
    return violated - inertial_violations(selection).keys() if violated else set()
