"""A search that was cut short -> a simulation that predicts no joint worse than the one that was given."""

from __future__ import annotations

from dataclasses import replace

from ...deadline import time_is_up
from ...types import Array
from ..data.noise import Noise
from ..extend.holdout import Shown, fit_of
from ..search.stepwise import SEARCH
from .findings import Result
from .holdout_warnings import LOUD, WORSE

KEPT = (
    "the search was cut short and what it found so far predicts the held-out torque of {} worse than the simulation "
    "that was given: model.json holds the given simulation, the findings are leads; diagnose again with more time"
)


def never_worse(given: Shown, result: Result, noise: Noise, floor: Array) -> Result:
    """The result of a search that time cut short, never with a simulation that predicts some joint worse, and a flag.

    Where the extended simulation does, the given one is kept.

    Args:
        given: rows of the simulation that was given.
        result: findings and the extended simulation.
        noise: of the rows.
        floor: (n,) [N.m or N] rms of white measurement noise in the band.
    """
    if not time_is_up(SEARCH):
        return result
    before, after = fit_of(given, noise, floor), fit_of(result.shown, noise, floor)
    rows = zip(after.joints, before.held_out_rms, after.held_out_rms, after.irreducible_rms, strict=True)
    worse = [joint for joint, then, now, floor in rows if now > WORSE * then and now > LOUD * floor]
    if not worse:
        return result
    unexplained = tuple(replace(one, modelled=False) for one in result.unexplained)
    flag = KEPT.format(", ".join(worse))
    return result._replace(shown=given, unexplained=unexplained, flags=(*result.flags, flag))
