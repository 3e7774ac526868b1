"""Recordings, simulation and rows of a diagnosis; columns of further hypotheses on request."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...model import Model
from ...regression.bandwidth import Decimator
from ...regression.rows import Task
from ...types import Array, Frozen, Law
from .column_groups import Group
from .hypotheses import Hypothesis
from .motions import Piece, row_filter, torque_of
from .noise import Noise
from .rows import RowTable
from .whitened_rows import Fitted, Whitened
from .whitening import Whitening


@dataclass(frozen=True, eq=False)
class Dataset(Frozen):
    """Recordings, the simulation, and the rows computed from them."""

    task: Task
    model: Model
    pieces: tuple[Piece, ...]
    periods: tuple[float | None, ...]  # [s] period of the motion in each recording, None where it does not repeat
    table: RowTable
    noise: Noise

    @cached_property
    def thin(self) -> Decimator:
        """Low-pass filter and decimation of columns and torque."""
        return row_filter(self.task)

    def thinned(self, columns: Sequence[Mapping[int, Array]]) -> dict[int, Array]:
        """Filter and decimate columns of each piece, per joint (N, k): per joint (M, k) [torque per coefficient]."""
        rows = np.concatenate([self.thin(np.concatenate(list(made.values()), axis=1)) for made in columns])
        ends = np.cumsum([x.shape[1] for x in columns[0].values()])
        return dict(zip(columns[0], np.split(rows, ends[:-1], axis=1), strict=True))

    def columns(self, hypothesis: Hypothesis) -> dict[int, Array]:
        """Rows of a hypothesis: per joint (M, k) [torque per coefficient]."""
        return self.thinned([hypothesis.columns(piece.motion) for piece in self.pieces])

    def torque(self, law: Law) -> dict[int, Array]:
        """Rows of the torque of a law with all its parameters: per joint (M,) [N.m or N]."""
        made = [{j: x[:, None] for j, x in torque_of(law, piece.motion).items()} for piece in self.pieces]
        return {j: x[:, 0] for j, x in self.thinned(made).items()}

    def remaining(self, data: Whitened, fit: Fitted) -> Array:
        """(M, n) [N.m or N] residual y - X a - S b of a fit."""
        rest = self.table.residual.copy()
        for j in range(data.joints):
            at = data.at[j, fit.which]
            rest[:, j] -= data.torque[j][:, at[at >= 0]] @ fit.value[at >= 0]
        return rest

    @cached_property
    def whitening(self) -> Whitening:
        """Whitening of rows against their noise and discrepancy."""
        return Whitening(self.table, self.noise)


def append(dataset: Dataset, data: Whitened, hypothesis: Hypothesis) -> tuple[Whitened, Group]:
    """Append the columns of one hypothesis to the whitened rows."""
    size, columns = hypothesis.size, dataset.columns(hypothesis)
    group, white = Group(data.count, size, hypothesis), dataset.whitening(columns)
    place, torque, made = list(data.place), list(data.torque), list(data.columns)
    for j, x in columns.items():
        place[j] = np.append(place[j], range(group.start, group.start + size)).astype(np.intp)
        torque[j], made[j] = np.column_stack([torque[j], x]), np.column_stack([made[j], white[j]])
    return replace(
        data,
        groups=(*data.groups, group),
        count=data.count + size,
        place=tuple(place),
        torque=tuple(torque),
        columns=tuple(made),
    ), group
