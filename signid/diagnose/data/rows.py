"""Filtered, decimated rows of motions: the residual of each joint and the columns of all hypotheses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...deadline import need_time, show_step
from ...model import Model
from ...regression.bandwidth import Decimator
from ...regression.rows import Task
from ...types import Array, Frozen, Indices, Mask
from .column_groups import Group, nuisances
from .hypotheses import finite
from .motions import Piece, reversal_uncertainty, row_filter, standstill
from .thresholds import HOLD_TIME, MIN_MOVING_ROWS, MIN_TORQUE, STATIC_OVER_DRY

STAMP_DECIMALS = 6  # decimals of times [s] that are differences of large time stamps
BLOCK_GROUPS = 32  # groups of columns that are filtered at once: limits memory


@dataclass(frozen=True, eq=False)
class RowTable(Frozen):
    """M rows of n joints, one piece after another."""

    groups: tuple[Group, ...]
    count: int  # p, number of columns
    piece: Indices  # (M,) piece of each row
    recording: Indices  # (M,) recording of each row
    t: Array  # (M,) [s]
    q: Array  # (M, n) [rad or m]
    v: Array  # (M, n) [rad/s or m/s]
    a: Array  # (M, n) [rad/s2 or m/s2]
    torque: Array  # (M, n) [N.m or N] recorded torque
    predicted: Array  # (M, n) [N.m or N] torque that the simulation predicts
    residual: Array  # (M, n) [N.m or N] y: recorded - predicted
    at_rest: Mask  # (M, n) whether a joint is at rest within the reach of the filter: static friction is undetermined
    reversal_std: Array  # (M, n) [N.m or N] standard deviation of torque near velocity reversals
    place: tuple[Indices, ...]  # per joint (m_j,) indices of its columns
    columns: tuple[Array, ...]  # per joint (M, m_j) [torque per coefficient]
    origins: tuple[float, ...] = ()  # per piece [s] time stamp from which reports count; empty: 0

    def __len__(self) -> int:
        return len(self.t)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return int(self.residual.shape[1])

    @property
    def scale(self) -> Array:
        """(n,) [N.m or N] rms torque of each joint, with a lower bound relative to the largest."""
        rms = np.sqrt(np.mean(self.torque**2, axis=0))
        return np.asarray(np.maximum(np.maximum(rms, MIN_TORQUE * rms.max()), 1e-300))

    def since_origin(self) -> Array:
        """(M,) [s] times, from the start of each recording whose time stamps begin far from 0."""
        if not any(self.origins):
            return self.t.copy()
        return np.asarray(np.round(self.t - np.array(self.origins)[self.piece], STAMP_DECIMALS))

    def variable(self, joint: int, name: str) -> Array:
        """(M,) [rad, rad/s, rad/s2, N.m or s; m and N for prismatic joints] variable that torque may depend on."""
        if name == "time":
            return self.t
        signals = {"position": self.q, "velocity": self.v, "acceleration": self.a, "torque": self.predicted}
        return np.asarray(signals[name][:, joint])


def build_table(task: Task, model: Model, groups: Sequence[Group], pieces: Sequence[Piece], dry: Array) -> RowTable:
    """Compute all rows: columns at the rate of the pieces, then the same low-pass filter as the torque.

    The cut-off is twice that of the band; dry friction is `dry` (n,) [N.m or N].
    """
    thin = row_filter(task)
    place, columns = columns_along(task, model, groups, pieces, dry)
    lengths = [len(thin.at(piece.motion.t)) for piece in pieces]

    def inner(signals: Sequence[Array]) -> Array:
        return np.concatenate([thin.at(x) for x in signals])

    rests = inner([standstill(piece.motion, thin, HOLD_TIME) for piece in pieces]) > 0
    sampled: dict[str, Any] = {name: inner([getattr(p.motion, name) for p in pieces]) for name in ("t", "q", "v", "a")}
    signals = [np.column_stack([p.residual, p.residual + np.asarray(p.motion.predicted)]) for p in pieces]
    residual, torque = np.split(np.concatenate([thin(np.nan_to_num(x)) for x in signals]), 2, axis=1)
    return RowTable(
        groups=tuple(groups),
        count=groups[-1].start + groups[-1].size,
        piece=np.repeat(np.arange(len(pieces)), lengths),
        recording=np.repeat([p.recording for p in pieces], lengths),
        **sampled,
        reversal_std=reversal_uncertainty(thin, pieces, dry),
        at_rest=rests
        & ~_pushed(rests, np.abs(torque) - np.abs(torque - residual), _holding_torque(residual, rests, dry)),
        torque=torque,
        predicted=torque - residual,
        residual=residual,
        place=place,
        columns=columns,
        origins=tuple(piece.origin for piece in pieces),
    )


def _holding_torque(residual: Array, rests: Mask, dry: Array) -> Array:
    """(n,) [N.m or N] largest torque that dry friction may hold at rest; infinite for joints that hardly move.

    Static friction exceeds that of motion by a factor: what the simulation states of it, `dry` (n,), and what it leaves
    in motion, residual (M, n), bound it. A command beyond both and the load is another matter, such as saturation.
    """
    moving = np.where(rests, np.nan, np.abs(residual))
    enough = np.sum(~rests, axis=0) > MIN_MOVING_ROWS
    largest = np.array([np.nanmax(x) if yes else np.inf for x, yes in zip(moving.T, enough, strict=True)])
    return np.asarray(STATIC_OVER_DRY * (dry + largest))


def _pushed(rests: Mask, excess: Array, held: Array) -> Mask:
    """(M, n) rests in which the torque exceeds the load, by `excess` (M, n), by more than friction may hold, (n,)."""
    run = np.cumsum(np.diff(rests, axis=0, prepend=False), axis=0)
    beyond = rests & (excess > held)
    return np.column_stack([np.isin(r, r[b]) for r, b in zip(run.T, beyond.T, strict=True)])


def columns_along(
    task: Task, model: Model, groups: Sequence[Group], pieces: Sequence[Piece], dry: Array
) -> tuple[tuple[Indices, ...], tuple[Array, ...]]:
    """Indices of the columns of each joint, and their rows of all pieces; dry friction `dry` (n,) [N.m or N]."""
    thin = row_filter(task)
    made = [_thinned(model, groups, piece, thin, dry) for piece in pieces]
    columns = [np.concatenate([rows[j][1] for rows in made]) for j in range(len(made[0]))]
    return tuple(index for index, _ in made[0]), tuple(columns)


def _thinned(
    model: Model, groups: Sequence[Group], piece: Piece, thin: Decimator, dry: Array
) -> list[tuple[Indices, Array]]:
    """For each joint, the indices of its columns and their rows."""
    piece = piece._replace(motion=replace(piece.motion))  # the large arrays that a motion caches are freed afterwards
    joints = range(len(model.robot.joints))
    place, rows, waiting = ([list[Any]() for _ in joints] for _ in range(3))
    for group, made in zip(groups, _columns(model, groups, piece, dry), strict=True):
        for j, x in made.items():
            place[j].extend(range(group.start, group.start + group.size))
            waiting[j].append(finite(x))
            if len(waiting[j]) == BLOCK_GROUPS:
                rows[j].append(thin(np.concatenate(waiting[j], axis=1)))
                waiting[j].clear()
    for j in joints:
        rows[j] += [thin(np.concatenate(waiting[j], axis=1))] if waiting[j] else []
    return [(np.array(p, dtype=np.intp), np.concatenate(r, axis=1)) for p, r in zip(place, rows, strict=True)]


def _columns(model: Model, groups: Sequence[Group], piece: Piece, dry: Array) -> Iterator[dict[int, Array]]:
    yield from (found.columns for found in nuisances(model, piece.motion, dry))
    for group in (group for group in groups if group.hypothesis is not None):
        need_time("the search for laws")
        show_step(f"columns of {group.claim.kind}", group.start / max(groups[-1].start, 1))
        yield group.claim.columns(piece.motion)
