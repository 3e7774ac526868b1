"""Priors: of hypotheses, their coefficients and probability; of stated parameters, from the covariance of a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...effects import LISTED_LAWS
from ...effects.base import BodyLaw, TransmissionLaw
from ...model import Model
from ...regression.motion import labels
from ...types import INERTIAL, Array, Frozen, Indices, Law
from .. import thresholds as tuned
from ..data.hypotheses import Hypothesis
from ..data.rows import Group

SCALED_RIDGE = 1e-9  # [1] added to the diagonal of the scaled covariance, so that it can be inverted
PRIOR_RANK_TOLERANCE = 1e-10  # [1] smallest eigenvalue over the largest; 1e-6 cuts off the cubic of a cable


@dataclass(frozen=True, eq=False)
class CoefficientPrior(Frozen):
    """Gaussian prior b ~ N(mean, f^2 T T') of the coefficients of one group; f is the size of the effect."""

    covariance_factor: Array  # (d, d) [units of the coefficients] T; columns beyond its rank are zero
    mean: float  # mean of each coefficient; if it is not 0, f = 1
    positive: int  # index of the coefficient that must be positive, -1 for none


def coefficient_prior(hypothesis: Hypothesis, square: Array) -> CoefficientPrior | None:
    """g-prior in units of torque: the rms torque of the effect is a share f of the joints' rms torque.

    None if the columns are zero along this motion; square (d, d) [1 per coefficient, squared]: their `mean_products`.

    Source: Zellner, in: Bayesian Inference and Decision Techniques, 1986.
    """
    size = np.sqrt(np.maximum(np.diag(square), 0))
    if size.max() < 1e-9:
        return None
    if not hypothesis.unknown and not any(law.effect.linear() for law in hypothesis.laws):  # laws without numbers
        approximate = isinstance(hypothesis.laws[0].effect, TransmissionLaw)
        std = tuned.APPROXIMATE_STD if approximate else tuned.PRESENCE_STD
        return CoefficientPrior(np.eye(len(square)) * std, 1.0, -1)
    units = [kind.unit for law in hypothesis.laws for kind in law.effect.linear().values()]
    if hypothesis.laws and not hypothesis.scaled and isinstance(hypothesis.laws[0].effect, BodyLaw) and "kg" in units:
        lever = np.array([tuned.BODY_LEVER ** {"kg": 0, "kg.m": 1, "kg.m2": 2}[unit] for unit in units])
        return CoefficientPrior(np.diag(lever / np.sqrt(lever**2 @ size**2)), 0.0, _positive(hypothesis))
    size = np.where(size < 1e-9 * size.max(), np.inf, size)
    values, vectors = np.linalg.eigh(square / size / size[:, None])
    kept = values > PRIOR_RANK_TOLERANCE * values[-1]
    spread = vectors * np.where(kept, 1 / np.sqrt(np.where(kept, values, 1)), 0) / size[:, None] / np.sqrt(kept.sum())
    return CoefficientPrior(spread, 0.0, _positive(hypothesis))


def log_prior(hypothesis: Hypothesis, places: int, kinds: int, unknowns: int) -> float:
    """Log prior probability of a hypothesis [-]: one of `places` of its effect, `kinds` of effects, or `unknowns`."""
    if hypothesis.unknown:
        return float(np.log(tuned.PRIOR_UNKNOWN * (1 - tuned.PRIOR_NOTHING) / unknowns))
    effects = [law.effect for law in hypothesis.laws]
    common = min(x.common or (1.0 if x.name in LISTED_LAWS else tuned.ADDED_FREQUENCY) for x in effects)
    one = hypothesis.laws[0]
    if one.effect.scope == "any" and len(one.joints) == 1:
        common *= tuned.ONE_JOINT_FACTOR
    return float(np.log((1 - tuned.PRIOR_UNKNOWN) * (1 - tuned.PRIOR_NOTHING) * common / kinds / places))


def _positive(hypothesis: Hypothesis) -> int:
    if hypothesis.stated is not None:
        return -1
    kinds: Sequence[bool] = [k.positive for law in hypothesis.laws for k in law.effect.linear().values()]
    return kinds.index(True) if sum(kinds) == 1 else -1


class StatedPrior(NamedTuple):
    """Gaussian prior of stated bodies and laws, from the recordings of an earlier identification."""

    columns: Indices  # (k,) column indices of the coefficients
    information: Array  # (k, k) [1 per coefficient, squared] inverse of their covariance, at k = 1


def stated_prior(model: Model, groups: Sequence[Group]) -> StatedPrior | None:
    """Prior of the stated parameters: information K' C^-1 K; None if the model has no covariance C.

    A parameter that the simulation no longer has, such as that of a removed law, is zero, not unknown.
    """
    if (own := model.covariance) is None:
        return None
    columns = parameter_columns(model, groups)
    there = np.array([label in columns for label in own.labels])
    rows = np.isfinite(own.std)
    combination = own.combination[np.ix_(rows, there)]
    places = np.array([columns[label] for label, yes in zip(own.labels, there, strict=True) if yes], dtype=np.intp)
    covariance = own.matrix[np.ix_(rows, rows)]
    size = np.sqrt(np.diag(covariance))
    inverse = np.linalg.inv(covariance / size / size[:, None] + SCALED_RIDGE * np.eye(len(size))) / size / size[:, None]
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
