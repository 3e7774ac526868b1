"""The classical tree as a search for the signs of segments."""

from __future__ import annotations

from collections.abc import Sequence

from ...model import stated_parameters
from ...regression.rows import Task
from ...types import Progress
from ..inferred import Choice, Choose
from ..result import Proof
from ..rows.segments import Segment
from ..search.certificate import certify
from ..search.problem import Problem
from .tree import search_tree

NOTE = (
    "signs were searched by the classical tree ({nodes} nodes, {evaluations} evaluations), which keeps few nodes of "
    "each level and proves nothing; samples below the threshold follow the model that it found"
)


def by_tree(task: Task, seed: int, progress: Progress | None = None) -> Choose:
    """A search by the tree of sign choices, every node solved over the standard parameters.

    Args:
        task: gives the base map and the description.
        seed: of the random starts.
        progress: told how far it is.
    """

    def choose(problem: Problem, segments: Sequence[Segment]) -> Choice:
        prior = stated_parameters(task)
        grown = search_tree(problem, task.base, prior, forward=problem.forward, seed=seed, progress=progress)
        loss, (lower, optimal) = problem.loss(grown.signs), certify(problem, grown.signs)
        gap = 0.0 if optimal or loss <= 0 else min(max(1 - lower / loss, 0.0), 1.0)
        note = NOTE.format(nodes=grown.nodes, evaluations=grown.evaluations)
        proof = Proof(optimal, gap, grown.nodes, optimal)
        return Choice(grown.signs, problem.coordinates(grown.signs), proof, (note, *grown.notes))

    return choose
