"""Choice of signs and zeros: as few changes of the description as the errors allow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...types import Array
from .fit import ZeroFit, fit_zeros
from .load import Loads
from .search import Trial, best_zeros

COST = 4.0  # nats that a changed zero or sign must save, beyond the fit of noise: a prior of 1/5 each and its width
LIKELY = 3  # trials of the search from which the choice starts, beside the description

Locked = Mapping[int, float]  # signs that are kept, by joint


class Proposal(NamedTuple):
    """Signs (n,) and zeros (n,) [rad or m] to start a fit from, and the joints whose zeros are free."""

    signs: Array
    zeros: Array
    free: tuple[int, ...]


def chosen(loads: Loads, noise: Array, trials: Sequence[Trial], joints: Sequence[int]) -> ZeroFit:
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


def simplified(
    loads: Loads, noise: Array, fit: ZeroFit, joints: Sequence[int], locked: Locked | None = None
) -> ZeroFit:
    """Cheapest fit that changes of single joints lead to; noise: (n,) [rad or m]; `locked`: signs that are kept."""
    for _ in range(2 * len(joints)):
        best = fit
        for proposal in _neighbours(loads, fit, joints, locked or {}):
            other = fit_zeros(loads, noise, *proposal)
            best = other if cost(other) < cost(best) - 0.1 else best
        if best is fit:
            break
        fit = best
    return fit


def _neighbours(loads: Loads, fit: ZeroFit, joints: Sequence[int], locked: Locked) -> Iterator[Proposal]:
    """Fits with another sign or zero of one joint; zeros that were free become those of the description."""
    here = Trial(np.inf, fit.signs, fit.zeros)
    for j in joints:
        others = tuple(k for k in fit.free if k != j)
        for sign in (1.0, -1.0):
            if locked.get(j, sign) != sign:
                continue
            at = best_zeros(loads, here, (j,), (sign,))
            plain = at.zeros.copy()
            plain[j] = 0.0
            if j in fit.free or sign != fit.signs[j]:
                yield Proposal(at.signs, plain, others)
            if j not in fit.free or sign != fit.signs[j]:
                yield Proposal(at.signs, at.zeros, (*others, j))
