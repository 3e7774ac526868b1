"""A joint that rests by static friction is no stuck sensor; a position that does not follow its torque is one."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

import signid
from signid.check import check
from signid.cli import run
from signid.types import Recording, Robot

pytestmark = pytest.mark.slow

JOINT, STUCK = "FL_calf_joint", "stands still"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return signid.load_robot("go2")


@pytest.fixture(scope="module")
def resting(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A go2 with static friction in one calf, which rests for seconds."""
    path = tmp_path_factory.mktemp("go2") / "recording.csv"
    law = f"coulomb_friction@{JOINT}:level=1.3"
    noise = ["--noise", "0.02", "--encoder-bits", "17", "--seed", "1"]
    assert run(["simulate", "go2", "--duration", "10", "--inject", law, *noise, "-o", str(path)]) == 0
    return signid.read_recording(path, robot)


def stuck(robot: Robot, recording: Recording) -> list[str]:
    return [flag for flag in check(robot, [recording]).flags if STUCK in flag]


def test_a_joint_at_rest_by_static_friction_is_no_stuck_sensor(
    robot: Robot, resting: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    still = np.diff(resting.read().q[:, robot.joints.index(JOINT)]) == 0
    assert still.mean() > 0.1
    assert not stuck(robot, resting)
    monkeypatch.setattr(import_module("signid.faults.examine"), "BEYOND", 0.0)
    assert stuck(robot, resting), "its torque varies as much as when it moves: only its size distinguishes it"


def test_a_joint_whose_position_does_not_follow_is_reported(robot: Robot, resting: Recording) -> None:
    rows = resting.read()
    q, thigh, first = rows.q.copy(), robot.joints.index("RL_thigh_joint"), len(rows.t) // 3
    q[first:, thigh] = q[first, thigh]
    recording = signid.read_recording({"t": rows.t, "q": q, "tau": rows.tau}, robot)
    assert any("RL_thigh_joint" in flag for flag in stuck(robot, recording))
