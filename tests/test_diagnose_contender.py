"""The probability of a selected law, from hand-made evidence."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from signid.diagnose.findings.alternatives import Contender

LAW, RIVAL, UNKNOWN = ("spring", (0,)), ("counterbalance", (0,)), ("", (0,))


def contender(evidence: float = 5.0, **more: Any) -> Contender:
    """A spring with a share of .7, a counterbalance with .2 and something that no law explains with .1."""
    group = cast(Any, SimpleNamespace(claim=SimpleNamespace(key=LAW)))
    shares, rival = {LAW: 0.7, RIVAL: 0.2, UNKNOWN: 0.1}, cast(Any, SimpleNamespace())
    return Contender(group, evidence, shares, {RIVAL: rival}, unexplained=0.1, **more)


def chance(log: float) -> float:
    return float(1 / (1 + np.exp(-log)))


def test_the_probability_is_that_of_any_law_times_the_share_of_this_one() -> None:
    one = contender(2.0)
    assert one.probability == pytest.approx(0.7 * chance(2.0))
    assert one.unknown == pytest.approx(0.1 * chance(2.0))
    assert one.rivals[RIVAL][0] == pytest.approx(0.2 * chance(2.0)) and list(one.rivals) == [RIVAL]
    with_none = one.probability + one.unknown + one.rivals[RIVAL][0] + 1 - chance(2.0)
    assert with_none == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("evidence", "steadiness", "held_out", "refused", "log"),
    [
        (5.0, np.inf, 0.0, False, 5.0),
        (5.0, np.inf, -3.0, False, 2.0),  # held-out rows speak against it
        (5.0, 1.0, 0.0, False, 1.0),  # its gain is uneven
        (5.0, 1.0, 4.0, False, 1.0),  # held-out rows do not lift that limit
        (5.0, 1.0, -2.0, False, -1.0),  # and count below it
        (5.0, np.inf, 4.0, True, 0.0),  # refused: even at most
        (5.0, -2.0, 0.0, True, -2.0),
    ],
)
def test_log_odds_are_limited_and_held_out_rows_add_to_them(
    evidence: float, steadiness: float, held_out: float, refused: bool, log: float
) -> None:
    one = contender(evidence, steadiness=steadiness, held_out=held_out, refused=refused)
    assert one.log == log and one.probability == pytest.approx(0.7 * chance(log))


@pytest.mark.parametrize("evidence", [-1e6, -800.0, 800.0, 1e6])
def test_extreme_evidence_does_not_overflow(evidence: float) -> None:
    with np.errstate(all="raise"):
        assert contender(evidence).probability == pytest.approx(0.7 * (evidence > 0), abs=1e-12)


def test_a_law_that_is_not_its_own_candidate_has_no_probability() -> None:
    assert replace(contender(9.0), shares={RIVAL: 0.9, UNKNOWN: 0.1}).probability == 0.0
