"""Search for the laws and numbers of drives that predict windows which took no part in the fit."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...model import Model
from ...servos import DRIVE_LAWS, Servo
from ...types import Progress
from .choice import (
    SHORT,
    STEPS,
    Candidate,
    ServoTrial,
    fit_candidate,
    improved,
    law_probabilities,
    scored,
    tried,
    worth,
)
from .data import ServoData

FIRST = "load_friction"  # tried before the laws: without it, limits are fitted to friction
ADDITIONAL = (FIRST, "dead_band", "droop", "profile_speed")
EQUAL = ("effort", "duty")  # the same law while nothing saturates
MORE = 6  # most iterations from a fit with one number less
NEAR_TOP = 0.9  # second start of a limit, over the largest torque that the loop asks for


@dataclass(frozen=True)
class ServoOptions:
    """Options of a servo identification. Defaults come from the data."""

    rate: float | None = None  # [Hz] of the grids
    window: float = 0.0  # [s] of the windows of the fit; 0: 1 s for single joints, 0.8 s for coupled ones (linearised)
    additional: tuple[str, ...] = ADDITIONAL  # numbers that are tried one at a time
    seed: int = 0


@dataclass(frozen=True)
class Chosen:
    """Drives and free numbers that were chosen, and the probability of each law at each joint."""

    candidate: Candidate
    laws: Mapping[str, Mapping[str, float]]  # empty at joints whose law is stated


@dataclass(frozen=True)
class KnownLimits:
    """Known limits of drives before the search, by joint."""

    errors: Mapping[str, float]  # error [rad or m] at the limit, of joints that seem to saturate or state a limit
    laws: Mapping[str, str]  # stated laws, and `duty` where the recorded PWM shows it


@dataclass(frozen=True)
class Searcher:
    """Model, data and options of a search."""

    model: Model
    data: ServoData
    sets: Sequence[Sequence[str]]  # connected joints
    options: ServoOptions
    progress: Progress | None = None

    def fit(self, candidate: Candidate, steps: int = STEPS) -> ServoTrial:
        """Fit to all training data."""
        return tried(self.model, self.data, candidate, self.options.window, steps)

    def score(self, trial: ServoTrial, joints: Collection[str]) -> ServoTrial:
        """Score some joints, with those that share bodies with them, on windows that took no part."""
        if all(joint in trial.scores for joint in joints):
            return trial
        return trial.with_joints(scored(self.model, self.data, trial.only(joints), self.options.window))

    def near(self, joints: Collection[str]) -> set[str]:
        """Joints that share moved bodies with some joints, and these."""
        return {joint for members in self.sets if any(j in joints for j in members) for joint in members}

    def say(self, step: str, share: float) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(step, share)


def search(by: Searcher, start: Candidate, limits: KnownLimits) -> Chosen:
    """Choose load friction, then laws, then other additional numbers.

    Args:
        by: model, data and options.
        start: drives without limits, unless they are stated or tied to a gain.
        limits: of joints that seem to saturate, and stated laws.
    """
    laws: dict[str, Mapping[str, float]] = {
        joint: {law: 1 / len(EQUAL) for law in EQUAL} for joint in start.servos if joint not in limits.laws
    }
    by.say("fitting servos without limits", 0.1)
    base = by.fit(start)
    if not by.data.folds:
        return Chosen(base.candidate, laws)
    by.say("trying a delay of each servo", 0.15)
    base = _try_own_delays(by, base)
    if by.options.additional[:1] == (FIRST,):
        by.say(f"trying {FIRST} of servos", 0.2)
        base = _try_number(by, base, FIRST)
    if open_ := [joint for joint in limits.errors if joint not in start.tied]:
        by.say("trying laws of servos", 0.3)
        base, found = _try_laws(by, base, {joint: limits.errors[joint] for joint in open_}, limits.laws)
        laws.update({joint: p for joint, p in found.items() if joint not in limits.laws})
    for k, name in enumerate(by.options.additional):
        by.say(f"trying {name} of servos", 0.5 + 0.3 * k / len(by.options.additional))
        base = _try_number(by, base, name)
    return Chosen(base.candidate, laws)


def _try_number(by: Searcher, base: ServoTrial, name: str) -> ServoTrial:
    """Free a number at all joints, and keep it where windows that took no part improve."""
    start, neutral = base.candidate, getattr(Servo(), name)
    joints = [joint for joint, servo in start.servos.items() if getattr(servo, name) == neutral]
    if not joints:
        return base
    new = by.fit(start.changed({}, [(joint, name) for joint in joints]), MORE)
    if not (promising := worth(base, new, joints)):
        return base
    near = by.near(promising)
    if set(promising) != set(joints):
        new = by.fit(start.only(near).changed({}, [(joint, name) for joint in promising]), MORE)
    base = by.score(base, near)
    new = by.score(new, near)
    kept = improved(base, new, promising)
    if not kept:
        return base
    if kept != promising:
        near = by.near(kept)
        new = by.score(by.fit(start.only(near).changed({}, [(joint, name) for joint in kept]), MORE), near)
    return base.with_joints(new)


def _try_own_delays(by: Searcher, base: ServoTrial) -> ServoTrial:
    """Give each joint of a branch its own delay, and keep that where windows that took no part improve."""
    free = {joint for joint, name in base.candidate.free if name == "delay"}
    joints = [joint for members in by.sets if len(free.intersection(members)) > 1 for joint in members]
    if not joints:
        return base
    new = by.fit(replace(base.candidate.only(joints), own_delay=frozenset(free.intersection(joints))), MORE)
    near = by.near(worth(base, new, joints))
    if not near:
        return base
    base, new = by.score(base, near), by.score(new.only(near), near)
    kept = by.near(improved(base, new, sorted(near)))
    return base.with_joints(new.only(kept)) if kept else base


def _try_laws(
    by: Searcher, base: ServoTrial, errors: Mapping[str, float], given: Mapping[str, str]
) -> tuple[ServoTrial, dict[str, dict[str, float]]]:
    """Law of each joint that seems to saturate, by windows that took no part; none if a limit does not help."""
    near = by.near(errors)
    start = base.candidate.only(near)
    trials, limits = dict[str, ServoTrial](), _limits_of(by, start, errors)
    for law in DRIVE_LAWS:
        if own := {joint: limits[joint] for joint in errors if given.get(joint, law) == law}:
            trials[law] = by.fit(limited(start, own, law))
            fixed = [joint for joint in own if np.isfinite(start.servos[joint].effort_limit)]
            keep = {*fixed, *worth(base, trials[law], list(own))}
            errors = {joint: error for joint, error in errors.items() if joint in keep or joint not in own}
    if not errors:
        return base, {}
    near = by.near(errors)
    base = by.score(base, near)
    trials = {law: by.score(trial.only(near), near) for law, trial in trials.items()}
    chosen, found = base.candidate.only(near), {}
    for joint in errors:
        allowed = {law: trial for law, trial in trials.items() if given.get(joint, law) == law}
        p = law_probabilities({law: trial.scores[joint] for law, trial in allowed.items()}, by.options.seed)
        law = max(p, key=lambda name: p[name])
        stated = np.isfinite(start.servos[joint].effort_limit)
        if stated or improved(base, trials[law], [joint]):
            mine = trials[law].candidate
            chosen = chosen.changed({joint: mine.servos[joint]}, [name for name in mine.free if name[0] == joint])
            found[joint] = p
    if not found:
        return base, found
    same = [trial for trial in trials.values() if trial.candidate == chosen]
    return base.with_joints(same[0] if same else by.score(by.fit(chosen, MORE), near)), found


def _limits_of(by: Searcher, base: Candidate, errors: Mapping[str, float]) -> dict[str, float]:
    """Limit to start from at each joint [N.m or N]: the better one of two, by short windows."""
    servos, trials = base.servos, []
    for ratio in (0.0, NEAR_TOP):
        limits = {
            joint: servos[joint].kp * max(error, ratio * _asked(by.data, joint)) for joint, error in errors.items()
        }
        start = limited(base, limits, DRIVE_LAWS[0])
        candidate, fit = fit_candidate(by.model, by.data.train, start, SHORT, MORE, coarse=True)
        size = sum(np.log(fit.residual_rms[by.data.joints.index(joint)]) for joint in errors)
        trials.append((size, {joint: candidate.servos[joint].effort_limit for joint in errors}))
    return min(trials, key=lambda pair: pair[0])[1]


def _asked(data: ServoData, joint: str) -> float:
    """Largest error of a joint [rad or m] at the nominal gain, while its drive is on."""
    j = data.joints.index(joint)
    return max(float(np.abs(g.on[:, j] * g.gain[j] * (g.command - g.q)[:, j]).max(initial=0.0)) for g in data.train)


def limited(start: Candidate, limits: Mapping[str, float], law: str) -> Candidate:
    """Drives with a law and a limit to start from; a stated limit stays."""
    servos, free = {}, list[tuple[str, str]]()
    for joint, limit in limits.items():
        servo = replace(start.servos[joint], law=law)
        if not np.isfinite(servo.effort_limit):
            servo, free = servo.with_(effort_limit=limit), [*free, (joint, "effort_limit")]
        if servo.law == "torque_speed" and not np.isfinite(servo.speed_limit):
            free.append((joint, "speed_limit"))
        servos[joint] = servo
    return start.changed(servos, free)
