"""Whitening of rows against coloured noise and the discrepancy of each joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...types import Array, Frozen, Mask
from .discrepancy import Projection, features, project
from .noise import Noise, has_full_window, whiten
from .rows import RowTable


@dataclass(frozen=True, eq=False)
class Whitening(Frozen):
    """Whitening of rows against coloured noise and model discrepancy, joint by joint."""

    table: RowTable
    noise: Noise

    def local(self, columns: Mapping[int, Array]) -> dict[int, Array]:
        """Whiten columns against the coloured noise alone: per joint (M', k) [1 per coefficient].

        A row depends only on the rows just before it.

        Args:
            columns: per joint (M, k) [torque per coefficient].
        """
        noise, piece = self.noise, self.table.piece
        return {
            j: whiten(x, noise.coefficients[j], float(noise.innovation[j]), piece) * self._weight[:, j, None]
            for j, x in columns.items()
        }

    def __call__(self, columns: Mapping[int, Array]) -> dict[int, Array]:
        """Whiten columns against noise and discrepancy: per joint (M', k) [1 per coefficient].

        Args:
            columns: per joint (M, k) [torque per coefficient].
        """
        out = dict[int, Array]()
        for j, x in self.local(columns).items():
            projection = self._projections[j]
            out[j] = x if projection is None else projection(x)
        return out

    def log_scale(self, joint: int) -> float:
        """Log determinant of the whitening of a joint's rows [-]."""
        weight, projection = self._weight[:, joint], self._projections[joint]
        counted = weight[weight > 0]
        own = float(np.sum(np.log(counted))) - len(counted) * float(np.log(self.noise.innovation[joint]))
        return own if projection is None else own + float(np.sum(np.log1p(-projection.shrinkage)))

    @cached_property
    def _weight(self) -> Array:
        """(M', n) [1] weights of whitened rows."""
        return weights(self.table, self.noise)

    @cached_property
    def _projections(self) -> _Projections:
        return _Projections(self)


class _Projections(dict[int, "Projection | None"]):
    """Projection of each joint, computed on first use."""

    def __init__(self, whitening: Whitening) -> None:
        super().__init__()
        self.whitening = whitening

    def __missing__(self, joint: int) -> Projection | None:
        whitening, size = self.whitening, float(self.whitening.noise.discrepancy[joint])
        shape = features(whitening.table, joint) if size > 0 else None
        self[joint] = None if shape is None else project(whitening.local({joint: shape})[joint], size)
        return self[joint]


def moving(table: RowTable, order: int) -> Mask:
    """(M, n) whitened rows whose whole window is in motion."""
    still = np.asarray(np.array([table.at_rest[order - k : len(table) - k] for k in range(order + 1)]).any(axis=0))
    return np.asarray(~still[has_full_window(table.piece, order)])


def weights(table: RowTable, noise: Noise) -> Array:
    """(M, n) [1] weights of whitened rows: reduced near velocity reversals, zero at rest."""
    order = noise.coefficients.shape[1]
    unsure = np.max([table.reversal_std[order - k : len(table) - k] for k in range(order + 1)], axis=0)
    weight = 1 / np.sqrt(1 + (np.maximum(noise.reversal_scale, 1) * unsure / noise.saturated_floor) ** 2)
    return np.asarray(weight[has_full_window(table.piece, order)] * moving(table, order))
