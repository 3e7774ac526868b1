"""Recordings -> what lies beyond the description's limits, and whether there is enough of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..regression.rows import consumed
from ..regression.session import Part, Session
from ..types import Array, Indices
from .evidence import Evidence

PER_UNKNOWN = 2.5  # rows per unknown of the joint that sees most of them; noise cannot be told from fewer
BEYOND = 3.0  # times what the motion holds, at most, the cut-off is
MOTION = 6.25  # [Hz] up to which rows count: the motion says nothing new faster than that, whatever the cut-off
FAR = 0.05  # of the range, or rad or m: positions so little beyond are the description's rounding
STRONG, FAST = 1.05, 1.2  # times the limits of torque and of velocity


class Beyond(NamedTuple):
    """A joint's largest value of a kind, and its limit."""

    kind: str  # "torque", "velocity", "position"
    joint: int
    value: float  # [N.m or N, rad/s or m/s, rad or m]
    limit: float


class Amount(NamedTuple):
    """How much was recorded."""

    rows: int  # filtered, of all recordings, as far as they say something new
    unknowns: int  # of the joint that sees most
    seconds: float  # that it is learned from
    needed: float  # [s] to be learned from for `PER_UNKNOWN`
    whole: float  # [s] that were recorded, with what is held out of the same recordings

    @property
    def enough(self) -> bool:
        """Whether noise can be told from unknowns."""
        return self.rows >= PER_UNKNOWN * self.unknowns


def judge_limits(evidence: Evidence | None, parts: Sequence[Part], session: Session) -> list[Beyond]:
    """Values beyond the limits that the description states; noise beyond them does not count."""
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
    """Filtered rows against unknowns."""
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
