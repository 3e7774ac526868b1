"""Torque of each selected law, the residual of all of them together, and whether the gain of a law is steady."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import stdtr

from ...types import Array, Frozen, Indices
from ..data.dataset import Fitted, Whitened
from ..data.rows import Group
from ..evidence.bayes_factors import Evidence
from ..evidence.selection import Posterior
from ..thresholds import GAIN_BLOCKS, MIN_GAIN_BLOCKS, MIN_TEST_PROBABILITY, PRIOR_NOTHING


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
    """Fit all together at a dispersion (n,) [1] and a prior scale, and measure the torque of each selected law."""
    data, fit = evidence.data, evidence.fit(selected, dispersion, prior_scale)
    fitted, value, share = fit.value, {}, {}
    for group in selected:
        value[group] = theta = fitted[fit.place(group)]
        share[group] = np.zeros(data.joints)
        for j in data.rows(group):
            share[group][j] = np.sqrt(np.mean((data.raw(j, group) @ theta) ** 2)) / data.scale[j]
    return Contributions(data, fit, value, share)


def residual_growth(contributions: Contributions) -> dict[Group, Array]:
    """Growth of the residual sum of squares of each joint if a law is removed and all else is refitted: (n,) [1]."""
    fit, laws, out = contributions.fit, contributions.coefficients, dict[Group, Array]()
    for factor in fit.factors:
        which = fit.which[factor.place]
        places = {g: np.flatnonzero(which == g.start)[0] + np.arange(g.size) for g in laws if g.start in which}
        if not places:
            continue
        steps = list[Array]()  # (f,) each: decrease of the coefficients of the factor where those of a law become zero
        for group, at in places.items():
            below = factor.forward(np.eye(len(factor.place))[:, at])
            steps.append(factor.backward(below @ np.linalg.solve(below.T @ below, laws[group])[:, None])[:, 0])
        growth = np.maximum(_growth(contributions, which, np.column_stack(steps)), 0.0)
        out |= dict(zip(places, growth, strict=True))
    return {group: out[group] for group in laws}


def _growth(contributions: Contributions, which: Indices, steps: Array) -> Array:
    """(g, n) growth of the residual sum of squares of each joint, by steps (k, g) of the columns for g laws [1]."""
    data = contributions.data
    out = np.zeros((steps.shape[1], data.joints))
    for j in np.flatnonzero((data.at[:, which] >= 0).any(axis=1)).tolist():
        here, own = data.chosen(j, which)
        added = own @ steps[here]
        out[:, j] = np.sum(added**2, axis=0) + 2 * contributions.residual[j] @ added
    return out


def steadiness(posterior: Posterior, contributions: Contributions, residual: Array, group: Group) -> float:
    """Log odds that a law improves the prediction, from its gain in blocks of rows [-].

    The log likelihood ratio against its absence is summed over blocks in each of which the law makes about the same
    torque energy. The gain per energy over its standard error is compared with Student's t. A law that is right gains
    about the same per energy in each block; a law that imitates something else gains in some and loses in others. The
    test needs neither model to be right. The residual (M, n) [N.m or N] is that of all selected laws.

    Source: Vuong, Likelihood ratio tests for model selection and non-nested hypotheses, Econometrica 57, 1989;
    Cochran, Sampling Techniques, 1977, section 6.3 (the standard error of a ratio).
    """
    data, gain, energy = posterior.evidence.data, np.zeros(len(residual)), np.zeros(len(residual))
    for j in data.rows(group):
        size = max(float(np.sqrt(np.mean(residual[:, j] ** 2))), 1e-300)
        torque, left = data.raw(j, group) @ contributions.coefficients[group] / size, residual[:, j] / size
        gain, energy = gain + left * torque + torque**2 / 2, energy + torque**2
    made = np.cumsum(energy)
    if not made[-1] > 0:
        return np.inf
    block = np.minimum((GAIN_BLOCKS * made / made[-1]).astype(int), GAIN_BLOCKS - 1)
    parts = [block == k for k in np.unique(block)]
    if (count := len(parts)) < MIN_GAIN_BLOCKS:
        return np.inf
    gains, energies = (np.array([x[part].sum() for part in parts]) for x in (gain, energy))
    uneven = gains - energies * gains.sum() / energies.sum()
    error = float(np.sqrt(np.sum(uneven**2) * count / (count - 1)))
    better = float(stdtr(count - 1, float(gains.sum()) / max(error, 1e-300)))
    prior = posterior.priors.get(group.claim.key, 0.0) - float(np.log(PRIOR_NOTHING))
    return float(np.log(max(better, MIN_TEST_PROBABILITY)) - np.log(max(1 - better, MIN_TEST_PROBABILITY))) + prior
