"""Search over the signs of segments, repeated in standard deviations, and their posterior: confidence of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..types import Array, Frozen
from .observations import Observed
from .result import SignProof
from .samples.markov_chain import RefinedSigns, refine_signs
from .search.cone import PhysicalCone
from .search.exact import RivalSigns, SignSolution, enumerate_near, search_signs
from .search.problem import SignProblem, build_problem, friction_patterns, known_rows
from .segments import Segment, split_by_signs
from .thresholds import CONFIDENT, RECHECK_ROUNDS, RIVAL_WINDOW

UNCORRELATED = 0.05  # [1] autocorrelation from which later lags are ignored; tuned on logs and simulations
PAIRS = 0.1  # [share of the samples] smallest number of pairs that estimates a correlation; heuristic
LEAST_SAMPLES = 2  # [samples] of a part of a run; a single sample has no confidence of its own


def sign_confidence(problem: SignProblem, signs: Array, rivals: RivalSigns) -> Array:
    """Probability (S,) that each of the best signs (S,) [1] is right; 1 for the known segment.

    With a loss in squared standard deviations, p(s) ~ exp(-J_c(s)/2) is the posterior of the signs under a flat prior
    on the parameters, whose normalisation is the same for all s. The confidence of sign i is its marginal over the
    rivals, but at most 1 / (1 + exp(-dJ_i/2)) with dJ_i the rise of J when segment i alone is flipped. The problem is
    weighted by one over the standard deviation of independent samples.
    """
    weights, same, b = rivals.weights, rivals.signs == signs, problem.projections
    marginal = weights @ same / max(float(weights.sum()), 1e-300) if len(weights) else np.ones(problem.count)
    costs = 4 * signs * (b.T @ (b @ signs)) - 4 * np.sum(b**2, axis=0)  # dJ_i = 4 s_i b_i'B s - 4 |b_i|^2
    flipped = 1 / (1 + np.exp(np.clip(-costs / 2, -700, 700)))
    return np.where(problem.joints < 0, 1.0, np.minimum(marginal, flipped))


def joint_flip_probability(problem: SignProblem, signs: Array, rivals: RivalSigns) -> dict[int, float]:
    """Per joint, the probability that signs (S,) [1] are inverted in segments with more than half of its energy."""
    weights = rivals.weights
    total = max(float(weights.sum()), 1e-300)
    found = {}
    for joint in np.unique(problem.joints[problem.joints >= 0]).tolist():
        own = problem.joints == joint
        share = np.average(rivals.signs[:, own] != signs[own], axis=1, weights=problem.energies[own] + 1e-300)
        found[joint] = float(weights[share > 0.5].sum()) / total
    return found


def inflation(residual: Array, runs: Sequence[tuple[int, int]]) -> float:
    """Integrated autocorrelation time kappa of the residual (N,) [N.m or N] of one joint: at least 1 [1].

    It is 1 + 2 sum of correlations over pairs of samples within one run (start, stop), up to the first small one; so it
    is less than twice the length of the longest run. NaN in the residual: the sample is ignored.

    Source: Sokal, Monte Carlo methods in statistical mechanics, in: Functional Integration, 1997, section 3.
    """
    run = np.full(len(residual), -1)
    for k, (start, stop) in enumerate(runs):
        run[start:stop] = k
    inside = (run >= 0) & np.isfinite(residual)
    count, values = int(inside.sum()), np.where(inside, residual, 0.0)
    power = float(values @ values) / max(count, 1)
    longest, total = max((stop - start for start, stop in runs), default=0), 1.0
    for lag in range(1, longest if power > 0 else 0):
        pairs = inside[lag:] & inside[:-lag] & (run[lag:] == run[:-lag])
        if pairs.sum() < PAIRS * count:
            break
        correlation = float(np.mean((values[lag:] * values[:-lag])[pairs])) / power
        if correlation < UNCORRELATED:
            break
        total += 2 * correlation
    return total


@dataclass(frozen=True, eq=False)
class SegmentSearch(Frozen):
    """Search over the signs of any segments of some observations."""

    observed: Observed
    inequalities: Array  # (g, b) rows c with c'theta >= 0 [1 over units of base]
    seed: int = 0

    def cone(self, problem: SignProblem) -> PhysicalCone:
        """The physical cone in the coordinates of a problem."""
        return PhysicalCone.of(problem, self.inequalities)

    def solve(self, problem: SignProblem, segments: Sequence[Segment], start: Array | None = None) -> SignSolution:
        """The signs of lowest loss within the cone; start (S,) [1] may be good. `segments` lack the known one."""
        patterns = friction_patterns(problem, self.observed, segments)
        return search_signs(problem, self.cone(problem), patterns, start, seed=self.seed)


class RecheckedSigns(NamedTuple):
    """Segments, their problem weighted in standard deviations, its solution and its rivals."""

    segments: list[Segment]
    problem: SignProblem
    solution: SignSolution
    rivals: RivalSigns
    confidence: Array  # (S,) [1]


def recheck_signs(
    search: SegmentSearch, runs: Sequence[Segment], refined: RefinedSigns, weights: Array, free: bool
) -> RecheckedSigns:
    """Search again in standard deviations, from the signs that refinement gave, and enumerate the rivals.

    Runs are first split where refinement changes sign. If a part of a run is not certain, the second round takes the
    whole run as one segment. Parts that are uncertain only in the second round keep their confidence. Unless `free`,
    signs do not change, and only their rivals are enumerated. Of each joint's torque, weights (n,) [1/N.m or 1/N] are
    one over the standard deviation of independent samples.
    """
    known = known_rows(search.observed, weights)
    segments = [s for s in split_by_signs(runs, refined.signs) if s.length >= LEAST_SAMPLES]
    for left in reversed(range(RECHECK_ROUNDS)):
        problem = build_problem(search.observed, segments, weights, known)
        start = np.array([_majority(refined, s) for s in segments] + [1.0] * (problem.count - len(segments)))
        cone = search.cone(problem)
        solution = search.solve(problem, segments, start) if free else _unchanged(problem, cone, start)
        rivals = enumerate_near(problem, cone, solution, RIVAL_WINDOW)
        confidence = sign_confidence(problem, solution.signs, rivals)
        uncertain = {run for run in runs if _is_uncertain(run, segments, confidence)}
        if not uncertain or not left:
            break
        segments = sorted([*(s for s in segments if not any(_holds(run, s) for run in uncertain)), *uncertain])
    return RecheckedSigns(segments, problem, solution, rivals, confidence)


def apply_signs(observed: Observed, refined: RefinedSigns, rechecked: RecheckedSigns) -> RefinedSigns:
    """Give all samples of a segment the sign of the segment; refine again if a sign changed."""
    signs = rechecked.solution.signs[: len(rechecked.segments)]
    if any(_majority(refined, s) != sign for s, sign in zip(rechecked.segments, signs, strict=True)):
        refined = refine_signs(observed, rechecked.problem.back @ rechecked.solution.coordinates)
    samples = refined.signs.copy()
    for (joint, start, stop), sign in zip(rechecked.segments, signs, strict=True):
        samples[start:stop, joint] = sign
    return replace(refined, signs=samples)


def _majority(refined: RefinedSigns, segment: Segment) -> float:
    joint, start, stop = segment
    return 1.0 if refined.signs[start:stop, joint].sum() >= 0 else -1.0


def _is_uncertain(run: Segment, segments: Sequence[Segment], confidence: Array) -> bool:
    """Whether a run was split, and the confidence of one of its parts is low."""
    parts = [k for k, s in enumerate(segments) if _holds(run, s)]
    return segments[parts[0]] != run and min(confidence[parts]) < CONFIDENT if parts else False


def _holds(run: Segment, part: Segment) -> bool:
    return run.joint == part.joint and run.start <= part.start and part.stop <= run.stop


def _unchanged(problem: SignProblem, cone: PhysicalCone, signs: Array) -> SignSolution:
    """Given signs as a solution without proof."""
    z = problem.coordinates(signs)
    squared, nearest = cone.distance(z)
    return SignSolution(signs, nearest, problem.loss(signs) + squared, SignProof(False, 1.0, 0), np.zeros((len(z), 0)))
