"""How much faster signs are found than by the classical tree."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from signid.recording.sampling import survey
from signid.signs.infer import infer
from signid.signs.rows.observations import Observed, observe
from signid.signs.rows.segments import threshold_runs
from signid.signs.search.problem import Segment, pose
from signid.signs.tree.beam import WIDTH
from signid.signs.tree.condition import condition_order
from signid.types import Indices

from ..summary import frame
from . import paper, real
from .beam import beam
from .row import Row, Verdict
from .trial import Puzzle, attempt
from .truth import Array, majority

TIMES = 400.0  # end to end, at least
STRIDE = 20  # levels of the tree for one that is timed


@dataclass(frozen=True)
class Race:
    """Two ways to the same signs."""

    name: str
    rival: str
    exact: float  # s
    other: float  # s
    right: str  # segments with their true sign, exact
    other_right: str
    least: float | None = None  # times that the exact way should be faster

    @property
    def times(self) -> float:
        """How many times faster the exact way is."""
        return self.other / self.exact

    @property
    def verdict(self) -> Verdict:
        """Whether it is as many times faster as it should be."""
        asked = "" if self.least is None else f" ({self.least:g})"
        told = f"{self.name} against {self.rival}: {self.times:.3g} times faster{asked}"
        return Verdict(told, None if self.least is None else self.times >= self.least)


def races(done: Sequence[Row], tree: bool = True) -> Iterator[Race]:
    """Both arms of the paper against the tree by NLopt, a Panda against the tree by pseudo-inverses.

    Args:
        done: rows that need not be run again.
        tree: whether to race against the tree by NLopt.
    """
    arms = [row for row in done if row.group == "3R" and "anew" not in row.case] if tree else []
    if tree and not any(row.method == "tree" for row in arms):
        puzzles = [puzzle for puzzle in paper.puzzles(anew=False) if puzzle.group == "3R"]
        arms = [attempt(puzzle, method) for puzzle in puzzles for method in ("exact", "tree")]
    for exact, other in zip(arms[::2], arms[1::2], strict=True):
        right = [f"{row.right}/{row.segments}" for row in (exact, other)]
        yield Race(f"3R {exact.case}", "tree by NLopt", exact.whole, other.whole, right[0], right[1], TIMES)
    yield from beaten(real.panda())


def beaten(puzzle: Puzzle) -> Iterator[Race]:
    """The search with refinement and confidence, against nothing but order and beam; rows ready for both."""
    task, (learn, _) = puzzle.known.session.task, puzzle.read(unsigned=True)
    observed = observe(task, [(learn[0], survey(learn[0], task.robot))])
    start = time.process_time()
    found = infer(task, observed)
    between = time.process_time()
    segments, _ = threshold_runs(observed)
    problem = pose(observed, segments, 1 / observed.scale)
    ordered = condition_order(problem)
    grown = beam(problem, ordered.order, ordered.start)
    end = time.process_time()
    right = right_of(puzzle, observed, found.segments, found.signs)
    both = [right_of(puzzle, observed, segments, side * grown.signs) for side in (1, -1)]
    other = max(both, key=lambda told: int(told.partition("/")[0]))  # the tree leaves the overall sign open
    name = f"{puzzle.group}, {len(learn[0].joints)} joints"
    yield Race(name, "tree of 5, pseudo-inverses of Gram matrices", between - start, end - between, right, other)
    slow = stacked_time(observed, segments, ordered.order)
    yield Race(name, f"the same, of stacked rows (every {STRIDE}th level timed)", between - start, slow, right, other)


def stacked_time(observed: Observed, segments: Sequence[Segment], order: Indices) -> float:
    """[s] of a tree whose every node takes the pseudo-inverse of all rows of its segments, as their programs do.

    Nodes of a level take equally long; levels between those that are timed are taken to be like them.

    Args:
        observed: the rows.
        segments: S of them.
        order: (S,) of the tree.
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
    """How many segments of the first recording have their true sign, signs (S,) [1]."""
    ends = [(s.joint, float(observed.t[s.start]), float(observed.t[s.stop - 1])) for s in segments]
    true = np.array([majority(puzzle.truth[0], *end)[0] for end in ends])
    return f"{int(np.sum(true == signs))}/{len(true)}"


def show(done: Sequence[Race]) -> Table:
    """One race a line."""
    table = frame("time", ("", "against", "exact, s", "other, s", "times", "right", "other right"), left=2)
    for race in done:
        figures = (f"{race.exact:.3f}", f"{race.other:.2f}", f"{race.times:.3g}")
        table.add_row(race.name, race.rival, *figures, race.right, race.other_right)
    return table
