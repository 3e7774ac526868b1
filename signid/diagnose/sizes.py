"""Fitted coefficients -> how much torque each effect makes, per joint, and what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..types import Array
from .evidence import Evidence
from .group import Group


class Sizes(NamedTuple):
    """Of hypotheses that are taken for true."""

    value: Mapping[Group, Array]  # (size,) [units of the coefficients] of each
    energy: Mapping[Group, Array]  # (n,) whitened energy of each on every joint [1]
    share: Mapping[Group, Array]  # (n,) rms torque of each over the rms torque of every joint [1]
    left: Array  # (n,) mean square of the whitened residual [1]


def measure_sizes(evidence: Evidence, true: Sequence[Group], dispersion: Array, trust: float) -> Sizes:
    """Of a fit of everything together.

    Args:
        evidence: rows.
        true: hypotheses that are taken for true.
        dispersion: (n,) variance of the whitened residual [1].
        trust: of the tolerance of inertials, how far they are off.
    """
    data, fit = evidence.data, evidence.fit(true, dispersion, trust)
    whole = np.zeros(data.count)
    whole[fit.which] = fit.value
    left = np.array([
        np.mean((data.residual[j] - data.columns[j] @ whole[data.place[j]]) ** 2) for j in range(data.joints)
    ])  # fmt: skip
    value, energy, share = {}, {}, {}
    for group in true:
        value[group] = theta = whole[group.place]
        energy[group] = np.array([np.sum((data.part(j, group) @ theta) ** 2) for j in range(data.joints)])
        raw = [np.sqrt(np.mean((data.raw(j, group) @ theta) ** 2)) for j in range(data.joints)]
        share[group] = np.array(raw) / data.scale
    return Sizes(value, energy, share, left)
