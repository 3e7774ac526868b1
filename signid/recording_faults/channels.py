"""Recordings -> channels that are clipped, that stand still while the joint moves, or that skip; raw samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..regression.session import PIECE, Part
from ..types import Array, Mask, Samples
from .evidence import Evidence

LEVELS = 200  # distinct values: fewer are too coarse to tell a standstill from a quantum
OFTEN, SHARE, RUN = 10, 2e-3, 4  # samples at the extreme value, share of all, and so many in a row
NEXT, BAND = 5.0, 5e-3  # times as many as within a band below, as a share of the range
STILL, TRAVEL = 0.25, 0.02  # s, and share of the joint's range it moved meanwhile
HOLD, STEPS, JUMP = 0.05, 5, 3.0  # s and samples a position stands; times the largest step of the five after it


NEAR = 0.02  # of the largest torque: absolute torque goes so near to zero where its sign changes

BOTH = 0.1  # of the rows, in which the model's torque has the rarer sign

SEVERAL = 2  # joints that touch zero and never go below: no friction makes all of them one-sided

BETTER, ALIKE = 0.5, 0.2  # of what the model leaves, and of the torque, that its absolute value leaves at most


class Fault(NamedTuple):
    """What a channel of a joint does, how often, and how much of it."""

    kind: str  # "clipping", "stuck torque", "skipping position"
    joint: int
    times: int  # or samples
    value: float  # [N.m or N] at which it clips, [s] that it stands


def judge_channels(parts: Sequence[Part]) -> list[Fault]:
    """Faults of single channels, in the rows of each recording's longest stretch; each kind once a joint."""
    found: dict[tuple[str, int], Fault] = {}
    for part in parts:
        (recording, sampling), rows = part, longest_rows(part)
        for j, signed in enumerate(recording.signed):
            for fault in _faults(rows.q[:, j], rows.tau[:, j], sampling.period, j, bool(signed)):
                found.setdefault((fault.kind, j), fault)
    return list(found.values())


def longest_rows(part: Part) -> Samples:
    """Raw samples of a recording's longest stretch, or the beginning of it."""
    recording, sampling = part
    start, stop = max(sampling.spans, key=lambda span: span[1] - span[0])
    return recording.read(start, min(stop, start + PIECE))


def _faults(q: Array, tau: Array, period: float, joint: int, signed: bool) -> Iterator[Fault]:
    if np.all(np.isfinite(tau)) and len(np.unique(tau)) >= LEVELS:
        sides = [(_clipped(side * tau, q), side) for side in (1.0, -1.0)[: 1 + signed]]
        for count, side in sides:
            if count:
                yield Fault("clipping", joint, count, float(np.max(side * tau)))
        if not any(count for count, _ in sides) and (stands := _stuck(tau, q, period)):
            yield Fault("stuck torque", joint, stands, stands * period)
    if skips := _skips(q, period):
        yield Fault("skipping position", joint, len(skips), max(skips) * period)


def _clipped(y: Array, q: Array) -> int:
    """Samples at the greatest value, where they are many and those just below are few."""
    at = y >= y.max() - 1e-9 * np.ptp(y)
    levels = np.unique(y)[-2:]
    band = max(BAND * np.ptp(y), 1.5 * (levels[1] - levels[0]))
    below = np.sum((y > y.max() - band) & ~at)
    runs = _runs(at)
    moving = np.mean(np.diff(q, prepend=q[0])[at] != 0)
    many = at.sum() >= max(OFTEN, SHARE * len(y), NEXT * below) and moving > 0.3
    return int(at.sum()) if many and len(runs) > 1 and max(b - a for a, b in runs) >= RUN else 0


def _stuck(y: Array, q: Array, period: float) -> int:
    """Samples of the longest stretch in which a value stands while the position moves."""
    runs = [(a, b) for a, b in _runs(np.diff(y) == 0) if (b - a) * period >= STILL]
    far = TRAVEL * np.ptp(q)
    return max((b - a + 1 for a, b in runs if np.ptp(q[a : b + 1]) > far), default=0)


def _skips(q: Array, period: float) -> list[int]:
    """Samples for which a position stood and then made up for it at once, for each time."""
    step = np.diff(q)
    found = []
    for a, b in _runs(step == 0):
        before, after = np.abs(step[max(a - STEPS, 0) : a]), np.abs(step[b + 1 : b + 1 + STEPS])
        if b - a < max(STEPS, HOLD / period) or len(before) < STEPS or len(after) < STEPS:
            continue
        usual = max(before.max(), after.max())
        if before.min() > 0 and after.min() > 0 and abs(step[b]) > JUMP * usual:
            found.append(b - a)
    return found


def _runs(mask: Array) -> list[tuple[int, int]]:
    """First and one past the last index of every stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def judge_absolute(evidence: Evidence, parts: Sequence[Part]) -> Mask:
    """(n,) joints whose torque is said to have its sign and has none: all that are never negative, if one shows it.

    Args:
        evidence: rows of all recordings.
        parts: the recordings, whose raw samples of the longest stretch are looked at.
    """
    predicted, torque = evidence.plain.predicted, evidence.plain.torque
    rarer = np.minimum((predicted > 0).mean(axis=0), (predicted < 0).mean(axis=0))
    sizes, plain = (np.sum((torque - p) ** 2, axis=0) for p in (np.abs(predicted), predicted))
    raw = np.concatenate([np.nan_to_num(longest_rows(part).tau) for part in parts])
    least, most = raw.min(axis=0), raw.max(axis=0)
    never = evidence.signed & (least >= 0) & (most > 0)
    touches = never & (least <= NEAR * most) & (rarer >= BOTH)
    alike = (sizes <= BETTER * plain) & (sizes <= ALIKE * np.sum(torque**2, axis=0))
    lost = touches & (alike | ((touches & (sizes < plain)).sum() >= SEVERAL))
    return np.asarray(never if lost.any() else lost)
