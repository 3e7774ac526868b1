"""Confidence of cut runs, in parts or whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from signless import lost

from signid.signs import infer as weigh_module
from signid.signs.infer import SegmentSearch, infer, recheck_signs
from signid.signs.search.branch_and_bound import cone_inequalities
from signid.signs.search.problem import SignProblem
from signid.types import Array


def test_segments_and_confidences_go_together_after_every_round(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of two cut runs is uncertain in the first round, the other only in the second."""
    made = lost(0.02)
    found, runs = infer(made.task, made.observed), sorted(made.segments())
    signs, cut = found.refined.signs.copy(), (runs[0], runs[-1])
    for joint, start, stop in cut:
        signs[(start + stop) // 2 : stop, joint] *= -1
    rounds = iter(cut)

    def confident(problem: SignProblem, best: Array, *_: object) -> Array:
        parts = np.flatnonzero(problem.joints == next(rounds).joint)
        return np.where(np.isin(np.arange(len(best)), parts[[0, -1]]), 0.5, 1.0)

    monkeypatch.setattr(weigh_module, "sign_confidence", confident)
    search = SegmentSearch(made.observed, cone_inequalities(made.task, made.observed))
    rechecked = recheck_signs(search, runs, replace(found.refined, signs=signs), made.weights, free=False)
    known = int(rechecked.problem.anchored)
    assert len(rechecked.segments) == rechecked.problem.count - known == len(rechecked.confidence) - known
    assert [s.joint for s in rechecked.segments] == rechecked.problem.joints[: len(rechecked.segments)].tolist()
    assert cut[0] in rechecked.segments and cut[1] not in rechecked.segments
    assert next(rounds, None) is None
