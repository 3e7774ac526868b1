"""Rows -> signs: segments, exact search within the physical cone, refinement of samples, confidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..regression.rows import Task
from ..types import Array, Frozen
from .observations import Observed
from .posterior import SegmentSearch, apply_signs, inflation, joint_flip_probability, recheck_signs
from .result import SignProof
from .samples.markov_chain import RefinedSigns, refine_signs
from .search.cone import cone_inequalities
from .search.problem import KnownRows, SignProblem, build_problem, known_rows, signed_rows
from .segments import Segment, runs_between_minima, split_by_signs, split_impure, threshold_runs
from .thresholds import CORRELATED_RESIDUAL, LARGE_RESIDUAL, NOISE_FLOOR, SPLIT_ROUNDS


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


@dataclass(frozen=True, eq=False)
class _Attempt(Frozen):
    """First search, weighted by rms torque, and the refinement from it."""

    segments: tuple[Segment, ...]
    choice: SignChoice
    refined: RefinedSigns
    splits: int
    finer: bool = False  # whether segments are runs between minima


def infer(task: Task, observed: Observed, seed: int = 0, choose: ChooseSigns | None = None) -> Inferred:
    """Infer the signs of the joints whose torque has none.

    The problem is solved twice: weighted by the rms torque of the joints, to start the refinement of samples, then in
    standard deviations, from which signs, confidence and (for the exact search) the proof are reported. With another
    first search, `choose`, its signs stay and its proof is reported.
    """
    segments, threshold = threshold_runs(observed)
    search = SegmentSearch(observed, cone_inequalities(task, observed, seed), seed)
    if choose is None:
        attempt = _search_exactly(search, segments)
    else:
        attempt = _attempt(observed, segments, choose, signed_rows(observed, 1 / observed.scale), rounds=1)
    refined = attempt.refined
    pure = tuple(split_by_signs(segments, refined.signs))
    kappa = _inflations(observed, replace(attempt, segments=pure))
    sigma = np.maximum(refined.sigma, NOISE_FLOOR * observed.scale)
    rechecked = recheck_signs(search, segments, refined, 1 / (sigma * np.sqrt(kappa)), choose is None)
    solution, count = rechecked.solution, len(rechecked.segments)
    split = [run.joint for run in segments if run not in set(rechecked.segments)]
    return Inferred(
        segments=tuple(rechecked.segments),
        signs=solution.signs[:count],
        confidence=rechecked.confidence[:count],
        refined=apply_signs(observed, refined, rechecked),
        inflation=kappa,
        threshold=threshold,
        problem=rechecked.problem,
        proof=solution.proof if choose is None else attempt.choice.proof,
        complete=rechecked.rivals.complete,
        flip_probability=joint_flip_probability(rechecked.problem, solution.signs, rechecked.rivals),
        impure={joint: split.count(joint) for joint in sorted(set(split))},
        finer=attempt.finer,
        notes=attempt.choice.notes,
    )


def _search_exactly(search: SegmentSearch, segments: Sequence[Segment]) -> _Attempt:
    """Search the runs above the threshold; if they hid changes of sign, also runs between minima; keep the better."""
    observed = search.observed
    known = known_rows(observed, 1 / observed.scale)

    def choose(problem: SignProblem, segments: Sequence[Segment]) -> SignChoice:
        solution = search.solve(problem, segments)
        return SignChoice(solution.signs, solution.coordinates, solution.proof)

    attempt = _attempt(observed, segments, choose, known)
    large = attempt.refined.sigma / observed.scale > LARGE_RESIDUAL
    if attempt.splits or np.any(large & (_inflations(observed, attempt) > CORRELATED_RESIDUAL)):
        other = _attempt(observed, runs_between_minima(observed), choose, known)
        if other.refined.loss < attempt.refined.loss:
            return replace(other, finer=True)
    return attempt


def _attempt(
    observed: Observed, segments: Sequence[Segment], choose: ChooseSigns, known: KnownRows, rounds: int = SPLIT_ROUNDS
) -> _Attempt:
    """Search, split segments in which the model changes sign, and search again; then refine the signs of samples."""
    weights, total = 1 / observed.scale, 0
    for _ in range(rounds):
        problem = build_problem(observed, segments, weights, known)
        choice = choose(problem, segments)
        predicted = observed.predict(problem.back @ choice.coordinates)
        noise = np.sqrt(np.mean((np.abs(predicted) - np.abs(observed.torque)) ** 2, axis=0))
        segments, splits = split_impure(observed, segments, predicted, noise)
        total += splits
        if not splits:
            break
    return _Attempt(tuple(segments), choice, refine_signs(observed, problem.back @ choice.coordinates), total)


def _inflations(observed: Observed, attempt: _Attempt) -> Array:
    """Autocorrelation time kappa (n,) of each joint's residual inside its segments, away from reversals [1]."""
    refined, segments = attempt.refined, attempt.segments
    residual = refined.signs * np.abs(observed.torque) - observed.predict(refined.value)
    residual[~observed.steady] = np.nan
    kappa = np.ones(len(observed.joints))
    for joint in observed.hidden:
        kappa[joint] = inflation(residual[:, joint], [(s.start, s.stop) for s in segments if s.joint == joint])
    return kappa
