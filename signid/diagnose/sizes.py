"""Fitted coefficients -> how much torque each effect makes, per joint, and what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..types import Array, Frozen
from .evidence import Evidence
from .fitted import Fitted
from .group import Group
from .whitened import Whitened


@dataclass(frozen=True, eq=False)
class Sizes(Frozen):
    """Of hypotheses that are taken for true."""

    data: Whitened
    fit: Fitted
    value: Mapping[Group, Array]  # (size,) [units of the coefficients] of each
    share: Mapping[Group, Array]  # (n,) rms torque of each over the rms torque of every joint [1]

    @cached_property
    def rest(self) -> Array:
        """(n, M) whitened residual [1]."""
        out, value = self.data.residual.copy(), self.fit.value
        for j in range(self.data.joints):
            here, own = self.data.chosen(j, self.fit.which)
            out[j] -= own @ value[here]
        return out

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
    fitted, value, share = fit.value, {}, {}
    for group in true:
        value[group] = theta = fitted[fit.place(group)]
        share[group] = np.zeros(data.joints)
        for j in data.rows(group):
            share[group][j] = np.sqrt(np.mean((data.raw(j, group) @ theta) ** 2)) / data.scale[j]
    return Sizes(data, fit, value, share)


def energies(sizes: Sizes) -> dict[Group, Array]:
    """Per hypothesis, by how much the residual of each joint grows without it while all else is refitted: (n,) [1].

    Without it, everything else is what it is likeliest to be where the hypothesis's coefficients are zero.
    """
    data, fit, groups = sizes.data, sizes.fit, list(sizes.value)
    if not groups:
        return {}
    covariance = fit.covariance
    places = [fit.place(group) for group in groups]
    steps = [covariance[:, own] @ np.linalg.solve(covariance[own, own], fit.value[own]) for own in places]
    taken, out = np.column_stack(steps), np.zeros((len(groups), data.joints))
    for j in range(data.joints):
        here, own = data.chosen(j, fit.which)
        added = own @ taken[here]
        out[:, j] = np.sum(added**2, axis=0) + 2 * sizes.rest[j] @ added
    return dict(zip(groups, np.maximum(out, 0.0), strict=True))
