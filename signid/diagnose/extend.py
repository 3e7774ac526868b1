"""Extended simulation: refitted numbers, additional laws, physically consistent bodies, and the residuals it leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..effects.base import TorqueLaw
from ..effects.law import coefficient_count
from ..errors import RecordingError
from ..estimation.feasible import ConsistentFit, fit_consistent
from ..estimation.fit_quality import Course, Fit, fit_rows, rms_of
from ..model import Model
from ..regression.bandwidth import Decimator
from ..regression.base_parameters import build_base
from ..regression.rows import Task
from ..regression.session import Part, Session
from ..robot.dynamics import own_body
from ..types import INERTIAL, Array, BaseMap, Effect, Estimate, Indices, Law, Parameters, Robot, pseudo_inertia
from .data.dataset import Fitted, columns_of
from .data.hypotheses import is_refitted
from .data.motions import Piece, pieces, reversal_uncertainty, row_filter, standstill, stated_friction
from .data.noise import Noise
from .data.rows import Group, tolerance

PRIOR_WEIGHTS = (0.01, 1.0)  # weights of the stated bodies where torque shows nothing, tried in turn [1]; heuristic
MAX_MASS_RATIO = 5.0  # mass over stated mass plus step beyond which the larger weight is used [1]; heuristic
MIN_RELATIVE_STD, MIN_ABSOLUTE_STD = 1e-6, 1e-12  # of a base parameter: condition the inverse
BODY_CHANGE_EFFECTS = ("link_inertia", "payload")  # laws that change a body
OTHER_BODY_STD = 0.1  # std of the other bodies, over their tolerance, in the same projection [1]; heuristic


def extend(
    model: Model,
    refitted: Sequence[Group],
    fit: Fitted,
    added: Mapping[Group, Sequence[Law]],
    base: BaseMap | None = None,
) -> Model:
    """Refit numbers of the simulation and add the laws of some hypotheses.

    A law that the simulation has already at the same joints becomes the sum of both. Bodies stay physically consistent.
    The groups `refitted` are in the order of the columns; `base` is built here if it is None.
    """
    laws = [law for own in added.values() for law in own]
    steps = iter([fit.value[fit.place(group)] for group in refitted if group.law is not None])
    moved = [_moved(law, next(steps)) if is_refitted(law) else law for law in model.laws] if refitted else [*model.laws]
    own, inertials = moved, model.inertials
    bodies = inertial_places(refitted, fit)
    if len(bodies):
        step, spread = fit.value[bodies].reshape(inertials.shape), fit.covariance[np.ix_(bodies, bodies)]
        inertials = move_bodies(base or build_base(model.robot), inertials, step, spread)
    whole = replace(model, inertials=inertials, laws=extended_laws(own, laws), covariance=None)
    changes = [law for law in whole.laws if law.effect.name in BODY_CHANGE_EFFECTS]
    if not changes or is_possible(model.whole_inertials(), whole.whole_inertials()):
        return whole
    # body laws that make consistent bodies inconsistent: the nearest consistent bodies replace them
    step, kept = whole.whole_inertials() - inertials, tuple(law for law in whole.laws if law not in changes)
    consistent = move_bodies(base or build_base(model.robot), inertials, step, _changed_spread(model, fit, added))
    return replace(whole, inertials=consistent, laws=kept)


def extended_laws(known: Sequence[Law], laws: Sequence[Law]) -> tuple[Law, ...]:
    """Add laws to others; laws of the same effect, joints and shape become one with the sum of their numbers."""
    own = [*known]
    for law in laws:
        law, own = _merged(law, own)
        adds = is_plain(law.effect) or isinstance(law.effect, TorqueLaw)
        same = [k for k, other in enumerate(own) if adds and is_same(law, other)]
        if same:
            own[same[0]] = _sum(law, own[same[0]])
        else:
            own.append(law)
    return tuple(law for one in own for law in _positive(one))


def _positive(law: Law) -> tuple[Law, ...]:
    """Raise negative numbers of positive parameters to zero; drop the law if all its numbers become zero."""
    kinds = law.effect.linear()
    low = {key: 0.0 for key, x in law.parameters.items() if key in kinds and kinds[key].positive and x < 0}
    mended = replace(law, parameters={**law.parameters, **low})
    return (mended,) if not low or any(mended.parameters[key] for key in kinds) else ()


def _changed_spread(model: Model, fit: Fitted, added: Mapping[Group, Sequence[Law]]) -> Array:
    """(10 nb, 10 nb) covariance of the bodies with the changes by some hypotheses [products of kg, kg.m, kg.m2].

    Bodies that no hypothesis changes keep a share of their tolerance.
    """
    spread = np.diag(OTHER_BODY_STD**2 * tolerance(model).ravel() ** 2)
    for group in added:
        law = group.claim.laws[0]
        if law.effect.name in BODY_CHANGE_EFFECTS:
            own, numbers = fit.place(group), group.claim.numbers
            at = 10 * own_body(model.robot, law.joints[0]) + np.arange(len(numbers))
            spread[np.ix_(at, at)] += numbers @ fit.covariance[own, own] @ numbers.T
    return spread


def inertial_places(refitted: Sequence[Group], fit: Fitted) -> Indices:
    """(10 nb,) positions of the inertials of all bodies among the fitted columns; empty if they are not refitted."""
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


def _sum(law: Law, other: Law) -> Law:
    """One law in place of two of the same effect, joints and shape; the sum of their coefficients."""
    effect = law.effect
    if is_plain(effect):
        one, two = (effect.filled(x.parameters) for x in (law, other))
        return replace(law, parameters={**law.parameters, **{key: one[key] + two[key] for key in effect.linear()}})
    total = [x + y for x, y in zip(*(effect.coefficients(x.parameters) for x in (law, other)), strict=True)]
    return replace(law, parameters=effect.physical(total, effect.shape(law.parameters)))


def is_plain(effect: Effect) -> bool:
    """Whether the coefficients of an effect are its numbers."""
    return effect.coefficients(effect.example) == [effect.filled(effect.example)[key] for key in effect.linear()]


def is_same(law: Law, other: Law) -> bool:
    """Whether two laws have the same effect, joints and shape."""
    one, two = ((x.effect.name, x.joints, x.effect.shape(x.parameters)) for x in (law, other))
    return one == two


def has_possible_numbers(group: Group, value: Array) -> bool:
    """Whether the coefficients, value: (size,) [their units], added to the stated ones are physically possible."""
    stated = group.claim.stated
    if stated is None:
        return all(law.effect.possible_value(law.parameters) for law in read_laws(group, value))
    kinds, before = stated.effect.linear(), stated.effect.coefficients(stated.parameters)
    after = [x + step for x, step in zip(before, value.tolist(), strict=False)]
    numbers = stated.effect.physical(after, stated.effect.shape(stated.parameters)) if kinds else stated.parameters
    positive = all(not kind.positive or x > 0 for kind, x in zip(kinds.values(), after, strict=False))
    return positive and stated.effect.possible_value(numbers)


def read_laws(group: Group, value: Array) -> tuple[Law, ...]:
    """Laws of a hypothesis with all their numbers; value: (size,) coefficients [their units]."""
    out, at, numbers_of_all = list[Law](), 0, group.claim.numbers @ value
    for law in group.claim.laws:
        effect, count = law.effect, coefficient_count(law)
        own = numbers_of_all[at : at + count]
        numbers = effect.physical(own.tolist(), effect.shape(law.parameters)) if effect.linear() else law.parameters
        out.append(Law(effect, law.joints, dict(numbers)))
        at += count
    return tuple(out)


def move_bodies(base: BaseMap, inertials: Array, step: Array, covariance: Array) -> Array:
    """Add a step to the bodies; project onto the physically consistent set where the sum lies outside it.

    Distance is measured in the metric of the covariance. A body that is inconsistent as stated may stay so.
    inertials and step: (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2].
    covariance: (k, k) of the step, k = 10 nb [products of the units].
    """
    if is_possible(inertials, inertials + step):
        return inertials + step
    for weight in PRIOR_WEIGHTS:
        bodies = nearest_bodies(base, inertials, step, covariance, weight).parameters.bodies()
        if np.all(bodies[:, 0] < MAX_MASS_RATIO * (inertials[:, 0] + np.abs(step[:, 0]))):
            break
    return bodies


def nearest_bodies(
    base: BaseMap, inertials: Array, step: Array, covariance: Array, weight: float = PRIOR_WEIGHTS[0]
) -> ConsistentFit:
    """Project bodies plus a step onto the physically consistent set, in the metric of the covariance.

    inertials and step: (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2].
    covariance: (k, k) of the step, k = 10 nb [products of the units].
    weight: of the stated bodies in directions that torque does not show [1].
    """
    value, spread = base.combination @ (inertials + step).ravel(), base.combination @ covariance @ base.combination.T
    spread = spread + np.diag((MIN_RELATIVE_STD * np.abs(value) + MIN_ABSOLUTE_STD) ** 2)
    size = np.sqrt(np.diag(spread))
    information = np.linalg.pinv(spread / size / size[:, None], rcond=1e-10, hermitian=True) / size / size[:, None]
    estimate = Estimate(value, spread, information, np.zeros(len(base.sees)), ())
    return fit_consistent(base, estimate, Parameters(base.labels, inertials.ravel()), prior_weight=weight)


def is_possible(stated: Array, inertials: Array) -> bool:
    """Whether all bodies are physically consistent, except those that are inconsistent as stated.

    stated and inertials: (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2].
    """
    return bool(np.all(_least(inertials) > np.minimum(0.0, _least(stated))))


def _least(inertials: Array) -> Array:
    """(nb,) smallest eigenvalue of each pseudo-inertia matrix [kg or kg.m2]."""
    return np.array([np.linalg.eigvalsh(pseudo_inertia(body)).min() for body in inertials.reshape(-1, len(INERTIAL))])


class ResidualRows(NamedTuple):
    """M low-passed and decimated rows of some recordings; NaN in rows that do not count."""

    pieces: tuple[Piece, ...]  # empty where they are not kept
    thin: Decimator
    stretch: Indices  # (M,) piece of each row
    recording: Indices  # (M,) recording of each row
    t: Array  # (M,) [s] from the origin of each recording
    q: Array  # (M, n) [rad or m]
    v: Array  # (M, n) [rad/s or m/s]
    residual: Array  # (M, n) [N.m or N] measured - predicted
    torque: Array  # (M, n) [N.m or N] measured
    reversal_std: Array  # (M, n) [N.m or N] standard deviation near velocity reversals

    def irreducible_std(self, noise: Noise, least: float = 0.0) -> Array:
        """(M, n) [N.m or N] std that no simulation could predict; `least`: least multiple of `reversal_std` in it."""
        return np.asarray(np.hypot(noise.saturated_floor, np.maximum(noise.reversal_scale, least) * self.reversal_std))


class Prediction(NamedTuple):
    """A simulation and its residuals on the recordings of a session."""

    model: Model
    train: ResidualRows
    held_out: ResidualRows


class Comparison(NamedTuple):
    """Residuals before and after the extension."""

    before: Fit
    after: Fit
    train: Course
    held_out: Course


def predict(session: Session, model: Model) -> Prediction:
    """Predict the training and the held-out recordings."""
    return Prediction(model, *(residual_rows(session.task, model, own) for own in (session.train, session.held_out)))


def fit_of(prediction: Prediction, noise: Noise, floor: Array) -> Fit:
    """Residual rms in training and held out; floor: (n,) [N.m or N] rms of white measurement noise in the band."""
    rows, irreducible = prediction.held_out, rms_of(prediction.held_out.irreducible_std(noise))
    return fit_rows(prediction.model.robot, rows.residual, rows.torque, floor, prediction.train.residual, irreducible)


def compare(before: Prediction, after: Prediction, noise: Noise, floor: Array) -> Comparison:
    """Compare the given and the extended simulation; floor: (n,) [N.m or N] rms of white noise in the band."""
    robot = after.model.robot
    return Comparison(
        fit_of(before, noise, floor),
        fit_of(after, noise, floor),
        course_of(before.train, after.train, robot),
        course_of(before.held_out, after.held_out, robot),
    )


def course_of(before: ResidualRows, after: ResidualRows, robot: Robot) -> Course:
    """Residuals of two simulations over time, on the same recordings."""
    return Course(
        joints=robot.joints,
        unit=tuple("N" if prismatic else "N.m" for prismatic in robot.prismatic),
        prismatic=tuple(map(bool, robot.prismatic)),
        before=before.residual,
        after=after.residual,
        **{key: getattr(before, key) for key in ("stretch", "recording", "t", "q", "v", "torque")},
    )


def residual_rows(task: Task, model: Model, parts: Sequence[Part], keep: bool = True) -> ResidualRows:
    """Residuals of a simulation; rows where a joint stands still do not count, since friction is undetermined there.

    Unless `keep`, pieces, whose memory grows with the recordings at their full rate, are dropped one by one.

    Raises:
        RecordingError: no stretch is as long as the filter.
    """
    thin, dry, kept, rows = row_filter(task), stated_friction(model), list[Piece](), list[tuple[Array, ...]]()
    for k, piece in enumerate(pieces(task, model, parts)):
        t, q, v = (thin.at(x).copy() for x in (piece.motion.t - piece.origin, piece.motion.q, piece.motion.v))
        which = (np.full(len(t), k), np.full(len(t), piece.recording))
        rows.append((*which, t, q, v, *filtered(piece, thin), reversal_uncertainty(thin, [piece], dry)))
        kept += [piece] if keep else []
    if not rows:
        raise RecordingError(
            f"no stretch of the held-out recordings is as long as the filter for {task.band.cutoff:.3g} Hz; hold out "
            f"more with --held-out, or raise the cut-off"
        )
    return ResidualRows(tuple(kept), thin, *(np.concatenate(x) for x in zip(*rows, strict=True)))


def filtered(piece: Piece, thin: Decimator) -> tuple[Array, Array]:
    """Rows of one piece: (M, n) residual and (M, n) measured torque [N.m or N]; NaN where a joint stands still."""
    still = (thin.at(standstill(piece.motion, thin)) > 0) & piece.motion.v.any()  # not of postures at rest
    residual = np.where(still, np.nan, thin(piece.residual))
    return residual, residual + thin(np.asarray(piece.motion.predicted))
