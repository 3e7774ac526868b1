"""Senseless recordings are refused or flagged, with a sentence that names the fault; good ones are not."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import pytest
from senseless import Columns, senseless

import signid
from signid.check import check
from signid.types import Recording, Robot

ROBOT = Path(__file__).parents[1] / "robots" / "3r"
NOT_FROM_MOTION = "does not follow from its motion"
NAMED = {  # recording -> words of the sentence
    "tau_white_noise": NOT_FROM_MOTION,
    "tau_of_another_motion": NOT_FROM_MOTION,
    "tau_shifted_1s": "s late against the motion",
    "tau_early_1s": "s early against the motion",
    "tau_reversed": "the torque runs backwards in time",
    "tau_joints_exchanged": "the torques of joints joint_1 and joint_2 are exchanged",
    "tau_joints_rotated": "the torques of joints joint_1, joint_2 and joint_3 are exchanged",
    "tau_negated": "the torque of joints joint_1, joint_2 and joint_3 has the wrong sign",
    "tau_one_negated": "the torque of joint_2 has the wrong sign",
    "tau_times_1000": "they seem to be in mN.m",
    "tau_signs_random": "has spikes",
    "tau_three_levels": "the torque of joint_1 has only 3 different values",
    "tau_spikes": "the torque of joint_1 has spikes",
    "tau_saturated": "the torque of joint_2 is clipped",
    "tau_stuck": "the torque of joint_2 is constant",
    "tau_signed_sqrt": "all torques seem to be square roots",
    "tau_squared": "all torques seem to be squares",
    "tau_dropouts": "the torque of joint_1 drops to 0 for single samples",
    "tau_constant_plus_noise": NOT_FROM_MOTION,
    "tau_random_walk": NOT_FROM_MOTION,
    "q_random_walk": NOT_FROM_MOTION,
    "q_joints_exchanged": "the positions of joints joint_1 and joint_2 are exchanged",
    "q_reversed": "the positions run backwards in time",
    "q_negated": "the position of joints joint_1, joint_2 and joint_3 has the wrong sign",
    "q_spikes": "the position of joint_1 has spikes",
    "q_stuck": "the position of joint_2 stands still",
    "q_off_90": "the position of joint_2 is off by about 90 degrees",
    "q_halved": "the position of joint_2 is about 2 times too small",
    "q_doubled": "the position of joint_2 is about 2 times too large",
    "q_8bit": "the position of joint_1 has only 75 different values",
    "q_dropouts": "the position of joint_1 drops to 0 for single samples",
    "q_degrees": "it is in degrees",
    "time_half": "times too fast",
    "rows_shuffled": "rows are mixed up, or each is a posture at rest",
}
SILENT = {"time_double"}  # friction and rotors explain the slow motion of the 3r with half the speed as well


@cache
def robot() -> Robot:
    return signid.load_robot("3r")


def good(name: str = "recording") -> Recording:
    return signid.read_recording(ROBOT / f"{name}.parquet", robot())


@cache
def recordings() -> dict[str, Columns]:
    rows = good().read()
    return senseless(rows.t, rows.q, rows.tau, good("held_out").read().tau)


def read(name: str) -> Recording:
    return signid.read_recording(recordings()[name], robot())


wls = partial(signid.identify, method="wls")  # names the faults that `check` finds


def test_every_recording_has_an_expectation() -> None:
    assert set(recordings()) == set(NAMED) | SILENT


@pytest.mark.slow_cases("verb|reversed|saturated|spikes|signs_random")
@pytest.mark.parametrize(
    ("verb", "name"), [*((check, name) for name in NAMED), *((wls, name) for name in [*NAMED][::3])]
)
def test_the_fault_is_named(verb: Callable[..., Any], name: str) -> None:
    try:
        said = verb(robot(), [read(name)]).flags
    except ValueError as error:
        said = (str(error),)
    assert any(NAMED[name] in sentence for sentence in said), said


@pytest.mark.parametrize(
    "name", ["q_off_90", "q_dropouts", "q_spikes", "tau_signed_sqrt", "rows_shuffled", "tau_reversed"]
)
def test_diagnose_refuses_what_it_cannot_explain(name: str) -> None:
    with pytest.raises(ValueError) as error:
        signid.diagnose(signid.load_model("3r"), [read(name)])
    assert NAMED[name] in str(error.value)


@pytest.mark.parametrize("name", ["recording", "held_out"])
def test_good_recordings_pass(name: str) -> None:
    assert check(robot(), [good(name)]).flags == ()
