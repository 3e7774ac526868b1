"""Rows -> signs, by the exact search: segments, boolean least squares within physics, refinement, confidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..regression.rows import Task
from ..types import Array, Frozen
from .inferred import SUSPECT, SYSTEMATIC, ChooseSigns, Inferred, SignChoice
from .posterior.confidence import inflation, joint_flip_probability
from .posterior.recheck import apply_signs, known_rows, recheck_signs
from .rows.observations import Observed
from .rows.segments import Segment, cut_by_signs, minimum_cuts, split_impure, threshold_runs
from .samples.markov_chain import RefinedSigns, refine_signs
from .search.cone import PhysicalCone, cone_inequalities
from .search.exact import search_signs
from .search.friction import friction_patterns
from .search.problem import KnownRows, SignProblem, pose, signed_rows

SPLITS = 3  # rounds of cutting segments in which the model changes sign
LEAST_NOISE = 1e-3  # of the rms torque: no residual counts as smaller when confidence is judged


@dataclass(frozen=True, eq=False)
class _Attempt(Frozen):
    segments: tuple[Segment, ...]
    choice: SignChoice
    refined: RefinedSigns
    cuts: int


def infer(task: Task, observed: Observed, seed: int = 0, choose: ChooseSigns | None = None) -> Inferred:
    """Signs of the hidden joints.

    Args:
        task: what the rows were made for.
        observed: the rows.
        seed: of everything random.
        choose: another search for the signs of segments, which then stay and are not proved; the exact one by default.

    Raises:
        RecordingError: a torque has no segment.
    """
    segments, threshold = threshold_runs(observed)
    cone, finer = cone_inequalities(task, observed, seed), False
    if choose is None:
        attempt, finer = _exactly(task, observed, segments, cone, seed)
    else:
        attempt = _attempt(observed, segments, choose, signed_rows(observed, 1 / observed.scale), splits=1)
    refined = attempt.refined
    kappa = _inflations(observed, refined, cut_by_signs(observed, segments, refined.signs))
    sigma = np.maximum(refined.sigma, LEAST_NOISE * observed.scale)
    rechecked = recheck_signs(
        task, observed, segments, refined, 1 / (sigma * np.sqrt(kappa)), cone, seed, choose is None
    )
    told, proof = rechecked.segments, rechecked.found.proof if choose is None else attempt.choice.proof
    count, signs = len(told), rechecked.found.signs
    return Inferred(
        segments=tuple(told),
        signs=signs[:count],
        confidence=rechecked.confidence[:count],
        refined=apply_signs(observed, refined, rechecked),
        inflation=kappa,
        threshold=threshold,
        problem=rechecked.problem,
        proof=proof,
        complete=rechecked.rivals.complete,
        flip_probability=joint_flip_probability(
            rechecked.problem, signs, rechecked.rivals.signs, rechecked.rivals.losses
        ),
        impure=_impure(segments, told),
        finer=finer,
        notes=attempt.choice.notes,
    )


def _exactly(
    task: Task, observed: Observed, segments: Sequence[Segment], cone: Array, seed: int
) -> tuple[_Attempt, bool]:
    """Runs above the threshold first; stretches between minima where those hid changes of sign, if they do better."""
    known = known_rows(task, observed, 1 / observed.scale)

    def choose(problem: SignProblem, segments: Sequence[Segment]) -> SignChoice:
        found = search_signs(
            problem, PhysicalCone.of(problem, cone), friction_patterns(problem, observed, segments), seed=seed
        )
        return SignChoice(found.signs, found.coordinates, found.proof)

    attempt = _attempt(observed, segments, choose, known)
    if attempt.cuts or _is_suspect(observed, attempt):
        other = _attempt(observed, minimum_cuts(observed), choose, known)
        if other.refined.loss < attempt.refined.loss:
            return other, True
    return attempt, False


def _attempt(
    observed: Observed, segments: Sequence[Segment], choose: ChooseSigns, known: KnownRows, splits: int = SPLITS
) -> _Attempt:
    """Search, cut segments in which the model changes sign, search again; then the signs of all samples."""
    weights, total = 1 / observed.scale, 0
    for _ in range(splits):
        problem = pose(observed, segments, weights, known)
        choice = choose(problem, segments)
        predicted = observed.predict(problem.back @ choice.coordinates)
        noise = np.sqrt(np.mean((np.abs(predicted) - np.abs(observed.torque)) ** 2, axis=0))
        segments, cuts = split_impure(observed, segments, predicted, noise)
        total += cuts
        if not cuts:
            break
    return _Attempt(tuple(segments), choice, refine_signs(observed, weights, problem.back @ choice.coordinates), total)


def _is_suspect(observed: Observed, attempt: _Attempt) -> bool:
    """Whether some joint's residual is large, and not as noise is."""
    share = attempt.refined.sigma / observed.scale
    return bool(np.any((share > SUSPECT) & (_inflations(observed, attempt.refined, attempt.segments) > SYSTEMATIC)))


def _inflations(observed: Observed, refined: RefinedSigns, told: Sequence[Segment]) -> Array:
    residual = refined.signs * np.abs(observed.torque) - observed.predict(refined.value)
    residual[~observed.steady] = np.nan  # friction near a reversal is another matter
    kappa = np.ones(len(observed.joints))
    for joint in observed.hidden:
        kappa[joint] = inflation(residual[:, joint], [(s.start, s.stop) for s in told if s.joint == joint])
    return kappa


def _impure(runs: Sequence[Segment], told: Sequence[Segment]) -> dict[int, int]:
    cut = [run.joint for run in runs if run not in set(told)]
    return {joint: cut.count(joint) for joint in sorted(set(cut))}
