"""Signs of segments and samples as the search infers them, with the evidence for flags."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..types import Array, Frozen
from .result import SignProof
from .rows.segments import Segment
from .samples.markov_chain import RefinedSigns
from .search.problem import SignProblem


@dataclass(frozen=True, eq=False)
class Inferred(Frozen):
    """Signs of S segments and N samples of n joints, their confidence, and the evidence for flags."""

    segments: tuple[Segment, ...]  # S
    signs: Array  # (S,) s [1]
    confidence: Array  # (S,) [1]
    refined: RefinedSigns
    inflation: Array  # (n,) kappa, samples per independent sample of the residual [1]
    threshold: Array  # (n,) [N.m or N]
    problem: SignProblem  # weighted in standard deviations
    proof: SignProof
    complete: bool  # whether every rival within the window was enumerated
    flip_probability: dict[int, float]  # joint -> probability that all its signs are inverted
    impure: dict[int, int]  # joint -> segments in which torque changed its sign
    finer: bool  # whether segments between low minima were used
    notes: tuple[str, ...]


class SignChoice(NamedTuple):
    """Signs of the segments of a problem, and how they were found."""

    signs: Array  # (S,) s [1]
    coordinates: Array  # (r,) z [standard deviations]
    proof: SignProof
    notes: tuple[str, ...] = ()


ChooseSigns = Callable[[SignProblem, Sequence[Segment]], SignChoice]
