"""Blocks of recordings in turn -> whether a hypothesis predicts what it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ..types import Array, Mask
from .group import Group
from .linear import Linear
from .whitened import Whitened

BLOCKS = 8
ALONE = 0.8  # of a joint's rows in motion, from which on other recordings do not tell of it


class _Block(NamedTuple):
    """What is predicted by all other blocks, k columns fitted there."""

    rows: slice
    gram: Array  # (k, k) [1 per coefficient, squared] its own
    rest: Array  # (k,) [1 per coefficient] columns times what they leave of it unseen
    factor: tuple[Array, bool]  # of the others' normal equations
    value: Array  # (k,) [units of the coefficients] the others'


class Unseen(NamedTuple):
    """Hypotheses that are taken for true, fitted to all blocks but one in turn."""

    linear: Linear
    dispersion: Array  # (n,) variance of the whitened residual [1]
    columns: list[tuple[Mask, Array]]  # per joint (k,) which it has, (M, a) [1 per coefficient] over that root
    blocks: list[_Block]

    def gain(self, group: Group) -> float:
        """By how much one more hypothesis lessens the squared residual of blocks that it was not fitted to [1]."""
        data, root = self.linear.data, np.sqrt(self.dispersion)
        joints = data.rows(group)
        own = [data.part(j, group) / root[j] for j in joints]
        target = [data.residual[j] / root[j] for j in joints]
        parts = list[tuple[Array, Array, Array]]()
        for block in self.blocks:
            across, (z, y) = (
                np.zeros((len(block.rest), group.size)),
                ([a[block.rows] for a in x] for x in (own, target)),
            )
            for (here, x), new in zip((self.columns[j] for j in joints), z, strict=True):
                across[here] += x[block.rows].T @ new
            parts.append((across, _sum(z, z), _sum(z, y)))
        across, square, right = (np.asarray(sum(part[i] for part in parts)) for i in range(3))
        square = square + self.linear.own_precision(group)
        return sum(
            _gain(block, part, (across - part[0], square - part[1], right - part[2]))
            for block, part in zip(self.blocks, parts, strict=True)
        )


def leave_out(linear: Linear, true: Sequence[Group], dispersion: Array, trust: float) -> Unseen:
    """Each block predicted by the others: whole recordings where several move each joint, else eighths of them.

    Args:
        linear: rows.
        true: hypotheses that are taken for true.
        dispersion: (n,) variance of the whitened residual [1].
        trust: of the tolerance of inertials, how far they are off.
    """
    data, which, root = linear.data, linear.columns(true, trust), np.sqrt(dispersion)
    columns = [(here, x / root[j]) for j in range(data.joints) for here, x in [data.chosen(j, which)]]
    spans = [slice(a, b) for a, b in pairwise(_edges(data))]
    grams, rights = np.zeros((len(spans), len(which), len(which))), np.zeros((len(spans), len(which)))
    for j, (here, x) in enumerate(columns):
        for k, span in enumerate(spans):
            grams[k][np.ix_(here, here)] += x[span].T @ x[span]
            rights[k][here] += x[span].T @ data.residual[j, span] / root[j]
    whole, told = grams.sum(axis=0), rights.sum(axis=0)
    prior, blocks = linear.precision(true, np.diag(whole), trust), list[_Block]()
    for span, gram, right in zip(spans, grams, rights, strict=True):
        others = whole - gram + prior
        factor = cho_factor(others + 1e-11 * np.diag(np.diag(others)), lower=True)
        value = cho_solve(factor, told - right)
        blocks.append(_Block(span, gram, right - gram @ value, factor, value))
    return Unseen(linear, dispersion, columns, blocks)


def _gain(block: _Block, here: tuple[Array, Array, Array], others: tuple[Array, Array, Array]) -> float:
    """Of one block: products of the new columns with the others' (k, d), themselves (d, d), the residual (d,)."""
    made = cho_solve(block.factor, others[0])  # (k, d) what the k columns make of the new ones
    value = np.linalg.solve(others[1] - others[0].T @ made, others[2] - others[0].T @ block.value)
    right = here[2] - here[0].T @ block.value - made.T @ block.rest
    cross = made.T @ here[0]
    return float(2 * value @ right - value @ (here[1] - cross - cross.T + made.T @ block.gram @ made) @ value)


def _edges(data: Whitened) -> list[int]:
    """Where blocks begin, and the end: recordings, cut in eighths where other ones do not move all joints."""
    starts = [0, *(np.flatnonzero(np.diff(data.recording)) + 1).tolist(), len(data)]
    moved = np.array([data.moves[a:b].sum(axis=0) for a, b in pairwise(starts)])
    if np.all(moved.max(axis=0) <= ALONE * moved.sum(axis=0)):
        return starts
    return [*(-(-k * (b - a) // BLOCKS) + a for a, b in pairwise(starts) for k in range(BLOCKS)), len(data)]


def _sum(left: Sequence[Array], right: Sequence[Array]) -> Array:
    return np.asarray(sum(a.T @ b for a, b in zip(left, right, strict=True)))
