"""The standard parameters nearest to the description that reproduce given base parameters."""

from __future__ import annotations

import numpy as np

from ...regression.projection import least_squares
from ...types import Array, BaseMap, Parameters
from .prior import believable, coefficient_sizes, inertial

_SCALE = np.array([0.3] + [0.1] * 3 + [0.01] * 6)  # of a body per kg: 30 % of mass, 10 cm, (10 cm)^2


def standard_from_base(base: BaseMap, value: Array, prior: Parameters) -> Parameters:
    """The standard parameters nearest to the prior that reproduce the base parameters exactly, feasible or not.

    Near is measured in 30 % of a body's mass, 10 cm for its centre, (10 cm)^2 per kg for its inertia, and for a
    coefficient in its own size.

    Args:
        base: which combinations of the standard parameters the torque shows.
        value: (b,) base parameters [kg, kg.m, kg.m2 or the unit of the coefficient that leads].
        prior: standard parameters with the labels of `base`.

    Raises:
        ValueError: when the prior does not have the labels of the base map.
    """
    start, _ = believable(base, prior)
    size = coefficient_sizes(base, value, start.values)
    size[inertial(start)] = np.outer(start.bodies()[:, 0], _SCALE).ravel()
    x = np.nan_to_num(prior.values)
    for _ in range(3):  # the second and the third remove the rounding of the first
        rest = value - base.combination @ x
        x = x + size * least_squares(base.combination * size, rest)
    return Parameters(prior.labels, x)
