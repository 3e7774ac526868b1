"""Flags of a diagnosis: worse on held-out data or in roll-outs, too few rows; separating motions in limited time."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_output_report_diagnosis import ROBOT, finding

import signid
from signid.diagnose import Finding
from signid.diagnose.findings import findings
from signid.diagnose.findings.findings import rollout_warnings
from signid.effects.naming import parse_law
from signid.simulation.rollout import RollOut

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


def rolled(sizes: tuple[float, float], windows: int = 48) -> RollOut:
    """Errors of two joints of given sizes [rad]."""
    noise = np.exp(0.3 * np.random.default_rng(0).standard_normal((windows, 5, 2)))
    return RollOut(
        joints=("a", "b"),
        unit=("rad", "rad"),
        horizons=(0.5,),
        t=np.arange(1, 6) * 0.1,
        recording=np.zeros(windows, dtype=np.intp),
        start=np.arange(windows, dtype=float),
        error=noise * sizes,
        step=1e-3,
    )


def test_a_joint_that_leaves_the_motion_faster_is_named() -> None:
    (flag,) = rollout_warnings(rolled((0.01, 0.02)), rolled((0.005, 0.03)))
    assert "held-out motion of b faster" in flag and "1.50 times" in flag


@pytest.mark.parametrize("after", [(0.01, 0.02), (0.005, 0.021), (0.011, 0.01)])
def test_equal_or_better_roll_outs_are_silent(after: tuple[float, float]) -> None:
    assert not list(rollout_warnings(rolled((0.01, 0.02)), rolled(after)))


def test_without_enough_windows_nothing_is_said() -> None:
    assert not list(rollout_warnings(rolled((0.01, 0.01), 4), rolled((0.1, 0.1), 4)))
    assert not list(rollout_warnings(None, None))


def test_a_simulation_that_diverges_is_worse() -> None:
    before, after = rolled((0.01, 0.02)), rolled((0.01, 0.02))
    broken = RollOut(**{**vars(after), "error": np.full_like(after.error, np.inf)})
    assert len(list(rollout_warnings(before, broken))) == 2
