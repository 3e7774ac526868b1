"""Fitted drives -> result: identifiable numbers, scale, roll-outs, flags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import shorten
from ...model import Model, command_model
from ...servos import PASSIVE, SERVO_NUMBERS, SUMS, Servo
from ...types import Robot
from ..assumptions import OWN, Assumptions, Name
from ..fit import ServoFit
from ..hints import Estimates, equal_hints, unequal_flags
from ..search.data import ServoData, loop_error
from ..search.searcher import Chosen, ServoOptions
from .assess import closed_loops, nominal_servos
from .facts import joint_facts
from .fits import block, number_at_bound, number_std
from .flags import (
    assumption_notes,
    duty_notes,
    joint_flags,
    joint_notes,
    lag_flags,
    law_flags,
    law_notes,
    prior_notes,
    rollout_flags,
    worse_flag,
    worse_than_stated,
)
from .held_out import HeldOutError, compared, far_flags, held_out_errors
from .identifiable import RARE, JointFacts, dependence, dependent_numbers, joint_numbers
from .result import ServoIdentification, ServoJoint, ServoRollOut, ServoTrace
from .scale import alternatives, known_scale
from .start import Stated


@dataclass(frozen=True)
class Known:
    """Knowledge before the fit."""

    scale: str  # "masses", "kp" or "nothing"
    stated: Stated  # by the actuators file
    fixed: Stated  # of these, what the fit keeps
    laws: Mapping[str, str]  # stated laws by joint
    tied: Mapping[str, float]  # error of full duty [rad or m] by joint, from the recorded PWM
    sets: Sequence[Sequence[str]]  # connected joints
    timing: Mapping[str, float]  # time [s] by which the delay of a joint may be longer, as commands change between rows
    assumptions: Assumptions
    own: Mapping[str, Estimates]  # of joints that are fitted as equal: numbers without that assumption


@dataclass(frozen=True)
class JudgedFit:
    """A fit, the facts of its rows, and the errors of a fit without the held-out rows."""

    data: ServoData
    fit: ServoFit
    facts: Mapping[str, JointFacts]  # by joint
    errors: Mapping[str, HeldOutError]  # by joint; empty where nothing is held out
    rollout: ServoRollOut
    traces: tuple[ServoTrace, ...]
    refit: bool = False  # whether `data` and `fit` contain the held-out rows


def judge(models: tuple[Model, Model], data: ServoData, fit: ServoFit, known: Known) -> JudgedFit:
    """Errors of a fit on held-out rows. models: as described, and with the masses that were used."""
    described, model = models
    unseen = data.held_out is not data.train
    facts = facts_of(model, data, fit, known)
    errors = held_out_errors(model, data, fit.servos) if unseen else {}
    facts = compared(model, data, fit.servos, facts, errors) if unseen else facts
    nominal = nominal_servos(model.robot, fit.servos, known.stated)
    beside = (described, nominal) if nominal else None
    rolled, traces = closed_loops(model, fit.servos, data.held_out, unseen, beside)
    return JudgedFit(data, fit, facts, errors, rolled, traces)


def facts_of(model: Model, data: ServoData, fit: ServoFit, known: Known) -> dict[str, JointFacts]:
    """Facts of the rows of a fit, by joint."""
    saturated = {joint: float(fit.saturated_share[data.joints.index(joint)]) for joint in fit.servos}
    return {
        joint: replace(
            fact,
            full_duty_error=known.tied.get(joint, 0.0),
            command_timing=known.timing.get(joint, 0.0),
            priors={name: x for (one, name), x in known.assumptions.priors.items() if one == joint},
            bounds={name: x for (one, name), x in known.assumptions.bounds.items() if one == joint},
            masses_set_scale=fact.masses_set_scale and (joint, "kp") not in known.assumptions.priors,
            at_bound=frozenset(number_at_bound(fit, joint)),
            unexplained=float(fit.residual_rms[data.joints.index(joint)]) / max(loop_error(data, joint), 1e-12),
        )
        for joint, fact in joint_facts(
            model, data, fit.servos, saturated, known.fixed, known.scale != "nothing"
        ).items()
    }


def conclude(
    models: tuple[Model, Model],
    judged: JudgedFit,
    chosen: Chosen,
    known: Known,
    remarks: Sequence[str],
    options: ServoOptions,
) -> ServoIdentification:
    """Result of a fit. models: as described, and with the masses that were used; remarks: flags of earlier steps."""
    described, model = models
    data, fit, facts, rolled = judged.data, judged.fit, judged.facts, judged.rollout
    joints = tuple(_joint(joint, fit, chosen, facts[joint], known.assumptions) for joint in fit.servos)
    robot, added = model.robot, list(remarks)
    servos = _marked(fit.servos, joints, known.stated, robot)
    if worse_than_stated(rolled):
        servos = nominal_servos(robot, fit.servos, known.stated)
        model, added = described, [*added, worse_flag(rolled)]
    limited = [joint for joint, fact in facts.items() if fact.saturated_share >= RARE]
    gains = {joint: of["kp"] for joint, of in known.stated.items() if "kp" in of}
    std = {joint: s for joint, s in number_std(fit, "kp").items() if _has_value(joints, joint)}
    other = alternatives(known.sets, fit.servos, std, gains) if known.scale == "masses" else ()
    scale = known_scale(known.scale, gains, other)
    added += [scale.sentence] if known.scale == "nothing" else []
    added += far_flags(judged.errors)
    added += unequal_flags(_identified(known.own, joints), known.assumptions.equal)
    unsure = [joint for joint, fact in facts.items() if fact.held_out_torque > 0]
    notes = (*joint_notes(joints), *law_notes(joints, known.laws, [*limited, *unsure]), *prior_notes(joints))
    notes = (*notes, *assumption_notes(known.assumptions, fit.free))
    notes = (*notes, *equal_hints({one.joint: _estimates(one) for one in joints}, known.assumptions.equal))
    return ServoIdentification(
        robot=robot,
        model=command_model(model, servos, complete=True)[0],
        servos=servos,
        joints=joints,
        scale=scale,
        rollout=rolled,
        traces=judged.traces,
        inputs=data.inputs,
        flags=_flags(added, joints, fit, data, rolled, limited),
        notes=(*model.robot.notes, *notes, *duty_notes(known.tied), *fit.notes),
        seed=options.seed,
        refit=judged.refit,
        start=replace(chosen.candidate, window=chosen.candidate.window or options.window),
        far=tuple(joint for joint, error in judged.errors.items() if error.far),
    )


def _estimates(one: ServoJoint) -> dict[str, tuple[float, float]]:
    """Measured numbers of a drive with their standard deviations, but the sum lag and the offset of the joint alone.

    None of a joint with a number at its bound, since the others hold only for that value.
    """
    if any(number.at_bound for number in one.numbers.values()):
        return {}
    return {
        name: (number.value, number.std)
        for name, number in one.numbers.items()
        if number.value is not None and number.std and not number.prior and name not in ("lag", OWN)
    }


def _identified(own: Mapping[str, Estimates], joints: Sequence[ServoJoint]) -> dict[str, Estimates]:
    """Numbers of joints, without those that are not identifiable even if they are common; kd as part of the damping."""
    whole = {part: name for name, parts in SUMS.items() if name == "damping" for part in parts}
    lost = {(one.joint, name) for one in joints for name, number in one.numbers.items() if number.value is None}
    return {
        joint: {name: x for name, x in numbers.items() if (joint, whole.get(name, name)) not in lost and name != OWN}
        for joint, numbers in own.items()
    }


def _marked(
    servos: Mapping[str, Servo], joints: Sequence[ServoJoint], stated: Stated, robot: Robot
) -> dict[str, Servo]:
    """Drives that know which of their numbers are not identifiable, and what was stated of them before."""
    out = dict(servos)
    for one in joints:
        known = {n: float(x) for n in PASSIVE if np.isfinite(x := getattr(robot.actuators, n)[robot.index(one.joint)])}
        known |= {name: float(x) for name, x in stated.get(one.joint, {}).items() if name in SERVO_NUMBERS}
        lost = {name for name, number in one.numbers.items() if number.value is None and name in SERVO_NUMBERS}
        combined = tuple(name for name, parts in SUMS.items() if _has(one, name) and lost.issuperset(parts))
        lost = lost.difference(*(SUMS[name] for name in combined))
        unknown = {name: known.get(name) for name in SERVO_NUMBERS if name in lost}
        std = {name: number.std for name, number in one.numbers.items() if name in SERVO_NUMBERS}
        std |= {part: one.numbers[name].std for name in combined for part in SUMS[name]}
        found = {name: float(x) for name, x in std.items() if x}
        out[one.joint] = replace(out[one.joint], not_identifiable=unknown, combined=combined, std=found)
    return out


def _has(one: ServoJoint, name: str) -> bool:
    return name in one.numbers and one.numbers[name].value is not None


def _joint(joint: str, fit: ServoFit, chosen: Chosen, facts: JointFacts, assumptions: Assumptions) -> ServoJoint:
    names, covariance = block(fit, joint)
    servo = fit.servos[joint]
    numbers, lost = joint_numbers(servo, names, covariance, facts)
    laws = dict(chosen.laws.get(joint, {}))
    return ServoJoint(
        joint=joint,
        law=servo.law,
        law_probability=laws.get(servo.law),
        laws=laws,
        numbers=numbers,
        saturated_share=facts.saturated_share,
        known_load_share=facts.known_load_share,
        not_identifiable=lost,
        equal=tuple(other for other in assumptions.peers(joint) if other != joint),
    )


def _has_value(joints: Sequence[ServoJoint], name: str) -> bool:
    return any(one.joint == name and one.numbers["kp"].value is not None for one in joints if "kp" in one.numbers)


def _said_names(fit: ServoFit) -> list[Name]:
    """Free numbers with all their joints."""
    return [(shorten(joints), number) for (_, number), joints in zip(fit.names, fit.owners, strict=True)]


def _flags(
    added: Sequence[str],
    joints: Sequence[ServoJoint],
    fit: ServoFit,
    data: ServoData,
    rolled: ServoRollOut,
    limited: Sequence[str],
) -> tuple[str, ...]:
    """Flags of all steps, each once."""
    flags = (
        *added,
        *joint_flags(joints),
        *dependence(dependent_numbers(fit.information, _said_names(fit))),
        *law_flags(joints, limited),
        *lag_flags(joints, data),
        *rollout_flags(rolled),
    )
    return tuple(dict.fromkeys(flags))
