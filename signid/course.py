"""What a model leaves of recorded torque along a motion, beside what another left: rows to be looked at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .rows import Rows, read_rows
from .session import Part, Session
from .types import Array, Frozen, Indices

MOST = 20_000  # rows that are kept


@dataclass(frozen=True, eq=False)
class Course(Frozen):
    """M rows of n joints, through the filter of the rows; NaN where no torque counts."""

    joints: tuple[str, ...]
    unit: tuple[str, ...]  # of torque, one a joint
    prismatic: tuple[bool, ...]
    stretch: Indices  # (M,) number of the stretch without gaps that a row is of
    recording: Indices  # (M,) number of the recording
    t: Array  # (M,) [s]
    q: Array  # (M, n) [rad or m]
    v: Array  # (M, n) [rad/s or m/s]
    torque: Array  # (M, n) [N.m or N] measured
    before: Array  # (M, n) [N.m or N] measured - predicted by the model before
    after: Array  # (M, n) [N.m or N] measured - predicted
    whole: bool = True  # whether all rows of the recordings are here

    def __len__(self) -> int:
        return len(self.t)


def follow(session: Session, parts: Sequence[Part], value: Array, stated: Array, most: int = MOST) -> Course:
    """The course of base parameters over recordings, and of those that were stated.

    Args:
        session: joints, base map and band.
        parts: of its recordings.
        value: (b,) [units of base].
        stated: (b,) [units of base] before anything was identified.
        most: rows that are kept, the first ones.
    """
    rows, numbers, whole = list[Rows](), list[int](), True
    for number, found in _numbered(session, parts):
        rows.append(found)
        numbers.append(number)
        if sum(len(each.t) for each in rows) >= most:
            whole = False
            break
    robot, seen = session.robot, [session.task.seen(j) for j in range(len(session.robot.joints))]
    lengths = [len(each.t) for each in rows]
    torque = np.concatenate([np.where(each.recorded, each.torque, np.nan) for each in rows])

    def rest(values: Array) -> Array:
        told = [np.column_stack([c @ values[s] for c, s in zip(r.columns, seen, strict=True)]) for r in rows]
        return np.asarray(torque - np.concatenate(told))

    return Course(
        joints=robot.joints,
        unit=tuple("N" if prismatic else "N.m" for prismatic in robot.prismatic),
        prismatic=tuple(map(bool, robot.prismatic)),
        stretch=np.repeat(np.cumsum([each.first for each in rows]), lengths),
        recording=np.repeat(numbers, lengths),
        t=np.concatenate([each.t for each in rows]),
        q=np.concatenate([each.q for each in rows]),
        v=np.concatenate([each.v for each in rows]),
        torque=torque,
        before=rest(stated),
        after=rest(value),
        whole=whole,
    )


def _numbered(session: Session, parts: Sequence[Part]) -> Iterator[tuple[int, Rows]]:
    for number, (recording, sampling) in enumerate(parts):
        for found in read_rows(session.task, recording, sampling):
            yield number, found
