"""Fitted coefficients -> how much torque each effect makes, per joint, and what is left."""

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
class Sizes(Frozen):
    """Of selected hypotheses."""

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


def measure_sizes(evidence: Evidence, selected: Sequence[Group], dispersion: Array, prior_scale: float) -> Sizes:
    """Of a fit of everything together.

    Args:
        evidence: rows.
        selected: selected hypotheses.
        dispersion: (n,) variance of the whitened residual [1].
        prior_scale: of the tolerance of inertials, how far they are off.
    """
    data, fit = evidence.data, evidence.fit(selected, dispersion, prior_scale)
    fitted, value, share = fit.value, {}, {}
    for group in selected:
        value[group] = theta = fitted[fit.place(group)]
        share[group] = np.zeros(data.joints)
        for j in data.rows(group):
            share[group][j] = np.sqrt(np.mean((data.raw(j, group) @ theta) ** 2)) / data.scale[j]
    return Sizes(data, fit, value, share)


def energies(sizes: Sizes) -> dict[Group, Array]:
    """Per hypothesis, by how much the residual of each joint grows without it while all else is refitted: (n,) [1].

    Without it, everything else is what it is likeliest to be where the hypothesis's coefficients are zero.
    """
    fit, out = sizes.fit, dict[Group, Array]()
    for one in fit.factors:
        which = fit.which[one.place]
        places = {g: np.flatnonzero(which == g.start)[0] + np.arange(g.size) for g in sizes.value if g.start in which}
        if places:
            steps = [_step(one, at, sizes.value[group]) for group, at in places.items()]
            out |= dict(zip(places, np.maximum(_grown(sizes, which, np.column_stack(steps)), 0.0), strict=True))
    return {group: out[group] for group in sizes.value}


def _step(factor: Factor, own: Indices, value: Array) -> Array:
    """(f,) by how much the coefficients of a factor are less where some of them, with this value, are zero."""
    below = factor.forward(np.eye(len(factor.place))[:, own])
    return np.asarray(factor.backward(below @ np.linalg.solve(below.T @ below, value)[:, None])[:, 0])


def _grown(sizes: Sizes, which: Indices, steps: Array) -> Array:
    """(g, n) by how much the residual of each joint grows [1].

    Args:
        sizes: give it.
        which: (k,) columns.
        steps: (k, g) by how much their coefficients become less, in g ways.
    """
    out = np.zeros((steps.shape[1], sizes.data.joints))
    for j in np.flatnonzero((sizes.data.at[:, which] >= 0).any(axis=1)).tolist():
        here, own = sizes.data.chosen(j, which)
        added = own @ steps[here]
        out[:, j] = np.sum(added**2, axis=0) + 2 * sizes.rest[j] @ added
    return out
