"""Task of a set -> stretches: motion and torque of its three parts, and the filter that makes rows of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from signid.errors import RecordingError
from signid.types import Recording

from ..blackbox.rows import Array, filtered
from ..blackbox.run import figures
from ..blackbox.task import Task, together

PARTS = ("train", "valid", "test")  # A, B and C


@dataclass(frozen=True)
class Stretch:
    """N uniform samples of n joints, and which of their M rows count."""

    part: str  # one of PARTS
    name: str  # of its file, without ending
    start: float  # [s] time of the first sample in its recording
    rate: float  # [Hz]
    motion: Array  # (N, 3 n) q, v, a: positions low-passed above the cut-off of the rows, and their derivatives
    torque: Array  # (N, n) [N.m or N] measured, not low-passed to the rows
    taps: Array  # (k,) [1] low-pass of the rows
    factor: int  # samples per row
    counts: NDArray[np.bool_]  # (M, n) rows where the joint moves
    slow: Array  # (n,) [rad/s or m/s] speed below which the direction of motion is uncertain


@dataclass(frozen=True)
class SetFiles:
    """All stretches of a set, and the figures of least squares on its test rows."""

    task: Task
    stretches: tuple[Stretch, ...]

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint's torque."""
        return tuple("N" if x else "N.m" for x in self.task.least_squares.robot.prismatic)

    @cached_property
    def least_squares_rms(self) -> tuple[float, ...]:
        """Rms [N.m or N] of least squares per joint, the row of `benchmarks.blackbox`."""
        rest = self.task.held_out.rest
        return figures(rest, self.task.held_out.torque, np.isfinite(rest))[0]

    def rows(self, part: str) -> list[int]:
        """Rows of a part that count, per joint.

        Args:
            part: one of PARTS.
        """
        own = [x.counts.sum(axis=0) for x in self.stretches if x.part == part]
        return np.sum(own, axis=0).astype(int).tolist()


def set_files(task: Task) -> SetFiles:
    """Cut the parts of a set into stretches without gaps; A and B are at one rate, as for the other methods.

    Args:
        task: data of the set.

    Raises:
        RecordingError: every stretch is shorter than the filter, or samples have no torque.
    """
    *a, b = together(task)
    named = [("train", f"A{k + 1}", x) for k, x in enumerate(a)] + [("valid", "B", b), ("test", "C", task.c)]
    return SetFiles(task, tuple(x for part, name, own in named for x in _stretches(task, part, name, own)))


def _stretches(task: Task, part: str, name: str, recording: Recording) -> Iterator[Stretch]:
    rows = filtered(task.least_squares, recording, task.cutoff)
    first = 0
    for k, piece in enumerate(rows.pieces):
        motion = piece.motion
        torque = piece.residual + np.asarray(motion.predicted)
        if not np.isfinite(torque).all():
            raise RecordingError(f"{task.name}, {name}: samples without torque; IdentiBench needs it at every sample")
        last = first + len(rows.thin.at(motion.t))
        yield Stretch(
            part=part,
            name=f"{name}_{k + 1}",
            start=float(motion.t[0]),
            rate=1 / motion.dt,
            motion=np.hstack([motion.q, motion.v, motion.a]),
            torque=torque,
            taps=rows.thin.taps,
            factor=rows.thin.factor,
            counts=np.isfinite(rows.residual[first:last]),
            slow=np.asarray(motion.slow),
        )
        first = last
