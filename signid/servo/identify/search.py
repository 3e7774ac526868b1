"""Search for the laws and numbers of drives that predict windows which took no part in the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...model import Model
from ...parameters import Array
from ...servos import DRIVE_LAWS, Servo
from ...types import Progress
from .choice import Candidate, choose_laws, improved, unseen_scores
from .data import ServoData

ADDITIONAL = ("load_friction", "dead_band", "droop", "profile_speed")
EQUAL = ("effort", "duty")  # the same law while nothing saturates

Scores = Mapping[str, Array]  # log rms (W,) of windows that took no part, by joint


@dataclass(frozen=True)
class ServoOptions:
    """Options of a servo identification. Defaults come from the data."""

    rate: float | None = None  # [Hz] of the grids
    window: float = 0.8  # [s] of the windows of the fit
    additional: tuple[str, ...] = ADDITIONAL  # numbers that are tried one at a time
    seed: int = 0


@dataclass(frozen=True)
class Chosen:
    """Drives and free numbers that were chosen, and the probability of each law at each joint."""

    candidate: Candidate
    laws: Mapping[str, Mapping[str, float]]  # empty at joints whose law is stated


def search(
    model: Model,
    data: ServoData,
    start: Candidate,
    limits: Mapping[str, float],
    given: Mapping[str, str],
    options: ServoOptions,
    progress: Progress | None,
) -> Chosen:
    """Choose laws, then additional numbers.

    Args:
        model: bodies and laws of the robot.
        data: grids and folds.
        start: drives without limits, unless they are stated.
        limits: effort limit [N.m or N] to start from, at joints whose drive seems to saturate or has a stated limit.
        given: laws that are stated.
        options: additional numbers that are tried, seed.
        progress: called with the current step and the share that is done.
    """
    laws: dict[str, Mapping[str, float]] = {
        joint: {law: 0.5 for law in EQUAL} for joint in start.servos if joint not in given
    }
    if not data.folds:
        return Chosen(_limited(start, limits, given), laws)
    _say(progress, "trying servos without limits", 0.2)
    candidate = start
    scores: Scores = unseen_scores(model, data, start, options.window)
    if limits:
        candidate, scores, found = _laws(model, data, (candidate, scores), limits, given, options, progress)
        laws.update({joint: p for joint, p in found.items() if joint not in given})
    for k, name in enumerate(options.additional):
        _say(progress, f"trying {name} of servos", 0.5 + 0.3 * k / len(options.additional))
        candidate, scores = _try_number(model, data, (candidate, scores), name, options)
    return Chosen(candidate, laws)


def _laws(
    model: Model,
    data: ServoData,
    base: tuple[Candidate, Scores],
    limits: Mapping[str, float],
    given: Mapping[str, str],
    options: ServoOptions,
    progress: Progress | None,
) -> tuple[Candidate, Scores, dict[str, dict[str, float]]]:
    """Law of each joint that seems to saturate, by windows that took no part; none if a limit does not help."""
    start, without = base
    tried: dict[str, tuple[Candidate, Scores]] = {}
    for k, law in enumerate(DRIVE_LAWS):
        own = {joint: limit for joint, limit in limits.items() if given.get(joint, law) == law}
        if own:
            _say(progress, f"trying the law {law} of servos", 0.3 + 0.07 * k)
            candidate = _limited(start, own, dict.fromkeys(own, law))
            tried[law] = candidate, unseen_scores(model, data, candidate, options.window)
    probabilities = choose_laws({law: scores for law, (_, scores) in tried.items()}, list(limits), options.seed)
    chosen, found = start, {}
    scores = dict(without)
    for joint in limits:
        allowed = {law: p for law, p in probabilities[joint].items() if given.get(joint, law) == law}
        law = max(allowed, key=lambda name: allowed[name])
        stated = np.isfinite(start.servos[joint].effort_limit)
        if stated or joint in improved({joint: without[joint]}, {joint: tried[law][1][joint]}):
            free = [name for name in tried[law][0].free if name[0] == joint]
            chosen = chosen.changed({joint: tried[law][0].servos[joint]}, free)
            found[joint] = probabilities[joint]
            scores[joint] = tried[law][1][joint]
    return chosen, scores, found


def _limited(start: Candidate, limits: Mapping[str, float], laws: Mapping[str, str]) -> Candidate:
    """Drives with a law and a limit to start from; a stated limit stays."""
    servos, free = {}, list[tuple[str, str]]()
    for joint, limit in limits.items():
        servo = replace(start.servos[joint], law=laws.get(joint, DRIVE_LAWS[0]))
        if not np.isfinite(servo.effort_limit):
            servo, free = servo.with_(effort_limit=limit), [*free, (joint, "effort_limit")]
        if servo.law == "torque_speed" and not np.isfinite(servo.speed_limit):
            free.append((joint, "speed_limit"))
        servos[joint] = servo
    return start.changed(servos, free)


def _try_number(
    model: Model, data: ServoData, base: tuple[Candidate, Scores], name: str, options: ServoOptions
) -> tuple[Candidate, Scores]:
    """Free a number at all joints, and keep it where windows that took no part improve."""
    start, before = base
    neutral = getattr(Servo(), name)
    joints = [joint for joint, servo in start.servos.items() if getattr(servo, name) == neutral]
    if not joints:
        return base
    after = unseen_scores(model, data, start.changed({}, [(joint, name) for joint in joints]), options.window)
    kept = [joint for joint in improved(before, after) if joint in joints]
    if not kept:
        return base
    candidate = start.changed({}, [(joint, name) for joint in kept])
    if set(kept) != set(joints):
        after = unseen_scores(model, data, candidate, options.window)
    return candidate, after


def known_names(free: Sequence[tuple[str, str]], joint: str) -> tuple[str, ...]:
    """Free numbers of a joint."""
    return tuple(name for owner, name in free if owner == joint)


def _say(progress: Progress | None, step: str, share: float) -> None:
    if progress is not None:
        progress(step, share)
