"""Second search, weighted in standard deviations, from the signs that refinement gave; its rivals are enumerated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...types import Array
from ..result import SignProof
from ..rows.observations import Observed
from ..rows.segments import Segment, split_by_signs
from ..samples.markov_chain import RefinedSigns, refine_signs
from ..search.cone import PhysicalCone
from ..search.exact import RivalSigns, SignSolution, enumerate_near
from ..search.problem import SignProblem
from ..search.segment_search import SegmentSearch
from ..thresholds import CONFIDENT, RECHECK_ROUNDS, RIVAL_WINDOW
from .confidence import sign_confidence

LEAST_SAMPLES = 2  # [samples] of a part of a run; a single sample has no confidence of its own


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
    whole run as one segment. Parts that are uncertain only in the second round keep their confidence.

    Args:
        search: search over the signs of segments.
        runs: segments above the threshold.
        refined: signs of all samples.
        weights: (n,) [1/N.m or 1/N] one over the standard deviation of independent samples of each joint's torque.
        free: whether signs may change; else only their rivals are enumerated.
    """
    segments = [s for s in split_by_signs(search.observed, runs, refined.signs) if s.stop - s.start >= LEAST_SAMPLES]
    for left in reversed(range(RECHECK_ROUNDS)):
        problem = search.build(segments, weights)
        start = np.array([_majority(refined, s) for s in segments] + [1.0] * (problem.count - len(segments)))
        cone = search.cone(problem)
        solution = search.solve(problem, segments, start) if free else _unchanged(problem, cone, start)
        rivals = enumerate_near(problem, cone, solution, RIVAL_WINDOW)
        confidence = sign_confidence(problem, solution.signs, rivals)
        uncertain = {run for run in runs if _is_uncertain(run, segments, confidence)}
        if not uncertain or not left:
            break
        segments = [s for s in segments if not any(_holds(run, s) for run in uncertain)]
        segments = sorted([*segments, *uncertain])
    return RecheckedSigns(segments, problem, solution, rivals, confidence)


def apply_signs(observed: Observed, refined: RefinedSigns, rechecked: RecheckedSigns) -> RefinedSigns:
    """Give all samples of a segment the sign of the segment; refine again if a sign changed.

    Args:
        observed: observations.
        refined: signs of all samples before.
        rechecked: signs of the segments.
    """
    signs = rechecked.solution.signs[: len(rechecked.segments)]
    if any(_majority(refined, s) != sign for s, sign in zip(rechecked.segments, signs, strict=True)):
        value = rechecked.problem.back @ rechecked.solution.coordinates
        refined = refine_signs(observed, 1 / observed.scale, value)
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
