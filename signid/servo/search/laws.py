"""Laws of drives that seem to saturate, by windows that took no part in the fit."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...servos import DRIVE_LAWS, Servo
from ..fit import start_limits
from ..plant.course import recorded_course
from .choice import SHORT_WINDOW, Candidate, ServoProblem, ServoTrial, fit_candidate, improved, law_probabilities, worth
from .data import ServoData

SHORT_STEPS = 6  # most iterations over short windows
NEAR_TOP = 0.9  # second start of a limit, over the largest torque that the loop asks for
SPEED_RATIO = 3.0  # largest speed of a torque-speed law over that of the motion from which it is the effort law
INSIDE = 0.15  # share of the damping inside the limit below which effort and duty are the same law
FIRST_LIMIT_STEPS, LIMIT_STEPS = 3, 8  # most iterations, before limits promise something and in all
PROMISING = 0.95  # residual over that without a limit after the first of them
REGRESSED = ("kp", "kd", "delay", "coulomb_friction", "armature", "torque_offset")  # numbers of a regression
LIMIT_RESIDUAL_RATIO = 0.8  # residual over that without a limit from which the laws of a joint are tried


def try_laws(by: ServoProblem, base: ServoTrial, suspects: Sequence[str], loose: Collection[str] = ()) -> ServoTrial:
    """Law of each joint that seems to saturate, by windows that took no part; none if a limit does not help.

    All laws are tried at the `loose` joints, which no drive without a limit explains.
    """
    given, stated = by.assumptions.laws, [j for j in suspects if base.candidate.servos[j].effort_limit < np.inf]
    trials, near = dict[str, ServoTrial](), by.near(suspects)
    start = replace(base.candidate.only(near), window=0.0)
    for law in ("effort", "duty", "torque_speed"):  # where no limit of the effort helps, one of the duty does not
        if able := _with(given, law, suspects):
            new = by.fit(_law_start(by, start, able, law, trials))
            helps = {*stated, *loose, *worth(base, new, able)}
            better = by.lengthen(new) if helps.intersection(able) else new
            trials[law] = replace(better, residual=new.residual)  # of short windows, to compare it with others
            suspects = [joint for joint in suspects if law != "effort" or joint in helps or joint not in able]
    keep = {*stated, *(j for law, trial in trials.items() for j in worth(base, trial, _with(given, law, suspects)))}
    if not keep:
        return base
    near = by.near(keep)
    base = by.score(base, near)
    trials = {law: by.score(trial.only(near), near) for law, trial in trials.items()}
    chosen, probabilities = base.candidate.only(near), dict[str, dict[str, float]]()
    for joint in keep:
        j = by.searched.joints.index(joint)
        top = max(float(np.abs(recorded_course(by.model, grid).motion.v[:, j]).max()) for grid in by.searched.train)
        allowed = _apart({law: trial for law, trial in trials.items() if given.get(joint, law) == law}, joint, top)
        p = law_probabilities({law: trial.scores[joint] for law, trial in allowed.items()}, by.options.seed)
        law = max(p, key=lambda name: p[name])
        if joint in stated or improved(base, allowed[law], [joint]):
            mine = allowed[law].candidate
            servos = {j: servo for j, servo in mine.servos.items() if j == joint or j not in keep}  # and its neighbours
            chosen = chosen.changed(servos, [name for name in mine.free if name[0] == joint])
            chosen = replace(chosen, window=max(chosen.window if probabilities else 0.0, mine.window))
            probabilities[joint] = p
    if not probabilities:
        return base
    new = by.fit(chosen, coarse=False)
    new, probabilities = _simpler(new, probabilities, given)
    laws = {**base.laws, **{joint: p for joint, p in probabilities.items() if joint not in given}}
    return replace(base.with_joints(by.score(new, near)), laws=laws)


def _simpler(
    trial: ServoTrial, probabilities: Mapping[str, Mapping[str, float]], given: Mapping[str, str]
) -> tuple[ServoTrial, dict[str, dict[str, float]]]:
    """Trial and probabilities with the duty law at joints whose effort law has no damping inside its limit."""
    candidate, out = trial.candidate, {joint: dict(p) for joint, p in probabilities.items()}
    for joint, p in out.items():
        servo = candidate.servos[joint]
        if servo.law == "effort" and joint not in given and servo.kd < INSIDE * servo.damping:
            duty = replace(servo, law="duty").with_(kd=servo.damping, viscous_friction=0.0)
            free = tuple(name for name in candidate.free if name != (joint, "viscous_friction"))
            candidate = replace(candidate.changed({joint: duty}), free=free)
            p["duty"] = p.get("duty", 0.0) + p.pop("effort", 0.0)
    return replace(trial, candidate=candidate), out


def _apart(trials: Mapping[str, ServoTrial], joint: str, top: float) -> dict[str, ServoTrial]:
    """Trials by law, without those that found the numbers of a simpler law; top: largest speed [rad/s or m/s].

    An effort law without damping inside its limit is a duty law; a torque-speed law whose largest speed is far is an
    effort law, and takes its place if it fits better.
    """
    out, line = dict(trials), trials.get("torque_speed")
    if line is not None and "effort" in out and line.candidate.servos[joint].speed_limit > SPEED_RATIO * top:
        del out["torque_speed"]
        if line.residual[joint] < out["effort"].residual[joint]:
            servo = replace(line.candidate.servos[joint], law="effort", speed_limit=np.inf)
            free = tuple(name for name in line.candidate.free if name != (joint, "speed_limit"))
            out["effort"] = replace(line, candidate=replace(line.candidate.changed({joint: servo}), free=free))
    servo = out["effort"].candidate.servos[joint] if {"effort", "duty"} <= set(out) else Servo(kd=1.0)
    return {law: trial for law, trial in out.items() if law != "effort" or servo.kd >= INSIDE * servo.damping}


def _with(given: Mapping[str, str], law: str, joints: Sequence[str]) -> list[str]:
    """Joints that may have a law."""
    return [joint for joint in joints if given.get(joint, law) == law]


def _law_start(
    by: ServoProblem,
    base: Candidate,
    joints: Sequence[str],
    law: str,
    before: Mapping[str, ServoTrial],
) -> Candidate:
    """Start of a law at some joints: the best one by short windows, of regression, a high limit and a simpler law."""
    top = {j: NEAR_TOP * x for j, x in largest_torques(by.searched, {j: base.servos[j] for j in joints}).items()}
    known = by.limited.get(law, by.limited[DRIVE_LAWS[0]])
    mine = {j: known.servos[j] for j in joints if known.servos[j].effort_limit < np.inf}
    numbers = {j: {name: getattr(servo, name) for name in REGRESSED} for j, servo in mine.items()}
    regressed = base.changed({j: base.servos[j].with_(**of) for j, of in numbers.items()})
    sizes = {**top, **{j: servo.effort_limit for j, servo in mine.items()}}
    starts = [limited(base, top, law), limited(regressed, sizes, law)]
    if law == "torque_speed" and "effort" in before:
        starts = [limited(replace(before["effort"].candidate.only(base.servos), window=0.0), top, law)]
    ends = [
        fit_candidate(by.model, by.searched.train, start, SHORT_WINDOW, SHORT_STEPS, coarse=True) for start in starts
    ]
    rows = [by.searched.joints.index(joint) for joint in joints]
    return min(ends, key=lambda end: float(np.log(end[1].residual_rms[rows]).sum()))[0]


def largest_torques(data: ServoData, servos: Mapping[str, Servo]) -> dict[str, float]:
    """Largest torque by joint [N.m or N] that the error asks of drives without limits while they are on."""
    out = {}
    for joint, servo in servos.items():
        j = data.joints.index(joint)
        errors = [np.abs(g.on[:, j] * g.gain[j] * (g.command - g.q)[:, j]).max(initial=0.0) for g in data.train]
        out[joint] = servo.kp * float(max(errors))
    return out


def limited(start: Candidate, limits: Mapping[str, float], law: str) -> Candidate:
    """Drives with a law and a limit to start from; a stated limit stays.

    A limit that acts on the damping of the drive separates it from viscous friction.
    """
    servos, free = {}, list[tuple[str, str]]()
    for joint, limit in limits.items():
        servo = replace(start.servos[joint], law=law)
        if not np.isfinite(servo.effort_limit):
            servo, free = servo.with_(effort_limit=limit), [*free, (joint, "effort_limit")]
        if law != "duty" and servo.viscous_friction == 0.0:
            free.append((joint, "viscous_friction"))
        if servo.law == "torque_speed" and not np.isfinite(servo.speed_limit):
            free.append((joint, "speed_limit"))
        servos[joint] = servo
    return start.changed(servos, free)


def rare_limits(by: ServoProblem, base: ServoTrial) -> tuple[ServoProblem, list[str]]:
    """Joints without a limit whose training data one fits notably better, and starts with their drives."""
    start = base.candidate
    joints = [j for j, servo in start.servos.items() if not servo.effort_limit < np.inf and j not in start.tied]
    if not joints:
        return by, []
    top = largest_torques(by.searched, {joint: start.servos[joint] for joint in joints})
    sizes = start_limits(by.model, by.searched.train, start.servos, top)
    for law in DRIVE_LAWS:  # of a joint: its stated one, or else the first
        mine = {j: limit for j, limit in sizes.items() if by.assumptions.laws.get(j, DRIVE_LAWS[0]) == law}
        start = limited(start, mine, law)
    new = by.fit(start, FIRST_LIMIT_STEPS)
    if not worth(base, new, joints, PROMISING):
        return by, []
    new = by.fit(new.candidate, LIMIT_STEPS - FIRST_LIMIT_STEPS)
    kept = worth(base, new, joints, LIMIT_RESIDUAL_RATIO)
    drives = {joint: new.candidate.servos[joint] for joint in kept}
    return replace(by, limited={law: candidate.changed(drives) for law, candidate in by.limited.items()}), kept
