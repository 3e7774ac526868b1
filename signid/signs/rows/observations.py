"""Recordings -> rows to find signs from: torque as recorded, never low-passed, and the columns that make it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...recording.sampling import samples
from ...regression.filters import moving_minimum
from ...regression.motion import Motion, build_motion, margin
from ...regression.regressor import base_rows
from ...regression.rows import Task
from ...regression.session import Part
from ...types import Array, Frozen, Indices, Mask, Samples

DENSE = 8.0  # samples a period of the cut-off ...
LEAST = 100.0  # [Hz] ... and never fewer than this, where the recording has them
MOST = 20_000  # samples altogether; longer recordings are thinned further
WINDOW = 8192  # samples of the recording at a time
BEYOND = 2.0  # times the cut-off to which positions pass: less than for a fit, as torque is not filtered here
STILL = 5.0  # widths of a reversal: slower, friction is not certain


@dataclass(frozen=True, eq=False)
class Observed(Frozen):
    """N samples of n joints on thinned grids, one after the other over all spans of all recordings."""

    part: Indices  # (N,) which recording a sample is of
    first: Mask  # (N,) whether a span begins with it
    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad or m]
    v: Array  # (N, n) [rad/s or m/s]
    columns: tuple[Array, ...]  # per joint (N, m) [torque per unit of the base parameter], not filtered
    seen: tuple[Indices, ...]  # per joint (m,) base parameters
    count: int  # b, base parameters
    joints: tuple[str, ...]  # n names
    torque: Array  # (N, n) [N.m or N] as recorded: absolute where the sign is lost, 0 where there is none
    signed: Mask  # (n,) whether the recorded torque has its sign, in all recordings
    known: Mask  # (n,) whether torque is recorded, in all recordings
    steady: Mask  # (N, n) far enough from a reversal for friction to be certain, and from the ends for the filter
    period: float  # [s] between neighbours of a span

    def __len__(self) -> int:
        return len(self.t)

    @property
    def hidden(self) -> tuple[int, ...]:
        """Joints whose torque has lost its sign."""
        return tuple(np.flatnonzero(self.known & ~self.signed).tolist())

    @cached_property
    def rms(self) -> Array:
        """(n,) of the torque [N.m or N], 0 where there is none."""
        return np.asarray(np.sqrt(np.mean(self.torque**2, axis=0)))

    @property
    def scale(self) -> Array:
        """(n,) rms torque [N.m or N], 1 where there is none."""
        return np.asarray(np.where(self.rms > 0, self.rms, 1.0))

    def rows(self, joint: int, at: slice | Mask | Indices = slice(None)) -> Array:
        """(M, b) rows of a joint over all base parameters [torque per unit of each].

        Args:
            joint: its index.
            at: which samples.
        """
        own = self.columns[joint][at]
        wide = np.zeros((len(own), self.count))
        wide[:, self.seen[joint]] = own
        return wide

    def predict(self, value: Array) -> Array:
        """(N, n) torque of a model [N.m or N].

        Args:
            value: (b,) base parameters [units of base].
        """
        return _predicted(self.columns, self.seen, value)


class Stretch(NamedTuple):
    """N consecutive samples at full rate."""

    first: bool  # whether a span begins with them
    motion: Motion
    steady: Mask  # (N, n) far enough from a reversal, and from the ends of the span for the filter


def observe(task: Task, parts: Sequence[Part], most: int = MOST) -> Observed:
    """Rows of some recordings, thin enough to be searched.

    Args:
        task: robot, laws, base map and band.
        parts: recordings and their sampling.
        most: samples altogether.
    """
    step = thinning(task, parts, most)
    pieces = [(k, *stretch) for k, part in enumerate(parts) for stretch in motions(task, part, step)]
    rows = [columns_of(task, _thin(motion, step)) for _, _, motion, _ in pieces]
    recorded = np.concatenate([_recorded(motion)[::step] for _, _, motion, _ in pieces])
    known = ~np.isnan(recorded).any(0)
    lengths = [len(motion.t[::step]) for _, _, motion, _ in pieces]
    first = np.zeros(sum(lengths), dtype=bool)
    first[np.cumsum([0, *lengths[:-1]])] = [begins for _, begins, _, _ in pieces]
    return Observed(
        part=np.repeat([k for k, *_ in pieces], lengths).astype(np.intp),
        first=first,
        t=np.concatenate([motion.t[::step] for _, _, motion, _ in pieces]),
        q=np.concatenate([motion.q[::step] for _, _, motion, _ in pieces]),
        v=np.concatenate([motion.v[::step] for _, _, motion, _ in pieces]),
        columns=tuple(np.concatenate(c) for c in zip(*rows, strict=True)),
        seen=_seen(task),
        count=task.base.rank,
        joints=task.robot.joints,
        torque=np.where(known, recorded, 0.0),
        signed=np.all([recording.signed for recording, _ in parts], axis=0),
        known=known,
        steady=np.concatenate([steady[::step] for *_, steady in pieces]),
        period=step / task.band.rate,
    )


def columns_of(task: Task, motion: Motion) -> list[Array]:
    """Per joint (N, m) [torque per unit of the base parameter], those that it sees.

    Args:
        task: laws and base map.
        motion: N samples.
    """
    return base_rows(motion, task.laws, [task.base.independent[seen] for seen in _seen(task)])


def predict(task: Task, motion: Motion, value: Array) -> Array:
    """(N, n) torque of a model [N.m or N].

    Args:
        task: laws and base map.
        motion: N samples.
        value: (b,) base parameters [units of base].
    """
    return _predicted(columns_of(task, motion), _seen(task), value)


def alone(task: Task) -> dict[int, tuple[str, int]]:
    """Base parameters that are one coefficient of a law by itself -> name of the law, joint."""
    found = {}
    for k, row in enumerate(task.base.combination):
        label = task.base.labels[task.base.independent[k]]
        if np.count_nonzero(row) == 1 and label.law is not None and label.joint is not None:
            found[k] = (task.laws[label.law].effect.name, label.joint)
    return found


def thinning(task: Task, parts: Sequence[Part], most: int = MOST) -> int:
    """Samples of the recording for one that is observed."""
    rate, total = task.band.rate, sum(s.length(span) for _, s in parts for span in s.spans)
    dense = max(LEAST, DENSE * task.band.cutoff) if task.band.filtered else rate
    return max(1, int(rate / dense), -(-total // most))


def motions(task: Task, part: Part, step: int) -> Iterator[Stretch]:
    """The motion of every span at full rate to its very ends, in windows that are a multiple of the step long.

    Beyond the ends positions go on as their mirror images through the last one, so that the filter has what it needs.
    """
    recording, sampling = part
    band = replace(task.band, beyond=BEYOND)
    edge, size = margin(band, task.recorded_derivatives), -(-WINDOW // step) * step
    reach = int(np.ceil(0.5 * band.rate / band.position_cutoff))
    for span in sampling.spans:
        total = sampling.length(span)
        for k in range(0, total, size):
            stop = min(k + size, total)
            low, high = max(k - edge, 0), min(stop + edge, total)
            window = _extended(samples(recording, sampling, span, low, high), low - k + edge, stop + edge - high)
            motion = build_motion(task.robot, window, band, sampling.period, task.recorded_derivatives, task.slow)
            place = np.arange(k, stop)
            whole = (place >= edge) & (place < total - edge)
            yield Stretch(k == 0, motion, _steady(task, motion, reach) & whole[:, None])


def _seen(task: Task) -> tuple[Indices, ...]:
    return tuple(task.seen(j) for j in range(len(task.robot.joints)))


def _predicted(columns: Sequence[Array], seen: Sequence[Indices], value: Array) -> Array:
    return np.column_stack([c @ value[s] for c, s in zip(columns, seen, strict=True)])


def _extended(window: Samples, before: int, after: int) -> Samples:
    if not before and not after:
        return window

    def longer(x: Array | None) -> Array | None:
        if x is None:
            return None
        sides = ((before, after), *((0, 0),) * (x.ndim - 1))
        return np.pad(x, sides, mode="reflect", reflect_type="odd")

    return Samples(*(longer(x) for x in window))  # type: ignore[arg-type]


def _thin(motion: Motion, step: int) -> Motion:
    return Motion(
        motion.robot,
        motion.t[::step],
        motion.q[::step],
        motion.v[::step],
        motion.a[::step],
        slow=motion.slow,
    )


def _recorded(motion: Motion) -> Array:
    assert motion.recorded is not None, "windows carry torque"
    return motion.recorded


def _steady(task: Task, motion: Motion, reach: int) -> Mask:
    return np.asarray((moving_minimum(np.abs(motion.v), reach) >= STILL * task.slow) | ~np.array(task.reverses))
