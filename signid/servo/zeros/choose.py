"""Choice of signs and zeros: as few changes of the description as the errors allow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ...types import Array
from .fit import ZeroFit, fit_zeros
from .load import Loads
from .search import ZeroTrial, best_zeros

COST = 4.0  # nats that a changed zero or sign must save, beyond the fit of noise: a prior of 1/5 each and its width
LIKELY = 3  # trials of the search from which the choice starts, beside the description
WORSE = 0.2  # sum of log rms by which gravity alone may fit worse with a sign that is tried
MOST = 6.0  # standard deviations of a zero that may be none


class Proposal(NamedTuple):
    """Start of a fit, and the joints whose zeros are free."""

    signs: Array  # (n,) [1]
    zeros: Array  # (n,) [rad or m]
    free: tuple[int, ...]


def chosen(loads: Loads, noise: Array, trials: Sequence[ZeroTrial], joints: Sequence[int]) -> ZeroFit:
    """Cheapest fit from the description and from the best trials; noise: (n,) [rad or m] of independent rows."""
    n = len(loads.rows.joints)
    starts = [fit_zeros(loads, noise, np.ones(n), np.zeros(n), ())]
    starts += [fit_zeros(loads, noise, trial.signs, trial.zeros, joints) for trial in trials[:LIKELY]]
    starts.sort(key=cost)
    ends = [simplified(loads, noise, start, joints) for start in starts[:2]]
    return min(ends, key=cost)


def cost(fit: ZeroFit) -> float:
    """Errors and changes of a fit in nats."""
    return fit.squares + COST * fit.changed


def simplified(loads: Loads, noise: Array, fit: ZeroFit, joints: Sequence[int]) -> ZeroFit:
    """Cheapest fit that changes of single joints lead to; noise: (n,) [rad or m]."""
    for _ in range(2 * len(joints)):
        best = fit
        for proposal in _neighbours(loads, fit, joints):
            other = fit_zeros(loads, noise, *proposal)
            best = other if cost(other) < cost(best) - 0.1 else best
        if best is fit:
            break
        fit = best
    return fit


def _neighbours(loads: Loads, fit: ZeroFit, joints: Sequence[int]) -> Iterator[Proposal]:
    """Fits with another sign or zero of one joint that may be cheaper; zeros that were free may be as described."""
    here = ZeroTrial(np.inf, fit.signs, fit.zeros)
    for j in joints:
        others = tuple(k for k in fit.free if k != j)
        at = {sign: best_zeros(loads, here, (j,), (sign,)) for sign in (1.0, -1.0)}
        least = min(one.score for one in at.values())
        for sign, one in at.items():
            plain = one.zeros.copy()
            plain[j] = 0.0
            other = sign != fit.signs[j]
            if other and one.score > least + WORSE:
                continue
            if other or (j in fit.free and abs(fit.zeros[j]) < MOST * fit.std[j]):
                yield Proposal(one.signs, plain, others)
            if other or j not in fit.free:
                yield Proposal(one.signs, one.zeros, (*others, j))
