"""Recordings -> rows for sign recovery: absolute torque as recorded, unfiltered, and its regressor columns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..errors import RecordingError
from ..recording.sampling import samples
from ..regression.motion import Motion, base_rows, build_motion, margin
from ..regression.rows import Task, away_from_reversals
from ..regression.session import Part
from ..types import Array, Frozen, Indices, Mask, Samples, prismatic_unit

CUTOFF_SAMPLES = 8.0  # [samples per period of the cut-off] density of the grid; heuristic
MIN_GRID_RATE = 100.0  # [Hz]; logs: one UR10e recording had impure segments at 47 Hz, none at 94 Hz
MAX_GRID_SAMPLES = 20_000  # [samples] of all recordings; longer ones are thinned further; heuristic: memory, time
POSITION_BANDWIDTH = 2.0  # [cut-offs] positions pass up to here: less than in a fit, since torque stays unfiltered and
# encoder noise in the acceleration hides small torques; heuristic
SEGMENT_QUANTILE = 0.1  # [1] of |torque| in motion: samples below it belong to no segment; logs: at 0.1 all segments of
# 7 of 8 recordings were pure; at 0.05 up to 5 segments of a recording were impure, at 0.02 up to 14
SEGMENT_DURATION = 0.2  # [s] shortest segment; logs: 20 samples at 100 Hz
SEGMENT_SAMPLES = 5  # [samples] shortest segment, if longer ones would leave out too much torque; logs, as above
SEGMENT_COVERAGE = 0.5  # [1] share of the samples above the threshold that segments must hold; heuristic
REST_DURATION = 0.1  # [s] without certain motion after which a joint counts as at rest; heuristic
MOVING_SHARE = 0.1  # [1] of the samples: a joint that moves in fewer is reported as resting; heuristic
MINIMUM_CEILING = 0.5  # [rms torque] local minima of |torque| below it are cut; logs: impurity <= 0.1 % of the samples
MINIMUM_FLOOR = 0.02  # [rms torque] samples below it belong to no segment between minima; logs, as above
SPLIT_DEVIATIONS = 3.0  # [standard deviations of the residual] of a model torque whose sign is clear; heuristic
SPLIT_SAMPLES = 3  # [samples] a run of clear signs must be longer to split a segment; heuristic
JUMP_TORQUE = 0.15  # [rms torque] where |torque| stays above it the torque jumped past zero; heuristic
MAX_WINDOW_SAMPLES = 8192  # [samples] of a recording processed at a time; bounds memory


@dataclass(frozen=True, eq=False)
class Observations(Frozen):
    """Observations for sign recovery: N samples of n joints on thinned grids, spans and recordings concatenated."""

    part: Indices  # (N,) index of the recording
    first: Mask  # (N,) whether a span begins with the sample
    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad or m]
    v: Array  # (N, n) [rad/s or m/s]
    columns: tuple[Array, ...]  # per joint (N, m) [torque per unit of the base parameter], not filtered
    seen: tuple[Indices, ...]  # per joint (m,) base parameters that its torque depends on
    count: int  # b, base parameters
    joints: tuple[str, ...]  # n names
    torque: Array  # (N, n) [N.m or N] as recorded: absolute where the sign is lost, 0 where there is none
    signed: Mask  # (n,) whether the recorded torque has its sign, in all recordings
    known: Mask  # (n,) whether torque is recorded, in all recordings
    steady: Mask  # (N, n) far enough from a reversal for the sign of friction, and from the ends for the filter
    period: float  # [s] between samples of a span
    coefficients: dict[int, tuple[str, int]]  # base parameter that is one law coefficient alone -> effect, joint
    units: tuple[str, ...]  # n units of torque: N.m or N

    def __len__(self) -> int:
        return len(self.t)

    @property
    def hidden(self) -> tuple[int, ...]:
        """Joints whose torque has lost its sign."""
        return tuple(np.flatnonzero(self.known & ~self.signed).tolist())

    @cached_property
    def rms(self) -> Array:
        """(n,) rms torque [N.m or N], 0 where none is recorded."""
        return np.asarray(np.sqrt(np.mean(self.torque**2, axis=0)))

    @property
    def scale(self) -> Array:
        """(n,) rms torque [N.m or N], 1 where none is recorded."""
        return np.asarray(np.where(self.rms > 0, self.rms, 1.0))

    def rows(self, joint: int, at: slice | Mask | Indices = slice(None)) -> Array:
        """(M, b) rows of a joint at some samples, over all base parameters [torque per unit of each]."""
        columns = self.columns[joint][at]
        wide = np.zeros((len(columns), self.count))
        wide[:, self.seen[joint]] = columns
        return wide

    def predict(self, value: Array) -> Array:
        """(N, n) torque [N.m or N] of a model with base parameters value (b,) [units of base]."""
        return np.column_stack([own @ value[seen] for own, seen in zip(self.columns, self.seen, strict=True)])


class MotionWindow(NamedTuple):
    """N consecutive samples at full rate."""

    first: bool  # whether a span begins with them
    motion: Motion
    torque: Array  # (N, n) [N.m or N] as recorded, NaN where absent
    steady: Mask  # (N, n) far enough from a reversal, and from the ends of the span for the filter


def observe(task: Task, parts: Sequence[Part]) -> Observations:
    """Rows of some recordings, thinned for the search."""
    step = thinning(task, parts)
    windows = [(k, window) for k, part in enumerate(parts) for window in motion_windows(task, part, step)]
    motions = [window.motion[::step] for _, window in windows]
    rows = [base_rows(motion, task.laws, task.wanted) for motion in motions]
    recorded = np.concatenate([window.torque[::step] for _, window in windows])
    known = ~np.isnan(recorded).any(0)
    lengths = [len(motion) for motion in motions]
    first = np.zeros(sum(lengths), dtype=bool)
    first[np.cumsum([0, *lengths[:-1]])] = [window.first for _, window in windows]
    return Observations(
        part=np.repeat([k for k, _ in windows], lengths).astype(np.intp),
        first=first,
        t=np.concatenate([motion.t for motion in motions]),
        q=np.concatenate([motion.q for motion in motions]),
        v=np.concatenate([motion.v for motion in motions]),
        columns=tuple(np.concatenate(c) for c in zip(*rows, strict=True)),
        seen=tuple(map(np.flatnonzero, task.base.sees)),
        count=task.base.rank,
        joints=task.robot.joints,
        torque=np.where(known, recorded, 0.0),
        signed=np.all([recording.signed for recording, _ in parts], axis=0),
        known=known,
        steady=np.concatenate([window.steady[::step] for _, window in windows]),
        period=step / task.band.rate,
        coefficients=law_coefficients(task),
        units=tuple(prismatic_unit("N.m") if moves else "N.m" for moves in task.robot.prismatic),
    )


def predict(task: Task, motion: Motion, value: Array) -> Array:
    """(N, n) torque [N.m or N] of a model with base parameters value (b,) [units of base]."""
    columns = base_rows(motion, task.laws, task.wanted)
    return np.column_stack([own @ value[task.seen(j)] for j, own in enumerate(columns)])


def law_coefficients(task: Task) -> dict[int, tuple[str, int]]:
    """Map each base parameter that is a single coefficient of a law to the effect's name and the joint."""
    coefficients = {}
    for k, row in enumerate(task.base.combination):
        label = task.base.labels[task.base.independent[k]]
        if np.count_nonzero(row) == 1 and label.law is not None and label.joint is not None:
            coefficients[k] = (task.laws[label.law].effect.name, label.joint)
    return coefficients


def thinning(task: Task, parts: Sequence[Part]) -> int:
    """Number of recorded samples per sample of the grid."""
    rate, total = task.band.rate, sum(s.length(span) for _, s in parts for span in s.spans)
    dense = max(MIN_GRID_RATE, CUTOFF_SAMPLES * task.band.cutoff) if task.band.filtered else rate
    return max(1, int(rate / dense), -(-total // MAX_GRID_SAMPLES))


def motion_windows(task: Task, part: Part, step: int) -> Iterator[MotionWindow]:
    """Motion of every span at full rate up to its ends, in windows whose length is a multiple of the step.

    Beyond the ends of a span, positions are extended by odd reflection so that the filter has enough samples.
    """
    recording, sampling = part
    band = replace(task.band, beyond=POSITION_BANDWIDTH)
    edge, size = margin(band, task.recorded_derivatives), -(-MAX_WINDOW_SAMPLES // step) * step
    reach = int(np.ceil(0.5 * band.rate / band.position_cutoff))
    for span in sampling.spans:
        total = sampling.length(span)
        for k in range(0, total, size):
            stop = min(k + size, total)
            low, high = max(k - edge, 0), min(stop + edge, total)
            window = samples(recording, sampling, span, low, high)._asdict()
            sides: Any = [(low - k + edge, stop + edge - high), (0, 0)]
            for key, x in window.items():
                if np.ndim(x):
                    window[key] = np.pad(x, sides[: x.ndim], mode="reflect", reflect_type="odd")
            extended = Samples(**window)
            motion = build_motion(task.robot, extended, band, sampling.period, task.recorded_derivatives, task.slow)
            assert motion.recorded is not None, "windows carry torque"
            place = np.arange(k, stop)
            whole = (place >= edge) & (place < total - edge)
            steady = away_from_reversals(motion.v, reach, task.slow) | ~np.array(task.reverses)
            yield MotionWindow(k == 0, motion, motion.recorded, steady & whole[:, None])


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


def threshold_runs(observed: Observations) -> tuple[list[Segment], Array]:
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
        ascending = np.sort(magnitude[moving] if moving.any() else magnitude)
        threshold[joint] = ascending[min(int(round(SEGMENT_QUANTILE * len(ascending))), len(ascending) - 1)]
        above = list(runs(observed, joint, moving & (magnitude >= threshold[joint]) & (magnitude > 0)))
        # if the long runs hold too few of all samples, short ones count
        lengths = np.array([run.length for run in above])
        enough = lengths >= max(SEGMENT_SAMPLES, round(SEGMENT_DURATION / observed.period))
        if lengths[enough].sum() < SEGMENT_COVERAGE * lengths.sum():
            enough = lengths >= SEGMENT_SAMPLES
        long = [run for run, keep in zip(above, enough, strict=True) if keep]
        if not long:
            raise RecordingError(_too_short(observed, joint, above))
        found += long
    return found, threshold


def runs_between_minima(observed: Observations) -> list[Segment]:
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
    observed: Observations, segments: Sequence[Segment], predicted: Array, noise: Array
) -> tuple[list[Segment], int]:
    """Split segments where a model, predicted (N, n) [N.m or N], clearly changes sign, and count the splits.

    The standard deviation of its residual is noise (n,) [N.m or N].
    """
    found: list[Segment] = []
    for segment in segments:
        at = _split_samples(observed, segment, predicted[:, segment.joint], float(noise[segment.joint]))
        found += [part for part in segment.cut(at) if part.length >= SPLIT_SAMPLES]
    return found, len(found) - len(segments)


def split_by_signs(segments: Sequence[Segment], signs: Array) -> list[Segment]:
    """Split segments where the signs (N, n) [1] of their samples change."""
    found: list[Segment] = []
    for segment in segments:
        segment_signs = signs[segment.start : segment.stop, segment.joint]
        found += segment.cut((segment.start + 1 + np.flatnonzero(segment_signs[1:] != segment_signs[:-1])).tolist())
    return found


def in_motion(observed: Observations, joint: int) -> Mask:
    """Mask (N,) of the samples in which a joint is not at rest; static friction of a joint at rest is unknown."""
    moving = np.ones(len(observed), dtype=bool)
    for _, start, stop in runs(observed, joint, ~observed.steady[:, joint]):
        moving[start:stop] = stop - start < max(SEGMENT_SAMPLES, round(REST_DURATION / observed.period))
    return moving


def runs(observed: Observations, joint: int, inside: Mask) -> Iterator[Segment]:
    """Runs of consecutive samples inside a mask (N,); a run ends where a span does."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside, [0]]).astype(np.int8)))
    begins = np.flatnonzero(observed.first)
    for start, stop in edges.reshape(-1, 2).tolist():
        yield from Segment(joint, start, stop).cut(begins[(begins > start) & (begins < stop)].tolist())


def _split_samples(observed: Observations, segment: Segment, predicted: Array, noise: float) -> Iterator[int]:
    """Samples at which to split a segment: lowest |torque| between clear runs of opposite signs of the model."""
    torque = predicted[segment.start : segment.stop]
    clear = np.where(np.abs(torque) > SPLIT_DEVIATIONS * noise, np.sign(torque), 0.0)
    at = np.flatnonzero(clear)
    if not len(at):
        return
    groups = np.split(at, np.flatnonzero(np.diff(clear[at])) + 1)
    groups = [group for group in groups if len(group) > SPLIT_SAMPLES]
    magnitude = np.abs(observed.torque[segment.start : segment.stop, segment.joint])
    for one, other in zip(groups[:-1], groups[1:], strict=True):
        if clear[one[0]] != clear[other[0]]:
            yield segment.start + int(one[-1] + np.argmin(magnitude[one[-1] : other[0] + 1]))


def _too_short(observed: Observations, joint: int, segments: Sequence[Segment]) -> str:
    longest = max((run.length for run in segments), default=0)
    have = f"the longest has {longest} sample{'' if longest == 1 else 's'}, {SEGMENT_SAMPLES} are needed"
    fact = f"no run of |torque| of {observed.joints[joint]} above its threshold is long enough ({have})"
    moves = float(in_motion(observed, joint).mean())
    if moves < MOVING_SHARE:
        return (
            f"{fact}, since the joint clearly moves in {100 * moves:.0f} % of the samples only, or its positions are "
            f"quantised too coarsely; move it more and for longer, or record finer positions"
        )
    return f"{fact}, so the sign may change from sample to sample; record faster, or move more slowly"


def place_sign_changes(observed: Observations, signs: Array, predicted: Array) -> Array:
    """Move changes of the signs (N, n) [1] near a reversal to where the model, predicted (N, n) [N.m or N], has them.

    Applies to stretches near a reversal whose ends differ in sign and whose torque is large throughout: the torque
    jumped past zero, so absolute values do not show where friction changed its sign.
    """
    placed, begins = signs.copy(), np.flatnonzero(observed.first)
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
                placed[start:at, joint], placed[at:stop, joint] = before, after
    return placed


def place_sign_change(before: float, after: float, size: Array, model: Array) -> int:
    """Number of samples with the sign `before` that minimises the squared residual of a model; the rest has `after`.

    The absolute torque size (K,) [N.m or N] is compared with the torque of the model (K,) [N.m or N].
    """
    gain = (before * size - model) ** 2 - (after * size - model) ** 2  # of one more sample with the sign before
    return int(np.argmin(np.append(0.0, np.cumsum(gain))))
