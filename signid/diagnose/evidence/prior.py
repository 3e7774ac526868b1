"""What is believed of an effect before the recordings speak: how large it may be, and how likely it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...effects.base import BodyLaw, TransmissionLaw
from ...types import Array, Frozen
from ..data.hypotheses import Hypothesis
from .thresholds import APPROXIMATE_STD, BODY_LEVER, PRESENCE_STD, PRIOR_NOTHING, PRIOR_UNKNOWN, SINGLE_JOINT

RANK = 1e-6  # of the largest eigenvalue: directions of a group that count


@dataclass(frozen=True, eq=False)
class CoefficientPrior(Frozen):
    """Coefficients of one group: normal about a mean, with deviation = spread @ unit normal, times the size."""

    covariance_factor: Array  # (d, d) [units of the coefficients], columns beyond its rank zero
    mean: float  # of each coefficient; where it is not 0, the size does not count
    positive: int  # which coefficient is positive, -1 for none


def coefficient_prior(hypothesis: Hypothesis, square: Array) -> CoefficientPrior | None:
    """Of an effect's size in torque: all its rows together have that share of the joints' rms torque.

    None where the motion does not show the effect at all.

    Args:
        hypothesis: the effect.
        square: (d, d) [1 per coefficient, squared] mean products of its columns, summed over the joints, in units of
            their rms torque.

    Source: a g-prior, Zellner, in: Bayesian Inference and Decision Techniques, 1986, in units of torque.
    """
    fixed = _fixed(hypothesis)
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
    """Log of the prior probability of a hypothesis.

    Args:
        hypothesis: which.
        places: where its effect may stand.
        skipped: effects that are left out of the library.
        kinds: effects of the library.
        unknowns: dependences that no law explains.
    """
    if hypothesis.unknown:
        return float(np.log(PRIOR_UNKNOWN * (1 - PRIOR_NOTHING) / unknowns))
    common = min(law.effect.common for law in hypothesis.laws)
    one = hypothesis.laws[0]
    if one.effect.scope == "any" and len(one.joints) == 1:
        common *= SINGLE_JOINT
    return float(np.log((1 - PRIOR_UNKNOWN) * (1 - PRIOR_NOTHING) * common / (kinds - skipped) / places))


def _fixed(hypothesis: Hypothesis) -> float | None:
    """Deviation of the coefficients of laws without coefficients of their own."""
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
