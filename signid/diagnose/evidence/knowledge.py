"""Prior of the nuisance parameters from the covariance that a model carries."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...model import Model
from ...regression.regressor import labels
from ...types import INERTIAL, Law
from ..data.column_groups import Group
from .linear_model import StatedPrior

RIDGE = 1e-9  # [1] added to the diagonal of the scaled covariance, so that it can be inverted


def stated_prior(model: Model, groups: Sequence[Group]) -> StatedPrior | None:
    """Prior of the stated parameters: information K' C^-1 K; None if the model has no covariance C.

    A parameter that the simulation no longer has, such as that of a removed law, is zero, not unknown.

    Args:
        model: the simulation.
        groups: groups of all columns.
    """
    if model.covariance is None:
        return None
    columns = parameter_columns(model, groups)
    own = model.covariance
    there = np.array([label in columns for label in own.labels])
    rows = np.isfinite(own.std)
    combination = own.combination[np.ix_(rows, there)]
    places = np.array([columns[label] for label, yes in zip(own.labels, there, strict=True) if yes], dtype=np.intp)
    covariance = own.matrix[np.ix_(rows, rows)]
    size = np.sqrt(np.diag(covariance))
    inverse = np.linalg.inv(covariance / size / size[:, None] + RIDGE * np.eye(len(size))) / size / size[:, None]
    order = np.argsort(places)
    information = (combination.T @ inverse @ combination)[np.ix_(order, order)]
    return StatedPrior(places[order], information)


def parameter_columns(model: Model, groups: Sequence[Group]) -> dict[str, int]:
    """Column index of each standard parameter among the nuisance columns."""
    out, body = dict[str, int](), 0
    for group in groups:
        if group.bodies:
            body += 1
            out |= {f"{name}_{body}": group.start + k for k, name in enumerate(INERTIAL)}
        elif group.law is not None:
            out |= dict(law_parameter_columns(model, group, (group.law,)))
    return out


def law_parameter_columns(model: Model, group: Group, own: Sequence[Law]) -> list[tuple[str, int]]:
    """Column index of each parameter of laws."""
    names = [label.name for label in labels(model.robot, own)[10 * len(model.robot.links) :]]
    return [(name, group.start + k) for k, name in enumerate(names[: group.size])]
