"""A session of long recordings -> one that fits into memory: every hypothesis has columns for every sample."""

from __future__ import annotations

from dataclasses import replace

from ...deadline import seconds_left
from ...recording.sampling import spread
from ...recording_faults.limits import PER_UNKNOWN, judge_amount
from ...regression.session import Part, Session

MOST, LEAST = 30_000.0, 120.0  # [s] of recordings for one joint (its columns grow as joints squared), and for any robot
# [1] seconds of recordings for one joint per second that is left: columns take a third of the time limit. Measured:
# columns of 750 s of recordings for one joint a second (panda, 500 Hz, one core at 3 GHz)
SHARE = 250.0
SPARE, MORE = 2.0, 1.5  # times the rows that gross checks need at least; factor by which the stretches grow to get them


def enough(session: Session) -> Session:
    """The session with recordings cut to evenly spread stretches where they are longer than needed, and a note of it.

    Recordings that a time limit leaves no time for are longer than needed.
    """
    joints = len(session.robot.joints)
    seconds = max(LEAST, MOST / joints**2)
    soon = SHARE * seconds_left() / joints**2
    while soon < seconds and not _suffices(session, _cut(session.train, soon)):
        soon = MORE * max(soon, 1.0)
    seconds = min(seconds, soon)
    train, held_out = (_cut(parts, seconds) for parts in (session.train, session.held_out))
    whole, used = (
        sum(s.duration for _, s in parts) for parts in ((*session.train, *session.held_out), train + held_out)
    )
    if used >= whole:
        return session
    note = f"of {whole:.0f} s that were recorded {used:.0f} s were used, in stretches that are evenly spread"
    return replace(session, train=train, held_out=held_out, notes=(*session.notes, note))


def _suffices(session: Session, parts: tuple[Part, ...]) -> bool:
    amount = judge_amount(session, parts)
    return amount.rows >= SPARE * PER_UNKNOWN * amount.unknowns


def _cut(parts: tuple[Part, ...], seconds: float) -> tuple[Part, ...]:
    """Each recording by as much."""
    whole = sum(sampling.duration for _, sampling in parts)
    if whole <= seconds:
        return parts
    return tuple((recording, spread(s, seconds * s.duration / whole)) for recording, s in parts)
