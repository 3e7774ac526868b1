"""Laws of drives that one recording or one of several alike joints alone supports are held back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from servo_loops import RATE

from signid.servo.plant import grids_of_arrays
from signid.servo.search.choice import Candidate, ServoTrial, supported
from signid.servo.search.data import ServoData
from signid.types import Array

CALVES = ("FL_calf", "FR_calf", "RL_calf", "RR_calf")
SECONDS = 8
GAINS, LOSES = 0.2, -0.05  # log rms that a number saves


def data(recordings: int, joints: Sequence[str] = CALVES) -> ServoData:
    """Recordings, each of which validates a fit to the others, or halves of the only one."""
    t = np.arange(SECONDS * int(RATE)) / RATE
    still = np.zeros((len(t), len(joints)))
    grids = [grids_of_arrays(joints, t, still, still, path=f"{k}.csv") for k in range(recordings)]
    return ServoData(grids[0], grids[0], tuple((grids[0], one) for one in grids), ())


def trials(saved: dict[str, Array]) -> tuple[ServoTrial, ServoTrial]:
    """Trials without and with a number that saves log rms."""
    residual, candidate = dict.fromkeys(saved, 1e-3), Candidate({}, ())
    before = {joint: np.full(len(x), -5.0) for joint, x in saved.items()}
    return ServoTrial(candidate, residual, before), ServoTrial(
        candidate, residual, {joint: before[joint] - x for joint, x in saved.items()}
    )


def windows(*saved: float) -> Array:
    """Savings (W,) of recordings, one after another."""
    return np.repeat(saved, SECONDS)


@pytest.mark.parametrize("others", [LOSES, GAINS])
def test_of_one_recording_the_alike_joints_decide(others: float) -> None:
    saved = {joint: windows(GAINS if joint == "RL_calf" else others) for joint in CALVES}
    kept = supported(data(1), *trials(saved), ["RL_calf"], CALVES)
    assert kept == (["RL_calf"] if others == GAINS else [])


def test_an_alike_joint_that_the_number_hardly_changes_contradicts_it() -> None:
    assert supported(data(1), *trials({"RL_calf": windows(GAINS)}), ["RL_calf"], ["RL_calf", "RR_calf"]) == []
    assert supported(data(1), *trials({"RL_calf": windows(GAINS)}), ["RL_calf"], ["RL_calf"]) == ["RL_calf"]


def test_of_several_recordings_one_alone_is_not_enough() -> None:
    one, both = (trials({"RL_calf": windows(GAINS, second)}) for second in (LOSES, GAINS))
    assert supported(data(2), *one, ["RL_calf"], CALVES) == []
    assert supported(data(2), *both, ["RL_calf"], CALVES) == ["RL_calf"]
