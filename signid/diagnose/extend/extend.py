"""Build the extended simulation: refitted numbers and additional laws."""

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

CHANGED_BODY_STD = 0.02  # std of a changed body's mass and first moment, over their change [1]; heuristic
OTHER_BODY_STD = 0.1  # std of the other bodies, over their tolerance, in the same projection [1]; heuristic


def extend(
    model: Model, refitted: Sequence[Group], fit: Fitted, laws: Sequence[Law], base: BaseMap | None = None
) -> Model:
    """Refit numbers of the simulation and add laws.

    A law that the simulation has already at the same joints becomes the sum of both. Refitted inertials stay physically
    consistent.

    Args:
        model: the simulation.
        refitted: column groups of the numbers to refit, in the order of the columns.
        fit: coefficients of these groups.
        laws: laws to add, with all their numbers.
        base: base parameters of the rigid bodies; None: built here.
    """
    steps = iter([fit.value[fit.place(group)] for group in refitted if group.law is not None])
    moved = [_moved(law, next(steps)) if is_refitted(law) else law for law in model.laws] if refitted else [*model.laws]
    own, inertials = moved, model.inertials
    bodies = inertial_places(refitted, fit)
    if len(bodies):
        step, spread = fit.value[bodies].reshape(inertials.shape), fit.covariance[np.ix_(bodies, bodies)]
        inertials = move_bodies(base or build_base(model.robot), inertials, step, spread)
    return _with_consistent_bodies(model, Model(model.robot, inertials, extended_laws(own, laws)), base)


def extended_laws(known: Sequence[Law], laws: Sequence[Law]) -> tuple[Law, ...]:
    """Add laws to others; laws of the same effect, joints and shape become one with the sum of their numbers.

    Args:
        known: laws with all their numbers.
        laws: laws to add.
    """
    own = [*known]
    for law in laws:
        law, own = _merged(law, own)
        same = [k for k, other in enumerate(own) if _adds(law, other)]
        if same:
            stated = law.effect.filled(own[same[0]].parameters)
            contributions = {
                key: stated[key] + x
                for key, x in law.effect.filled(law.parameters).items()
                if key in law.effect.linear()
            }
            own[same[0]] = replace(law, parameters={**law.parameters, **contributions})
        else:
            own.append(law)
    return tuple(law for one in own for law in _positive(one))


def _positive(law: Law) -> tuple[Law, ...]:
    """Raise negative numbers of positive parameters to zero; drop the law if all its numbers become zero."""
    kinds = law.effect.linear()
    low = {key: 0.0 for key, x in law.parameters.items() if key in kinds and kinds[key].positive and x < 0}
    mended = replace(law, parameters={**law.parameters, **low})
    return (mended,) if not low or any(mended.parameters[key] for key in kinds) else ()


def _with_consistent_bodies(given: Model, model: Model, base: BaseMap | None) -> Model:
    """Replace body laws that make consistent bodies inconsistent by the nearest consistent bodies.

    Args:
        given: the simulation.
        model: the extended simulation.
        base: base parameters of the rigid bodies; None: built here.
    """
    changes = [law for law in model.laws if law.effect.name in ("link_inertia", "payload")]
    total = model.whole_inertials() if changes else model.inertials
    if not changes or is_possible(given.whole_inertials(), total):
        return model
    step, kept = total - model.inertials, tuple(law for law in model.laws if law not in changes)
    spread = np.diag(OTHER_BODY_STD**2 * tolerance(given).ravel() ** 2 + _step_std(step).ravel() ** 2)
    return Model(model.robot, move_bodies(base or build_base(model.robot), model.inertials, step, spread), kept)


def _step_std(step: Array) -> Array:
    """(nb, 10) standard deviation of body changes in the projection [kg, kg.m, kg.m2]; large for inertia.

    Args:
        step: (nb, 10) the changes [kg, kg.m, kg.m2].
    """
    mass, moment = np.abs(step[:, :1]), np.linalg.norm(step[:, 1:4], axis=1, keepdims=True)
    inertia = moment**2 / np.maximum(mass, 1e-12)
    return np.repeat(
        np.concatenate([CHANGED_BODY_STD * mass, CHANGED_BODY_STD * moment, inertia], axis=1), (1, 3, 6), axis=1
    )


def inertial_places(refitted: Sequence[Group], fit: Fitted) -> Indices:
    """(10 nb,) positions of the inertials of all bodies among the fitted columns; empty if inertials are not refitted.

    Args:
        refitted: refitted column groups, in the order of the columns.
        fit: the fit.
    """
    return np.flatnonzero(np.isin(fit.which, columns_of([group for group in refitted if group.bodies])))


def _merged(law: Law, own: list[Law]) -> tuple[Law, list[Law]]:
    """Merge simpler laws at the same joints into a law that contains them; return it and the remaining laws."""
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
    """Whether two laws add up to one law with the sum of their numbers."""
    effect = law.effect
    same = effect.name == other.effect.name and law.joints == other.joints
    return (
        same
        and effect.shape(law.parameters) == effect.shape(other.parameters)
        and effect.coefficients(effect.example) == [effect.filled(effect.example)[key] for key in effect.linear()]
    )


def has_possible_numbers(group: Group, value: Array) -> bool:
    """Whether the numbers of a hypothesis, added to the stated ones, are physically possible.

    Args:
        group: columns of the hypothesis.
        value: (size,) coefficients [units of the coefficients].
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
    """Laws of a hypothesis with all their numbers.

    Args:
        group: columns of the hypothesis.
        value: (size,) coefficients [units of the coefficients].
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
