"""Recordings -> values beyond the description's limits, and whether there is enough data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..regression.rows import consumed
from ..regression.session import Part, Session
from ..types import Array, Indices
from .evidence import FaultEvidence

PER_UNKNOWN = 2.5  # smallest number of rows per unknown, for the joint with most unknowns, to estimate noise
BEYOND = 3.0  # [1] largest cut-off over the highest frequency of the motion
MOTION = 6.25  # [Hz] highest frequency of a motion; rows beyond it have no new information
FAR = 0.05  # [ranges, or rad or m] excess of a position that is a rounding error of the description
STRONG, FAST = 1.05, 1.2  # [1] tolerated torque and velocity over their limits


class Beyond(NamedTuple):
    """Largest value of a joint that exceeds a limit."""

    kind: str  # "torque", "velocity", "position"
    joint: int
    value: float  # [N.m or N, rad/s or m/s, rad or m]
    limit: float


class Amount(NamedTuple):
    """Amount of data."""

    rows: int  # filtered rows of all recordings with new information
    unknowns: int  # of the joint with most of them
    seconds: float  # [s] of training data
    needed: float  # [s] of training data needed for `PER_UNKNOWN`
    whole: float  # [s] of training data and held-out data of the same recordings

    @property
    def enough(self) -> bool:
        """Whether there are enough rows to distinguish noise from unknowns."""
        return self.rows >= PER_UNKNOWN * self.unknowns


def judge_limits(evidence: FaultEvidence | None, parts: Sequence[Part], session: Session) -> list[Beyond]:
    """Values beyond the limits of the description, with a tolerance for noise."""
    robot, found = session.robot, []
    lower, upper = (np.array([getattr(s, key) for _, s in parts]) for key in ("lower", "upper"))
    for j in range(len(robot.joints)):
        low, high = float(robot.lower[j]), float(robot.upper[j])
        room = FAR * max(1.0, high - low if np.isfinite(high - low) else 1.0)
        top, bottom = float(upper[:, j].max()), float(lower[:, j].min())
        if low < high and (top > high + room or bottom < low - room):
            over = top - high >= low - bottom
            found.append(Beyond("position", j, top if over else bottom, high if over else low))
    if evidence is None:
        return found
    torque = np.max([np.abs(tau).max(axis=0) for _, tau in evidence.torques], axis=0)
    for kind, value, limit, factor in (
        ("velocity", np.abs(evidence.plain.v).max(axis=0), robot.velocity_limit, FAST),
        ("torque", torque, robot.effort_limit, STRONG),
    ):
        found += [Beyond(kind, int(j), float(value[j]), float(limit[j])) for j in _over(value, limit, factor)]
    return found


def judge_amount(session: Session, parts: Sequence[Part]) -> Amount:
    """Number of filtered rows and of unknowns."""
    band, task = session.task.band, session.task
    reach = consumed(band, task.recorded_derivatives)
    lengths = [s.length(span) for _, s in parts for span in s.spans]
    density, lost = 2 * min(band.cutoff, max(MOTION, band.cutoff / BEYOND)), len(lengths) * reach / band.rate
    rows = sum(int(max(0, length - reach) / band.rate * density) for length in lengths)
    unknowns = max((len(task.seen(j)) for j in range(len(task.robot.joints))), default=0)
    seconds, wanted = sum(s.duration for _, s in parts), PER_UNKNOWN * unknowns
    rest = sum(s.duration for r, s in session.held_out if any(r is used and s is not own for used, own in parts))
    return Amount(
        rows, unknowns, seconds, max(wanted / density + lost, seconds * wanted / max(rows, 1)), seconds + rest
    )


def _over(value: Array, limit: Array, factor: float) -> Indices:
    return np.flatnonzero((limit > 0) & (value > factor * limit))
