"""Fitted drives -> result: identifiable numbers, scale, roll-outs, flags."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import chi2

from ...effects import EFFECTS
from ...errors import decimals, shorten
from ...estimation.repeats import SERVO, VaryingNumber, varying_sentence
from ...model import Model, command_model
from ...robot.joints import name_pattern, similar_joints
from ...servos import PASSIVE_LAWS, SERVO_NUMBERS, SUM_PARTS, Servo, ServoGrid
from ...types import Array, Robot
from ..fit import ServoFit, fit_servos, start_limits
from ..given import UNSHARED
from ..plant.course import motion_of, recorded_course
from ..plant.roll_out import roll_out_along
from ..search.choice import SHORT_WINDOW, Candidate, Estimates, ServoProblem, ServoTrial
from ..search.data import ServoData, position_noise
from ..search.laws import FIRST_LIMIT_STEPS, LIMIT_RESIDUAL_RATIO, LIMIT_STEPS, PROMISING, largest_torques, limited
from .fits import (
    HORIZON,
    Stated,
    alternatives,
    block,
    closed_loops,
    gain_text,
    implied_ratios,
    known_scale,
    mass_ratios,
    nominal_servos,
    number_std,
)
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
from .identifiable import RARE, JointFacts, demand, dependence, dependent_numbers, facts_of, joint_numbers
from .result import ServoIdentification, ServoJoint, ServoRollOut, ServoTrace

MAX_HELD_OUT_RATIO = 3.0  # [1] held-out rms over that of the training data, from which it is flagged
MIN_NOISE_MULTIPLE = 3.0  # [1] held-out rms over the noise of positions, from which it is more than noise; as of torque
MIN_TRACKING_RATIO = 0.02  # [1] held-out rms over that of the tracking error, below which no use depends on it
MIN_LIMIT_RATIO = 0.9  # [1] limit of held-out rows over the bound of the training data, below which the two contradict
EQUAL_PROBABILITY = 0.05  # of such differences among equal joints, over all numbers, from which --equal is proposed
DIFFERENT = 0.01  # the same, below which the number that differs is named
REQUIRED_NUMBER = "kp"  # number that at least two joints must have


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
    notes: tuple[str, ...] = ()  # why they do not


def judge(problem: ServoProblem, fit: ServoFit) -> JudgedFit:
    """Errors of a fit on held-out rows."""
    model, data = problem.model, problem.data
    unseen = data.held_out is not data.train
    facts = facts_of(problem, fit)
    errors = held_out_errors(problem, fit.servos) if unseen else {}
    facts = compared(problem, fit.servos, facts, errors) if unseen else facts
    nominal = nominal_servos(model.robot, fit.servos, problem.assumptions.stated)
    beside = (problem.described, nominal) if nominal else None
    rolled, traces = closed_loops(model, fit.servos, data.held_out, unseen, beside)
    return JudgedFit(data, fit, facts, errors, rolled, traces)


def conclude(problem: ServoProblem, judged: JudgedFit, trial: ServoTrial) -> ServoIdentification:
    """Result of a judged fit of the laws that a trial chose."""
    described, model, assumed = problem.described, problem.model, problem.assumptions
    data, fit, facts, rolled = judged.data, judged.fit, judged.facts, judged.rollout
    joints = tuple(_joint(joint, fit, trial, facts[joint]) for joint in fit.servos)
    robot, added = model.robot, list(problem.flags)
    servos = _mark(fit.servos, joints, assumed.stated, robot)
    if worse_than_stated(rolled):
        servos = nominal_servos(robot, fit.servos, assumed.stated)
        model, added = described, [*added, worse_flag(rolled)]
    limited = [joint for joint, fact in facts.items() if fact.saturated_share >= RARE]
    gains = {joint: of["kp"] for joint, of in assumed.stated.items() if "kp" in of}
    kp_std = number_std(fit, "kp")
    std = {x.joint: kp_std[x.joint] for x in joints if _has(x, "kp") and kp_std.get(x.joint)}
    implied = problem.sets, fit.servos, std, gains
    other = alternatives(*implied) if assumed.scale == "masses" else ()
    heavier = mass_ratios(described, problem.model)
    if assumed.scale == "masses":
        heavier = [ratio for _, ratio, _ in implied_ratios(*implied)]
    scale = replace(
        known_scale(assumed.scale, gains, other), mass_ratios=tuple(heavier), gain=gain_text(gains.values())
    )
    added += [scale.sentence] if assumed.scale == "nothing" else []
    added += far_flags(judged.errors)
    whole = dict.fromkeys(SUM_PARTS["damping"], "damping")  # kd as part of it
    lost = {(x.joint, name) for x in joints for name, number in x.numbers.items() if number.value is None}
    unequal = {
        joint: {name: x for name, x in of.items() if (joint, whole.get(name, name)) not in lost and name != UNSHARED}
        for joint, of in problem.unequal.items()
    }
    added += unequal_flags(unequal, assumed.equal)
    unsure = [joint for joint, fact in facts.items() if fact.held_out_torque > 0]
    notes = (*joint_notes(joints), *law_notes(joints, assumed.laws, [*limited, *unsure]), *prior_notes(joints))
    notes = (*notes, *assumption_notes(assumed, fit.free))
    noise = (replace(fact, masses_error=0.0) for fact in facts.values())  # equal joints share the error of the masses
    apart = {fact.joint: _estimates(_joint(fact.joint, fit, trial, fact)) for fact in noise}
    notes = (*notes, *equal_hints(apart, assumed.equal))
    varies = tuple(varying_drives(joints, fit))
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
        notes=(*model.robot.notes, *notes, *duty_notes(problem.full_duty), *fit.notes, *varying_sentence(varies)),
        seed=problem.options.seed,
        refit=judged.refit,
        start=replace(trial.candidate, window=trial.candidate.window or problem.options.window),
        far=tuple(joint for joint, error in judged.errors.items() if error.far),
        varies=varies,
    )


def varying_drives(joints: Sequence[ServoJoint], fit: ServoFit) -> Iterator[VaryingNumber]:
    """Numbers that differ between recordings, by the names under which a result has them."""
    numbers_of = {drive.joint: drive.numbers for drive in joints}
    for k in np.flatnonzero(fit.spread).tolist():
        joint, name = fit.names[k]
        numbers, whole = numbers_of[joint], next((total for total, parts in SUM_PARTS.items() if name in parts), name)
        for key, size in {name: 1.0, whole: 1.0, f"{whole}/kp": fit.servos[joint].kp}.items():
            if (number := numbers.get(key)) is not None and number.value is not None:
                effect, parameter = (key, next(iter(EFFECTS[key].parameters))) if key in PASSIVE_LAWS else (SERVO, key)
                yield VaryingNumber(effect, joint, parameter, float(fit.spread[k]) / size, number.unit)
                break


def _estimates(drive: ServoJoint) -> Estimates:
    """Measured numbers of a drive with their standard deviations, but the sum lag and the offset of the joint alone.

    None of a joint with a number at its bound, since the others hold only for that value.
    """
    numbers = {name: x for name, x in drive.numbers.items() if "/" not in name and name not in ("lag", UNSHARED)}
    if any(number.at_bound for number in drive.numbers.values()):
        return {}
    return {name: (x.value, x.std) for name, x in numbers.items() if x.value is not None and x.std and not x.prior}


def _mark(servos: Mapping[str, Servo], joints: Sequence[ServoJoint], stated: Stated, robot: Robot) -> dict[str, Servo]:
    """Drives that know which of their numbers are not identifiable, and what was stated of them before."""
    out = dict(servos)
    for drive in joints:
        j = robot.index(drive.joint)
        known = {name: float(x) for name in PASSIVE_LAWS if np.isfinite(x := getattr(robot.actuators, name)[j])}
        known |= {name: float(x) for name, x in stated.get(drive.joint, {}).items() if name in SERVO_NUMBERS}
        lost = {name for name, number in drive.numbers.items() if number.value is None and name in SERVO_NUMBERS}
        combined = tuple(name for name, parts in SUM_PARTS.items() if _has(drive, name) and lost.issuperset(parts))
        lost = lost.difference(*(SUM_PARTS[name] for name in combined))
        unknown = {name: known.get(name) for name in SERVO_NUMBERS if name in lost}
        std = {name: number.std for name, number in drive.numbers.items() if name in SERVO_NUMBERS}
        std |= {part: drive.numbers[name].std for name in combined for part in SUM_PARTS[name]}
        stds = {name: float(x) for name, x in std.items() if x}
        out[drive.joint] = replace(out[drive.joint], not_identifiable=unknown, combined=combined, std=stds)
    return out


def _has(drive: ServoJoint, name: str) -> bool:
    return name in drive.numbers and drive.numbers[name].value is not None


def _joint(joint: str, fit: ServoFit, trial: ServoTrial, facts: JointFacts) -> ServoJoint:
    names, covariance = block(fit, joint)
    servo = fit.servos[joint]
    numbers, lost = joint_numbers(servo, names, covariance, facts)
    laws = dict(trial.laws.get(joint, {}))
    return ServoJoint(
        joint=joint,
        law=servo.law,
        law_probability=laws.get(servo.law),
        laws=laws,
        numbers=numbers,
        saturated_share=facts.saturated_share,
        known_load_share=facts.known_load_share,
        not_identifiable=lost,
        equal=tuple(other for other in trial.candidate.assumptions.peers(joint) if other != joint),
    )


def _flags(
    added: Sequence[str],
    joints: Sequence[ServoJoint],
    fit: ServoFit,
    data: ServoData,
    rolled: ServoRollOut,
    limited: Sequence[str],
) -> tuple[str, ...]:
    """Flags of all steps, each once."""
    names = [(shorten(owners), number) for (_, number), owners in zip(fit.names, fit.owners, strict=True)]
    flags = (
        *added,
        *joint_flags(joints),
        *dependence(dependent_numbers(fit.information, names)),
        *law_flags(joints, limited),
        *lag_flags(joints, data),
        *rollout_flags(rolled),
    )
    return tuple(dict.fromkeys(flags))


@dataclass(frozen=True)
class HeldOutError:
    """Rms error of one joint over roll-outs of one second [rad or m]."""

    joint: str
    unit: str
    trained: float  # on the data of the fit
    held_out: float
    far: bool  # whether the held-out one is far above that of the fit, and matters


def held_out_errors(problem: ServoProblem, servos: Mapping[str, Servo]) -> dict[str, HeldOutError]:
    """Errors of each joint with a drive on the data of the fit and on held-out data, by the same linearised loop."""
    model, data = problem.model, problem.data
    trained, unseen = (_rms(model, servos, grids) for grids in (data.train, data.held_out))
    errors = np.concatenate([grid.on * (grid.command - grid.q) for grid in data.held_out])
    noise, tracking = position_noise(data.held_out), np.sqrt(np.mean(errors**2, axis=0))
    beyond_noise = (unseen > MIN_NOISE_MULTIPLE * noise) & (unseen > MIN_TRACKING_RATIO * tracking)
    far = (unseen > MAX_HELD_OUT_RATIO * trained) & beyond_noise
    unit = ["m" if model.robot.prismatic[model.robot.index(joint)] else "rad" for joint in data.joints]
    return {
        joint: HeldOutError(joint, unit[j], float(trained[j]), float(unseen[j]), bool(far[j]))
        for j, joint in enumerate(data.joints)
        if joint in servos
    }


def far_flags(errors: Mapping[str, HeldOutError]) -> Iterator[str]:
    """A sentence on the joints whose held-out positions are predicted far worse than those of the fit."""
    if far := [error for error in errors.values() if error.far]:
        each = [
            f"{x.joint} ({decimals(1e3 * x.held_out)} m{x.unit} instead of {decimals(1e3 * x.trained)})" for x in far
        ]
        yield (
            f"the held-out motion of {shorten(each, 4)} is predicted far worse than that of the training data, in rms "
            f"over one second: the model lacks an effect that acts there; run signid diagnose with model.json and the "
            f"recordings, or learn from such motion as well"
        )


def compared(
    problem: ServoProblem,
    servos: Mapping[str, Servo],
    facts: Mapping[str, JointFacts],
    errors: Mapping[str, HeldOutError],
) -> dict[str, JointFacts]:
    """Facts of the joints with what held-out rows say of limits that the data of the fit do not reach."""
    data, beyond = problem.data, dict[str, float]()
    speeds = [motion_of(grid).v for grid in data.held_out]
    for joint, fact in facts.items():
        j, damping = data.joints.index(joint), fact.drive_damping
        rows = [demand(servos[joint], grid, v[:, j], j, damping) for grid, v in zip(data.held_out, speeds, strict=True)]
        torque = float(np.quantile(np.abs(np.concatenate(rows)), 1 - RARE))
        if not servos[joint].effort_limit < np.inf and torque > fact.largest_torque:
            beyond[joint] = torque
    if not beyond:
        return dict(facts)
    limits = _limits(problem, servos, beyond)
    completed = dict(facts)
    for joint, torque in beyond.items():
        limit = limits.get(joint, np.inf)
        limit = limit if limit > MIN_LIMIT_RATIO * facts[joint].largest_torque else np.inf
        if errors[joint].far or limit < np.inf:
            completed[joint] = replace(facts[joint], held_out_torque=torque, held_out_limit=limit)
    return completed


def _limits(problem: ServoProblem, servos: Mapping[str, Servo], joints: Mapping[str, float]) -> dict[str, float]:
    """Effort limits [N.m or N] with which short windows of held-out rows are predicted notably better than without.

    The other joints follow the recorded motion.
    """
    model, grids = problem.model, problem.data.held_out
    top = largest_torques(replace(problem.data, train=grids), {joint: servos[joint] for joint in joints})
    start = limited(Candidate(servos, ()), start_limits(model, grids, servos, top), "effort").servos
    fitted = partial(fit_servos, model, grids, window=SHORT_WINDOW, relinearise=False, scales=False, coarse=True)
    found = {}
    for joint in joints:
        j, free = grids[0].joints.index(joint), [(joint, "effort_limit")]
        without = fitted({joint: servos[joint]}, (), iterations=0).residual_rms[j]  # states as measured
        for steps, ratio in ((FIRST_LIMIT_STEPS, PROMISING), (LIMIT_STEPS, LIMIT_RESIDUAL_RATIO)):
            drive = fitted({joint: start[joint]}, free, iterations=steps).servos
            if not fitted(drive, (), iterations=0).residual_rms[j] < ratio * without:
                break
        else:
            found[joint] = drive[joint].effort_limit
    return found


def _rms(model: Model, servos: Mapping[str, Servo], grids: Sequence[ServoGrid]) -> Array:
    """Rms (n,) [rad or m] of roll-outs along the recorded motion, restarted from measured states."""
    with np.errstate(over="ignore", invalid="ignore"):
        errors = [roll_out_along(recorded_course(model, grid), servos, grid, HORIZON) - grid.q for grid in grids]
        return np.asarray(np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)))


def equal_hints(estimates: Mapping[str, Estimates], equal: Sequence[Sequence[str]] = ()) -> Iterator[str]:
    """Sentences on joints whose names differ in a side, finger or limb only.

    estimates: by servo joint, of those numbers that recordings identify; equal: joints fitted as equal already.
    """
    for members in similar_joints(tuple(estimates)):
        if any(set(members) <= set(group) for group in equal):
            continue
        name, p = _likeliest(members, estimates)
        if p > EQUAL_PROBABILITY and sum(REQUIRED_NUMBER in estimates[joint] for joint in members) > 1:
            yield (
                f"{shorten(members)}: no number differs beyond its interval; --equal "
                f"'{name_pattern(members, tuple(estimates))}' fits them as equal drives, with narrower intervals"
            )
        elif p < DIFFERENT:
            yield f"{shorten(members)} are alike by name and differ: {_difference(name, members, estimates)}"


def unequal_flags(estimates: Mapping[str, Estimates], equal: Sequence[Sequence[str]]) -> Iterator[str]:
    """Sentences on joints that were fitted as equal, and differ if they are not. Arguments as `equal_hints`."""
    for members in equal:
        name, p = _likeliest(members, estimates)
        if p < DIFFERENT:
            yield (
                f"{shorten(members)}: the recordings contradict equal drives: {_difference(name, members, estimates)}; "
                f"leave joints that differ out of --equal"
            )


def _likeliest(members: Sequence[str], estimates: Mapping[str, Estimates]) -> tuple[str, float]:
    """Number that differs most surely, and the probability of that among all numbers of equal joints; "", 1: none."""
    tests = {name: _test(name, members, estimates) for name in dict.fromkeys(n for j in members for n in estimates[j])}
    likely = {name: p for name, p in tests.items() if p is not None}
    name = min(likely, key=lambda name: likely[name], default="")
    return name, min(1.0, len(likely) * likely[name]) if name else 1.0


def _test(name: str, members: Sequence[str], estimates: Mapping[str, Estimates]) -> float | None:
    """Probability of such differences of a number if the joints are equal (Cochran's Q); None with fewer than two."""
    each = np.array([estimates[joint][name] for joint in members if name in estimates[joint]]).reshape(-1, 2)
    if len(each) < 2:
        return None
    value, weight = each[:, 0], each[:, 1] ** -2.0
    mean = np.average(value, weights=weight)
    return float(chi2.sf(np.sum(weight * (value - mean) ** 2), len(each) - 1))


def _difference(name: str, members: Sequence[str], estimates: Mapping[str, Estimates]) -> str:
    """Part of a sentence on the two joints whose values of a number are farthest apart."""
    have = [joint for joint in members if name in estimates[joint]]
    pairs = [(a, b) for k, a in enumerate(have) for b in have[k + 1 :]]

    def apart(pair: tuple[str, str]) -> float:
        (x, s), (y, t) = (estimates[joint][name] for joint in pair)
        return abs(x - y) / float(np.hypot(s, t))

    pair = max(pairs, key=apart)
    values = " and ".join(f"{x:.3g} +- {1.96 * s:.2g}" for x, s in (estimates[joint][name] for joint in pair))
    return f"{name.replace('_', ' ')} of {pair[0]} and {pair[1]} is {values} ({apart(pair):.1f} standard deviations)"
