"""Fit of the chosen drives to all rows, once their errors on held-out rows are known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...deadline import time_is_up
from ...errors import shorten
from ...model import Model
from ..search.choice import LOUDER, Candidate
from ..search.data import thinned
from ..search.searcher import ServoOptions
from .assess import whole_rms
from .conclude import JudgedFit, Known, facts_of
from .fits import final_fit
from .flags import worse_than_stated

KEPT = "the model was not fitted again to the held-out rows"


def fitted_again(
    model: Model, judged: JudgedFit, candidate: Candidate, known: Known, options: ServoOptions, most: int
) -> tuple[JudgedFit, tuple[str, ...]]:
    """The same laws and free numbers, fitted to all rows, with the errors on held-out rows as they were.

    The first fit stays, with a note, where held-out rows show what it has no number for, and where the new one predicts
    them worse. most: rows of the fit.
    """
    first, data = judged.fit, judged.data
    if reasons := tuple(_unlike(judged)):
        return judged, (f"{KEPT}: {' and '.join(reasons)}",)
    if worse_than_stated(judged.rollout) or time_is_up("the fit of drives to all rows", answer=False):
        return judged, ()
    everything = replace(data, train=(*data.train, *data.held_out))
    rows = replace(everything, train=thinned(everything.train, most))
    fit = final_fit(model, rows, candidate.follow(first.servos), options)
    before = judged.rollout
    after = replace(before, whole_rms=whole_rms(model, fit.servos, data.held_out))
    worse = not np.nanmean(after.whole_rms**2) <= LOUDER**2 * np.nanmean(before.whole_rms**2)
    if worse or worse_than_stated(after):
        return judged, (f"{KEPT}: it would predict them worse from commands alone",)
    facts = {
        joint: replace(fact, torque_off=judged.facts[joint].torque_off)  # by the numbers that are free
        for joint, fact in facts_of(model, everything, fit, known).items()
    }
    return replace(judged, data=everything, fit=fit, facts=facts, refit=True), ()


def _unlike(judged: JudgedFit) -> Iterator[str]:
    """Reasons why held-out rows must not be learned from."""
    if far := [joint for joint, error in judged.errors.items() if error.far]:
        yield f"its errors there are far above those of the training rows ({shorten(far)})"
    if beyond := [joint for joint, fact in judged.facts.items() if fact.held_out_limit < np.inf]:
        yield f"only they reach an effort limit, which the model lacks ({shorten(beyond)})"
