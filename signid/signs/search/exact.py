"""Boolean least squares under physical constraints -> the best signs, with a proof or a proven gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...deadline import show_step, time_is_up
from ...types import Array, Frozen
from ..result import SignProof
from .branch_and_bound import MOST, SEARCH, WIDEST, branch
from .certificate import certify
from .local_search import TURNS, ascend, climb
from .problem import SignProblem
from .scores import ConvexCone, Scores, WholeSpace

NARROW = 200  # nodes kept of a level in the first trees, ten times as many where they no longer show anything new
PATTERNS = 9  # groups of segments, at most, of which all patterns of flips are tried
SCORED = 500  # leaves of a tree whose distance from the cone is computed
NEAR = 1000  # signs near the best that are listed, about


@dataclass(frozen=True, eq=False)
class SignSolution(Frozen):
    """The best signs under the constraints. A loss is J(s) plus the squared distance of B s from the cone."""

    signs: Array  # (S,) [1]
    coordinates: Array  # (r,) z, inside the cone [standard deviations]
    loss: float  # [squared standard deviations]
    proof: SignProof
    cuts: Array  # (r, C) [1] directions c with c'z <= 0 in the cone


class RivalSigns(NamedTuple):
    """Signs almost as good as the best; s and -s are different."""

    signs: Array  # (K, S) [1]
    losses: Array  # (K,) [squared standard deviations] ascending
    complete: bool  # whether there are no others: proved


def search_signs(
    problem: SignProblem,
    cone: ConvexCone | None = None,
    moves: Sequence[Array] = (),
    start: Array | None = None,
    seed: int = 0,
    widest: int = WIDEST,
    most: int = MOST,
) -> SignSolution:
    """The signs of lowest loss.

    Without the cone: a climb from many starts, a certificate, else branch and bound. With it: flips of joints and
    segments from there, then branch and bound in which half-spaces that hold the cone raise the bounds.
    Where a budget bites, the proof tells the gap that is left. Of s and -s that lose the same, either is returned.

    Args:
        problem: the boolean least squares.
        cone: where the coordinates of a real robot lie; None: anywhere.
        moves: (S,) each [1], a known segment may be left out: signs that the segments of a joint may have together or
            be multiplied by; 0: no opinion.
        start: (S,) [1] signs that may be good.
        seed: of the random starts.
        widest: nodes kept of a level of a tree.
        most: nodes looked at, with and without the cone, about.
    """
    tries = climb(problem, seed=seed)[None]
    if start is not None:
        tries = np.concatenate([tries, start[None], ascend(problem, start[None], pairs=True)])
    free = Scores(problem, WholeSpace())
    free.add(tries)
    lower, certified = certify(problem, free.signs)
    lower, nodes = _prove(problem, free, (), free.best if certified else lower, widest, most)
    scores = free
    if cone is not None:
        scores = Scores(problem, cone)
        scores.add(np.concatenate([free.signs[None], tries]))
        lower, more = _prove(problem, scores, moves, lower, widest, most)
        nodes += more
    attained = scores.attained()
    optimal = attained and scores.best - lower <= scores.same
    gap = 0.0 if optimal else 1 - max(lower, 0.0) / scores.best if attained else 1.0
    proof = SignProof(optimal, gap, nodes, certified=optimal and not nodes)
    return SignSolution(scores.signs, scores.coordinates, scores.best, proof, scores.cuts)


def enumerate_near(
    problem: SignProblem,
    cone: ConvexCone | None,
    found: SignSolution,
    window: float,
    widest: int = NEAR,
    most: int = MOST,
) -> RivalSigns:
    """All signs whose loss exceeds that of those found by a window at most; the best where there are too many.

    Args:
        problem: the boolean least squares.
        cone: as in the search.
        found: what the search found, or any other signs.
        window: [squared standard deviations].
        widest: nodes kept of a level, and signs whose distance from the cone is computed, about.
        most: nodes looked at before only a few are kept of a level.
    """
    limit = found.loss + window
    scores = Scores(problem, cone or WholeSpace(), limit, found.cuts)
    scores.add(found.signs[None])
    above = limit - problem.loss(found.signs)
    tree = branch(problem, found.signs, above, found.cuts, found.coordinates, widest, most)
    beyond = min(tree.beyond, scores.add(tree.leaves, widest))
    signs, losses = scores.ranked()
    inside = losses <= limit + scores.same
    return RivalSigns(signs[inside], losses[inside], beyond >= limit - scores.same)


def _prove(
    problem: SignProblem, scores: Scores, moves: Sequence[Array], lower: float, widest: int, most: int
) -> tuple[float, int]:
    """Trees, each with the best signs and the half-spaces of those before; the lower bound proved, and nodes."""
    nodes, width = 0, min(NARROW, widest)
    if scores.best - lower > scores.same:
        _improve(problem, scores, moves)
    while scores.best - lower > scores.same and nodes < most and not time_is_up(SEARCH):
        show_step("searching signs", nodes / most)
        before = scores.best, scores.cuts.shape[1]
        window = scores.best - problem.loss(scores.signs)
        tree = branch(problem, scores.signs, window, scores.cuts, scores.coordinates, width, most - nodes)
        rest = min(tree.beyond, scores.add(tree.leaves, SCORED))
        lower = max(lower, min(rest, scores.best))
        nodes += tree.nodes
        _improve(problem, scores, moves)
        if (scores.best, scores.cuts.shape[1]) == before:
            if width == widest:
                break
            width = min(10 * width, widest)
    return lower, nodes


def _improve(problem: SignProblem, scores: Scores, moves: Sequence[Array]) -> None:
    """Flips of joints, moves of joints, flips of segments, until none of them lowers the loss, or for some rounds."""
    for _ in range(TURNS):
        if time_is_up(SEARCH):
            break
        before = scores.best
        for starts in (_patterns(problem, scores.signs), _moved(problem, scores.signs, moves)):
            scores.add(np.concatenate([starts, ascend(problem, starts, joints=False)]))
        _flip_segments(problem, scores)
        if scores.best >= before - scores.same:
            break


def _flip_segments(problem: SignProblem, scores: Scores) -> None:
    flips = 1 - 2 * np.eye(problem.count)[: problem.count - int(problem.anchored)]
    for _ in range(TURNS * problem.count):
        before = scores.best
        scores.add(scores.signs * flips)
        if scores.best >= before - scores.same:
            break


def _patterns(problem: SignProblem, signs: Array) -> Array:
    """(K, S) the signs with joints flipped: all patterns of a few joints, single ones and pairs of many."""
    groups, at = np.unique(problem.joints, return_inverse=True)  # a known segment is the first group
    count = len(groups)
    if count <= PATTERNS:
        flips = (np.arange(2 ** (count - 1))[:, None] >> np.arange(count - 1)) & 1
        flips = np.column_stack([np.zeros(len(flips), dtype=int), flips])
    else:
        one = np.eye(count, dtype=int)[int(problem.anchored) :]
        flips = np.unique((one[:, None] | one).reshape(-1, count), axis=0)
    return np.asarray(signs * (1.0 - 2.0 * flips[:, at]))


def _moved(problem: SignProblem, signs: Array, moves: Sequence[Array]) -> Array:
    """(K, S) the signs with those of one joint replaced by, or multiplied with, those of a move or their opposites."""
    found = []
    for move in moves:
        move = np.append(move, np.zeros(problem.count - len(move)))
        for joint in np.unique(problem.joints):
            own = (problem.joints == joint) & (joint >= 0)
            if own.any() and move[own].all():
                found += [np.where(own, sign * new, signs) for sign in (1, -1) for new in (move, signs * move)]
    return np.array(found).reshape(-1, problem.count)
