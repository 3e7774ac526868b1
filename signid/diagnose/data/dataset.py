"""What a diagnosis works on, from motions to whitened rows; more columns can be asked of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...model import Model
from ...regression.filters import Decimator
from ...regression.rows import Task
from ...types import Array, Frozen
from .column_groups import Group
from .hypotheses import Hypothesis
from .motions import Piece, row_filter, thinned
from .noise import Noise
from .normal_equations import Fitted
from .rows import RowTable
from .whitened_rows import Whitened
from .whitening import Whitening


@dataclass(frozen=True, eq=False)
class Dataset(Frozen):
    """Recordings, the simulation, and the rows made of them."""

    task: Task
    model: Model
    pieces: tuple[Piece, ...]
    periods: tuple[float | None, ...]  # [s] of the motion in each recording, None where it does not repeat
    table: RowTable
    noise: Noise

    @cached_property
    def thin(self) -> Decimator:
        """The low-pass of columns and torque."""
        return row_filter(self.task)

    def thinned(self, columns: Sequence[Mapping[int, Array]]) -> dict[int, Array]:
        """Per joint, rows (M, k) [torque per coefficient] of columns that were made at the rate of the pieces.

        Args:
            columns: piece by piece, per joint (N, k) [torque per coefficient].
        """
        return thinned(self.thin, columns)

    def columns(self, hypothesis: Hypothesis) -> dict[int, Array]:
        """Per joint, rows (M, k) [torque per coefficient] of a hypothesis."""
        return self.thinned([hypothesis.columns(piece.motion) for piece in self.pieces])

    def whiten(self, columns: Mapping[int, Array]) -> dict[int, Array]:
        """Per joint, (M', k) in units of noise and discrepancy.

        Args:
            columns: per joint (M, k) [torque per coefficient].
        """
        return self.whitening(columns)

    def remaining(self, data: Whitened, fit: Fitted) -> Array:
        """(M, n) [N.m or N] residual after all that is fitted.

        Args:
            data: the rows' columns.
            fit: the fit.
        """
        rest = self.table.residual.copy()
        for j in range(data.joints):
            at = data.at[j, fit.which]
            rest[:, j] -= data.torque[j][:, at[at >= 0]] @ fit.value[at >= 0]
        return rest

    @cached_property
    def whitening(self) -> Whitening:
        """What turns rows of torque into rows in units of their noise."""
        return Whitening(self.table, self.noise)


def append(
    dataset: Dataset, data: Whitened, hypothesis: Hypothesis, columns: Mapping[int, Array]
) -> tuple[Whitened, Group]:
    """The rows with one more hypothesis.

    Args:
        dataset: gives the noise.
        data: whitened rows.
        hypothesis: what the columns mean.
        columns: per joint (M, k) [torque per coefficient].
    """
    size = hypothesis.size
    group, white = Group(data.count, size, hypothesis), dataset.whiten(columns)
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
