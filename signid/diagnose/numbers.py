"""Coefficients -> the numbers of laws as they are spoken of."""

from __future__ import annotations

from ..effects.law import coefficient_count
from ..types import Array, Law
from .group import Group


def read_laws(group: Group, value: Array) -> tuple[Law, ...]:
    """The laws of a hypothesis with all their numbers.

    Args:
        group: the hypothesis.
        value: (size,) coefficients [of each].
    """
    out, at = list[Law](), 0
    for law in group.claim.laws:
        effect = law.effect
        count = coefficient_count(law)
        own = value[at : at + count]
        numbers = effect.physical(own.tolist(), effect.shape(law.parameters)) if effect.linear() else law.parameters
        out.append(Law(effect, law.joints, dict(numbers)))
        at += count
    return tuple(out)
