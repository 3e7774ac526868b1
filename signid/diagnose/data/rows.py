"""Motions -> filtered, thinned rows: per joint the residual and the columns of all that may explain it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...deadline import need_time, show_step
from ...model import Model
from ...regression.filters import Decimator, moving_minimum
from ...regression.motion import Motion
from ...regression.rows import Task
from ...types import Array, Frozen, Indices, Mask
from .column_groups import Group, nuisances
from .hypotheses import finite
from .motions import Piece, row_filter, unsure_rows


@dataclass(frozen=True, eq=False)
class Table(Frozen):
    """M rows of n joints, piece after piece."""

    groups: tuple[Group, ...]
    count: int  # p, columns altogether
    piece: Indices  # (M,) which piece a row is of
    recording: Indices  # (M,) which recording
    t: Array  # (M,) [s]
    q: Array  # (M, n) [rad or m]
    v: Array  # (M, n) [rad/s or m/s]
    a: Array  # (M, n) [rad/s2 or m/s2]
    torque: Array  # (M, n) [N.m or N] measured
    predicted: Array  # (M, n) [N.m or N]
    residual: Array  # (M, n) [N.m or N] measured - predicted
    rests: Mask  # (M, n) whether a joint stands still so near that the filter feels it: there friction is anything
    jumps: Array  # (M, n) [N.m or N] how unsure torque is near reversals, standard deviation
    place: tuple[Indices, ...]  # per joint (m_j,) the columns that it has
    columns: tuple[Array, ...]  # per joint (M, m_j) [torque per coefficient]

    def __len__(self) -> int:
        return len(self.t)

    @property
    def joints(self) -> int:
        """How many: n."""
        return int(self.residual.shape[1])

    @property
    def scale(self) -> Array:
        """(n,) [N.m or N] rms torque of each joint, at least a share of the largest."""
        rms = np.sqrt(np.mean(self.torque**2, axis=0))
        return np.asarray(np.maximum(np.maximum(rms, FAINT * rms.max()), 1e-300))

    def variable(self, joint: int, name: str) -> Array:
        """(M,) what torque may depend on [rad, rad/s, rad/s2, N.m or s, or with m and N]."""
        if name == "time":
            return self.t
        signals = {"position": self.q, "velocity": self.v, "acceleration": self.a, "torque": self.predicted}
        return np.asarray(signals[name][:, joint])


STILL, WHILE = 2.0, 0.3  # widths of a reversal that a joint at rest is slower than, and for how long [s]
HELD = 0.1  # [s] for which friction may hold a joint, so that no row of it tells what friction is
MANY = 32  # groups of columns that go through the low-pass at once
FAINT = 0.02  # of the largest rms torque: no joint's counts as smaller


def stands_still(motion: Motion, thin: Decimator, seconds: float = WHILE) -> Array:
    """(N, n) 1 where a joint stands still for a while, or does so near that the filter feels it, else 0.

    Args:
        motion: of all joints.
        thin: the filter.
        seconds: a while [s].
    """
    assert motion.slow is not None, "a diagnosed motion knows how wide a reversal is"
    slow = (np.abs(motion.v) < STILL * motion.slow).astype(np.float64)
    half = max(1, round(seconds / 2 / motion.dt))
    opened = moving_minimum(slow, half)
    return -moving_minimum(-opened, half + thin.half // 2)


def tabulate(task: Task, model: Model, groups: Sequence[Group], pieces: Sequence[Piece], dry: Array) -> Table:
    """Columns at full rate, through the same low-pass as the torque, at twice its cut-off.

    Args:
        task: gives the band.
        model: the simulation.
        groups: what columns are made of, as laid out.
        pieces: motions with residuals.
        dry: (n,) dry friction of each joint [N.m or N].
    """
    thin = row_filter(task)
    place, columns = _joined(model, groups, pieces, thin, dry)
    lengths = [len(thin.at(piece.motion.t)) for piece in pieces]

    def inner(signals: Sequence[Array]) -> Array:
        return np.concatenate([thin.at(x) for x in signals])

    signals = [thin(np.column_stack([np.nan_to_num(p.residual), _measured(p)])) for p in pieces]
    residual, torque = np.split(np.concatenate(signals), 2, axis=1)
    return Table(
        groups=tuple(groups),
        count=groups[-1].start + groups[-1].size,
        piece=np.repeat(np.arange(len(pieces)), lengths),
        recording=np.repeat([p.recording for p in pieces], lengths),
        t=inner([piece.motion.t for piece in pieces]),
        q=inner([piece.motion.q for piece in pieces]),
        v=inner([piece.motion.v for piece in pieces]),
        a=inner([piece.motion.a for piece in pieces]),
        jumps=unsure_rows(thin, pieces, dry),
        rests=inner([stands_still(piece.motion, thin, HELD) for piece in pieces]) > 0,
        torque=torque,
        predicted=torque - residual,
        residual=residual,
        place=place,
        columns=columns,
    )


def retabulated(table: Table, task: Task, model: Model, pieces: Sequence[Piece], dry: Array) -> Table:
    """The same rows with columns along other motions.

    Args:
        table: of the rows.
        task: gives the band.
        model: the simulation.
        pieces: as many as before, and as long.
        dry: (n,) dry friction of each joint [N.m or N].
    """
    place, columns = _joined(model, table.groups, pieces, row_filter(task), dry)
    return replace(table, place=place, columns=columns)


def _joined(
    model: Model, groups: Sequence[Group], pieces: Sequence[Piece], thin: Decimator, dry: Array
) -> tuple[tuple[Indices, ...], tuple[Array, ...]]:
    """Per joint, which columns it has and the rows of all pieces."""
    made = [_thinned(model, groups, piece, thin, dry) for piece in pieces]
    columns = [np.concatenate([rows[j][1] for rows in made]) for j in range(len(made[0]))]
    return tuple(index for index, _ in made[0]), tuple(columns)


def _measured(piece: Piece) -> Array:
    assert piece.motion.predicted is not None, "a diagnosed motion carries predicted torque"
    return np.nan_to_num(piece.residual + piece.motion.predicted)


def _thinned(
    model: Model, groups: Sequence[Group], piece: Piece, thin: Decimator, dry: Array
) -> list[tuple[Indices, Array]]:
    """Per joint, which columns it has and their rows.

    What the laws ask of the motion takes much memory, so it is kept no longer than this takes.
    """
    piece = piece._replace(motion=replace(piece.motion))
    joints = range(len(model.robot.joints))
    place, rows, waiting = ([list[Any]() for _ in joints] for _ in range(3))
    for group, made in zip(groups, _columns(model, groups, piece, dry), strict=True):
        for j, x in made.items():
            place[j].extend(range(group.start, group.start + group.size))
            waiting[j].append(finite(x))
            if len(waiting[j]) == MANY:
                rows[j].append(thin(np.concatenate(waiting[j], axis=1)))
                waiting[j].clear()
    for j in joints:
        rows[j] += [thin(np.concatenate(waiting[j], axis=1))] if waiting[j] else []
    return [(np.array(p, dtype=np.intp), np.concatenate(r, axis=1)) for p, r in zip(place, rows, strict=True)]


def _columns(model: Model, groups: Sequence[Group], piece: Piece, dry: Array) -> Iterator[dict[int, Array]]:
    yield from (found.columns for found in nuisances(model, piece.motion, dry))
    for group in (group for group in groups if group.hypothesis is not None):
        need_time("the search for laws")
        show_step(f"columns of {group.claim.key[0]}", group.start / max(groups[-1].start, 1))
        yield group.claim.columns(piece.motion)
