"""Signs near reversals: friction turns round there, and torque jumps past zero."""

from __future__ import annotations

import numpy as np

from ..types import Array
from .observed import Observed

LARGE = 0.15  # of the rms torque: what is larger did not go through zero


def place_turns(observed: Observed, signs: Array, predicted: Array) -> Array:
    """Signs (N, n) [1] that change, in each stretch near a reversal at whose ends they differ, where the model has it.

    Only where all torque of the stretch is large: then absolute values do not tell where friction turned round.

    Args:
        observed: the rows.
        signs: (N, n) [1] of the samples.
        predicted: (N, n) torque of the model [N.m or N].
    """
    found, begins = signs.copy(), np.flatnonzero(observed.first)
    for joint in observed.hidden:
        magnitude = np.abs(observed.torque[:, joint])
        large = LARGE * float(np.sqrt(np.mean(magnitude**2)))
        edges = np.flatnonzero(np.diff(np.concatenate([[0], ~observed.steady[:, joint], [0]]).astype(np.int8)))
        for start, stop in edges.reshape(-1, 2).tolist():
            if start == 0 or stop == len(signs) or np.any((begins >= start) & (begins <= stop)):
                continue
            before, after = signs[start - 1, joint], signs[stop, joint]
            size, model = magnitude[start:stop], predicted[start:stop, joint]
            if before != after and size.min() > large:
                gain = np.cumsum((before * size - model) ** 2 - (after * size - model) ** 2)  # of one more before
                turn = start + int(np.argmin(np.concatenate([[0.0], gain])))
                found[start:turn, joint], found[turn:stop, joint] = before, after
    return found
