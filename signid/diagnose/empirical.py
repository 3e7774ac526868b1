"""Torque that no law explains -> a piecewise linear function of what it depends on, where that foretells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..effects import EFFECTS
from ..effects.empirical import PLACES, VARIABLES
from ..effects.law import law_columns
from ..filters import Decimator
from ..model import Model
from ..session import Part, Session
from ..types import Array, Law
from .prove import residuals
from .result import Unexplained
from .sample import pieces

ENOUGH = 0.05  # share of the held-out sum of squares that such a function must take away
RIDGE = 1e-6  # of the Gram's largest diagonal


def model_rest(session: Session, model: Model, left: Sequence[Unexplained]) -> tuple[Model, tuple[Unexplained, ...]]:
    """The simulation with what no law explains, as far as it holds on what was held out; and how far it does.

    Args:
        session: recordings.
        model: the extended simulation.
        left: joints and what their torque depends on.
    """
    out, laws = list[Unexplained](), list[Law]()
    rest, judged = (residuals(session.task, model, parts)[0] for parts in (session.train, session.held_out))
    for one in left:
        if one.place.variable not in VARIABLES:
            out.append(one)
            continue
        law = _shape(session, model, one)
        x, y = _columns(session, model, session.train, law), np.nan_to_num(rest[:, one.joint])
        gram = x.T @ x
        value = np.linalg.solve(gram + RIDGE * np.eye(len(gram)) * gram.diagonal().max(), x.T @ y)
        unseen = np.nan_to_num(judged[:, one.joint])
        after = unseen - _columns(session, model, session.held_out, law) @ value
        gain = 1 - float(after @ after) / max(float(unseen @ unseen), 1e-300)
        if gain > ENOUGH:
            values = {f"value_{k}": float(v) for k, v in zip(PLACES, value, strict=True)}
            laws.append(replace(law, parameters={**law.parameters, **values}))
        out.append(replace(one, held_out_gain=gain, modelled=gain > ENOUGH))
    return replace(model, laws=(*model.laws, *laws)), tuple(out)


def _shape(session: Session, model: Model, one: Unexplained) -> Law:
    """The law with knots where the variable is."""
    index = VARIABLES.index(one.place.variable)
    motions = [piece.motion for piece in pieces(session.task, model, session.train)]
    signal = np.concatenate([(m.q, m.v, m.a, m.load)[index][:, one.joint] for m in motions])
    knots = np.quantile(signal, np.linspace(0, 1, len(PLACES)))
    knots = knots + np.arange(len(knots)) * 1e-9 * max(float(np.ptp(signal)), 1e-9)  # none twice
    shape = {f"knot_{k}": float(x) for k, x in zip(PLACES, knots, strict=True)}
    return Law(EFFECTS["empirical"], (one.joint,), {"variable": float(index), **shape})


def _columns(session: Session, model: Model, parts: Sequence[Part], law: Law) -> Array:
    """(M, k) [1] of the law at the joint, through the filter of the rows."""
    thin = Decimator(session.task.band.taps, session.task.band.factor)
    found = [p.motion for p in pieces(session.task, model, parts) if len(p.motion) > 2 * thin.half]
    return np.concatenate([thin(law_columns(law, motion)[1][:, 0]) for motion in found])
