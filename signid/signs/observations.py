"""Recordings -> rows for sign recovery: absolute torque as recorded, unfiltered, and its regressor columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..recording.sampling import samples
from ..regression.motion import Motion, base_rows, build_motion, margin
from ..regression.rows import Task, away_from_reversals
from ..regression.session import Part
from ..types import Array, Frozen, Indices, Mask, Samples, prismatic_unit
from .thresholds import CUTOFF_SAMPLES, LEAST_RATE, MOST_SAMPLES, POSITION_BANDWIDTH

WINDOW = 8192  # [samples] of a recording processed at a time; bounds memory


@dataclass(frozen=True, eq=False)
class Observed(Frozen):
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
        own = self.columns[joint][at]
        wide = np.zeros((len(own), self.count))
        wide[:, self.seen[joint]] = own
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


def observe(task: Task, parts: Sequence[Part]) -> Observed:
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
    return Observed(
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
    found = {}
    for k, row in enumerate(task.base.combination):
        label = task.base.labels[task.base.independent[k]]
        if np.count_nonzero(row) == 1 and label.law is not None and label.joint is not None:
            found[k] = (task.laws[label.law].effect.name, label.joint)
    return found


def thinning(task: Task, parts: Sequence[Part]) -> int:
    """Number of recorded samples per sample of the grid."""
    rate, total = task.band.rate, sum(s.length(span) for _, s in parts for span in s.spans)
    dense = max(LEAST_RATE, CUTOFF_SAMPLES * task.band.cutoff) if task.band.filtered else rate
    return max(1, int(rate / dense), -(-total // MOST_SAMPLES))


def motion_windows(task: Task, part: Part, step: int) -> Iterator[MotionWindow]:
    """Motion of every span at full rate up to its ends, in windows whose length is a multiple of the step.

    Beyond the ends of a span, positions are extended by odd reflection so that the filter has enough samples.
    """
    recording, sampling = part
    band = replace(task.band, beyond=POSITION_BANDWIDTH)
    edge, size = margin(band, task.recorded_derivatives), -(-WINDOW // step) * step
    reach = int(np.ceil(0.5 * band.rate / band.position_cutoff))
    for span in sampling.spans:
        total = sampling.length(span)
        for k in range(0, total, size):
            stop = min(k + size, total)
            low, high = max(k - edge, 0), min(stop + edge, total)
            window = _extended(samples(recording, sampling, span, low, high), low - k + edge, stop + edge - high)
            motion = build_motion(task.robot, window, band, sampling.period, task.recorded_derivatives, task.slow)
            assert motion.recorded is not None, "windows carry torque"
            place = np.arange(k, stop)
            whole = (place >= edge) & (place < total - edge)
            steady = away_from_reversals(motion.v, reach, task.slow) | ~np.array(task.reverses)
            yield MotionWindow(k == 0, motion, motion.recorded, steady & whole[:, None])


def _extended(window: Samples, before: int, after: int) -> Samples:
    sides: Any = [(before, after), (0, 0)]
    signals = {key: x for key, x in window._asdict().items() if np.ndim(x)}
    longer = {key: np.pad(x, sides[: x.ndim], mode="reflect", reflect_type="odd") for key, x in signals.items()}
    return Samples(**{**window._asdict(), **longer})
