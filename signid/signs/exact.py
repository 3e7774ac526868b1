"""Boolean least squares under physical constraints -> the best signs, with a proof or a proven gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ..types import Array, Frozen
from .branch import MOST, WIDEST, bounds, branch
from .certificate import certify
from .climb import ascend, climb
from .problem import Problem
from .result import Proof

ROUNDS = 3  # trees, each with the cuts and the best signs of the one before
SHARE = 8  # of the nodes, the part that the search without the cone may spend where there is one
PATTERNS = 9  # groups of segments, at most, of which all patterns of flips are tried
SCORED = 2000  # leaves of one tree whose distance from the cone is computed
CUTS = 32
WORTH = 0.9  # of a distance: a cut is kept where those kept before tell less
SAME = 1e-11  # share of the total energy by which losses of the same signs may differ


class Cone(Protocol):
    """A convex cone of coordinates that a real robot could have."""

    def distance(self, z: Array) -> tuple[float, Array]:
        """Squared distance from the cone, and the nearest point of it (r,) [standard deviations].

        Args:
            z: (r,) [standard deviations].
        """
        ...


@dataclass(frozen=True, eq=False)
class Found(Frozen):
    """The best signs under the constraints. A loss is J(s) plus the squared distance of B s from the cone."""

    signs: Array  # (S,) [1]
    coordinates: Array  # (r,) z, inside the cone [standard deviations]
    loss: float  # [squared standard deviations]
    free_signs: Array  # (S,) [1] the best without the cone
    free_loss: float  # of those [squared standard deviations]
    proof: Proof
    rival_signs: Array  # (K, S) [1] all signs whose loss was computed, the best first; s and -s are different
    rival_losses: Array  # (K,) [squared standard deviations]
    cuts: Array  # (r, C) [1] directions c with c'z <= 0 in the cone


class Rivals(NamedTuple):
    """Signs almost as good as the best."""

    signs: Array  # (K, S) [1]
    losses: Array  # (K,) [squared standard deviations] ascending
    complete: bool  # whether there are no others: proved


def search(
    problem: Problem,
    cone: Cone | None = None,
    moves: Sequence[Array] = (),
    tries: Sequence[Array] = (),
    seed: int = 0,
    widest: int = WIDEST,
    most: int = MOST,
) -> Found:
    """The signs of lowest loss.

    Without the cone: a climb from many starts, a certificate, else branch and bound. With it: flips of joints and
    segments from there, then branch and bound in which supporting half-spaces of the cone raise the bounds.
    Where a budget bites, the proof tells the gap that is left. Of s and -s that lose the same, either is returned.

    Args:
        problem: the boolean least squares.
        cone: where the coordinates of a real robot lie; None: anywhere.
        moves: (S,) each [1], signs that the segments of a joint may have together or be multiplied by; 0: no opinion.
        tries: (S,) each [1], signs that may be good.
        seed: of the random starts.
        widest: nodes kept of a level.
        most: nodes looked at in one tree before only a few are kept of a level.
    """
    free = _search_free(problem, tries, seed, widest, most if cone is None else most // SHARE)
    scores = _Scores(problem, cone or _Everywhere())
    scores.add_all(np.array([free.signs, *tries]))
    _improve(problem, scores, moves)
    lower, nodes, certified = free.lower, free.nodes, free.certified
    for _ in range(ROUNDS if scores.best - lower > scores.same else 0):
        before = scores.best, len(scores.cuts)
        window = scores.best - free.loss
        tree = branch(problem, free.signs, window, scores.stacked, scores.coordinates, widest, most)
        lower = max(lower, min(tree.beyond, scores.add_all(tree.leaves, SCORED)))
        nodes, certified = nodes + tree.nodes, False
        if scores.best - lower <= scores.same or (scores.best, len(scores.cuts)) == before:
            break
        _improve(problem, scores, moves)
    optimal = scores.best - lower <= scores.same
    gap = 0.0 if optimal else 1 - max(lower, 0.0) / scores.best
    rivals, losses = scores.ranked()
    return Found(
        signs=scores.signs,
        coordinates=scores.coordinates,
        loss=scores.best,
        free_signs=free.signs,
        free_loss=free.loss,
        proof=Proof(optimal, gap, nodes, optimal and certified),
        rival_signs=rivals,
        rival_losses=losses,
        cuts=scores.stacked,
    )


def enumerate_near(
    problem: Problem,
    cone: Cone | None,
    found: Found,
    window: float,
    scored: int = SCORED,
    widest: int = WIDEST,
    most: int = MOST,
) -> Rivals:
    """All signs whose loss exceeds that of the best by a window at most.

    Args:
        problem: the boolean least squares.
        cone: as in the search.
        found: what the search found.
        window: [squared standard deviations].
        scored: signs whose distance from the cone is computed, at most.
        widest: nodes kept of a level.
        most: nodes looked at before only a few are kept of a level.
    """
    scores = _Scores(problem, cone or _Everywhere(), window, found.cuts)
    scores.add_all(found.signs[None])
    limit = found.loss + window
    beyond = limit - problem.loss(found.signs)
    tree = branch(problem, found.signs, beyond, found.cuts, found.coordinates, widest, most)
    beyond = min(tree.beyond, scores.add_all(tree.leaves, scored))
    signs, losses = scores.ranked()
    inside = losses <= limit + scores.same
    return Rivals(signs[inside], losses[inside], beyond >= limit - scores.same)


class _Everywhere:
    def distance(self, z: Array) -> tuple[float, Array]:
        return 0.0, z


class _Free(NamedTuple):
    signs: Array
    loss: float
    lower: float
    nodes: int
    certified: bool


def _search_free(problem: Problem, tries: Sequence[Array], seed: int, widest: int, most: int) -> _Free:
    climbed = climb(problem, seed=seed).signs
    ends = np.concatenate([climbed[None], ascend(problem, np.array([climbed, *tries]), pairs=True)])
    signs = min(ends, key=problem.loss)
    loss, (lower, certified) = problem.loss(signs), certify(problem, signs)
    if certified:
        return _Free(signs, loss, lower, 0, True)
    tree = branch(problem, signs, widest=widest, most=most)
    return _Free(tree.signs, problem.loss(tree.signs), max(lower, tree.lower), tree.nodes, False)


class _Scores:
    """Losses under the cone of the signs looked at so far, and the half-spaces that they showed."""

    def __init__(self, problem: Problem, cone: Cone, window: float = 0.0, cuts: Array | None = None) -> None:
        self.problem, self.cone, self.window = problem, cone, window
        self.same = SAME * float(problem.energies.sum())
        self.cuts = [] if cuts is None else list(cuts.T)
        self.seen: dict[bytes, float] = {}
        self.best, self.signs, self.coordinates = np.inf, np.zeros(0), np.zeros(0)

    @property
    def stacked(self) -> Array:
        """(r, C) [1]."""
        return np.array(self.cuts).reshape(-1, len(self.problem.projections)).T

    def add_all(self, signs: Array, most: int | None = None) -> float:
        """Score all that may be inside the window of the best; a lower bound of those left out, inf without any."""
        floor = bounds(self.problem, signs, self.stacked)
        count = 0
        for k in np.argsort(floor, kind="stable").tolist():
            if floor[k] >= self.best + self.window + self.same:
                return np.inf
            if most is not None and count >= most:
                return float(floor[k])
            count += self._add(signs[k])
            if not self.problem.anchored:
                count += self._add(-signs[k])
        return np.inf

    def ranked(self) -> tuple[Array, Array]:
        """Signs (K, S) and their losses (K,), the best first."""
        losses = np.array(list(self.seen.values()))
        at = np.argsort(losses, kind="stable")
        signs = np.array([np.frombuffer(key, dtype=np.int8) for key in self.seen], dtype=float)
        return signs[at], losses[at]

    def _add(self, signs: Array) -> bool:
        """Score signs, unless they are known or cannot be inside the window."""
        key = signs.astype(np.int8).tobytes()
        z, loss = self.problem.coordinates(signs), self.problem.loss(signs)
        told = max((float(cut @ z) for cut in self.cuts), default=0.0)
        if key in self.seen or loss + max(told, 0.0) ** 2 >= self.best + self.window + self.same:
            return False
        squared, nearest = self.cone.distance(z)
        self.seen[key] = loss + squared
        if self.seen[key] < self.best:
            self.best, self.signs, self.coordinates = self.seen[key], np.array(signs), nearest
        if squared > self.same and max(told, 0.0) ** 2 < WORTH * squared and len(self.cuts) < CUTS:
            self.cuts.append((z - nearest) / np.linalg.norm(z - nearest))
        return True


def _improve(problem: Problem, scores: _Scores, moves: Sequence[Array]) -> None:
    """Flips of joints, moves of joints, flips of segments, until none of them lowers the loss."""
    before = np.inf
    while scores.best < before - scores.same:
        before = scores.best
        for starts in (_patterns(problem, scores.signs), _moved(problem, scores.signs, moves)):
            scores.add_all(np.concatenate([starts, ascend(problem, starts, joints=False)]))
        flipped = np.inf
        while scores.best < flipped - scores.same:
            flipped = scores.best
            scores.add_all(scores.signs * (1 - 2 * np.eye(problem.count)[: problem.count - problem.anchored]))


def _patterns(problem: Problem, signs: Array) -> Array:
    """(K, S) the signs with joints flipped: all patterns of a few joints, single ones and pairs of many."""
    groups, at = np.unique(problem.joints, return_inverse=True)  # a known segment is the first group
    count = len(groups)
    if count <= PATTERNS:
        flips = (np.arange(2 ** (count - 1))[:, None] >> np.arange(count - 1)) & 1
        flips = np.column_stack([np.zeros(len(flips), dtype=int), flips])
    else:
        one = np.eye(count, dtype=int)[problem.anchored :]
        flips = np.unique((one[:, None] | one).reshape(-1, count), axis=0)
    return np.asarray(signs * (1.0 - 2.0 * flips[:, at]))


def _moved(problem: Problem, signs: Array, moves: Sequence[Array]) -> Array:
    """(K, S) the signs with those of one joint replaced by, or multiplied with, those of a move or their opposites."""
    found = []
    for move in moves:
        for joint in np.unique(problem.joints):
            own = (problem.joints == joint) & (joint >= 0)
            if own.any() and move[own].all():
                found += [np.where(own, sign * new, signs) for sign in (1, -1) for new in (move, signs * move)]
    return np.array(found).reshape(-1, problem.count)
