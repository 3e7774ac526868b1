"""Coefficients -> the numbers of laws as they are spoken of."""

from __future__ import annotations

from ...effects.law import coefficient_count
from ...types import Array, Law
from ..data.column_groups import Group


def has_possible_numbers(group: Group, value: Array) -> bool:
    """Whether a real robot could have the numbers of a hypothesis, added to those that the simulation states.

    Args:
        group: the hypothesis.
        value: (size,) coefficients [of each].
    """
    stated = group.claim.stated
    if stated is None:
        return all(law.effect.possible_value(law.parameters) for law in read_laws(group, value))
    kinds, before = stated.effect.linear(), stated.effect.coefficients(stated.parameters)
    after = [x + step for x, step in zip(before, value.tolist(), strict=False)]
    numbers = stated.effect.physical(after, stated.effect.shape(stated.parameters)) if kinds else stated.parameters
    positive = all(not kind.positive or x > 0 for kind, x in zip(kinds.values(), after, strict=False))
    return positive and stated.effect.possible_value(numbers)


def read_laws(group: Group, value: Array) -> tuple[Law, ...]:
    """The laws of a hypothesis with all their numbers.

    Args:
        group: the hypothesis.
        value: (size,) coefficients [of each].
    """
    out, at, numbers_of_all = list[Law](), 0, group.claim.numbers @ value
    for law in group.claim.laws:
        effect = law.effect
        count = coefficient_count(law)
        own = numbers_of_all[at : at + count]
        numbers = effect.physical(own.tolist(), effect.shape(law.parameters)) if effect.linear() else law.parameters
        out.append(Law(effect, law.joints, dict(numbers)))
        at += count
    return tuple(out)
