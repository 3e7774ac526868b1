"""Speed of the exact sign search compared with the classical tree."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from signid.errors import OptionError
from signid.recording.sampling import survey
from signid.signs.infer import infer
from signid.signs.observations import Observed, observe
from signid.signs.search.problem import Segment, SignProblem, build_problem
from signid.signs.segments import threshold_runs
from signid.signs.tree import LOST, WIDTH, TreeLevel, TreeNode, TreeResult, condition_order, grow, in_place
from signid.types import Indices

from ..summary import frame
from . import paper, real
from .trial import Array, Puzzle, Row, TargetResult, attempt, majority

SOLVERS = ("pseudo-inverse", "factor")


def beam(
    problem: SignProblem, order: Indices, start: int, width: int = WIDTH, solve: str = "pseudo-inverse"
) -> TreeResult:
    """Search the tree with linear least squares at every node; an undetermined sign is arbitrary.

    Args:
        problem: segments of the problem.
        order: order of the segments in the tree (S,).
        start: number of segments before nodes are dropped.
        width: number of nodes kept per level.
        solve: "pseudo-inverse" of the Gram matrix for every node, or "factor" once per level, with the same result.

    Raises:
        OptionError: `solve` is unknown, or the width is not positive.
    """
    if solve not in SOLVERS:
        raise OptionError(f"unknown solver {solve!r}; choose from {', '.join(SOLVERS)}")
    node, nodes = grow(problem, order, start, width, _by_pseudo_inverse if solve == SOLVERS[0] else _by_factor)
    signs = in_place(node.signs, order)
    return TreeResult(signs, problem.back @ problem.coordinates(signs), node.loss, nodes, nodes)


def _by_pseudo_inverse(level: TreeLevel, right: Array) -> TreeNode:
    z = np.linalg.pinv(level.gram, rcond=LOST, hermitian=True) @ right
    return TreeNode(max(level.energy - float(right @ z), 0.0), z, 1)


def _by_factor(level: TreeLevel, right: Array) -> TreeNode:
    z = level.turn @ right
    return TreeNode(max(level.energy - float(z @ z), 0.0), z, 1)


TIMES = 400.0  # lower bound on the speed-up, end to end [1]
STRIDE = 20  # every STRIDE-th tree level is timed


@dataclass(frozen=True)
class Race:
    """Times of two methods on the same signs."""

    name: str
    rival: str
    exact: float  # time [s]
    other: float  # time [s]
    right: str  # segments with their true sign, exact method
    other_right: str
    least: float | None = None  # lower bound on the speed-up [1]

    @property
    def times(self) -> float:
        """Speed-up of the exact method."""
        return self.other / self.exact

    @property
    def result(self) -> TargetResult:
        """Result of the speed-up target."""
        bound = "" if self.least is None else f" ({self.least:g})"
        text = f"{self.name} against {self.rival}: {self.times:.3g} times faster{bound}"
        return TargetResult(text, None if self.least is None else self.times >= self.least)


def races(done: Sequence[Row], tree: bool = True) -> Iterator[Race]:
    """Compare with the tree by NLopt on both arms of the paper, and by pseudo-inverses on a Panda."""
    arms = [row for row in done if row.group == "3R" and "anew" not in row.case] if tree else []
    if tree and not any(row.method == "tree" for row in arms):
        puzzles = [puzzle for puzzle in paper.puzzles(anew=False) if puzzle.group == "3R"]
        arms = [attempt(puzzle, method) for puzzle in puzzles for method in ("exact", "tree")]
    for exact, other in zip(arms[::2], arms[1::2], strict=True):
        right = [f"{row.right}/{row.segments}" for row in (exact, other)]
        yield Race(f"3R {exact.case}", "tree by NLopt", exact.whole, other.whole, right[0], right[1], TIMES)
    yield from beaten(real.panda())


def beaten(puzzle: Puzzle) -> Iterator[Race]:
    """Time the search with refinement and confidence against order and beam alone, from given rows."""
    task, (train, _) = puzzle.known.session.task, puzzle.read(unsigned=True)
    observed = observe(task, [(train[0], survey(train[0], task.robot))])
    start = time.process_time()
    found = infer(task, observed)
    between = time.process_time()
    segments, _ = threshold_runs(observed)
    problem = build_problem(observed, segments, 1 / observed.scale)
    ordered = condition_order(problem)
    grown = beam(problem, ordered.order, ordered.start)
    end = time.process_time()
    right = right_of(puzzle, observed, found.segments, found.signs)
    both = [right_of(puzzle, observed, segments, side * grown.signs) for side in (1, -1)]
    other = max(both, key=lambda text: int(text.partition("/")[0]))  # the tree's overall sign is arbitrary
    name = f"{puzzle.group}, {len(train[0].joints)} joints"
    yield Race(name, "tree of 5, pseudo-inverses of Gram matrices", between - start, end - between, right, other)
    slow = stacked_time(observed, segments, ordered.order)
    yield Race(name, f"the same, of stacked rows (every {STRIDE}th level timed)", between - start, slow, right, other)


def stacked_time(observed: Observed, segments: Sequence[Segment], order: Indices) -> float:
    """Time [s] of a tree with a pseudo-inverse of all rows of the segments (S,) at every node, as its authors do.

    All nodes of a level take equal time; levels without timing are extrapolated from the timed ones.
    """
    rows = [observed.rows(segments[i].joint, slice(segments[i].start, segments[i].stop)) for i in order]
    total = 0.0
    for k in range(STRIDE // 2, len(rows), STRIDE):
        stacked = np.concatenate(rows[: k + 1])
        start = time.process_time()
        np.linalg.pinv(stacked)
        total += 2 * WIDTH * STRIDE * (time.process_time() - start)
    return total


def right_of(puzzle: Puzzle, observed: Observed, segments: Sequence[Segment], signs: Array) -> str:
    """Number of segments of the first recording with their true sign, for signs (S,) [1]."""
    ends = [(s.joint, float(observed.t[s.start]), float(observed.t[s.stop - 1])) for s in segments]
    true = np.array([majority(puzzle.truth[0], *end)[0] for end in ends])
    return f"{int(np.sum(true == signs))}/{len(true)}"


def show(done: Sequence[Race]) -> Table:
    """Table with one line per race."""
    table = frame("time", ("", "against", "exact, s", "other, s", "speed-up", "right", "other right"), left=2)
    for race in done:
        figures = (f"{race.exact:.3f}", f"{race.other:.2f}", f"{race.times:.3g}")
        table.add_row(race.name, race.rival, *figures, race.right, race.other_right)
    return table
