"""Torque that no law explains -> a piecewise linear function of what it depends on, where that foretells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...effects import EFFECTS
from ...effects.empirical import PLACES, VARIABLES
from ...effects.law import law_columns
from ...regression.session import Session
from ...types import Array, Law
from ..extend.holdout import Rows, show
from ..result import Unexplained
from .findings import Result

ENOUGH = 0.3  # share of the held-out sum of squares that such a function must take away
CORRELATED = 4.0  # rows for one that tells something of its own


def model_rest(session: Session, result: Result) -> Result:
    """The same with what no law explains in the simulation, as far as it holds on what was held out.

    Args:
        session: recordings.
        result: the extended simulation, and the joints where it leaves torque.
    """
    shown, out, laws = result.shown, list[Unexplained](), list[Law]()
    for one in result.unexplained:
        if one.place.variable not in VARIABLES:
            out.append(one)
            continue
        law = _shape(shown.learned, one)
        x, y = _columns(shown.learned, law), np.nan_to_num(shown.learned.rest[:, one.joint])
        gram = x.T @ x
        value = np.linalg.solve(gram + CORRELATED * np.eye(len(gram)), x.T @ y)  # as large as what is left, at most
        unseen = np.nan_to_num(shown.judged.rest[:, one.joint])
        after = unseen - _columns(shown.judged, law) @ value
        gain = 1 - float(after @ after) / max(float(unseen @ unseen), 1e-300)
        modelled = gain > ENOUGH and not session.judges_itself
        if modelled:
            values = {f"value_{k}": float(v) for k, v in zip(PLACES, value, strict=True)}
            laws.append(replace(law, parameters={**law.parameters, **values}))
        out.append(replace(one, held_out_gain=gain, modelled=modelled))
    wider = replace(shown.model, laws=(*shown.model.laws, *laws))
    return result._replace(shown=show(session, wider) if laws else shown, unexplained=tuple(out))


def _shape(rows: Rows, one: Unexplained) -> Law:
    """The law with knots where the variable is."""
    index = VARIABLES.index(one.place.variable)
    motions = [piece.motion for piece in rows.pieces]
    signal = np.concatenate([(m.q, m.v, m.a, m.load)[index][:, one.joint] for m in motions])
    share = np.linspace(0, 1, len(PLACES))
    knots = (np.quantile(signal, share) + signal.min() + share * np.ptp(signal)) / 2  # where rows are, none too near
    knots = knots + np.arange(len(knots)) * 1e-9 * max(float(np.ptp(signal)), 1e-9)  # none twice
    shape = {f"knot_{k}": float(x) for k, x in zip(PLACES, knots, strict=True)}
    return Law(EFFECTS["empirical"], (one.joint,), {"variable": float(index), **shape})


def _columns(rows: Rows, law: Law) -> Array:
    """(M, k) [1] of the law at the joint, through the filter of the rows."""
    return np.concatenate([rows.thin(law_columns(law, piece.motion)[1][:, 0]) for piece in rows.pieces])
