"""Held-out prediction: empirical torque that improves it, the fallback where it got worse, and warnings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...deadline import time_is_up
from ...effects import EFFECTS
from ...effects.empirical import MOTION_VARIABLES, POINTS
from ...effects.law import law_columns
from ...estimation.fit_quality import MIN_R2, Fit
from ...regression.session import Session
from ...simulation.rollout import RollOut
from ...types import Array, Law
from ..data.noise import Noise
from ..extend.holdout import Prediction, ResidualRows, fit_of, predict
from ..result import Unexplained
from ..search.stepwise import LAW_SEARCH
from .findings import Conclusions
from .thresholds import CORRELATED_ROWS, EMPIRICAL_GAIN, LOUD_RATIO, MIN_WINDOWS, SURE_ERRORS, WORSE_RMS, WORSE_ROLLOUT

FALLBACK_FLAG = (
    "the search was cut short, and with the laws found so far the held-out torque of {} is predicted worse than by the "
    "given simulation: model.json holds the given simulation and the findings are leads; diagnose again with more time"
)


def add_empirical_torque(session: Session, result: Conclusions) -> Conclusions:
    """Add a piecewise linear torque for unexplained torque to the simulation where it predicts the held-out rows."""
    prediction, out, laws = result.prediction, list[Unexplained](), list[Law]()
    for one in result.unexplained:
        if one.place.variable not in MOTION_VARIABLES:
            out.append(one)
            continue
        law = _empirical_law(prediction.train, one)
        x, y = _columns(prediction.train, law), np.nan_to_num(prediction.train.residual[:, one.joint])
        gram = x.T @ x
        value = np.linalg.solve(gram + CORRELATED_ROWS * np.eye(len(gram)), x.T @ y)  # ridge: shrunk where rows are few
        held_out = np.nan_to_num(prediction.held_out.residual[:, one.joint])
        after = held_out - _columns(prediction.held_out, law) @ value
        gain = 1 - float(after @ after) / max(float(held_out @ held_out), 1e-300)
        modelled = gain > EMPIRICAL_GAIN and not session.judges_itself
        if modelled:
            values = {f"value_{k}": float(v) for k, v in zip(POINTS, value, strict=True)}
            laws.append(replace(law, parameters={**law.parameters, **values}))
        out.append(replace(one, held_out_gain=gain, modelled=modelled))
    if laws:
        prediction = predict(session, replace(prediction.model, laws=(*prediction.model.laws, *laws)))
    return result._replace(prediction=prediction, unexplained=tuple(out))


def keep_given_if_worse(given: Prediction, result: Conclusions, noise: Noise, floor: Array) -> Conclusions:
    """Keep the given simulation, with a flag, if a search that was cut short predicts some joint worse.

    floor: (n,) [N.m or N] rms of white measurement noise in the band.
    """
    if not time_is_up(LAW_SEARCH):
        return result
    before, after = fit_of(given, noise, floor), fit_of(result.prediction, noise, floor)
    worse = [joint for k, joint in enumerate(after.joints) if _is_worse(before, after, k)]
    if not worse:
        return result
    unexplained = tuple(replace(one, modelled=False) for one in result.unexplained)
    flag = FALLBACK_FLAG.format(", ".join(worse))
    return result._replace(prediction=given, unexplained=unexplained, flags=(*result.flags, flag))


def holdout_warnings(before: Fit, after: Fit) -> Iterator[str]:
    """One sentence for each joint that is predicted worse than before, or hardly at all."""
    for k, joint in enumerate(after.joints):
        then, now = before.held_out_rms[k], after.held_out_rms[k]
        if _is_worse(before, after, k):
            yield (
                f"the torque of {joint} on held-out recordings is predicted worse than before "
                f"({then:.3g} -> {now:.3g} {after.unit[k]}): do not use the extended simulation for it"
            )
        elif after.held_out_r2[k] < MIN_R2 and now > LOUD_RATIO * after.irreducible_rms[k]:
            yield (
                f"the extended simulation still predicts little of the torque of {joint} on held-out recordings "
                f"(R2 {after.held_out_r2[k]:.2f}): what is missing there was not found"
            )


def _is_worse(before: Fit, after: Fit, k: int) -> bool:
    now = after.held_out_rms[k]
    return bool(now > WORSE_RMS * before.held_out_rms[k] and now > LOUD_RATIO * after.irreducible_rms[k])


def _empirical_law(rows: ResidualRows, one: Unexplained) -> Law:
    """Empirical law without values, with knots between quantiles and equal distances of the variable."""
    index = MOTION_VARIABLES.index(one.place.variable)
    motions = [piece.motion for piece in rows.pieces]
    signal = np.concatenate([(m.q, m.v, m.a, m.load)[index][:, one.joint] for m in motions])
    share = np.linspace(0, 1, len(POINTS))
    knots = (np.quantile(signal, share) + signal.min() + share * np.ptp(signal)) / 2  # near the rows, but not too close
    knots = knots + np.arange(len(knots)) * 1e-9 * max(float(np.ptp(signal)), 1e-9)  # keeps knots distinct
    shape = {f"knot_{k}": float(x) for k, x in zip(POINTS, knots, strict=True)}
    return Law(EFFECTS["empirical"], (one.joint,), {"variable": float(index), **shape})


def _columns(rows: ResidualRows, law: Law) -> Array:
    """(M, k) low-passed columns of the law at its joint [1]."""
    return np.concatenate([rows.thin(law_columns(law, piece.motion)[1][:, 0]) for piece in rows.pieces])


def rollout_warnings(before: RollOut | None, after: RollOut | None) -> Iterator[str]:
    """One sentence for each joint whose simulation by the extended model leaves the held-out motion faster.

    A joint counts where its median error at the end of the windows grew by the factor `WORSE_ROLLOUT`, and the mean log
    ratio over windows is positive by `SURE_ERRORS` standard errors.
    """
    if before is None or after is None:
        return
    horizon = max(after.horizons)
    errors = [np.clip(np.abs(one.end(horizon)), 1e-12, 1e12) for one in (before, after)]
    for k, joint in enumerate(after.joints):
        first, last = (error[:, k] for error in errors)
        if len(first) < MIN_WINDOWS or np.isnan(last).any():
            continue
        ratio, grown = np.log(last / first), float(np.median(last) / np.median(first))
        if grown > WORSE_ROLLOUT and ratio.mean() > SURE_ERRORS * ratio.std() / np.sqrt(len(ratio)):
            yield (
                f"the extended simulation leaves the held-out motion of {joint} faster than the given one (median "
                f"error of roll-outs of {horizon:g} s: {grown:.2f} times); simulate {joint} with care, and record more "
                f"motions"
            )
