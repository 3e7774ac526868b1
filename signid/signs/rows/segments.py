"""Absolute torque -> segments in which it keeps one sign."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError
from ...types import Array, Indices, Mask
from .observations import Observed

QUANTILE = 0.1  # of |torque|: below it a torque may change its sign
SHORTEST, FEWEST = 0.2, 5  # [s] of a segment, and samples where that would leave most of the torque out
MOST = 0.5  # of the samples above the threshold
STANDS = 0.1  # [s] without certain motion after which a joint counts as at rest
LOW, LOWEST = 0.5, 0.02  # of the rms: minima below the first are cut, samples below the second belong to no segment
RESTS = 0.1  # share of the samples in motion below which a joint counts as one that hardly moves
CLEAR, TURN = 3.0, 3  # standard deviations and samples by which a model must have the other sign inside a segment


LARGE = 0.15  # of the rms torque: what is larger did not go through zero


class Segment(NamedTuple):
    """Consecutive samples start..stop of one joint, in which the torque keeps one sign."""

    joint: int
    start: int
    stop: int


def threshold_runs(observed: Observed, quantile: float = QUANTILE) -> tuple[list[Segment], Array]:
    """Runs of |torque| that are not below its quantile, and the thresholds (n,) [N.m or N].

    Raises:
        RecordingError: a joint's torque is zero throughout, or stays nowhere above its threshold for long enough.
    """
    threshold = np.zeros(len(observed.known))
    found: list[Segment] = []
    for joint in observed.hidden:
        magnitude, moving = np.abs(observed.torque[:, joint]), in_motion(observed, joint)
        _need_torque(observed, joint, magnitude)
        some = np.sort(magnitude[moving] if moving.any() else magnitude)
        threshold[joint] = some[min(int(round(quantile * len(some))), len(some) - 1)]
        above = list(runs(observed, joint, moving & (magnitude >= threshold[joint]) & (magnitude > 0)))
        long = _longest(above, usual_length(observed))
        if not long:
            raise RecordingError(_too_short(observed, joint, above))
        found += long
    return found, threshold


def minimum_cuts(observed: Observed) -> list[Segment]:
    """Stretches between all low local minima of |torque|: a change of sign cannot hide in one.

    Where there are none of a joint, its runs above the threshold.
    """
    found = []
    for joint in observed.hidden:
        magnitude, moving = np.abs(observed.torque[:, joint]), in_motion(observed, joint)
        inside = moving & (magnitude >= LOWEST * observed.rms[joint])
        inside[_minima(magnitude, LOW * float(observed.rms[joint]))] = False
        cut = [run for run in runs(observed, joint, inside) if run.stop - run.start >= FEWEST]
        found += cut or [s for s in threshold_runs(observed)[0] if s.joint == joint]
    return found


def split_impure(
    observed: Observed, segments: Sequence[Segment], predicted: Array, noise: Array
) -> tuple[list[Segment], int]:
    """The segments, cut where a model's torque clearly changes its sign inside them, and how many cuts were made.

    Args:
        observed: the rows.
        segments: as they are.
        predicted: (N, n) torque of the model [N.m or N].
        noise: (n,) standard deviation of its residual [N.m or N].
    """
    found: list[Segment] = []
    for segment in segments:
        at = [*_changes(observed, segment, predicted[:, segment.joint], float(noise[segment.joint]))]
        ends = [segment.start, *at, segment.stop]
        found += [Segment(segment.joint, a, b) for a, b in zip(ends[:-1], ends[1:], strict=True) if b - a >= TURN]
    return found, len(found) - len(segments)


def cut_by_signs(observed: Observed, segments: Sequence[Segment], signs: Array) -> list[Segment]:
    """The segments, cut where the signs of their samples change.

    Args:
        observed: the rows.
        segments: as they are.
        signs: (N, n) [1] of the samples.
    """
    found = []
    for joint, start, stop in segments:
        own = signs[start:stop, joint]
        ends = [start, *(start + 1 + np.flatnonzero(own[1:] != own[:-1])).tolist(), stop]
        found += [Segment(joint, a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    return found


def in_motion(observed: Observed, joint: int) -> Mask:
    """(N,) where a joint does not stand: friction of a joint that stands may be anything."""
    found = np.ones(len(observed), dtype=bool)
    for _, start, stop in runs(observed, joint, ~observed.steady[:, joint]):
        found[start:stop] = stop - start < max(FEWEST, round(STANDS / observed.period))
    return found


def runs(observed: Observed, joint: int, inside: Mask) -> Iterator[Segment]:
    """Stretches of samples inside, none across the beginning of a span.

    Args:
        observed: the rows.
        joint: that the stretches are of.
        inside: (N,) which samples.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside, [0]]).astype(np.int8)))
    begins = np.flatnonzero(observed.first)
    for start, stop in edges.reshape(-1, 2).tolist():
        ends = [start, *begins[(begins > start) & (begins < stop)].tolist(), stop]
        yield from (Segment(joint, a, b) for a, b in zip(ends[:-1], ends[1:], strict=True))


def usual_length(observed: Observed) -> int:
    """Samples of a segment, as a rule."""
    return max(FEWEST, round(SHORTEST / observed.period))


def _longest(found: Sequence[Segment], least: int) -> list[Segment]:
    """Those of so many samples; where they hold too few of all samples, those of a few."""
    lengths = np.array([run.stop - run.start for run in found])
    enough = lengths >= least
    if lengths[enough].sum() < MOST * lengths.sum():
        enough = lengths >= FEWEST
    return [run for run, keep in zip(found, enough, strict=True) if keep]


def _minima(magnitude: Array, below: float) -> Indices:
    """Samples lower than both neighbours and than `below`; one of a plateau."""
    inner = (magnitude[1:-1] <= magnitude[:-2]) & (magnitude[1:-1] < magnitude[2:]) & (magnitude[1:-1] < below)
    return np.flatnonzero(inner) + 1


def _changes(observed: Observed, segment: Segment, predicted: Array, noise: float) -> Iterator[int]:
    """Where to cut a segment: the lowest |torque| between stretches in which the model clearly has other signs."""
    own = predicted[segment.start : segment.stop]
    clear = np.where(np.abs(own) > CLEAR * noise, np.sign(own), 0.0)
    at = np.flatnonzero(clear)
    if not len(at):
        return
    groups = np.split(at, np.flatnonzero(np.diff(clear[at])) + 1)
    groups = [group for group in groups if len(group) > TURN]
    magnitude = np.abs(observed.torque[segment.start : segment.stop, segment.joint])
    for one, other in zip(groups[:-1], groups[1:], strict=True):
        if clear[one[0]] != clear[other[0]]:
            yield segment.start + int(one[-1] + np.argmin(magnitude[one[-1] : other[0] + 1]))


def _need_torque(observed: Observed, joint: int, magnitude: Array) -> None:
    if not magnitude.any():
        raise RecordingError(
            f"the absolute torque of {observed.joints[joint]} is zero throughout; leave its column out, or check the "
            f"logger"
        )


def _too_short(observed: Observed, joint: int, found: Sequence[Segment]) -> str:
    longest = max((run.stop - run.start for run in found), default=0)
    have = f"the longest has {longest} sample{'' if longest == 1 else 's'}, {FEWEST} are needed"
    told = f"|torque| of {observed.joints[joint]} stays above its threshold nowhere for long ({have})"
    moves = float(in_motion(observed, joint).mean())
    if moves < RESTS:
        return (
            f"{told}: the joint clearly moves in {100 * moves:.0f} % of the samples only, else it rests, or its "
            f"positions come in steps too coarse to tell; move it more and for longer, or record finer positions"
        )
    return f"{told}: its sign may change from sample to sample; record faster, or move more slowly"


def place_sign_changes(observed: Observed, signs: Array, predicted: Array) -> Array:
    """Signs (N, n) [1] that change, in each stretch near a reversal at whose ends they differ, where the model has it.

    Only where all torque of the stretch is large: then absolute values do not tell where friction turned round.

    Args:
        observed: the rows.
        signs: (N, n) [1] of the samples.
        predicted: (N, n) torque of the model [N.m or N].
    """
    found, begins = signs.copy(), np.flatnonzero(observed.first)
    for joint in observed.hidden:
        magnitude = np.abs(observed.torque[:, joint])
        large = LARGE * observed.rms[joint]
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
    """How many samples have the sign before and not the one after, where that leaves least of a model.

    Args:
        before: sign at the beginning.
        after: sign at the end.
        size: (K,) absolute torque [N.m or N].
        model: (K,) torque of the model [N.m or N].
    """
    gain = (before * size - model) ** 2 - (after * size - model) ** 2  # of one more before
    return int(np.argmin(np.append(0.0, np.cumsum(gain))))
