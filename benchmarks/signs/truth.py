"""True signs of torque, and evaluation of recovered signs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from signid.signs.result import Signs, Trace

Array = NDArray[np.float64]

ORDER, CORNER = 4, 8.0  # order and corner [Hz] of the low-pass for the truth of single samples
REST, LASTING = 0.02, 0.2  # speed of a joint at rest [rad/s or m/s], averaging time [s]


@dataclass(frozen=True, eq=False)
class Truth:
    """Signed torque of one recording: N samples of n joints."""

    t: Array  # (N,) [s]
    torque: Array  # (N, n) [N.m or N] the truth of segments
    smooth: Array  # (N, n) [N.m or N] the truth of single samples
    moving: NDArray[np.bool_] | None = None  # (N,) evaluated samples; None: all


class SegmentScore(NamedTuple):
    """Evaluation of a segment: confidence, agreement with the true majority, presence of both signs."""

    confidence: float
    right: bool
    mixed: bool


class Score(NamedTuple):
    """Evaluation of recovered signs."""

    judged: tuple[SegmentScore, ...]
    samples: float  # share of right samples of unsigned joints while the robot moves
    small: float  # the same for samples below the threshold; nan without any

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.judged)

    @property
    def right(self) -> int:
        """Number of segments with the true sign."""
        return sum(one.right for one in self.judged)

    @property
    def mixed(self) -> int:
        """Number of segments with both signs."""
        return sum(one.mixed for one in self.judged)


def measured(t: Array, q: Array, torque: Array, corner: float = CORNER) -> Truth:
    """Truth of a noisy signed recording; low-passed torque gives the signs of single samples.

    Samples with the whole robot at rest are excluded, because static friction holds any torque.

    Args:
        t: times (N,) [s].
        q: positions (N, n) [rad or m].
        torque: signed torque (N, n) [N.m or N].
        corner: corner of the forward-backward filter [Hz].
    """
    rate = 1 / float(np.median(np.diff(t)))
    smooth = sosfiltfilt(butter(ORDER, corner, fs=rate, output="sos"), torque, axis=0)
    half, at = max(1, round(LASTING / 2 * rate)), np.arange(len(t))
    later, before = np.minimum(at + half, len(t) - 1), np.maximum(at - half, 0)
    speed = np.abs(q[later] - q[before]).max(1) / (t[later] - t[before])
    return Truth(t, torque, np.asarray(smooth), speed > REST)


def evaluate(signs: Signs, truths: Sequence[Truth]) -> Score:
    """Compare the signs of segments and samples with the true ones.

    Args:
        signs: recovered signs.
        truths: truths of the recordings, in the order of `signs.traces`.
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
        tuple(_scores(signs, truths)),
        float(np.concatenate(right).mean()),
        float(below.mean()) if len(below) else float("nan"),
    )


def _moving(trace: Trace, truth: Truth) -> NDArray[np.bool_]:
    """Mask of evaluated samples (N,)."""
    if truth.moving is None:
        return np.ones(len(trace.t), dtype=bool)
    return np.asarray(truth.moving[np.searchsorted(truth.t, trace.t).clip(0, len(truth.t) - 1)])


def _same(trace: Trace, truth: Truth, joint: int) -> NDArray[np.bool_]:
    """Mask of samples with their true sign (N,); zero true torque matches both signs."""
    true = np.interp(trace.t, truth.t, truth.smooth[:, joint])
    return np.asarray(trace.signs[:, joint] * true >= 0)


def majority(truth: Truth, joint: int, start: float, end: float) -> tuple[int, bool]:
    """Sign with most of the torque's energy between two times [s], and whether both signs occur."""
    at = (truth.t >= start) & (truth.t <= end)
    torque, smooth = truth.torque[at, joint], truth.smooth[at, joint]
    sign = 1 if np.sum(torque * np.abs(torque)) >= 0 else -1
    return sign, bool(np.any(smooth * sign < 0))


def _scores(signs: Signs, truths: Sequence[Truth]) -> Iterator[SegmentScore]:
    for segment in signs.segments:
        sign, mixed = majority(truths[segment.part], segment.joint, segment.start, segment.end)
        yield SegmentScore(segment.confidence, segment.sign == sign, mixed)
