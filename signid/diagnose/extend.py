"""A simulation and what it lacks -> the extended simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..model import Model
from ..types import INERTIAL, Array, Law, pseudo_inertia
from .group import Group
from .hypothesis import refits
from .linear import Fitted

HALVINGS = 8  # of a correction of inertials until a real body could have them


def extend(model: Model, refitted: Sequence[Group], fit: Fitted, laws: Sequence[Law]) -> Model:
    """The simulation with its own numbers refitted, and more laws.

    A law that the simulation has at the same joints becomes the sum of both. Inertials move where the recordings say
    that they are wrong, as far as real bodies could.

    Args:
        model: the simulation.
        refitted: what was refitted, as laid out.
        fit: the fit.
        laws: to be added, with all their numbers.
    """
    own, inertials, steps = list[Law](), model.inertials, iter(_steps(refitted, fit))
    for law in model.laws:
        own.append(_moved(law, next(steps)) if refits(law) else law)
    bodies = [
        np.zeros(0) if step is None else step
        for group, step in zip(refitted, _steps(refitted, fit), strict=True)
        if group.bodies
    ]
    if bodies and len(bodies[0]):
        inertials = np.array(
            [_possible(x, dx) for x, dx in zip(inertials, bodies[0].reshape(-1, len(INERTIAL)), strict=True)]
        )
    for law in laws:
        law, own = _folded(law, own)
        same = [k for k, other in enumerate(own) if _adds(law, other)]
        if same:
            numbers = {key: own[same[0]].parameters[key] + x for key, x in law.parameters.items()}
            own[same[0]] = replace(law, parameters=numbers)
        else:
            own.append(law)
    return Model(model.robot, inertials, tuple(own))


def _folded(law: Law, own: list[Law]) -> tuple[Law, list[Law]]:
    """A law with the numbers of plainer ones at its joints that it contains, and the laws without those."""
    numbers, rest = dict(law.parameters), list[Law]()
    for other in own:
        keys = law.effect.contains.get(other.effect.name, {})
        if keys and other.joints == law.joints:
            (value,) = other.parameters.values()
            numbers = {key: x + value * keys.get(key, 0) for key, x in numbers.items()}
        else:
            rest.append(other)
    return replace(law, parameters=numbers), rest


def _steps(refitted: Sequence[Group], fit: Fitted) -> list[Array | None]:
    """What each refitted group's coefficients change by, None where it took no part."""
    value = dict(zip(fit.which.tolist(), fit.value.tolist(), strict=True))
    return [
        np.array([value[k] for k in range(group.start, group.start + group.size)]) if group.start in value else None
        for group in refitted
    ]


def _moved(law: Law, step: Array | None) -> Law:
    if step is None:
        return law
    coefficients = np.array(law.effect.coefficients(law.parameters)) + step
    numbers = law.effect.physical(coefficients.tolist(), law.effect.shape(law.parameters))
    for key, kind in law.effect.linear().items():
        numbers[key] = max(numbers[key], 0.0) if kind.positive else numbers[key]
    return replace(law, parameters=numbers)


def _adds(law: Law, other: Law) -> bool:
    """Whether two laws are one with the sum of their numbers."""
    effect = law.effect
    same = effect.name == other.effect.name and law.joints == other.joints
    return (
        same
        and list(effect.linear()) == list(effect.parameters)
        and effect.coefficients(effect.example) == [effect.filled(effect.example)[key] for key in effect.linear()]
    )


def _possible(inertial: Array, step: Array) -> Array:
    """The body moved by the step, or by half of it and so on, until a real body could have it."""
    before = float(np.linalg.eigvalsh(pseudo_inertia(inertial)).min())
    for _ in range(HALVINGS):
        moved = inertial + step
        if np.linalg.eigvalsh(pseudo_inertia(moved)).min() > min(0.0, before):
            return moved
        step = step / 2
    return inertial
