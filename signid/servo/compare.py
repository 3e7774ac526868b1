"""Identified drives and their recordings -> named friction models beside each other: numbers, errors, evidence."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..deadline import ends_in_time, time_is_up
from ..errors import OptionError
from ..model import Model
from ..recording import Recordings, as_recordings
from ..regression.session import only_once
from ..servos import LOOP_UNITS, Servo
from ..typed import typed
from ..types import Progress
from .diagnose.search import half_log_of, limited, price_of
from .fit import ServoFit
from .fit.coordinates import typical
from .identify.fits import block, connected_sets
from .identify.identifiable import SCALED, SIGNED, VAGUE, unit_of
from .identify.result import FrictionModel, ServoIdentification, ServoNumber
from .identify.run import FIT_BUDGET, rows_used
from .plant import roll_out
from .plant.course import recorded_course
from .search.choice import Candidate, fit_candidate
from .search.data import ServoData, position_noise, servo_data, thinned

STEPS = 6  # most iterations from each start, of several
POSITIVE = frozenset((*LOOP_UNITS, "damping")).difference(SIGNED, ("encoder_offset",))
TORQUES = (*SCALED, "gear_level", "gear_quadratic_motor", "gear_quadratic_external")  # unknown without their scale
WHOLE = ("kd", "viscous_friction")  # listed as damping
STRIBECK = ("gear_velocity", "gear_level", "gear_exponent")
LOAD = ("gear_load",)
STRIBECK_LOAD = (*LOAD, *STRIBECK, "gear_load_at_rest")
DIRECTIONAL = (*STRIBECK_LOAD, "gear_external", "gear_external_at_rest")
SPEEDS = (0.1, 0.5)  # velocities of the Stribeck decay to start from, over the rms speed of the joint
WEIGHTS = (1.0, 0.3)  # of the external load to start from, over that of the motor [1]
SQUARE = 2.0  # exponent of the decay to start from [1]
AS_FOUND = "identified"  # the drives of the identification itself


@dataclass(frozen=True, eq=False)
class _FittedModel:
    """A model, fitted to the training rows."""

    model: NamedModel
    candidate: Candidate
    fit: ServoFit
    seconds: float

    @property
    def loss(self) -> float:
        """Sum of the log residuals of the joints [1]."""
        return float(np.nansum(np.log(self.fit.residual_rms)))


@dataclass(frozen=True, eq=False)
class _Task:
    """Identified drives, and the rows that all models share."""

    found: ServoIdentification
    model: Model
    data: ServoData
    rows: int  # of a window
    sets: Sequence[Sequence[str]]  # connected joints
    sizes: Mapping[str, Mapping[str, float]]  # typical numbers by joint


@typed
@ends_in_time
def compare_models(
    found: ServoIdentification, recordings: Recordings, *, held_out: Recordings = (), progress: Progress | None = None
) -> ServoIdentification:
    """Compare the friction models M1 to M6 of BAM and PACE: `found` with `friction_models`.

    Each model takes the place of the friction of the identified drives, whose law and limits stay. All are fitted to
    the same windows of the training rows and simulate the held-out rows from commands alone. Numbers that are stated
    stay: PACE was published for stated gains.

    Args:
        found: result of `identify_servos`.
        recordings: those that it was identified from.
        held_out: its held-out recordings.
        progress: called with the current step and the share that is done.

    Raises:
        OptionError: other recordings than those of the identification.
        RecordingError: a recording cannot be used.
    """
    given = as_recordings(recordings, found.robot, "compare_models")
    unseen = as_recordings(held_out, found.robot, "compare_models")
    only_once((*given, *unseen))
    task = _task(found, servo_data(found.robot, given, unseen))
    fitted = dict[str, _FittedModel]()
    for k, model in enumerate(MODELS):
        if fitted and time_is_up("the comparison of friction models"):
            break
        if progress is not None:
            progress(f"fitting friction model {model.name}", k / len(MODELS))
        fitted[model.name] = _fitted(task, model, fitted)
    return replace(found, friction_models=tuple(_compared(task, list(fitted.values()))))


def _task(found: ServoIdentification, data: ServoData) -> _Task:
    if found.start is None or [x[:2] for x in data.inputs] != [x[:2] for x in found.inputs]:
        raise OptionError(
            "compare_models got other recordings than identify_servos; give the same recordings and held_out to both"
        )
    sets = connected_sets(found.model, data.joints, data.driven)
    data = replace(data, train=thinned(data.train, rows_used(sets, data, FIT_BUDGET)))
    motions = [recorded_course(found.model, grid).motion for grid in data.train]
    sizes = {
        joint: typical(servo, data.joints.index(joint), data.train, motions)
        for joint, servo in found.start.servos.items()
    }
    rows = round(found.start.window * data.train[0].rate) + 1
    return _Task(found, found.model, data, rows, sets, sizes)


def _fitted(task: _Task, model: NamedModel, before: Mapping[str, _FittedModel]) -> _FittedModel:
    """Fit from the best of the starts."""
    assert task.found.start is not None
    begin = time.process_time()
    last = before[model.before].candidate if model.before else task.found.start
    speeds = {joint: sizes["gear_velocity"] for joint, sizes in task.sizes.items()}
    tries = list(starts(model, last, task.found.start, speeds))
    if len(tries) > 1:
        coarse = [fit_candidate(task.model, task.data.train, one, 0.0, STEPS, coarse=True) for one in tries]
        tries = [min(coarse, key=lambda end: float(np.nansum(np.log(end[1].residual_rms))))[0]]
    candidate, fit = fit_candidate(task.model, task.data.train, tries[0], 0.0, relinearise=True)
    return _FittedModel(model, candidate.follow(fit.servos), fit, time.process_time() - begin)


def _compared(task: _Task, fitted: Sequence[_FittedModel]) -> Iterator[FrictionModel]:
    """Errors and evidence of fitted models."""
    data = task.data
    driven = [data.joints.index(joint) for joint in fitted[0].fit.servos]
    floor = position_noise(data.train)[driven]
    squares = [one.fit.window_squares[:, driven] for one in fitted]
    common = set.intersection(*(set(one.fit.names) for one in fitted))
    prices = [_price(task, one.fit, common) for one in fitted]
    evidence = [price - half_log_of(s, floor, task.rows) for price, s in zip(prices, squares, strict=True)]
    named = np.array([one.model.name != AS_FOUND for one in fitted])
    best = int(np.argmax(np.where(named, evidence, -np.inf)))
    sigma2 = np.mean(squares[best], axis=0) + floor**2
    differences = [task.rows * np.sum((s - squares[best]) / sigma2, axis=1) for s in squares]
    odds = [limited(evidence[best] - e, 0.0, x) for e, x in zip(evidence, differences, strict=True)]
    weights = np.where(named, np.exp(-np.array(odds)), np.nan)
    for one, e, weight in zip(fitted, evidence, weights, strict=True):
        with np.errstate(all="ignore"):
            errors = [roll_out(task.model, one.fit.servos, grid) - grid.q for grid in data.held_out]
            error = np.where([joint in one.fit.servos for joint in data.joints], np.concatenate(errors), np.nan)
            absolute, rms = np.mean(np.abs(error), axis=0), np.sqrt(np.mean(error**2, axis=0))
        numbers = {joint: _numbers(task, one, joint) for joint in one.fit.servos}
        yield FrictionModel(
            one.model.name,
            one.model.terms,
            numbers,
            one.fit.servos,
            absolute,
            rms,
            float(e - evidence[0]),
            float(weight / np.nansum(weights)),
            one.seconds,
        )


def _price(task: _Task, fit: ServoFit, common: set[tuple[str, str]]) -> float:
    """Log prior of the numbers that not all models have."""
    new = [k for k, name in enumerate(fit.names) if name not in common]
    if not new:
        return 0.0
    sizes = [task.sizes[joint].get(name, 1.0) for joint, name in (fit.names[k] for k in new)]
    return price_of(fit.information, new, sizes, task.rows)


def _numbers(task: _Task, one: _FittedModel, joint: str) -> dict[str, ServoNumber]:
    """Free numbers of a joint; those that the recordings do not identify have no value."""
    servo, prismatic = one.fit.servos[joint], task.model.robot.prismatic[task.model.robot.index(joint)]
    names, covariance = block(one.fit, joint)
    known = next(other.numbers for other in task.found.joints if other.joint == joint)
    unknown = {name for name in ("kp", "delay") if name in known and known[name].value is None}
    unknown |= set(TORQUES) if "kp" in unknown else set()
    values = {name: float(getattr(servo, name)) for name in names if name not in WHOLE}
    spread = dict(zip(names, np.sqrt(np.maximum(np.nan_to_num(np.diag(covariance), nan=np.inf), 0.0)), strict=True))
    damping = np.array([float(name in WHOLE) for name in names])
    if damping.any():
        values["damping"] = servo.damping
        spread["damping"] = np.sqrt(max(float(damping @ np.nan_to_num(covariance, nan=np.inf) @ damping), 0.0))
    found = {}
    for name, value in values.items():
        std = float(spread[name])
        lost = name in unknown or not np.isfinite(std) or (name in POSITIVE and std > VAGUE * value)
        found[name] = ServoNumber(name, unit_of(name, prismatic), None if lost else value, None if lost else std)
    return found


class NamedModel(NamedTuple):
    """A friction model: Coulomb and viscous friction, and what it has beside them."""

    name: str
    terms: str
    numbers: tuple[str, ...] = ()  # of a `Servo`, free beside those of M1
    before: str = ""  # model that its fit starts from


MODELS = (
    NamedModel("M1", "Coulomb, viscous"),
    NamedModel("M2", "M1, Stribeck", STRIBECK, "M1"),
    NamedModel("M3", "M1, load", LOAD, "M1"),
    NamedModel("M4", "M3, Stribeck also of the load", STRIBECK_LOAD, "M3"),
    NamedModel("M5", "M4, motor and external load apart", DIRECTIONAL, "M4"),
    NamedModel(
        "M6", "M5, squares of the loads", (*DIRECTIONAL, "gear_quadratic_motor", "gear_quadratic_external"), "M5"
    ),
    NamedModel("PACE", "M1, zero of the encoder in place of the torque offset", ("encoder_offset",), "M1"),
    NamedModel(AS_FOUND, "numbers of the identification"),
)


def starts(
    model: NamedModel, before: Candidate, identified: Candidate, speeds: Mapping[str, float]
) -> Sequence[Candidate]:
    """Drives that the fit of a model starts from.

    before: the fitted drives of `model.before`; identified: those of the identification, where M1 begins; speeds: rms
    by joint [rad/s or m/s].
    """
    if model.name == AS_FOUND:
        return [identified]
    if not model.before:
        return [_without(identified, "load_friction", identified.servos)]
    if "encoder_offset" in model.numbers:
        before = _without(before, "torque_offset", [joint for joint, name in before.free if name == "torque_offset"])
    held = {name for _, name in before.free}
    new = [name for name in model.numbers if name not in held]
    free = [(joint, name) for joint in before.servos for name in new]
    return [
        before.changed({joint: servo.with_(**one[joint]) for joint, servo in before.servos.items()}, free)
        for one in _begun(new, before, identified, speeds)
    ]


def _begun(
    new: Sequence[str], before: Candidate, identified: Candidate, speeds: Mapping[str, float]
) -> Iterator[dict[str, dict[str, float]]]:
    """Numbers by joint of each start; new ones that stay zero get theirs from the fit."""
    joints = before.servos
    if "gear_velocity" in new:
        for share in SPEEDS:
            yield {joint: {"gear_exponent": SQUARE, "gear_velocity": share * speeds[joint]} for joint in joints}
    elif "gear_external" in new:
        for weight in WEIGHTS:
            yield dict.fromkeys(joints, {"gear_external": weight})
        yield {joint: _by_motor(identified.servos[joint]) for joint in joints}
    elif "gear_load" in new:
        yield dict.fromkeys(joints, {"gear_exponent": SQUARE})
    else:
        yield dict.fromkeys(joints, {})


def _by_motor(servo: Servo) -> dict[str, float]:
    """Numbers of an identified drive, whose friction is by the torque of its motor alone."""
    same = {name: getattr(servo, name) for name in ("kp", "kd", "viscous_friction", "armature", "coulomb_friction")}
    return {
        **same,
        "gear_load": servo.load_friction,
        "gear_external": 0.05,
        "gear_level": 0.0,
        "gear_load_at_rest": 0.0,
    }


def _without(candidate: Candidate, number: str, joints: Collection[str]) -> Candidate:
    """Drives without a number at some joints."""
    servos = {joint: candidate.servos[joint].with_(**{number: 0.0}) for joint in joints}
    free = tuple(name for name in candidate.free if name[1] != number)
    return replace(candidate.changed(servos), free=free)
