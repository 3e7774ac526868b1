"""A simulation and what it lacks -> the extended simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...effects.law import coefficient_count
from ...model import Model
from ...regression.base_parameters import build_base
from ...types import Array, BaseMap, Indices, Law
from ..data.column_groups import Group, tolerance
from ..data.hypotheses import is_refitted
from ..data.normal_equations import Fitted
from ..data.whitened_rows import columns_of
from .bodies import is_possible, move_bodies

SOFT = 0.02  # share of a body's mass and first moment that may change where its inertia is impossible
FIRM = 0.1  # share of their tolerance by which other bodies may change for that


def extend(
    model: Model, refitted: Sequence[Group], fit: Fitted, laws: Sequence[Law], base: BaseMap | None = None
) -> Model:
    """The simulation with its own numbers refitted, and more laws.

    A law that the simulation has at the same joints becomes the sum of both. Inertials move where the recordings say
    that they are wrong, as far as real bodies could.

    Args:
        model: the simulation.
        refitted: what was refitted, as laid out.
        fit: the fit.
        laws: to be added, with all their numbers.
        base: which combinations of inertial parameters torque shows; of the robot's rigid bodies.
    """
    steps = iter([fit.value[fit.place(group)] for group in refitted if group.law is not None])
    moved = [_moved(law, next(steps)) if is_refitted(law) else law for law in model.laws] if refitted else [*model.laws]
    own, inertials = moved, model.inertials
    bodies = inertial_places(refitted, fit)
    if len(bodies):
        step, spread = fit.value[bodies].reshape(inertials.shape), fit.covariance[np.ix_(bodies, bodies)]
        inertials = move_bodies(base or build_base(model.robot), inertials, step, spread)
    return _possible(model, Model(model.robot, inertials, extended_laws(own, laws)), base)


def extended_laws(known: Sequence[Law], laws: Sequence[Law]) -> tuple[Law, ...]:
    """Laws with more of them: one at the same joints becomes the sum of both.

    Args:
        known: laws, with all their numbers.
        laws: to be added.
    """
    own = [*known]
    for law in laws:
        law, own = _folded(law, own)
        same = [k for k, other in enumerate(own) if _adds(law, other)]
        if same:
            stated = law.effect.filled(own[same[0]].parameters)
            sizes = {
                key: stated[key] + x
                for key, x in law.effect.filled(law.parameters).items()
                if key in law.effect.linear()
            }
            own[same[0]] = replace(law, parameters={**law.parameters, **sizes})
        else:
            own.append(law)
    return tuple(law for one in own for law in _physical(one))


def _physical(law: Law) -> tuple[Law, ...]:
    """The law with numbers that physics wants positive at zero at least; none where nothing of it stays."""
    kinds = law.effect.linear()
    low = {key: 0.0 for key, x in law.parameters.items() if key in kinds and kinds[key].positive and x < 0}
    mended = replace(law, parameters={**law.parameters, **low})
    return (mended,) if not low or any(mended.parameters[key] for key in kinds) else ()


def _possible(given: Model, model: Model, base: BaseMap | None) -> Model:
    """The model; where laws of bodies make impossible ones of possible ones, they are folded into the nearest possible.

    Args:
        given: the simulation.
        model: the extended one.
        base: which combinations of inertial parameters torque shows; of the robot's rigid bodies.
    """
    changes = [law for law in model.laws if law.effect.name in ("link_inertia", "payload")]
    total = model.whole_inertials() if changes else model.inertials
    if not changes or is_possible(given.whole_inertials(), total):
        return model
    step, kept = total - model.inertials, tuple(law for law in model.laws if law not in changes)
    spread = np.diag(FIRM**2 * tolerance(given).ravel() ** 2 + _softness(step).ravel() ** 2)
    return Model(model.robot, move_bodies(base or build_base(model.robot), model.inertials, step, spread), kept)


def _softness(step: Array) -> Array:
    """(nb, 10) how far changes of bodies may be off [kg, kg.m, kg.m2]: torque tells their inertia least.

    Args:
        step: (nb, 10) the changes [kg, kg.m, kg.m2].
    """
    mass, moment = np.abs(step[:, :1]), np.linalg.norm(step[:, 1:4], axis=1, keepdims=True)
    inertia = moment**2 / np.maximum(mass, 1e-12)
    return np.repeat(np.concatenate([SOFT * mass, SOFT * moment, inertia], axis=1), (1, 3, 6), axis=1)


def inertial_places(refitted: Sequence[Group], fit: Fitted) -> Indices:
    """(10 nb,) where the inertials of all bodies stand among what was fitted; none where they are trusted.

    Args:
        refitted: what was refitted, as laid out.
        fit: the fit.
    """
    return np.flatnonzero(np.isin(fit.which, columns_of([group for group in refitted if group.bodies])))


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


def _moved(law: Law, step: Array) -> Law:
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
        and effect.shape(law.parameters) == effect.shape(other.parameters)
        and effect.coefficients(effect.example) == [effect.filled(effect.example)[key] for key in effect.linear()]
    )


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
