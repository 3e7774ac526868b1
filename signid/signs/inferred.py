"""What the search for signs finds: signs of segments and samples, and the evidence for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..types import Array, Frozen
from .result import SignProof
from .rows.segments import Segment
from .samples.markov_chain import RefinedSigns
from .search.problem import SignProblem

SUSPECT, SYSTEMATIC = 0.15, 3.0  # residual over torque, and samples for one that is independent (noise alone: 1)


@dataclass(frozen=True, eq=False)
class Inferred(Frozen):
    """Signs of N samples, the S segments that are told, and all that says how far they can be trusted."""

    segments: tuple[Segment, ...]  # S
    signs: Array  # (S,) [1]
    confidence: Array  # (S,) [1]
    refined: RefinedSigns
    inflation: Array  # (n,) [1]
    threshold: Array  # (n,) [N.m or N]
    problem: SignProblem  # in variance units
    proof: SignProof
    complete: bool  # whether every rival within the window was counted
    flip_probability: dict[int, float]  # per joint, probability that all its signs are the other way round
    impure: dict[int, int]  # per joint, segments in which torque changed its sign
    finer: bool  # whether the finer segments were used
    notes: tuple[str, ...]


class SignChoice(NamedTuple):
    """Signs of the segments of a problem, and how they were found."""

    signs: Array  # (S,) [1]
    coordinates: Array  # (r,) z [standard deviations]
    proof: SignProof
    notes: tuple[str, ...] = ()


ChooseSigns = Callable[[SignProblem, Sequence[Segment]], SignChoice]
