"""Exact search over the signs of some segments, within the physical cone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...types import Array, Frozen
from ..rows.observations import Observed
from ..rows.segments import Segment
from .cone import PhysicalCone
from .exact import SignSolution, search_signs
from .friction import friction_patterns, known_rows
from .problem import SignProblem, build_problem


@dataclass(frozen=True, eq=False)
class SegmentSearch(Frozen):
    """Search over the signs of any segments of some observations."""

    observed: Observed
    inequalities: Array  # (g, b) rows c with c'theta >= 0 [1 over units of base]
    seed: int = 0

    def build(self, segments: Sequence[Segment], weights: Array) -> SignProblem:
        """Boolean least squares of the segments, with signed joints and the friction prior as known segment.

        Args:
            segments: segments of the joints whose torque has no sign.
            weights: (n,) [1/N.m or 1/N] weight of each joint's torque.
        """
        return build_problem(self.observed, segments, weights, known_rows(self.observed, weights))

    def cone(self, problem: SignProblem) -> PhysicalCone:
        """The physical cone in the coordinates of a problem."""
        return PhysicalCone.of(problem, self.inequalities)

    def solve(self, problem: SignProblem, segments: Sequence[Segment], start: Array | None = None) -> SignSolution:
        """The signs of lowest loss within the cone.

        Args:
            problem: boolean least squares of the segments.
            segments: its segments, without the known one.
            start: (S,) [1] signs that may be good.
        """
        patterns = friction_patterns(problem, self.observed, segments)
        return search_signs(problem, self.cone(problem), patterns, start, seed=self.seed)
