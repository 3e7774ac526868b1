"""Search for the laws and numbers of drives that predict windows which took no part in the fit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...servos import Servo
from .choice import Candidate, ServoTrial, improved, worth
from .data import loop_error
from .laws import rare_limits, try_laws
from .searcher import FIRST, Chosen, KnownLimits, Searcher

EQUAL = ("effort", "duty")  # the same law while nothing saturates
MORE = 6  # most iterations from a fit with one number less
LOOSE = 0.15  # residual over the error of the loop from which limits are tried before friction


def search(by: Searcher, start: Candidate, limits: KnownLimits) -> Chosen:
    """Choose laws of joints that no drive without limits explains, load friction, other laws, and other numbers.

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
    suspects = by.assumptions.with_peers(limits.joints(start.tied))
    loose = by.near([joint for joint in suspects if base.residual[joint] > LOOSE * loop_error(by.data, joint)])
    if first := [joint for joint in suspects if joint in loose]:
        by.say("trying laws of servos", 0.15)
        base, found = try_laws(by, base, first, limits, loose)
        laws.update({joint: p for joint, p in found.items() if joint not in limits.laws})
    before = base.candidate.free
    if by.options.additional[:1] == (FIRST,):
        by.say(f"trying {FIRST} of servos", 0.35)
        base = _try_number(by, base, FIRST)
    by.say("trying limits of servos", 0.4)
    limits, rare = rare_limits(by, base, limits)
    has = [joint for joint in suspects if base.candidate.servos[joint].effort_limit < np.inf]
    if again := [*(joint for joint in has if joint not in loose or base.candidate.free != before), *rare]:
        by.say("trying laws of servos", 0.4)
        base, found = try_laws(by, base, again, limits)
        laws.update({joint: p for joint, p in found.items() if joint not in limits.laws})
    for k, name in enumerate(by.options.additional):
        by.say(f"trying {name} of servos", 0.6 + 0.2 * k / len(by.options.additional))
        base = _try_number(by, base, name)
    base = base if base.candidate.window else by.lengthen(base)
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
