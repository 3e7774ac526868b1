"""Result of sign recovery: signs of segments with confidence, proof, flags, and the signed torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..types import Array, Frozen, Indices, Result

CERTAIN_CONFIDENCE = 0.999  # [1] confidence of a certain sign; logs and simulations: none of 2236 such signs was wrong
UNPROVED_GAP = 0.995  # [1] relative gap that rounds to 100 %: the lower bound excludes nothing


class SignProof(NamedTuple):
    """Proof that no other signs of the segments have a lower loss, or the gap that remains."""

    optimal: bool
    gap: float  # share by which other signs could lower the loss at most, 0 where optimal [1]
    nodes: int  # of the search tree that were examined
    certified: bool = False  # by eigenvalues alone, without a tree

    @property
    def has_bound(self) -> bool:
        """Whether a lower bound on the loss of all other signs is known."""
        return self.gap < UNPROVED_GAP


class SignSegment(NamedTuple):
    """Interval in which the torque of one joint keeps one sign."""

    part: int  # index of the recording
    joint: int
    start: float  # [s]
    end: float  # [s]
    sign: int  # +1 or -1
    confidence: float  # probability that the sign is right; valid if no flag is raised


class Gain(NamedTuple):
    """Estimate of an unknown torque constant."""

    joint: str
    value: float  # [unit]
    std: float  # [unit]
    unit: str = "N.m/A"


@dataclass(frozen=True, eq=False)
class Trace(Frozen):
    """Signed torque of one recording on a thinned grid: N samples of n joints."""

    path: str
    t: Array  # (N,) [s]
    first: Indices  # (k,) samples at which a span begins
    magnitude: Array  # (N, n) [N.m or N] as recorded
    signs: Array  # (N, n) [1]
    predicted: Array  # (N, n) [N.m or N] torque of the model that was fitted with the signs
    origin: float = 0.0  # [s] time stamp from which reports count


@dataclass(frozen=True, eq=False)
class Signs(Result):
    """Signs of torques that were recorded as absolute values. They are unreliable if `flags` is not empty."""

    joints: tuple[str, ...]  # n of the robot
    hidden: tuple[int, ...]  # joints whose torque had no sign
    method: str  # "exact" or "tree"
    segments: tuple[SignSegment, ...]  # in the order of recording, joint and time
    threshold: Array  # (n,) [N.m or N] samples below it belong to no segment; 0 where the sign was recorded
    proof: SignProof
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    value: Array  # (b,) base parameters fitted with the signs [units of base]
    noise: Array  # (n,) [N.m or N] of the residual
    inflation: Array  # (n,) samples per independent sample of the residual [1]
    traces: tuple[Trace, ...]  # one per recording
    gains: tuple[Gain, ...] = ()
    seed: int = 0

    def of(self, joint: int) -> tuple[SignSegment, ...]:
        """The segments of one joint."""
        return tuple(segment for segment in self.segments if segment.joint == joint)

    def is_certain(self, least: float = CERTAIN_CONFIDENCE) -> bool:
        """Whether no flag is raised and the confidence of every segment is at least `least`."""
        return not self.flags and bool(np.all([segment.confidence >= least for segment in self.segments]))
