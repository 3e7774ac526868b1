"""Empirical torque: a piecewise linear function of one variable, for torque that no law explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...effects import EFFECTS
from ...effects.empirical import PLACES, VARIABLES
from ...effects.law import law_columns
from ...regression.session import Session
from ...types import Array, Law
from ..extend.holdout import ResidualRows, predict
from ..result import Unexplained
from .findings import Conclusions
from .thresholds import CORRELATED_ROWS, EMPIRICAL_GAIN


def add_empirical_torque(session: Session, result: Conclusions) -> Conclusions:
    """Add empirical torque to the extended simulation where it predicts the held-out rows.

    Args:
        session: recordings.
        result: extended simulation, and the joints with unexplained torque.
    """
    prediction, out, laws = result.prediction, list[Unexplained](), list[Law]()
    for one in result.unexplained:
        if one.place.variable not in VARIABLES:
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
            values = {f"value_{k}": float(v) for k, v in zip(PLACES, value, strict=True)}
            laws.append(replace(law, parameters={**law.parameters, **values}))
        out.append(replace(one, held_out_gain=gain, modelled=modelled))
    if laws:
        prediction = predict(session, replace(prediction.model, laws=(*prediction.model.laws, *laws)))
    return result._replace(prediction=prediction, unexplained=tuple(out))


def _empirical_law(rows: ResidualRows, one: Unexplained) -> Law:
    """Empirical law without values, with knots between quantiles and equal distances of the variable."""
    index = VARIABLES.index(one.place.variable)
    motions = [piece.motion for piece in rows.pieces]
    signal = np.concatenate([(m.q, m.v, m.a, m.load)[index][:, one.joint] for m in motions])
    share = np.linspace(0, 1, len(PLACES))
    knots = (np.quantile(signal, share) + signal.min() + share * np.ptp(signal)) / 2  # near the rows, but not too close
    knots = knots + np.arange(len(knots)) * 1e-9 * max(float(np.ptp(signal)), 1e-9)  # keeps knots distinct
    shape = {f"knot_{k}": float(x) for k, x in zip(PLACES, knots, strict=True)}
    return Law(EFFECTS["empirical"], (one.joint,), {"variable": float(index), **shape})


def _columns(rows: ResidualRows, law: Law) -> Array:
    """(M, k) low-passed columns of the law at its joint [1]."""
    return np.concatenate([rows.thin(law_columns(law, piece.motion)[1][:, 0]) for piece in rows.pieces])
