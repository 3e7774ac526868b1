"""Rows -> signs: segments, exact search within the physical cone, refinement of samples, posterior confidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..regression.rows import Task
from ..types import Array, Frozen
from .branch_and_bound import PhysicalCone, cone_inequalities
from .exact import RivalSigns, SignSolution, enumerate_near, search_signs
from .observations import Observations, Segment, runs_between_minima, split_by_signs, split_impure, threshold_runs
from .problem import KnownRows, SignProblem, build_sign_problem, friction_patterns, known_rows, signed_rows
from .result import CERTAIN_CONFIDENCE, SignProof
from .samples import RefinedSigns, refine_signs

MAX_SPLITS = 3  # [rounds] of search and splitting; heuristic
RIVAL_WINDOW = 24.0  # [squared standard deviations] of excess loss: a rival beyond it weighs less than exp(-12) = 6e-6
NOISE_FLOOR = 1e-3  # [rms torque] smallest residual that the posterior assumes; heuristic
RECHECK_ROUNDS = 2  # [rounds] of the search in variance units; heuristic
MAX_RESIDUAL_SHARE = 0.15  # [rms torque] rms residual of a model that lacks physics; heuristic
MAX_RESIDUAL_KAPPA = 3.0  # [samples per independent one] of a systematic residual; white noise has 1, logs had 3 to 40
MIN_AUTOCORRELATION = 0.05  # [1] autocorrelation from which later lags are ignored; tuned on logs and simulations
MIN_PAIR_SHARE = 0.1  # [share of the samples] smallest number of pairs that estimates a correlation; heuristic
MIN_PART_SAMPLES = 2  # [samples] of a part of a run; a single sample has no confidence of its own


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
    probabilities = {}
    for joint in np.unique(problem.joints[problem.joints >= 0]).tolist():
        own = problem.joints == joint
        share = np.average(rivals.signs[:, own] != signs[own], axis=1, weights=problem.energies[own] + 1e-300)
        probabilities[joint] = float(weights[share > 0.5].sum()) / total
    return probabilities


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
        if pairs.sum() < MIN_PAIR_SHARE * count:
            break
        correlation = float(np.mean((values[lag:] * values[:-lag])[pairs])) / power
        if correlation < MIN_AUTOCORRELATION:
            break
        total += 2 * correlation
    return total


@dataclass(frozen=True, eq=False)
class SegmentSearch(Frozen):
    """Search over the signs of any segments of some observations."""

    observed: Observations
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
    segments = [s for s in split_by_signs(runs, refined.signs) if s.length >= MIN_PART_SAMPLES]
    for left in reversed(range(RECHECK_ROUNDS)):
        problem = build_sign_problem(search.observed, segments, weights, known)
        start = np.array([_majority_sign(refined, s) for s in segments] + [1.0] * (problem.count - len(segments)))
        cone = search.cone(problem)
        if free:
            solution = search.solve(problem, segments, start)
        else:  # the given signs, without proof
            z = problem.coordinates(start)
            squared, nearest = cone.distance(z)
            loss, proof = problem.loss(start) + squared, SignProof(False, 1.0, 0)
            solution = SignSolution(start, nearest, loss, proof, np.zeros((len(z), 0)))
        rivals = enumerate_near(problem, cone, solution, RIVAL_WINDOW)
        confidence = sign_confidence(problem, solution.signs, rivals)
        uncertain = {run for run in runs if _is_uncertain(run, segments, confidence)}
        if not uncertain or not left:
            break
        segments = sorted([*(s for s in segments if not any(_contains(run, s) for run in uncertain)), *uncertain])
    return RecheckedSigns(segments, problem, solution, rivals, confidence)


def apply_signs(observed: Observations, refined: RefinedSigns, rechecked: RecheckedSigns) -> RefinedSigns:
    """Give all samples of a segment the sign of the segment; refine again if a sign changed."""
    signs = rechecked.solution.signs[: len(rechecked.segments)]
    if any(_majority_sign(refined, s) != sign for s, sign in zip(rechecked.segments, signs, strict=True)):
        refined = refine_signs(observed, rechecked.problem.back @ rechecked.solution.coordinates)
    samples = refined.signs.copy()
    for (joint, start, stop), sign in zip(rechecked.segments, signs, strict=True):
        samples[start:stop, joint] = sign
    return replace(refined, signs=samples)


def _majority_sign(refined: RefinedSigns, segment: Segment) -> float:
    joint, start, stop = segment
    return 1.0 if refined.signs[start:stop, joint].sum() >= 0 else -1.0


def _is_uncertain(run: Segment, segments: Sequence[Segment], confidence: Array) -> bool:
    """Whether a run was split, and the confidence of one of its parts is low."""
    parts = [k for k, s in enumerate(segments) if _contains(run, s)]
    return segments[parts[0]] != run and min(confidence[parts]) < CERTAIN_CONFIDENCE if parts else False


def _contains(run: Segment, part: Segment) -> bool:
    return run.joint == part.joint and run.start <= part.start and part.stop <= run.stop


@dataclass(frozen=True, eq=False)
class InferredSigns(Frozen):
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


def infer(task: Task, observed: Observations, seed: int = 0, choose: ChooseSigns | None = None) -> InferredSigns:
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
    return InferredSigns(
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
    large = attempt.refined.sigma / observed.scale > MAX_RESIDUAL_SHARE
    if attempt.splits or np.any(large & (_inflations(observed, attempt) > MAX_RESIDUAL_KAPPA)):
        other = _attempt(observed, runs_between_minima(observed), choose, known)
        if other.refined.loss < attempt.refined.loss:
            return replace(other, finer=True)
    return attempt


def _attempt(
    observed: Observations, segments: Sequence[Segment], choose: ChooseSigns, known: KnownRows, rounds: int = MAX_SPLITS
) -> _Attempt:
    """Search, split segments in which the model changes sign, and search again; then refine the signs of samples."""
    weights, total = 1 / observed.scale, 0
    for _ in range(rounds):
        problem = build_sign_problem(observed, segments, weights, known)
        choice = choose(problem, segments)
        predicted = observed.predict(problem.back @ choice.coordinates)
        noise = np.sqrt(np.mean((np.abs(predicted) - np.abs(observed.torque)) ** 2, axis=0))
        segments, splits = split_impure(observed, segments, predicted, noise)
        total += splits
        if not splits:
            break
    return _Attempt(tuple(segments), choice, refine_signs(observed, problem.back @ choice.coordinates), total)


def _inflations(observed: Observations, attempt: _Attempt) -> Array:
    """Autocorrelation time kappa (n,) of each joint's residual inside its segments, away from reversals [1]."""
    refined, segments = attempt.refined, attempt.segments
    residual = refined.signs * np.abs(observed.torque) - observed.predict(refined.value)
    residual[~observed.steady] = np.nan
    kappa = np.ones(len(observed.joints))
    for joint in observed.hidden:
        kappa[joint] = inflation(residual[:, joint], [(s.start, s.stop) for s in segments if s.joint == joint])
    return kappa
