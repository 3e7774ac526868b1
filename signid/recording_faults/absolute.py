"""Torque that is never negative where the simulation's changes its sign: absolute values, and nobody said so."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..regression.session import Part
from ..types import Mask
from .channels import longest_rows
from .evidence import Evidence

NEAR = 0.02  # of the largest torque: absolute torque goes so near to zero where its sign changes
BOTH = 0.1  # of the rows, in which the model's torque has the rarer sign
SEVERAL = 2  # joints that touch zero and never go below: no friction makes all of them one-sided
BETTER, ALIKE = 0.5, 0.2  # of what the model leaves, and of the torque, that its absolute value leaves at most


def judge_absolute(evidence: Evidence, parts: Sequence[Part]) -> Mask:
    """(n,) joints whose torque is said to have its sign and has none: all that are never negative, if one shows it.

    Args:
        evidence: rows of all recordings.
        parts: the recordings, whose raw samples of the longest stretch are looked at.
    """
    predicted, torque = evidence.plain.predicted, evidence.plain.torque
    rarer = np.minimum((predicted > 0).mean(axis=0), (predicted < 0).mean(axis=0))
    sizes, plain = (np.sum((torque - p) ** 2, axis=0) for p in (np.abs(predicted), predicted))
    raw = np.concatenate([np.nan_to_num(longest_rows(part).tau) for part in parts])
    least, most = raw.min(axis=0), raw.max(axis=0)
    never = evidence.signed & (least >= 0) & (most > 0)
    touches = never & (least <= NEAR * most) & (rarer >= BOTH)
    alike = (sizes <= BETTER * plain) & (sizes <= ALIKE * np.sum(torque**2, axis=0))
    lost = touches & (alike | ((touches & (sizes < plain)).sum() >= SEVERAL))
    return np.asarray(never if lost.any() else lost)
