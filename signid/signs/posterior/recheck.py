"""Signs that were found -> judged in variance units: searched again, their rivals counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...regression.rows import Task
from ...types import Array
from ..result import SignProof
from ..rows.observations import Observed
from ..rows.segments import Segment, cut_by_signs
from ..samples.markov_chain import RefinedSigns, refine_signs
from ..search.cone import PhysicalCone
from ..search.exact import RivalSigns, SignSolution, enumerate_near, search_signs
from ..search.friction import friction_patterns, friction_prior
from ..search.problem import KnownRows, SignProblem, pose, signed_rows
from .confidence import WINDOW, sign_confidence

CERTAIN = 0.999  # confidence that the parts of a run need, to be told apart
ROUNDS = 2  # of joining runs again whose parts are not certain


class RecheckedSigns(NamedTuple):
    """Segments judged in variance units."""

    segments: list[Segment]
    problem: SignProblem
    found: SignSolution
    rivals: RivalSigns
    confidence: Array  # (S,) [1]


def recheck_signs(
    task: Task,
    observed: Observed,
    runs: Sequence[Segment],
    refined: RefinedSigns,
    weights: Array,
    rows: Array,
    seed: int,
    free: bool,
) -> RecheckedSigns:
    """Search again in variance units, from the signs that refinement gave, and count the rivals.

    A run that refinement cut is judged whole in a second round where its parts are not certain in the first. Parts
    that are not certain in the second keep the confidence that they have.

    Args:
        task: what the rows were made for.
        observed: the rows.
        runs: segments above the threshold.
        refined: signs of all samples.
        weights: (n,) [1/N.m or 1/N] of each joint's torque, one over the deviation of independent samples.
        rows: (g, b) of the physical cone [1 over units of base].
        seed: of the search.
        free: whether signs may change; else they stay, and only their rivals are counted.
    """
    told = [s for s in cut_by_signs(observed, runs, refined.signs) if s.stop - s.start >= 2]
    known = known_rows(task, observed, weights)
    for left in reversed(range(ROUNDS)):
        problem = pose(observed, told, weights, known)
        cone = PhysicalCone.of(problem, rows)
        start = np.array([_majority(refined, s) for s in told] + [1.0] * (problem.count - len(told)))
        if free:
            found = search_signs(problem, cone, friction_patterns(problem, observed, told), start, seed=seed)
        else:
            found = _unchanged(problem, cone, start)
        rivals = enumerate_near(problem, cone, found, WINDOW)
        confidence = sign_confidence(problem, found.signs, rivals.signs, rivals.losses)
        doubtful = {run for run in runs if _is_doubtful(run, told, confidence)}
        if not doubtful or not left:
            break
        told = [s for s in told if not any(_holds(run, s) for run in doubtful)]
        told = sorted([*told, *doubtful])
    return RecheckedSigns(told, problem, found, rivals, confidence)


def _majority(refined: RefinedSigns, segment: Segment) -> float:
    joint, start, stop = segment
    return 1.0 if refined.signs[start:stop, joint].sum() >= 0 else -1.0


def _is_doubtful(run: Segment, told: Sequence[Segment], confidence: Array) -> bool:
    parts = [k for k, s in enumerate(told) if _holds(run, s)]
    return told[parts[0]] != run and min(confidence[parts]) < CERTAIN if parts else False


def _holds(run: Segment, part: Segment) -> bool:
    return run.joint == part.joint and run.start <= part.start and part.stop <= run.stop


def apply_signs(observed: Observed, refined: RefinedSigns, rechecked: RecheckedSigns) -> RefinedSigns:
    """The signs of samples, in each segment that of the segment."""
    count = len(rechecked.segments)
    turned = any(
        _majority(refined, s) != x for s, x in zip(rechecked.segments, rechecked.found.signs[:count], strict=True)
    )
    if turned:
        value = rechecked.problem.back @ rechecked.found.coordinates
        refined = refine_signs(observed, 1 / observed.scale, value)
    start = refined.signs.copy()
    for (joint, begin, stop), sign in zip(rechecked.segments, rechecked.found.signs[:count], strict=True):
        start[begin:stop, joint] = sign
    return replace(refined, signs=start)


def _unchanged(problem: SignProblem, cone: PhysicalCone, signs: Array) -> SignSolution:
    """Signs as they are, as if a search had ended with them."""
    z = problem.coordinates(signs)
    squared, nearest = cone.distance(z)
    return SignSolution(signs, nearest, problem.loss(signs) + squared, SignProof(False, 1.0, 0), np.zeros((len(z), 0)))


def known_rows(task: Task, observed: Observed, weights: Array) -> KnownRows:
    """Rows with a known right side: joints whose torque has its sign, and weak beliefs on friction.

    Args:
        task: what the rows were made for.
        observed: the rows.
        weights: (n,) [1/N.m or 1/N] of each joint's torque.
    """
    parts = [signed_rows(observed, weights), friction_prior(task, observed, weights)]
    return KnownRows(np.concatenate([p.matrix for p in parts]), np.concatenate([p.target for p in parts]))
