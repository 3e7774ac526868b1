"""What the signs truly were, and how many of those that were found are right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from signid.signs.result import Signs, SignSegment, Trace

Array = NDArray[np.float64]

ORDER, CORNER = 4, 8.0  # of the low-pass that the truth of single samples passes [Hz]
REST, LASTING = 0.02, 0.2  # rad/s or m/s below which a joint counts as at rest, on average over so many s


@dataclass(frozen=True, eq=False)
class Truth:
    """One recording's torque with its sign: N samples of n joints."""

    t: Array  # (N,) [s]
    torque: Array  # (N, n) [N.m or N] the truth of segments
    smooth: Array  # (N, n) [N.m or N] the truth of single samples
    moving: NDArray[np.bool_] | None = None  # (N,) samples that are judged; None: all


class Judged(NamedTuple):
    """A segment: what is said of it, whether its sign is the true majority's, and whether it holds both signs."""

    confidence: float
    right: bool
    mixed: bool


class Score(NamedTuple):
    """How many signs are right."""

    judged: tuple[Judged, ...]
    samples: float  # share of all samples of joints without signs while the robot moves
    small: float  # share of those below the threshold, nan without any

    @property
    def segments(self) -> int:
        """How many there are."""
        return len(self.judged)

    @property
    def right(self) -> int:
        """How many of them have the true sign."""
        return sum(one.right for one in self.judged)

    @property
    def mixed(self) -> int:
        """How many of them hold both signs."""
        return sum(one.mixed for one in self.judged)


def measured(t: Array, q: Array, torque: Array, corner: float = CORNER) -> Truth:
    """The truth of a recording that has its signs, but also noise: its low-passed torque tells those of samples.

    While the whole robot is at rest, friction holds any torque, and samples are not judged.

    Args:
        t: (N,) [s].
        q: (N, n) [rad or m].
        torque: (N, n) [N.m or N].
        corner: of the filter, forth and back [Hz].
    """
    rate = 1 / float(np.median(np.diff(t)))
    smooth = sosfiltfilt(butter(ORDER, corner, fs=rate, output="sos"), torque, axis=0)
    half, at = max(1, round(LASTING / 2 * rate)), np.arange(len(t))
    later, before = np.minimum(at + half, len(t) - 1), np.maximum(at - half, 0)
    speed = np.abs(q[later] - q[before]).max(1) / (t[later] - t[before])
    return Truth(t, torque, np.asarray(smooth), speed > REST)


def judge(signs: Signs, truths: Sequence[Truth]) -> Score:
    """The signs of segments and samples against the true ones.

    Args:
        signs: what was found.
        truths: of the recordings, in the order of `signs.traces`.
    """
    small, right = [], []
    for trace, truth in zip(signs.traces, truths, strict=True):
        for joint in signs.hidden:
            moving = _moving(trace, truth)
            same = _same(trace, truth, joint)[moving]
            right.append(same)
            small.append(same[trace.magnitude[moving, joint] < signs.threshold[joint]])
    below = np.concatenate(small)
    return Score(
        tuple(_judged(signs.segments, truths)),
        float(np.concatenate(right).mean()),
        float(below.mean()) if len(below) else float("nan"),
    )


def _moving(trace: Trace, truth: Truth) -> NDArray[np.bool_]:
    """(N,) whether the samples are judged."""
    if truth.moving is None:
        return np.ones(len(trace.t), dtype=bool)
    return np.asarray(truth.moving[np.searchsorted(truth.t, trace.t).clip(0, len(truth.t) - 1)])


def _same(trace: Trace, truth: Truth, joint: int) -> NDArray[np.bool_]:
    """(N,) whether the sample has its true sign; where the true torque is zero, either is."""
    true = np.interp(trace.t, truth.t, truth.smooth[:, joint])
    return np.asarray(trace.signs[:, joint] * true >= 0)


def majority(truth: Truth, joint: int, start: float, end: float) -> tuple[int, bool]:
    """The sign of most of the torque's energy between two times [s], and whether there are both signs."""
    at = (truth.t >= start) & (truth.t <= end)
    torque, smooth = truth.torque[at, joint], truth.smooth[at, joint]
    sign = 1 if np.sum(torque * np.abs(torque)) >= 0 else -1
    return sign, bool(np.any(smooth * sign < 0))


def _judged(segments: Sequence[SignSegment], truths: Sequence[Truth]) -> Iterator[Judged]:
    for told in segments:
        sign, mixed = majority(truths[told.part], told.joint, told.start, told.end)
        yield Judged(told.confidence, told.sign == sign, mixed)
