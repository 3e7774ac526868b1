"""Flags of a diagnosis: worse on held-out data, too few rows; separating motions within the time limit."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest
from test_output_report_diagnosis import ROBOT, finding

import signid
from signid.diagnose import Finding
from signid.diagnose.findings import findings
from signid.effects.naming import parse_law

SETTING: Any = SimpleNamespace(model=signid.load_model("3r"))
MISSING = (
    "something is missing that no effect of the library explains; the report says what it depends on, not what it is"
)
LAWS = [parse_law(text, ROBOT) for text in ("spring@2:stiffness=3", "armature@2", "viscous_friction@2")]


def flags(verdict: str, *some: Finding, itself: bool = False) -> list[str]:
    return list(findings._flags(SETTING, some, SimpleNamespace(name=verdict), itself))  # type: ignore[arg-type]


def test_findings_worse_on_held_out_data_are_flagged_in_one_sentence() -> None:
    out = finding("spring@2:stiffness=3", {}, in_model=False)
    assert flags("named", finding("armature@1", {})) == []
    assert flags("named", out, finding("armature@1", {})) == [
        "spring of joint_2 explains the training recordings, but not the held-out recordings: "
        "it is not in the extended simulation"
    ]
    assert flags("named", out, finding("armature@1", {}, in_model=False, role="secondary")) == [
        "spring of joint_2, armature of joint_1 explain the training recordings, but not the held-out recordings: "
        "they are not in the extended simulation"
    ]


def test_too_few_rows_are_not_called_held_out() -> None:
    assert flags("named", finding("spring@2:stiffness=3", {}, in_model=False), itself=True) == [
        "spring of joint_2 explains the training recordings, but not by enough for so few rows: "
        "it is not in the extended simulation"
    ]


def test_causes_that_explain_little_do_not_mean_nothing_missing() -> None:
    assert flags("unknown") == [MISSING] == flags("unknown", finding("armature@1", {}, role="secondary"))
    assert flags("unknown", finding("armature@1", {})) == [
        f"the named causes leave more torque than they explain: {MISSING}"
    ]


def contender(probabilities: Sequence[float]) -> Any:
    """A contender with rivals of these probabilities."""
    rivals = {k: (p, SimpleNamespace(claim=SimpleNamespace(laws=LAWS[:1]))) for k, p in enumerate(probabilities)}
    return SimpleNamespace(group=object(), rivals=rivals)


def test_separating_motions_are_sought_for_few_plausible_rivals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(findings, "tell_apart", lambda *_: "a motion")
    monkeypatch.setattr(findings._Reporter, "finding", lambda reporter, one, law, std, rivals: rivals)
    some = [contender(p) for p in ([0.3, 0.06, 0.05, 1e-9], [0.1] * 6, [0.2, 0.2, 0.2], [0.5])]
    extended: Any = SimpleNamespace(laws={one.group: LAWS[1:2] for one in some})
    selection: Any = SimpleNamespace(data=SimpleNamespace(floor=None))
    reporter = findings._Reporter(SETTING, selection, extended, {one.group: [{}] for one in some}, (), 0)
    found: Any = list(reporter.findings(some))
    assert [[bool(rival.separating_motion) for rival in rivals] for rivals in found] == [
        [True, True, False, False],
        [True] * 4 + [False] * 2,
        [True, True, False],
        [False],
    ]
