"""What is known about signs that were lost, and how far it can be trusted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..types import Array, Frozen, Indices

NOTHING = 0.995  # gap from which on nothing is proved


class SignProof(NamedTuple):
    """Whether the signs of the segments are the best there are."""

    optimal: bool
    gap: float  # share by which better signs could lower the loss at most, 0 where optimal
    nodes: int  # of the tree that were looked at
    certified: bool = False  # by eigenvalues alone, without the tree

    @property
    def has_bound(self) -> bool:
        """Whether anything is known about signs that were not looked at."""
        return self.gap < NOTHING


class SignSegment(NamedTuple):
    """A stretch of one joint's torque that keeps one sign."""

    part: int  # of which recording
    joint: int
    start: float  # [s]
    end: float  # [s]
    sign: int  # +1 or -1
    confidence: float  # probability that the sign is right, where no flag is raised


class Gain(NamedTuple):
    """A torque constant that was not known."""

    joint: str
    value: float  # [unit]
    std: float  # [unit]
    unit: str = "N.m/A"


@dataclass(frozen=True, eq=False)
class Trace(Frozen):
    """One recording's torque with the signs found, on a thinned grid: N samples of n joints."""

    path: str
    t: Array  # (N,) [s]
    first: Indices  # (k,) samples at which a span begins
    magnitude: Array  # (N, n) [N.m or N] as recorded
    signs: Array  # (N, n) [1]
    predicted: Array  # (N, n) [N.m or N] of the model found with the signs


@dataclass(frozen=True, eq=False)
class Signs(Frozen):
    """Signs of torques that were recorded without them. `flags` say when they are not to be trusted."""

    joints: tuple[str, ...]  # n of the robot
    hidden: tuple[int, ...]  # those whose torque had no sign
    method: str  # "exact" or "tree"
    segments: tuple[SignSegment, ...]  # in the order of recording, joint and time
    threshold: Array  # (n,) [N.m or N] below which a sample belongs to no segment; 0 where the sign was recorded
    proof: SignProof
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    value: Array  # (b,) base parameters that the signs were found with [units of base]
    noise: Array  # (n,) [N.m or N] of the residual
    inflation: Array  # (n,) samples for one that is independent of the others [1]
    traces: tuple[Trace, ...]  # of every recording
    gains: tuple[Gain, ...] = ()
    seed: int = 0

    def of(self, joint: int) -> tuple[SignSegment, ...]:
        """The segments of one joint."""
        return tuple(told for told in self.segments if told.joint == joint)

    def is_certain(self, least: float = 0.999) -> bool:
        """Whether nothing is flagged and every segment reaches a confidence."""
        return not self.flags and bool(np.all([told.confidence >= least for told in self.segments]))
