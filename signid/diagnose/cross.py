"""Blocks of recordings in turn -> whether a hypothesis predicts what it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..types import Array, Indices
from .evidence import Evidence
from .group import Group
from .linear import solve

BLOCKS = 8


def gain_unseen(evidence: Evidence, true: Sequence[Group], group: Group, dispersion: Array, trust: float) -> float:
    """By how much a hypothesis lessens the squared whitened residual of blocks that it was not fitted to [1].

    Blocks are whole recordings where there are several, else eighths of the only one.

    Args:
        evidence: rows.
        true: hypotheses that are taken for true beside it.
        group: the hypothesis.
        dispersion: (n,) variance of the whitened residual [1].
        trust: of the tolerance of inertials, how far they are off.
    """
    block = _blocks(evidence)
    without, beside = (_unseen(evidence, some, block, dispersion, trust) for some in (true, [*true, group]))
    return without - beside


def _blocks(evidence: Evidence) -> Indices:
    """(M,) which block a row is of."""
    recording = evidence.data.recording
    if len(np.unique(recording)) > 1:
        return recording
    return np.minimum(np.arange(len(recording)) * BLOCKS // len(recording), BLOCKS - 1)


def _unseen(evidence: Evidence, true: Sequence[Group], block: Indices, dispersion: Array, trust: float) -> float:
    """Sum of squared residuals over the dispersion, each block predicted by the others [1]."""
    data, which = evidence.data, evidence.columns(true, trust)
    grams, rights, rows = list[Array](), list[Array](), list[list[tuple[Array, Array]]]()
    for b in np.unique(block):
        own, gram, right = block == b, np.zeros((len(which), len(which))), np.zeros(len(which))
        kept = list[tuple[Array, Array]]()
        for j in range(data.joints):
            x = np.zeros((int(own.sum()), len(which)))
            here = np.isin(which, data.place[j])
            x[:, here] = data.columns[j][own][:, np.searchsorted(data.place[j], which[here])]
            x, y = x / np.sqrt(dispersion[j]), data.residual[j, own] / np.sqrt(dispersion[j])
            gram, right = gram + x.T @ x, right + x.T @ y
            kept.append((x, y))
        grams.append(gram)
        rights.append(right)
        rows.append(kept)
    whole, told, left = sum(grams), sum(rights), 0.0
    precision = evidence.precision(true, np.diag(np.asarray(whole)), trust)
    for gram, right, kept in zip(grams, rights, rows, strict=True):
        value = solve(which, np.asarray(whole - gram), np.asarray(told - right), precision).value
        left += sum(float(np.sum((y - x @ value) ** 2)) for x, y in kept)
    return left
