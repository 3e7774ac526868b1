"""Limits that drives reach rarely, by a fit from the best limits of a scan; a regression may miss or invent them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...servos import DRIVE_LAWS
from ..fit import start_limits
from .choice import Candidate, ServoTrial
from .laws import largest_torques, limited
from .searcher import KnownLimits, Searcher

STEPS = 8  # most iterations
WORTH = 0.8  # residual over that without a limit from which the laws of a joint are tried


def rare_limits(by: Searcher, base: ServoTrial, limits: KnownLimits) -> tuple[KnownLimits, list[str]]:
    """Joints without a limit whose training data one fits notably better, and starts with their drives."""
    start = base.candidate
    joints = [j for j, servo in start.servos.items() if not servo.effort_limit < np.inf and j not in start.tied]
    if not joints:
        return limits, []
    top = largest_torques(by.data, {joint: start.servos[joint] for joint in joints})
    new = by.fit(_limited(start, start_limits(by.model, by.data.train, start.servos, top), limits), STEPS)
    kept = [joint for joint in joints if new.residual[joint] < WORTH * base.residual[joint]]
    starts = {
        law: one.changed({joint: new.candidate.servos[joint] for joint in kept}) for law, one in limits.starts.items()
    }
    return replace(limits, starts=starts), kept


def _limited(start: Candidate, top: dict[str, float], limits: KnownLimits) -> Candidate:
    """Drives with limits to start from, by their stated law or else by the first one."""
    for law in DRIVE_LAWS:
        mine = {joint: limit for joint, limit in top.items() if limits.laws.get(joint, DRIVE_LAWS[0]) == law}
        start = limited(start, mine, law)
    return start
