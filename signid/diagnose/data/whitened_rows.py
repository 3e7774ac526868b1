"""Rows and noise -> whitened rows, and the products that every later question needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...regression.projection import RANK
from ...types import Array, Frozen, Indices, Mask
from .column_groups import Group
from .noise import Noise, has_full_window
from .rows import RowTable
from .whitening import Whitening, moving


class Block(NamedTuple):
    """Products of columns on one joint; k and p of them are more than the joint has."""

    rows: Indices  # (a,) which of the k it has
    place: Indices  # (b,) which of the p
    products: Array  # (a, b) [1 per coefficient, squared]


Gram = tuple[Block, ...]  # one a joint


@dataclass(frozen=True, eq=False)
class Whitened(Frozen):
    """M rows of n joints in units of their noise; p columns altogether, of which a joint has some."""

    groups: tuple[Group, ...]
    count: int  # p
    place: tuple[Indices, ...]  # per joint (m_j,) the columns that it has
    columns: tuple[Array, ...]  # per joint (M, m_j) [1 per coefficient]
    residual: Array  # (n, M) [1]
    moves: Mask  # (M, n) rows that count: the joint does not stand still
    recording: Indices  # (M,)
    torque: tuple[Array, ...]  # per joint (N, m_j) [torque per coefficient] not whitened
    scale: Array  # (n,) [N.m or N] rms torque
    floor: Array  # (n,) [N.m or N]

    def __len__(self) -> int:
        return int(self.residual.shape[1])

    @cached_property
    def counts(self) -> Array:
        """(n,) rows of each joint that count."""
        return np.asarray(np.maximum(self.moves.sum(axis=0), 1), dtype=np.float64)

    @property
    def joints(self) -> int:
        """How many: n."""
        return len(self.place)

    @cached_property
    def refitted(self) -> tuple[Group, ...]:
        """What is refitted beside every hypothesis."""
        return tuple(group for group in self.groups if group.hypothesis is None)

    @cached_property
    def right(self) -> Array:
        """(n, p) columns times residual, per joint [1 per coefficient]."""
        out = np.zeros((self.joints, self.count))
        for j in range(self.joints):
            out[j, self.place[j]] = self.columns[j].T @ self.residual[j]
        return out

    def gram(self, which: Indices) -> Gram:
        """Products of some columns with all.

        Args:
            which: (k,) columns.
        """
        own = [self.chosen(j, which) for j in range(self.joints)]
        return tuple(
            Block(np.flatnonzero(here), place, x.T @ columns)
            for (here, x), place, columns in zip(own, self.place, self.columns, strict=True)
        )

    def products(self, which: Indices, dispersion: Array, columns: Mapping[int, Array]) -> tuple[Array, Array, Array]:
        """Of columns that are not among its own: with each other (d, d), with the residual (d,), with some own (k, d).

        Args:
            which: (k,) own columns.
            dispersion: (n,) variance of the whitened residual [1].
            columns: per joint (M, d) whitened [1 per coefficient].
        """
        d = next(iter(columns.values())).shape[1]
        own, right, across = np.zeros((d, d)), np.zeros(d), np.zeros((len(which), d))
        for j, x in columns.items():
            here, beside = self.chosen(j, which)
            own += x.T @ x / dispersion[j]
            right += x.T @ self.residual[j] / dispersion[j]
            across[here] += beside.T @ x / dispersion[j]
        return own, right, across

    def chosen(self, joint: int, which: Indices) -> tuple[Mask, Array]:
        """Which of some columns a joint has (k,), and these (M, a) [1 per coefficient].

        Args:
            joint: which.
            which: (k,) columns.
        """
        at = self.at[joint, which]
        return at >= 0, self.columns[joint][:, at[at >= 0]]

    @cached_property
    def at(self) -> Indices:
        """(n, p) where each joint has each column among its own, -1 where it has not."""
        out = np.full((self.joints, self.count), -1)
        for own, place in zip(out, self.place, strict=True):
            own[place] = range(len(place))
        return out

    def columns_at(self, joints: Sequence[int]) -> tuple[Indices, list[Indices]]:
        """The columns (p,) that some joints have, and where each joint has its own (m,) among them."""
        columns = np.flatnonzero((self.at[list(joints)] >= 0).any(axis=0))
        return columns, [np.searchsorted(columns, self.place[j]) for j in joints]

    @cached_property
    def refitted_gram(self) -> Gram:
        """Of the columns that are refitted."""
        return self.gram(columns_of(self.refitted))

    def part(self, joint: int, group: Group) -> Array:
        """(M, size) columns of a group on one joint [1 per coefficient]; zero where it has none."""
        return self._part(self.columns[joint], joint, group)

    def free(self, joint: int, columns: Array) -> Array:
        """(M, k) what refitted laws of a joint alone cannot make of columns.

        Args:
            joint: which.
            columns: (M, k) of this joint [1 per coefficient].
        """
        return np.asarray(columns - self._laws[joint] @ (self._laws[joint].T @ columns))

    @cached_property
    def _laws(self) -> list[Array]:
        """Per joint (M, a) [1] an orthonormal basis of what is refitted to it alone, but for bodies."""
        out = list[Array]()
        for j in range(self.joints):
            x = self.chosen(j, columns_of([g for g in self.refitted if not g.bodies and self.rows(g) == [j]]))[1]
            size = np.linalg.norm(x, axis=0)
            left, singular, _ = np.linalg.svd(x[:, size > 0] / size[size > 0], full_matrices=False)
            out.append(left[:, singular > RANK * singular.max(initial=0.0)])
        return out

    def rows(self, group: Group) -> list[int]:
        """The joints on which a group acts."""
        return self._rows[group.start]

    @cached_property
    def _rows(self) -> list[list[int]]:
        """Of each column, the joints that have it."""
        out: list[list[int]] = [[] for _ in range(self.count)]
        for j, place in enumerate(self.place):
            for column in place.tolist():
                out[column].append(j)
        return out

    def raw(self, joint: int, group: Group) -> Array:
        """(M', size) columns of a group on one joint [torque per coefficient]; zero where it has none."""
        return self._part(self.torque[joint], joint, group)

    def _part(self, columns: Array, joint: int, group: Group) -> Array:
        at = int(self.at[joint, group.start])
        return columns[:, at : at + group.size] if at >= 0 else np.zeros((len(columns), group.size))


def total(gram: Gram, dispersion: Array, shape: tuple[int, int]) -> Array:
    """(k, p) products of some columns with others, joints weighted [1 per coefficient, squared].

    Args:
        gram: per joint.
        dispersion: (n,) variance of the whitened residual [1].
        shape: k and p.
    """
    out = np.zeros(shape)
    for block, variance in zip(gram, dispersion.tolist(), strict=True):
        out[block.rows[:, None], block.place] += block.products / variance
    return out


def mean_products(columns: Mapping[int, Array], scale: Array) -> Array:
    """(d, d) mean products of columns, summed over joints, in units of their rms torque [1 per coefficient, squared].

    Args:
        columns: per joint (M, d) [torque per coefficient].
        scale: (n,) rms torque [N.m or N].
    """
    return np.asarray(sum(x.T @ x / len(x) / scale[j] ** 2 for j, x in columns.items()))


def whitened(table: RowTable, noise: Noise) -> Whitened:
    """Rows in units of noise and discrepancy."""
    n, order = table.joints, noise.coefficients.shape[1]
    moves, whitening = moving(table, order), Whitening(table, noise)
    return Whitened(
        groups=table.groups,
        count=table.count,
        place=table.place,
        columns=tuple(whitening(dict(enumerate(table.columns))).values()),
        residual=np.array([whitening({j: table.residual[:, j, None]})[j][:, 0] for j in range(n)]),
        moves=moves,
        recording=table.recording[order:][has_full_window(table.piece, order)],
        torque=table.columns,
        scale=table.scale,
        floor=noise.floor,
    )


def columns_of(groups: Sequence[Group]) -> Indices:
    """Their columns, in order."""
    spans = [np.arange(group.start, group.start + group.size) for group in groups]
    return np.concatenate(spans).astype(np.intp) if spans else np.zeros(0, dtype=np.intp)
