"""Empirical torque: a fitted piecewise linear function of one variable, without physical interpretation."""

from itertools import pairwise

import numpy as np

from ..types import Array, Coefficient, Shape, View
from .base import TorqueLaw

MOTION_VARIABLES = ("position", "velocity", "acceleration", "torque")
POINTS = range(1, 9)


class Empirical(TorqueLaw):
    """Unexplained part of a residual that a diagnosis keeps if it also predicts held-out recordings."""

    name, equation = "empirical", "interp(variable, knots, values)"
    source = "de Boor, A Practical Guide to Splines, Springer, 1978, chapter III (broken lines)"
    typical = "a few per cent of the torque"
    parameters = {
        "variable": Shape("1", (), positive=False),
        **{f"knot_{k}": Shape("1", (), positive=False) for k in POINTS},
        **{f"value_{k}": Coefficient("N.m") for k in POINTS},
    }
    example = {"variable": 1.0, **{f"knot_{k}": k - 4.5 for k in POINTS}, **{f"value_{k}": 0.1 * k for k in POINTS}}

    def columns(self, x: View, variable: float, **knots: float) -> list[Array]:
        """Hat function of each knot: 1 at the knot, 0 at the others, (..., m) [1]."""
        signal = np.select([np.equal(variable, k) for k in range(3)], [x.q, x.v, x.a], x.load)
        k = list(knots.values())
        one = np.ones_like(signal)
        up = [one, *((signal - low) / (high - low) for low, high in pairwise(k))]
        down = [*((high - signal) / (high - low) for low, high in pairwise(k)), one]
        return [np.asarray(np.clip(np.minimum(a, b), 0, 1)) for a, b in zip(up, down, strict=True)]


PLUGIN = Empirical()
