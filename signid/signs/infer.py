"""Rows -> signs, by the exact search: segments, boolean least squares within physics, refinement, confidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..rows import Task
from ..types import Array, Frozen
from .believed import believe
from .chain import Refined, refine
from .cone import Cone, physical_cone
from .confidence import WINDOW, joint_doubt, judge_confidence
from .exact import Found, enumerate_near, search
from .friction import friction_moves
from .inflation import inflation
from .observed import Observed
from .problem import Problem, Rows, Segment, pose, signed_rows
from .result import Proof
from .segments import cut_by_signs, minimum_cuts, split_impure, threshold_runs

SPLITS = 3  # rounds of cutting segments in which the model changes sign
LEAST_NOISE = 1e-3  # of the rms torque: no residual counts as smaller when confidence is judged
SUSPECT, SYSTEMATIC = 0.15, 3.0  # residual over torque, and samples for one that is independent: finer segments then


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


@dataclass(frozen=True, eq=False)
class _Attempt(Frozen):
    segments: tuple[Segment, ...]
    found: Found
    refined: Refined
    cuts: int


def infer(task: Task, observed: Observed, seed: int = 0) -> Inferred:
    """Signs of the hidden joints.

    Raises:
        RecordingError: a torque has no segment.
    """
    segments, threshold = threshold_runs(observed)
    rows = physical_cone(task, observed, seed)
    attempt = _attempt(task, observed, segments, rows, seed)
    finer = False
    if attempt.cuts or _is_suspect(observed, attempt):
        other = _attempt(task, observed, minimum_cuts(observed), rows, seed)
        if other.refined.loss < attempt.refined.loss:
            attempt, finer = other, True
    return _judged(task, observed, attempt, segments, threshold, rows, seed, finer)


def scales(observed: Observed) -> Array:
    """(n,) rms torque of each joint [N.m or N], 1 where there is none."""
    rms = np.sqrt(np.mean(observed.torque**2, axis=0))
    return np.where(rms > 0, rms, 1.0)


def _attempt(task: Task, observed: Observed, segments: Sequence[Segment], rows: Array, seed: int) -> _Attempt:
    weights = 1 / scales(observed)
    known, total = _known(task, observed, weights), 0
    for _ in range(SPLITS):
        problem = pose(observed, segments, weights, known)
        found = search(problem, Cone.of(problem, rows), _moves(problem, observed, segments), seed=seed)
        predicted = observed.predict(problem.back @ found.coordinates)
        noise = np.sqrt(np.mean((np.abs(predicted) - np.abs(observed.torque)) ** 2, axis=0))
        segments, cuts = split_impure(observed, segments, predicted, noise)
        total += cuts
        if not cuts:
            break
    refined = refine(observed, weights, problem.back @ found.coordinates)
    return _Attempt(tuple(segments), found, refined, total)


def _judged(
    task: Task,
    observed: Observed,
    attempt: _Attempt,
    runs: Sequence[Segment],
    threshold: Array,
    rows: Array,
    seed: int,
    finer: bool,
) -> Inferred:
    """Search again in variance units, from the signs that refinement gave, and count the rivals."""
    refined = attempt.refined
    told = cut_by_signs(observed, runs, refined.signs)
    told = [s for s in told if s.stop - s.start >= 2]
    kappa = _inflations(observed, refined, told)
    sigma = np.maximum(refined.sigma, LEAST_NOISE * scales(observed))
    weights = 1 / (sigma * np.sqrt(kappa))
    problem = pose(observed, told, weights, _known(task, observed, weights))
    cone = Cone.of(problem, rows)
    start = np.array([refined.signs[s.start, s.joint] for s in told] + [1.0] * (problem.count - len(told)))
    found = search(problem, cone, _moves(problem, observed, told), (start,), seed=seed)
    rivals = enumerate_near(problem, cone, found, WINDOW)
    confidence = judge_confidence(problem, found.signs, rivals.signs, rivals.losses)
    if np.any(found.signs != start):
        refined = refine(observed, 1 / scales(observed), problem.back @ found.coordinates)
    return Inferred(
        segments=tuple(told),
        signs=found.signs[: len(told)],
        confidence=confidence[: len(told)],
        refined=refined,
        inflation=kappa,
        threshold=threshold,
        problem=problem,
        proof=found.proof,
        complete=rivals.complete,
        doubt=joint_doubt(problem, found.signs, rivals.signs, rivals.losses),
        impure=_impure(runs, told),
        finer=finer,
    )


def _moves(problem: Problem, observed: Observed, segments: Sequence[Segment]) -> list[Array]:
    spare = problem.count - len(segments)
    return [np.append(move, np.zeros(spare)) for move in friction_moves(observed, segments)]


def _known(task: Task, observed: Observed, weights: Array) -> Rows:
    parts = [signed_rows(observed, weights), believe(task, observed, weights)]
    return Rows(np.concatenate([p.matrix for p in parts]), np.concatenate([p.target for p in parts]))


def _is_suspect(observed: Observed, attempt: _Attempt) -> bool:
    """Whether some joint's residual is large, and not as noise is."""
    share = attempt.refined.sigma / scales(observed)
    return bool(np.any((share > SUSPECT) & (_inflations(observed, attempt.refined, attempt.segments) > SYSTEMATIC)))


def _inflations(observed: Observed, refined: Refined, told: Sequence[Segment]) -> Array:
    residual = refined.signs * np.abs(observed.torque) - observed.predict(refined.value)
    residual[~observed.steady] = np.nan  # friction near a reversal is another matter
    kappa = np.ones(len(observed.joints))
    for joint in observed.hidden:
        kappa[joint] = inflation(residual[:, joint], [(s.start, s.stop) for s in told if s.joint == joint])
    return kappa


def _impure(runs: Sequence[Segment], told: Sequence[Segment]) -> dict[int, int]:
    cut = [run.joint for run in runs if run not in set(told)]
    return {joint: cut.count(joint) for joint in sorted(set(cut))}
