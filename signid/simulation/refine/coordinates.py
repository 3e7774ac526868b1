"""Free numbers of a model: coefficients and shapes of its torque laws, armature, and the mass of a single slide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...effects.armature import Armature
from ...effects.base import TorqueLaw
from ...errors import OptionError
from ...model import Model
from ...types import Array, Frozen, Law

LEAST = 0.05  # [1] smallest factor of the mass, and of a shape that must be positive


@dataclass(frozen=True, eq=False)
class FreeNumbers(Frozen):
    """Vector of P free numbers, with their lower bounds and typical sizes."""

    value: Array  # (P,) [units of the laws; the mass as a factor, 1]
    lower: Array  # (P,) [units of the laws]
    size: Array  # (P,) [units of the laws] positive


def coordinates_of(model: Model) -> FreeNumbers:
    """Free numbers of a model, in the order of `with_coordinates`.

    Raises:
        OptionError: the model has none.
    """
    rows = [(1.0, LEAST, 1.0)] if _slides(model) else []
    for law in free_laws(model):
        coefficients, linear = law.effect.coefficients(law.parameters), list(law.effect.linear().values())
        example = law.effect.coefficients(law.effect.example)
        for value, typical, number in zip(coefficients, example, linear, strict=True):
            bounded = number.positive and value >= 0
            rows.append((value, 0.0 if bounded else -np.inf, max(abs(value), 0.01 * abs(typical), 1e-6)))
        for value in law.effect.shape(law.parameters).values():
            rows.append((value, LEAST * value if value > 0 else -np.inf, max(abs(value), 1e-6)))
    if not rows:
        raise OptionError("the model has no law whose numbers could be refined; identify it with friction first")
    return FreeNumbers(*map(np.array, zip(*rows, strict=True)))


def with_coordinates(model: Model, value: Sequence[float] | Array) -> Model:
    """The model with other free numbers, value (P,) [units of the laws]; its covariance no longer applies."""
    left = [float(x) for x in value]
    inertials = model.inertials * left.pop(0) if _slides(model) else model.inertials
    laws = list[Law]()
    for law in model.laws:
        if not _free(model, law):
            laws.append(law)
            continue
        count, shape = len(law.effect.coefficients(law.parameters)), law.effect.shape(law.parameters)
        coefficients, left = left[:count], left[count:]
        changed, left = dict(zip(shape, left[: len(shape)], strict=True)), left[len(shape) :]
        laws.append(replace(law, parameters=law.effect.physical(coefficients, changed)))
    return replace(model, inertials=inertials, laws=tuple(laws), covariance=None)


def free_laws(model: Model) -> list[Law]:
    """Laws whose numbers are refined."""
    return [law for law in model.laws if _free(model, law)]


def _free(model: Model, law: Law) -> bool:
    return isinstance(law.effect, TorqueLaw) or (isinstance(law.effect, Armature) and not _slides(model))


def _slides(model: Model) -> bool:
    """Whether the robot is a single prismatic joint: only its moved mass counts, so the mass is free."""
    return len(model.robot.joints) == 1 and bool(model.robot.prismatic[0])
