"""Warnings where the extended simulation predicts held-out torque badly, and the fallback to the given simulation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ...deadline import time_is_up
from ...estimation.fit_quality import LITTLE, Fit
from ...types import Array
from ..data.noise import Noise
from ..extend.holdout import Prediction, fit_of
from ..search.stepwise import SEARCH
from .findings import Conclusions
from .thresholds import LOUD, WORSE

FALLBACK = (
    "the search was cut short, and with the laws found so far the held-out torque of {} is predicted worse than by the "
    "given simulation: model.json holds the given simulation and the findings are leads; diagnose again with more time"
)


def holdout_warnings(before: Fit, after: Fit) -> Iterator[str]:
    """One sentence for each joint that is predicted worse than before, or hardly at all.

    Args:
        before: residuals of the given simulation.
        after: residuals of the extended simulation.
    """
    rows = zip(
        after.joints,
        after.unit,
        before.held_out_rms,
        after.held_out_rms,
        after.irreducible_rms,
        after.held_out_r2,
        strict=True,
    )
    for joint, unit, then, now, irreducible, r2 in rows:
        if now > WORSE * then and now > LOUD * irreducible:
            yield (
                f"the torque of {joint} on held-out recordings is predicted worse than before "
                f"({then:.3g} -> {now:.3g} {unit}): do not use the extended simulation for it"
            )
        elif r2 < LITTLE and now > LOUD * irreducible:
            yield (
                f"the extended simulation still predicts little of the torque of {joint} on held-out recordings "
                f"(R2 {r2:.2f}): what is missing there was not found"
            )


def keep_given_if_worse(given: Prediction, result: Conclusions, noise: Noise, floor: Array) -> Conclusions:
    """Keep the given simulation, with a flag, if a search that was cut short predicts some joint worse.

    Args:
        given: residuals of the given simulation.
        result: findings and the extended simulation.
        noise: noise of the rows.
        floor: (n,) [N.m or N] rms of white measurement noise in the band.
    """
    if not time_is_up(SEARCH):
        return result
    before, after = fit_of(given, noise, floor), fit_of(result.prediction, noise, floor)
    rows = zip(after.joints, before.held_out_rms, after.held_out_rms, after.irreducible_rms, strict=True)
    worse = [joint for joint, then, now, irreducible in rows if now > WORSE * then and now > LOUD * irreducible]
    if not worse:
        return result
    unexplained = tuple(replace(one, modelled=False) for one in result.unexplained)
    flag = FALLBACK.format(", ".join(worse))
    return result._replace(prediction=given, unexplained=unexplained, flags=(*result.flags, flag))
