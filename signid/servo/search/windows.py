"""Longer windows of a fit, where whole recordings are fitted worse than short windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...model import Model
from ...servos import ServoGrid
from ..plant.course import recorded_course
from ..plant.roll_out import roll_out_along
from .choice import DIVERGED, Candidate, ServoTrial, tried
from .data import ServoData

FACTORS = (2.0, 4.0, 16.0)  # of the windows, one after another
LEAST = 16  # windows in all recordings: fewer give no intervals
STEPS = 8  # most iterations
WORSE = 1.15  # error of whole recordings over that of windows from which longer windows are tried
BETTER = 0.98  # error of whole recordings over that before, geometric mean of the joints, so that they stay


def lengthened(model: Model, data: ServoData, trial: ServoTrial, window: float) -> ServoTrial:
    """Trial with windows of the length that fits whole recordings best; `window` [s] is the one of the trial.

    Short windows begin at measured states, which take up what repeats of an error would add to.
    """
    whole = whole_rms(model, data.train, trial.candidate)
    if not any(whole[joint] > WORSE * trial.residual[joint] for joint in whole):
        return trial
    best, seconds = trial, sum(len(grid) / grid.rate for grid in data.train)
    for factor in FACTORS:
        if seconds / (factor * window) < LEAST and factor * window > max(len(g) / g.rate for g in data.train):
            break
        new = tried(model, data, replace(best.candidate, window=factor * window), window, STEPS)
        after = whole_rms(model, data.train, new.candidate)
        if np.mean([np.log(after[joint] / whole[joint]) for joint in whole]) > np.log(BETTER):
            break
        best, whole = new, after
    return best


def whole_rms(model: Model, grids: Sequence[ServoGrid], candidate: Candidate) -> dict[str, float]:
    """Rms error by joint [rad or m] of whole recordings from commands alone."""
    errors = [roll_out_along(recorded_course(model, grid), candidate.servos, grid) - grid.q for grid in grids]
    both = np.clip(np.nan_to_num(np.concatenate(errors), nan=DIVERGED), -DIVERGED, DIVERGED)
    rms = np.maximum(np.sqrt(np.mean(both**2, axis=0)), 1e-12)
    return {joint: float(rms[grids[0].joints.index(joint)]) for joint in candidate.servos}
