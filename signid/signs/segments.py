"""Absolute torque -> segments: runs of samples in which the torque keeps one sign."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError
from ..types import Array, Mask
from .observations import Observed
from .thresholds import (
    JUMP_TORQUE,
    MINIMUM_CEILING,
    MINIMUM_FLOOR,
    MOVING_SHARE,
    REST_DURATION,
    SEGMENT_COVERAGE,
    SEGMENT_DURATION,
    SEGMENT_QUANTILE,
    SEGMENT_SAMPLES,
    SPLIT_DEVIATIONS,
    SPLIT_SAMPLES,
)


class Segment(NamedTuple):
    """Samples start..stop (exclusive) of one joint in which the torque keeps one sign."""

    joint: int
    start: int
    stop: int

    @property
    def length(self) -> int:
        """Number of samples."""
        return self.stop - self.start

    def cut(self, at: Iterable[int]) -> list[Segment]:
        """The parts that begin at its start and at the given samples, in ascending order."""
        return [Segment(self.joint, a, b) for a, b in pairwise([self.start, *at, self.stop])]


def threshold_runs(observed: Observed) -> tuple[list[Segment], Array]:
    """Runs of |torque| at or above its quantile in motion, and the thresholds (n,) [N.m or N].

    Raises:
        RecordingError: a joint's torque is zero throughout, or no run above its threshold is long enough.
    """
    threshold = np.zeros(len(observed.known))
    found: list[Segment] = []
    for joint in observed.hidden:
        magnitude, moving = np.abs(observed.torque[:, joint]), in_motion(observed, joint)
        if not magnitude.any():
            raise RecordingError(
                f"the absolute torque of {observed.joints[joint]} is zero throughout; leave its column out, or check "
                f"the logger"
            )
        some = np.sort(magnitude[moving] if moving.any() else magnitude)
        threshold[joint] = some[min(int(round(SEGMENT_QUANTILE * len(some))), len(some) - 1)]
        above = list(runs(observed, joint, moving & (magnitude >= threshold[joint]) & (magnitude > 0)))
        long = _long_runs(above, max(SEGMENT_SAMPLES, round(SEGMENT_DURATION / observed.period)))
        if not long:
            raise RecordingError(_too_short(observed, joint, above))
        found += long
    return found, threshold


def runs_between_minima(observed: Observed) -> list[Segment]:
    """Runs between the low local minima of |torque|, inside which no change of sign can hide.

    A joint without such runs gets its runs above the threshold.
    """
    found = []
    for joint in observed.hidden:
        magnitude, moving = np.abs(observed.torque[:, joint]), in_motion(observed, joint)
        inside = moving & (magnitude >= MINIMUM_FLOOR * observed.rms[joint])
        middle = magnitude[1:-1]
        low = (middle <= magnitude[:-2]) & (middle < magnitude[2:]) & (middle < MINIMUM_CEILING * observed.rms[joint])
        inside[1:-1][low] = False  # the last sample of a plateau
        cut = [run for run in runs(observed, joint, inside) if run.length >= SEGMENT_SAMPLES]
        found += cut or [s for s in threshold_runs(observed)[0] if s.joint == joint]
    return found


def split_impure(
    observed: Observed, segments: Sequence[Segment], predicted: Array, noise: Array
) -> tuple[list[Segment], int]:
    """Split segments where a model, predicted (N, n) [N.m or N], clearly changes sign, and count the splits.

    The standard deviation of its residual is noise (n,) [N.m or N].
    """
    found: list[Segment] = []
    for segment in segments:
        at = _changes(observed, segment, predicted[:, segment.joint], float(noise[segment.joint]))
        found += [part for part in segment.cut(at) if part.length >= SPLIT_SAMPLES]
    return found, len(found) - len(segments)


def split_by_signs(segments: Sequence[Segment], signs: Array) -> list[Segment]:
    """Split segments where the signs (N, n) [1] of their samples change."""
    found: list[Segment] = []
    for segment in segments:
        own = signs[segment.start : segment.stop, segment.joint]
        found += segment.cut((segment.start + 1 + np.flatnonzero(own[1:] != own[:-1])).tolist())
    return found


def in_motion(observed: Observed, joint: int) -> Mask:
    """Mask (N,) of the samples in which a joint is not at rest; static friction of a joint at rest is unknown."""
    found = np.ones(len(observed), dtype=bool)
    for _, start, stop in runs(observed, joint, ~observed.steady[:, joint]):
        found[start:stop] = stop - start < max(SEGMENT_SAMPLES, round(REST_DURATION / observed.period))
    return found


def runs(observed: Observed, joint: int, inside: Mask) -> Iterator[Segment]:
    """Runs of consecutive samples inside a mask (N,); a run ends where a span does."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside, [0]]).astype(np.int8)))
    begins = np.flatnonzero(observed.first)
    for start, stop in edges.reshape(-1, 2).tolist():
        yield from Segment(joint, start, stop).cut(begins[(begins > start) & (begins < stop)].tolist())


def _long_runs(found: Sequence[Segment], least: int) -> list[Segment]:
    """Runs of at least `least` samples; if they hold too few of all samples, runs of SEGMENT_SAMPLES or more."""
    lengths = np.array([run.length for run in found])
    enough = lengths >= least
    if lengths[enough].sum() < SEGMENT_COVERAGE * lengths.sum():
        enough = lengths >= SEGMENT_SAMPLES
    return [run for run, keep in zip(found, enough, strict=True) if keep]


def _changes(observed: Observed, segment: Segment, predicted: Array, noise: float) -> Iterator[int]:
    """Samples at which to split a segment: lowest |torque| between clear runs of opposite signs of the model."""
    own = predicted[segment.start : segment.stop]
    clear = np.where(np.abs(own) > SPLIT_DEVIATIONS * noise, np.sign(own), 0.0)
    at = np.flatnonzero(clear)
    if not len(at):
        return
    groups = np.split(at, np.flatnonzero(np.diff(clear[at])) + 1)
    groups = [group for group in groups if len(group) > SPLIT_SAMPLES]
    magnitude = np.abs(observed.torque[segment.start : segment.stop, segment.joint])
    for one, other in zip(groups[:-1], groups[1:], strict=True):
        if clear[one[0]] != clear[other[0]]:
            yield segment.start + int(one[-1] + np.argmin(magnitude[one[-1] : other[0] + 1]))


def _too_short(observed: Observed, joint: int, found: Sequence[Segment]) -> str:
    longest = max((run.length for run in found), default=0)
    have = f"the longest has {longest} sample{'' if longest == 1 else 's'}, {SEGMENT_SAMPLES} are needed"
    fact = f"no run of |torque| of {observed.joints[joint]} above its threshold is long enough ({have})"
    moves = float(in_motion(observed, joint).mean())
    if moves < MOVING_SHARE:
        return (
            f"{fact}, since the joint clearly moves in {100 * moves:.0f} % of the samples only, or its positions are "
            f"quantised too coarsely; move it more and for longer, or record finer positions"
        )
    return f"{fact}, so the sign may change from sample to sample; record faster, or move more slowly"


def place_sign_changes(observed: Observed, signs: Array, predicted: Array) -> Array:
    """Move changes of the signs (N, n) [1] near a reversal to where the model, predicted (N, n) [N.m or N], has them.

    Applies to stretches near a reversal whose ends differ in sign and whose torque is large throughout: the torque
    jumped past zero, so absolute values do not show where friction changed its sign.
    """
    found, begins = signs.copy(), np.flatnonzero(observed.first)
    for joint in observed.hidden:
        magnitude = np.abs(observed.torque[:, joint])
        large = JUMP_TORQUE * observed.rms[joint]
        for _, start, stop in runs(observed, joint, ~observed.steady[:, joint]):
            if start == 0 or stop == len(signs) or np.any((begins >= start) & (begins <= stop)):
                continue
            before, after = signs[start - 1, joint], signs[stop, joint]
            size, model = magnitude[start:stop], predicted[start:stop, joint]
            if before != after and size.min() > large:
                at = start + place_sign_change(before, after, size, model)
                found[start:at, joint], found[at:stop, joint] = before, after
    return found


def place_sign_change(before: float, after: float, size: Array, model: Array) -> int:
    """Number of samples with the sign `before` that minimises the squared residual of a model; the rest has `after`.

    The absolute torque size (K,) [N.m or N] is compared with the torque of the model (K,) [N.m or N].
    """
    gain = (before * size - model) ** 2 - (after * size - model) ** 2  # of one more sample with the sign before
    return int(np.argmin(np.append(0.0, np.cumsum(gain))))
