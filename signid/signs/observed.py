"""Recordings -> rows to find signs from: torque as recorded, never low-passed, and the columns that make it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter1d

from ..motion import Motion, build_motion, margin
from ..regressor import base_rows
from ..rows import Task
from ..sampling import samples
from ..session import Part
from ..types import Array, Frozen, Indices, Mask

DENSE = 8.0  # samples a period of the cut-off ...
LEAST = 100.0  # [Hz] ... and never fewer than this, where the recording has them
MOST = 20_000  # samples altogether; longer recordings are thinned further
WINDOW = 8192  # samples of the recording at a time
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
    signed: Mask  # (n,) whether the recorded torque has its sign
    known: Mask  # (n,) whether torque is recorded at all
    steady: Mask  # (N, n) far enough from a reversal for friction to be certain
    period: float  # [s] between neighbours of a span

    def __len__(self) -> int:
        return len(self.t)

    @property
    def hidden(self) -> tuple[int, ...]:
        """Joints whose torque has lost its sign."""
        return tuple(np.flatnonzero(self.known & ~self.signed).tolist())

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
        return np.column_stack([c @ value[seen] for c, seen in zip(self.columns, self.seen, strict=True)])


def observe(task: Task, parts: Sequence[Part], most: int = MOST) -> Observed:
    """Rows of some recordings, thin enough to be searched.

    Args:
        task: robot, laws, base map and band.
        parts: recordings and their sampling.
        most: samples altogether.
    """
    step = thinning(task, parts, most)
    pieces = [
        (k, first, motion) for k, part in enumerate(parts) for first, motion in motions(task, part, step) if len(motion)
    ]
    wanted = [task.base.independent[task.seen(j)] for j in range(len(task.robot.joints))]
    rows = [base_rows(_thin(motion, step), task.laws, wanted) for _, _, motion in pieces]
    recorded = np.concatenate([_recorded(motion)[::step] for _, _, motion in pieces])
    known = np.asarray(~np.isnan(recorded).all(0))
    reach = int(np.ceil(0.5 * task.band.rate / task.band.position_cutoff))
    lengths = [len(motion.t[::step]) for _, _, motion in pieces]
    first = np.zeros(sum(lengths), dtype=bool)
    first[np.cumsum([0, *lengths[:-1]])] = [begins for _, begins, _ in pieces]
    return Observed(
        part=np.repeat([k for k, _, _ in pieces], lengths).astype(np.intp),
        first=first,
        t=np.concatenate([motion.t[::step] for _, _, motion in pieces]),
        q=np.concatenate([motion.q[::step] for _, _, motion in pieces]),
        v=np.concatenate([motion.v[::step] for _, _, motion in pieces]),
        columns=tuple(np.concatenate(c) for c in zip(*rows, strict=True)),
        seen=tuple(task.seen(j) for j in range(len(wanted))),
        count=task.base.rank,
        joints=task.robot.joints,
        torque=np.nan_to_num(recorded),
        signed=np.asarray(parts[0][0].signed),
        known=known,
        steady=np.concatenate([_steady(task, motion, reach)[::step] for _, _, motion in pieces]),
        period=step / task.band.rate,
    )


def thinning(task: Task, parts: Sequence[Part], most: int = MOST) -> int:
    """Samples of the recording for one that is observed."""
    rate, total = task.band.rate, sum(s.length(span) for _, s in parts for span in s.spans)
    dense = max(LEAST, DENSE * task.band.cutoff) if task.band.filtered else rate
    return max(1, int(rate / dense), -(-total // most))


def motions(task: Task, part: Part, step: int) -> Iterator[tuple[bool, Motion]]:
    """The motion of every span at full rate, in windows that are a multiple of the step long."""
    recording, sampling = part
    edge, size = margin(task.band, task.recorded_derivatives), -(-WINDOW // step) * step
    for span in sampling.spans:
        total = sampling.length(span) - 2 * edge
        for k in range(0, total, size):
            window = samples(recording, sampling, span, k, min(k + size, total) + 2 * edge)
            yield (
                k == 0,
                build_motion(task.robot, window, task.band, sampling.period, task.recorded_derivatives, task.slow),
            )


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
    slowest = minimum_filter1d(np.abs(motion.v), 2 * reach + 1, axis=0, mode="nearest")
    return np.asarray((slowest >= STILL * task.slow) | ~np.array(task.reverses))
