"""Parameters of an identification: base parameters, and the parameters of laws."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...effects.base import Effect
from ...identify import Identification
from ...types import BaseMap, Coefficient, Law


class LawNumber(NamedTuple):
    """One parameter of a law; std is None if it is identifiable only in combination."""

    effect: str
    joint: str | None  # None: the whole robot
    key: str
    value: float
    std: float | None
    unit: str


def alone(base: BaseMap) -> dict[int, int]:
    """Individually identifiable standard parameters: index of each -> index of its base parameter."""
    terms = np.count_nonzero(base.combination, axis=1)
    return {int(lead): row for row, lead in enumerate(base.independent) if terms[row] == 1}


def rigid_rows(base: BaseMap) -> list[int]:
    """Base parameters other than a single coefficient of a law."""
    singles = alone(base)
    laws = {singles[k] for k, label in enumerate(base.labels) if label.law is not None and k in singles}
    return [row for row in range(base.rank) if row not in laws]


def law_numbers(result: Identification) -> list[list[LawNumber]]:
    """Parameters of each law of the model, with their standard deviations."""
    singles, std = alone(result.base), result.estimate.std
    places: dict[int, list[int]] = {}
    for k, label in enumerate(result.base.labels):
        if label.law is not None:
            places.setdefault(label.law, []).append(k)
    found = []
    for i, law in enumerate(result.model.laws):
        known = [float(std[singles[k]]) if k in singles else None for k in places.get(i, ())]
        found.append(_numbers(result, law, known))
    return found


def _numbers(result: Identification, law: Law, known: list[float | None]) -> list[LawNumber]:
    robot, linear = result.robot, list(law.effect.linear())
    plain = type(law.effect).physical is Effect.physical  # the parameters are the coefficients
    single = len(law.joints) == 1
    numbers = []
    for key, value in law.parameters.items():
        kind = law.effect.parameters[key]
        prismatic = single and bool(robot.prismatic[law.joints[0]])
        unit = kind.unit_at(prismatic) if isinstance(kind, Coefficient) else kind.unit
        std = known[linear.index(key)] if plain and key in linear else None
        joint = robot.joints[law.joints[0]] if single else None
        numbers.append(LawNumber(law.effect.name, joint, key, float(value), std, unit))
    return numbers
