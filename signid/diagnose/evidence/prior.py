"""Priors of hypotheses: size of their coefficients and probability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...effects.base import BodyLaw, TransmissionLaw
from ...types import Array, Frozen
from ..data.hypotheses import Hypothesis
from .thresholds import APPROXIMATE_STD, BODY_LEVER, PRESENCE_STD, PRIOR_NOTHING, PRIOR_UNKNOWN, SINGLE_JOINT

RANK = 1e-6  # [1] smallest eigenvalue that counts, over the largest. Prototype


@dataclass(frozen=True, eq=False)
class CoefficientPrior(Frozen):
    """Gaussian prior b ~ N(mean, f^2 T T') of the coefficients of one group; f is the size of the effect."""

    covariance_factor: Array  # (d, d) [units of the coefficients] T; columns beyond its rank are zero
    mean: float  # mean of each coefficient; if it is not 0, f = 1
    positive: int  # index of the coefficient that must be positive, -1 for none


def coefficient_prior(hypothesis: Hypothesis, square: Array) -> CoefficientPrior | None:
    """g-prior in units of torque: the rms torque of the effect is a share f of the joints' rms torque.

    None if the columns of the effect are zero along this motion.

    Args:
        hypothesis: the hypothesis.
        square: (d, d) [1 per coefficient, squared] mean products of its columns over squared rms torque, summed over
            joints.

    Source: Zellner, in: Bayesian Inference and Decision Techniques, 1986.
    """
    fixed = _fixed_std(hypothesis)
    size = np.sqrt(np.maximum(np.diag(square), 0))
    if size.max() < 1e-9:
        return None
    if fixed is not None:
        return CoefficientPrior(np.eye(len(square)) * fixed, 1.0, -1)
    units = [kind.unit for law in hypothesis.laws for kind in law.effect.linear().values()]
    if hypothesis.laws and not hypothesis.scaled and isinstance(hypothesis.laws[0].effect, BodyLaw) and "kg" in units:
        lever = np.array([BODY_LEVER ** _power(unit) for unit in units])
        return CoefficientPrior(np.diag(lever / np.sqrt(lever**2 @ size**2)), 0.0, _positive(hypothesis))
    size = np.where(size < 1e-9 * size.max(), np.inf, size)
    values, vectors = np.linalg.eigh(square / size / size[:, None])
    kept = values > RANK * values[-1]
    spread = vectors * np.where(kept, 1 / np.sqrt(np.where(kept, values, 1)), 0) / size[:, None] / np.sqrt(kept.sum())
    return CoefficientPrior(spread, 0.0, _positive(hypothesis))


def log_prior(hypothesis: Hypothesis, places: int, skipped: int, kinds: int, unknowns: int) -> float:
    """Log of the prior probability of a hypothesis [-].

    Args:
        hypothesis: the hypothesis.
        places: number of hypotheses of the same effect.
        skipped: number of effects that are left out of the library.
        kinds: number of effects of the library.
        unknowns: number of unknown dependences.
    """
    if hypothesis.unknown:
        return float(np.log(PRIOR_UNKNOWN * (1 - PRIOR_NOTHING) / unknowns))
    common = min(law.effect.common for law in hypothesis.laws)
    one = hypothesis.laws[0]
    if one.effect.scope == "any" and len(one.joints) == 1:
        common *= SINGLE_JOINT
    return float(np.log((1 - PRIOR_UNKNOWN) * (1 - PRIOR_NOTHING) * common / (kinds - skipped) / places))


def _fixed_std(hypothesis: Hypothesis) -> float | None:
    """Standard deviation of the coefficient of laws without coefficients of their own; None for others [1]."""
    if hypothesis.unknown or any(law.effect.linear() for law in hypothesis.laws):
        return None
    return APPROXIMATE_STD if isinstance(hypothesis.laws[0].effect, TransmissionLaw) else PRESENCE_STD


def _power(unit: str) -> int:
    return {"kg": 0, "kg.m": 1, "kg.m2": 2}[unit]


def _positive(hypothesis: Hypothesis) -> int:
    if hypothesis.stated is not None:
        return -1
    kinds: Sequence[bool] = [k.positive for law in hypothesis.laws for k in law.effect.linear().values()]
    return kinds.index(True) if sum(kinds) == 1 else -1
