"""Classical tree search as a choice of the signs of segments."""

from __future__ import annotations

from collections.abc import Sequence

from ...model import stated_parameters
from ...regression.rows import Task
from ...types import Progress
from ..inferred import ChooseSigns, SignChoice
from ..result import SignProof
from ..rows.segments import Segment
from ..search.certificate import certify
from ..search.problem import SignProblem
from .tree import search_tree

NOTE = (
    "signs were searched by the classical tree ({nodes} nodes, {evaluations} evaluations), which keeps few nodes per "
    "level and proves nothing; samples below the threshold follow the model that it found"
)


def by_tree(task: Task, seed: int, progress: Progress | None = None) -> ChooseSigns:
    """Search by the tree of sign choices, each node solved over the standard parameters.

    Args:
        task: base map and description.
        seed: seed of the random starts.
        progress: called with the share of levels done.
    """

    def choose(problem: SignProblem, segments: Sequence[Segment]) -> SignChoice:
        prior = stated_parameters(task)
        grown = search_tree(problem, task.base, prior, forward=problem.forward, seed=seed, progress=progress)
        loss, (lower, optimal) = problem.loss(grown.signs), certify(problem, grown.signs)
        gap = 0.0 if optimal or loss <= 0 else min(max(1 - lower / loss, 0.0), 1.0)
        note = NOTE.format(nodes=grown.nodes, evaluations=grown.evaluations)
        proof = SignProof(optimal, gap, grown.nodes, optimal)
        return SignChoice(grown.signs, problem.coordinates(grown.signs), proof, (note, *grown.notes))

    return choose
