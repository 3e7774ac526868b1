"""What the search for signs finds: signs of segments and samples, and the evidence for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..types import Array, Frozen
from .result import Proof
from .rows.segments import Segment
from .samples.markov_chain import Refined
from .search.problem import Problem

SUSPECT, SYSTEMATIC = 0.15, 3.0  # residual over torque, and samples for one that is independent (noise alone: 1)


@dataclass(frozen=True, eq=False)
class Inferred(Frozen):
    """Signs of N samples, the S segments that are told, and all that says how far they can be trusted."""

    segments: tuple[Segment, ...]  # S
    signs: Array  # (S,) [1]
    confidence: Array  # (S,) [1]
    refined: Refined
    inflation: Array  # (n,) [1]
    threshold: Array  # (n,) [N.m or N]
    problem: Problem  # in variance units
    proof: Proof
    complete: bool  # whether every rival within the window was counted
    doubt: dict[int, float]  # per joint, probability that all its signs are the other way round
    impure: dict[int, int]  # per joint, segments in which torque changed its sign
    finer: bool  # whether the finer segments were used
    notes: tuple[str, ...]


class Choice(NamedTuple):
    """Signs of the segments of a problem, and how they were found."""

    signs: Array  # (S,) [1]
    coordinates: Array  # (r,) z [standard deviations]
    proof: Proof
    notes: tuple[str, ...] = ()


Choose = Callable[[Problem, Sequence[Segment]], Choice]
