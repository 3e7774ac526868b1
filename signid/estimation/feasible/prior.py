"""Prior of the feasible fit: feasible bodies, and the sizes of coefficients."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...regression.projection import least_squares
from ...types import Array, BaseMap, Parameters, pseudo_inertia
from .packing import TO_INERTIAL, pack

LEAST_MASS = 1e-3  # [kg] mass below which a body counts as massless
LEAST_RADIUS = 3e-3  # [m] radius of gyration below which a body counts as flat
MASS, RADIUS = 0.05, 0.03  # [kg], [m] mass and radius of gyration of a substitute

_SCALE = np.array([0.3] + [0.1] * 3 + [0.01] * 6)  # [1, m, m2] scale of a body's parameters per kg: 30 %, 10 cm


def inertial(parameters: Parameters) -> NDArray[np.bool_]:
    """Mask (p,) of the standard parameters that are inertial parameters of a body."""
    return np.array([label.body is not None for label in parameters.labels], dtype=bool)


def positive(parameters: Parameters) -> NDArray[np.bool_]:
    """Mask (p,) of the standard parameters with a lower bound of zero."""
    return np.array([label.positive for label in parameters.labels], dtype=bool)


def feasible_prior(base: BaseMap, prior: Parameters) -> tuple[Parameters, tuple[str, ...]]:
    """Strictly feasible prior: massless, flat and infeasible bodies are replaced, with a sentence on each; NaN is 0.

    Raises:
        ValueError: the prior does not have the labels of the base map.
    """
    if prior.labels != base.labels:
        raise ValueError(
            f"the {len(prior.labels)} labels of the prior differ from the {len(base.labels)} of the base map; "
            "build both from the same robot and the same laws"
        )
    values = np.nan_to_num(prior.values)
    values[positive(prior)] = np.maximum(values[positive(prior)], 0.0)
    given = values[inertial(prior)].reshape(-1, 10)
    made = np.array([_solid(body) for body in given]).reshape(-1, 10)
    fault = ("is thinner than 3 mm or infeasible", "has no mass")
    notes = tuple(
        f"body {i + 1} of the description {fault[int(old[0] < LEAST_MASS)]}; "
        f"one of {new[0]:.3g} kg and {RADIUS * 100:.0f} cm radius of gyration replaces it"
        for i, (old, new) in enumerate(zip(given, made, strict=True))
        if not np.array_equal(old, new)
    )
    values[inertial(prior)] = made.ravel()
    return replace(prior, values=values), notes


def coefficient_sizes(base: BaseMap, value: Array, prior: Array, std: Array | None = None) -> Array:
    """Scale (p,) of each parameter: its size if it alone made up the base parameters that it is part of.

    Base parameters: value (b,) [unit of each], their std (b,) [unit of each], inf where unidentifiable: ignored.
    The size is at least that of prior (p,) [unit of each].
    """
    known = np.abs(value) if std is None else np.where(np.isfinite(std), np.abs(value) + std, 0.0)
    share = np.abs(base.combination)
    alone = (known[:, None] / np.where(share > 0, share, np.inf)).max(0, initial=0.0)
    size = np.maximum(alone, np.abs(prior))
    return np.where(size > 0, size, 1.0)


def _solid(body: Array) -> Array:
    """The body if it is feasible, else a similar feasible one."""
    matrix = pseudo_inertia(body)
    mass = matrix[3, 3] if matrix[3, 3] >= LEAST_MASS else MASS
    centre = matrix[:3, 3] / mass
    spread, axes = np.linalg.eigh(matrix[:3, :3] - mass * np.outer(centre, centre))
    if mass == matrix[3, 3] and spread[0] >= LEAST_RADIUS**2 * mass:
        return body
    spread = np.where(spread < LEAST_RADIUS**2 * mass, RADIUS**2 * mass, spread)
    matrix[:3, :3] = (axes * spread) @ axes.T + mass * np.outer(centre, centre)
    matrix[3, 3] = mass
    return np.asarray(TO_INERTIAL @ pack(matrix))


def standard_from_base(base: BaseMap, value: Array, prior: Parameters) -> Parameters:
    """Standard parameters nearest to the prior that reproduce the base parameters exactly, feasible or not.

    Distances are measured in 30 % of a body's mass, 10 cm for its centre, (10 cm)^2 per kg for its inertia, and in the
    size of a coefficient. The base parameters are value (b,) [kg, kg.m, kg.m2 or the unit of the leading coefficient].
    """
    start, _ = feasible_prior(base, prior)
    size = coefficient_sizes(base, value, start.values)
    size[inertial(start)] = np.outer(start.bodies()[:, 0], _SCALE).ravel()
    x = np.nan_to_num(prior.values)
    for _ in range(3):  # the second and the third iteration remove rounding errors
        rest = value - base.combination @ x
        x = x + size * least_squares(base.combination * size, rest)
    return Parameters(prior.labels, x)
