"""A session of long recordings -> one that fits into memory: every hypothesis has columns for every sample."""

from __future__ import annotations

from dataclasses import replace

from ..sampling import spread
from ..session import Part, Session

MOST, LEAST = 30_000.0, 120.0  # [s] of recordings for one joint (its columns grow as joints squared), and for any robot


def enough(session: Session) -> Session:
    """The session with recordings that are longer than needed cut to stretches, evenly spread, and a note of it."""
    seconds = max(LEAST, MOST / len(session.robot.joints) ** 2)
    train, held_out = (_cut(parts, seconds) for parts in (session.train, session.held_out))
    whole, used = (
        sum(s.duration for _, s in parts) for parts in ((*session.train, *session.held_out), train + held_out)
    )
    if used >= whole:
        return session
    note = f"of {whole:.0f} s that were recorded {used:.0f} s were used, in stretches that are evenly spread"
    return replace(session, train=train, held_out=held_out, notes=(*session.notes, note))


def _cut(parts: tuple[Part, ...], seconds: float) -> tuple[Part, ...]:
    """Each recording by as much."""
    whole = sum(sampling.duration for _, sampling in parts)
    if whole <= seconds:
        return parts
    return tuple((recording, spread(s, seconds * s.duration / whole)) for recording, s in parts)
