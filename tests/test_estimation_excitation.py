"""Poor excitation is flagged: joints at rest, joints in step."""

from __future__ import annotations

import numpy as np
import pytest
from motions import Trial, trial

from signid.estimation.excitation import ExcitationVerdict, judge_excitation
from signid.estimation.least_squares import estimate
from signid.regression.session import prepare
from signid.robot import load_robot
from signid.types import Array, Estimate, Robot


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot("3r")


def judged(made: Trial, **changes: Array) -> tuple[Estimate, ExcitationVerdict]:
    recording = made.recording(**changes)
    session = prepare(made.robot, [recording], [recording])
    factors = session.reduce(session.train)
    found = estimate(factors, session.task.base)
    return found, judge_excitation(session.task, factors, found)


def test_poor_excitation_is_reported(arm: Robot) -> None:
    found, verdict = judged(trial(arm, rest=(2,)))
    assert np.isinf(found.std).any()
    assert verdict.resting == ("joint_3",)
    assert not verdict.sufficient
    assert any("joint joint_3 did not move" in sentence for sentence in verdict.sentences)


def test_joints_in_step_are_named(arm: Robot) -> None:
    made = trial(arm)
    q = made.q.copy()
    q[:, 2] = 0.7 * q[:, 1]
    assert judged(made, q=q)[1].in_step == (("joint_2", "joint_3"),)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_joint_that_stands_at_zero_is_named_without_a_warning(arm: Robot) -> None:
    made = trial(arm)
    still = made.q * [1.0, 0.0, 1.0]
    verdict = judged(made, q=still)[1]
    assert verdict.resting == ("joint_2",) and verdict.in_step == ()


def test_good_motion_is_not_flagged(arm: Robot) -> None:
    verdict = judged(trial(arm))[1]
    assert verdict.sufficient
    assert verdict.sentences == ()
