"""Fitted coefficients -> how much torque each effect makes, per joint, and what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..types import Array, Frozen, Indices
from .evidence import Evidence
from .group import Group
from .whitened import Whitened


@dataclass(frozen=True, eq=False)
class Sizes(Frozen):
    """Of hypotheses that are taken for true."""

    data: Whitened
    which: Indices  # (k,) columns that are fitted
    whole: Array  # (p,) [units of the coefficients], zero where they are not fitted
    value: Mapping[Group, Array]  # (size,) [units of the coefficients] of each
    share: Mapping[Group, Array]  # (n,) rms torque of each over the rms torque of every joint [1]

    @cached_property
    def rest(self) -> Array:
        """(n, M) whitened residual [1]."""
        return _rest(self.data, self.whole, self.which)

    @property
    def left(self) -> Array:
        """(n,) mean square of the whitened residual [1]."""
        return np.asarray(np.sum(self.rest**2, axis=1) / self.data.counts)


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
    value, share = {}, {}
    for group in true:
        value[group] = theta = whole[group.place]
        raw = [np.sqrt(np.mean((data.raw(j, group) @ theta) ** 2)) for j in range(data.joints)]
        share[group] = np.array(raw) / data.scale
    return Sizes(data, fit.which, whole, value, share)


def energies(
    evidence: Evidence, true: Sequence[Group], dispersion: Array, trust: float, left: Array
) -> dict[Group, Array]:
    """Per hypothesis, by how much the residual of each joint grows without it while all else is refitted: (n,) [1].

    Args:
        evidence: rows.
        true: hypotheses that are taken for true.
        dispersion: (n,) variance of the whitened residual [1].
        trust: of the tolerance of inertials, how far they are off.
        left: (n,) mean square of the whitened residual with all of them [1].
    """
    data, out = evidence.data, dict[Group, Array]()
    for group in true:
        fit = evidence.fit([g for g in true if g is not group], dispersion, trust)
        whole = np.zeros(data.count)
        whole[fit.which] = fit.value
        out[group] = np.maximum(np.sum(_rest(data, whole, fit.which) ** 2, axis=1) - left * data.counts, 0.0)
    return out


def _rest(data: Whitened, whole: Array, which: Indices) -> Array:
    """(n, M) whitened residual after coefficients (p,) of which only some are not zero."""
    out = data.residual.copy()
    for j in range(data.joints):
        own = np.flatnonzero(np.isin(data.place[j], which))
        out[j] -= data.columns[j][:, own] @ whole[data.place[j][own]]
    return out
