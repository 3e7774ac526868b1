"""Runs that were cut, judged in parts or whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from signless import lost

from signid.signs.infer import infer
from signid.signs.posterior import recheck as weigh_module
from signid.signs.posterior.recheck import weigh
from signid.signs.search.cone import physical_cone
from signid.signs.search.problem import Problem
from signid.types import Array


def test_segments_and_confidences_go_together_after_every_round(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two runs that were cut, one is doubtful in the first round, the other only in the second."""
    made = lost(0.02)
    found, runs = infer(made.task, made.observed), sorted(made.segments())
    signs, cut = found.refined.signs.copy(), (runs[0], runs[-1])
    for joint, start, stop in cut:
        signs[(start + stop) // 2 : stop, joint] *= -1
    rounds = iter(cut)

    def confident(problem: Problem, best: Array, *_: object) -> Array:
        parts = np.flatnonzero(problem.joints == next(rounds).joint)
        return np.where(np.isin(np.arange(len(best)), parts[[0, -1]]), 0.5, 1.0)

    monkeypatch.setattr(weigh_module, "judge_confidence", confident)
    cone, refined = physical_cone(made.task, made.observed), replace(found.refined, signs=signs)
    weighed = weigh(made.task, made.observed, runs, refined, made.weights, cone, 0, free=False)
    known = int(weighed.problem.anchored)
    assert len(weighed.segments) == weighed.problem.count - known == len(weighed.confidence) - known
    assert [s.joint for s in weighed.segments] == weighed.problem.joints[: len(weighed.segments)].tolist()
    assert cut[0] in weighed.segments and cut[1] not in weighed.segments
    assert next(rounds, None) is None
