"""Estimates of each of several recordings -> numbers that differ between recordings, and what this spread adds.

Source: DerSimonian, Laird, Controlled Clinical Trials 7, 1986 (random effects by the method of moments); Hartung,
Knapp, Statistics in Medicine 20, 2001 (Student's t of few recordings).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..effects.base import Effect
from ..errors import decimals, shorten
from ..types import TWO_SIDED, Array, BaseMap, Law, Robot

MAX_CHANCE = 0.001  # probability of such differences by chance, over all numbers, below which a number varies
SERVO = "servo"  # effect of the numbers of a drive
JACKKNIFE_RIDGE = 1e-10  # [1] over the diagonal of the normal equations
MIN_DEGREES_OF_FREEDOM = 2  # of Student's t: with one, two recordings would give useless intervals


class VaryingNumber(NamedTuple):
    """A number that differs between recordings by more than its intervals."""

    effect: str | None  # law, or SERVO; None: a base parameter
    joint: str | None
    parameter: str  # of the effect, or the expression of the base parameter
    spread: float  # standard deviation between recordings [unit]
    unit: str

    @property
    def words(self) -> str:
        """Number, joint and spread."""
        spread = f"({decimals(self.spread, 2)} {self.unit})"
        if self.effect is None or self.joint is None:
            return f"{self.parameter} {spread}"
        law = self.effect.removesuffix(f"_{self.parameter}") if self.effect != SERVO else ""
        return f"{f'{law} {self.parameter}'.strip().replace('_', ' ')} of {self.joint} {spread}"


def spread_between(values: Array, variances: Array) -> Array:
    """Standard deviation (P,) between R recordings of P numbers; 0 of those that agree within their intervals.

    values: (R, P) of each recording alone [units of the numbers]; variances: (R, P) [squared units], infinite where a
    recording does not identify a number.
    """
    from scipy.special import chdtrc  # needed by several recordings alone

    weight = 1 / np.maximum(variances, 1e-300)
    count, total = (weight > 0).sum(0) - 1, np.maximum(weight.sum(0), 1e-300)
    squares = np.sum(weight * (values - (weight * values).sum(0) / total) ** 2, axis=0)
    by_chance = chdtrc(np.maximum(count, 1), squares) * max(np.count_nonzero(count > 0), 1)
    free = np.maximum(total - (weight**2).sum(0) / total, 1e-300)
    return np.where((count > 0) & (by_chance < MAX_CHANCE), np.sqrt(np.maximum(squares - count, 0) / free), 0.0)


def spread_covariance(spread: Array, parts: Array, inverse: Array) -> Array:
    """Covariance (P, P) that a spread of numbers between recordings gives their common estimate.

    Args:
        spread: (P,) standard deviation between recordings [units of the numbers].
        parts: (R, P, P) of each recording [inverse products of the units].
        inverse: (P, P) of their sum, without unidentifiable directions [products of the units].
    """
    from scipy.special import stdtrit

    moved = inverse @ parts * spread
    few = float(stdtrit(max(len(parts) - 1, MIN_DEGREES_OF_FREEDOM), 0.975)) / TWO_SIDED
    return np.asarray(few**2 * np.einsum("rik,rjk->ij", moved, moved))


def jackknife_variance(square: Array, right: Array, precision: Array, first: int) -> Array:
    """(d,) jackknife variance of the first d coefficients of a linear model over c parts of its rows.

    Scaled by Student's t over the normal quantile, since there are few parts. `first` is d.
    square: (c, k, k) Gram of each part, and precision: (k, k) of the prior [1 per coefficient, squared].
    right: (c, k) right side of each part, about the coefficients of all rows [1 per coefficient].
    """
    from scipy.special import stdtrit

    whole = square.sum(axis=0) + precision
    size = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    ridge = JACKKNIFE_RIDGE * np.eye(len(size))
    steps = np.linalg.solve((whole - square) / size / size[:, None] + ridge, (right / size)[..., None])[:, :first, 0]
    count, ratio = len(square), float(stdtrit(len(square) - 1, 0.975)) / TWO_SIDED
    return np.asarray(ratio**2 * (count - 1) * np.var(steps / size[:first], axis=0))


def varying_numbers(robot: Robot, base: BaseMap, laws: Sequence[Law], spread: Array) -> tuple[VaryingNumber, ...]:
    """Base parameters that differ between recordings; single coefficients by their laws.

    spread: (b,) standard deviation between recordings [units of base].
    """
    numbers = list[VaryingNumber]()
    for k in np.flatnonzero(spread).tolist():
        effect, joint, parameter = None, None, base.expressions[k]
        label = base.labels[lead := int(base.independent[k])]
        if label.law is not None and np.count_nonzero(base.combination[k]) == 1:
            law = laws[label.law]
            if type(law.effect).physical is Effect.physical:  # the parameters are the coefficients
                coefficients = [i for i, other in enumerate(base.labels) if other.law == label.law]
                effect, parameter = law.effect.name, [*law.effect.linear()][coefficients.index(lead)]
                joint = robot.joints[law.joints[0]]
        numbers.append(VaryingNumber(effect, joint, parameter, float(spread[k]), base.units[k]))
    return tuple(numbers)


def varying_sentence(varies: Sequence[VaryingNumber]) -> tuple[str, ...]:
    """One sentence on the numbers that differ between recordings; none without any."""
    listed = shorten([number.words for number in varies], 4)
    said = "between recordings more than within them, and the intervals contain it (standard deviation)"
    return (f"these numbers vary {said}: {listed}",) * bool(varies)
