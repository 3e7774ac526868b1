"""Raw samples -> faults of single channels: clipped or stuck torque, skipping positions, absolute torque."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..regression.session import PIECE, Part
from ..types import Array, Mask, Samples
from .evidence import FaultEvidence

LEVELS = 200  # smallest number of distinct values; with fewer, a standstill looks like quantisation
# Clipping: smallest number of samples at the extreme value, their smallest share of all samples [1], and the smallest
# length of their longest run; their smallest number over that within a band below, and the width of the band [ranges]
OFTEN, SHARE, RUN = 10, 2e-3, 4
NEXT, BAND = 5.0, 5e-3
STILL, TRAVEL = 0.25, 0.02  # stuck torque: [s] smallest duration, and [ranges] smallest travel of the joint in it
# Skipping position: smallest duration [s] and number of samples of a standstill, and the smallest jump after it, over
# the largest of the five steps on either side [1]
HOLD, STEPS, JUMP = 0.05, 5, 3.0
# Absolute torque: largest minimum of the torque over its maximum [1]; smallest share of the rows with the rarer sign of
# the predicted torque [1]; number of joints without negative torque that friction cannot explain; largest residual of
# the absolute predicted torque, over the residual of the signed one, and over the torque (sums of squares) [1]
NEAR = 0.02
BOTH = 0.1
SEVERAL = 2
BETTER, ALIKE = 0.5, 0.2


class Fault(NamedTuple):
    """Fault of a joint's channel."""

    kind: str  # "clipping", "stuck torque", "skipping position"
    joint: int
    times: int  # number of samples; for skipping positions, number of skips
    value: float  # [N.m or N] clipped value, or [s] duration of a standstill


def judge_channels(parts: Sequence[Part]) -> list[Fault]:
    """Faults of single channels in the longest stretch of each recording; each kind at most once per joint."""
    found: dict[tuple[str, int], Fault] = {}
    for part in parts:
        (recording, sampling), rows = part, longest_rows(part)
        for j, signed in enumerate(recording.signed):
            for fault in _faults(rows.q[:, j], rows.tau[:, j], sampling.period, j, bool(signed)):
                found.setdefault((fault.kind, j), fault)
    return list(found.values())


def longest_rows(part: Part) -> Samples:
    """Raw samples of a recording's longest stretch, or its beginning if it is long."""
    recording, sampling = part
    start, stop = max(sampling.spans, key=lambda span: span[1] - span[0])
    return recording.read(start, min(stop, start + PIECE))


def _faults(q: Array, tau: Array, period: float, joint: int, signed: bool) -> Iterator[Fault]:
    if np.all(np.isfinite(tau)) and len(np.unique(tau)) >= LEVELS:
        sides = [(_clipped(side * tau, q), side) for side in (1.0, -1.0)[: 1 + signed]]
        for count, side in sides:
            if count:
                yield Fault("clipping", joint, count, float(np.max(side * tau)))
        if not any(count for count, _ in sides) and (stuck := _stuck(tau, q, period)):
            yield Fault("stuck torque", joint, stuck, stuck * period)
    if skips := _skips(q, period):
        yield Fault("skipping position", joint, len(skips), max(skips) * period)


def _clipped(y: Array, q: Array) -> int:
    """Number of samples at the largest value if it is clipped: many are there and few just below; else 0."""
    at = y >= y.max() - 1e-9 * np.ptp(y)
    levels = np.unique(y)[-2:]
    band = max(BAND * np.ptp(y), 1.5 * (levels[1] - levels[0]))
    below = np.sum((y > y.max() - band) & ~at)
    runs = _runs(at)
    moving = np.mean(np.diff(q, prepend=q[0])[at] != 0)
    many = at.sum() >= max(OFTEN, SHARE * len(y), NEXT * below) and moving > 0.3
    return int(at.sum()) if many and len(runs) > 1 and max(b - a for a, b in runs) >= RUN else 0


def _stuck(y: Array, q: Array, period: float) -> int:
    """Length in samples of the longest stretch with constant value while the position changes."""
    runs = [(a, b) for a, b in _runs(np.diff(y) == 0) if (b - a) * period >= STILL]
    far = TRAVEL * np.ptp(q)
    return max((b - a + 1 for a, b in runs if np.ptp(q[a : b + 1]) > far), default=0)


def _skips(q: Array, period: float) -> list[int]:
    """Length in samples of each standstill of a position that a jump follows."""
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
    """Start and end (exclusive) of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def judge_absolute(evidence: FaultEvidence, parts: Sequence[Part]) -> Mask:
    """Mask (n,) of joints with absolute values in a signed torque column.

    If at least one joint shows it, all joints whose torque is never negative are included.

    Args:
        evidence: rows of all recordings.
        parts: recordings, of which the raw samples of the longest stretch are used.
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
