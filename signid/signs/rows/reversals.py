"""Signs near reversals: friction turns round there, and torque jumps past zero."""

from __future__ import annotations

import numpy as np

from ...types import Array
from .observations import Observed
from .segments import runs

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
        large = LARGE * observed.rms[joint]
        for _, start, stop in runs(observed, joint, ~observed.steady[:, joint]):
            if start == 0 or stop == len(signs) or np.any((begins >= start) & (begins <= stop)):
                continue
            before, after = signs[start - 1, joint], signs[stop, joint]
            size, model = magnitude[start:stop], predicted[start:stop, joint]
            if before != after and size.min() > large:
                at = start + place_turn(before, after, size, model)
                found[start:at, joint], found[at:stop, joint] = before, after
    return found


def place_turn(before: float, after: float, size: Array, model: Array) -> int:
    """How many samples have the sign before and not the one after, where that leaves least of a model.

    Args:
        before: sign at the beginning.
        after: sign at the end.
        size: (K,) absolute torque [N.m or N].
        model: (K,) torque of the model [N.m or N].
    """
    gain = (before * size - model) ** 2 - (after * size - model) ** 2  # of one more before
    return int(np.argmin(np.append(0.0, np.cumsum(gain))))
