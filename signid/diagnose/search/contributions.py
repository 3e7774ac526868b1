"""Torque of each selected law, and the residual of all of them together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...types import Array, Frozen, Indices
from ..data.column_groups import Group
from ..data.normal_equations import Factor, Fitted
from ..data.whitened_rows import Whitened
from ..evidence.bayes_factors import Evidence


@dataclass(frozen=True, eq=False)
class Contributions(Frozen):
    """Coefficients and torque of the selected laws in one joint fit."""

    data: Whitened
    fit: Fitted
    coefficients: Mapping[Group, Array]  # (size,) [units of the coefficients] of each law
    torque_share: Mapping[Group, Array]  # (n,) rms torque of each law over the rms torque of every joint [1]

    @cached_property
    def residual(self) -> Array:
        """(n, M) whitened residual [1]."""
        out, value = self.data.residual.copy(), self.fit.value
        for j in range(self.data.joints):
            here, own = self.data.chosen(j, self.fit.which)
            out[j] -= own @ value[here]
        return out

    @property
    def mean_square(self) -> Array:
        """(n,) mean square of the whitened residual [1]."""
        return np.asarray(np.sum(self.residual**2, axis=1) / self.data.counts)


def measure_contributions(
    evidence: Evidence, selected: Sequence[Group], dispersion: Array, prior_scale: float
) -> Contributions:
    """Fit everything together and measure the torque of each selected law.

    Args:
        evidence: rows.
        selected: columns of the selected laws.
        dispersion: (n,) variance of the whitened residual [1].
        prior_scale: errors of the given simulation, in standard deviations of their prior [1].
    """
    data, fit = evidence.data, evidence.fit(selected, dispersion, prior_scale)
    fitted, value, share = fit.value, {}, {}
    for group in selected:
        value[group] = theta = fitted[fit.place(group)]
        share[group] = np.zeros(data.joints)
        for j in data.rows(group):
            share[group][j] = np.sqrt(np.mean((data.raw(j, group) @ theta) ** 2)) / data.scale[j]
    return Contributions(data, fit, value, share)


def residual_growth(contributions: Contributions) -> dict[Group, Array]:
    """Growth of the residual sum of squares of each joint if a law is removed and all else is refitted: (n,) [1].

    Args:
        contributions: fit of all laws.
    """
    fit, out = contributions.fit, dict[Group, Array]()
    for factor in fit.factors:
        which = fit.which[factor.place]
        places = {
            g: np.flatnonzero(which == g.start)[0] + np.arange(g.size)
            for g in contributions.coefficients
            if g.start in which
        }
        if places:
            steps = [_step(factor, at, contributions.coefficients[group]) for group, at in places.items()]
            growth = np.maximum(_growth(contributions, which, np.column_stack(steps)), 0.0)
            out |= dict(zip(places, growth, strict=True))
    return {group: out[group] for group in contributions.coefficients}


def _step(factor: Factor, own: Indices, value: Array) -> Array:
    """(f,) decrease of the coefficients of a factor where some of them, with this value, become zero."""
    below = factor.forward(np.eye(len(factor.place))[:, own])
    return np.asarray(factor.backward(below @ np.linalg.solve(below.T @ below, value)[:, None])[:, 0])


def _growth(contributions: Contributions, which: Indices, steps: Array) -> Array:
    """(g, n) growth of the residual sum of squares of each joint [1].

    Args:
        contributions: fit of all laws.
        which: (k,) columns.
        steps: (k, g) decrease of their coefficients, for each of g laws.
    """
    data = contributions.data
    out = np.zeros((steps.shape[1], data.joints))
    for j in np.flatnonzero((data.at[:, which] >= 0).any(axis=1)).tolist():
        here, own = data.chosen(j, which)
        added = own @ steps[here]
        out[:, j] = np.sum(added**2, axis=0) + 2 * contributions.residual[j] @ added
    return out
