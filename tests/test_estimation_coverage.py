"""Coverage of confidence intervals on robots simulated in MuJoCo."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from benchmarks.arms import ARMS, load
from benchmarks.coverage import HELD_RATE, HELD_TARGET, TARGET, evaluate, hold, identify, record
from benchmarks.plants.mujoco_ import Track
from signid.robot import load_robot
from signid.types import Robot

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[1] / "robots" / "3r"
ARM = ARMS[0]


@pytest.fixture(scope="module")
def arm() -> tuple[Robot, list[Track]]:
    """The 3R arm and its true tracks along 20 motions."""
    robot = load(ARM)
    return robot, record(ARM, robot)


@pytest.mark.parametrize("noise", ["white", "white, 3 Hz"])
def test_intervals_have_nominal_coverage(arm: tuple[Robot, list[Track]], noise: str) -> None:
    row = evaluate(ARM, *arm, noise, draws=5)
    assert row.recordings >= 100
    assert TARGET[0] <= row.coverage <= TARGET[1]
    assert TARGET[0] <= row.inertial <= TARGET[1]
    assert TARGET[0] <= row.drives <= TARGET[1]
    assert row.worst >= 85, row.worst_parameter


@pytest.mark.parametrize("noise", ["held 2 ms, 1 %"])
def test_intervals_widen_with_two_milliseconds_of_torque_hold(noise: str) -> None:
    """UR10, 58 base parameters; intervals for noise alone cover only half to nine tenths."""
    slow = next(arm for arm in ARMS if arm.robot == "ur10")
    robot = load(slow)
    tracks = [hold(track) for track in record(replace(slow, rate=HELD_RATE), robot, 4)]
    assert np.array_equal(tracks[0].tau[1::2], tracks[0].tau[::2])
    row = evaluate(slow, robot, tracks, noise, 1)
    assert row.parameters == 58 and row.coverage >= HELD_TARGET and row.holds


def test_the_recording_identifies_the_true_parameters() -> None:
    robot = load_robot(FOLDER)
    known = tomllib.loads((FOLDER / "truth.toml").read_text())
    session, found = identify(robot, pl.read_parquet(FOLDER / "recording.parquet").to_dict(as_series=False))
    links = [known["link"][link] for link in robot.links]
    bodies = [[link["mass"], *link["first_moment"], *link["inertia"]] for link in links]
    drives = [known["joint"][robot.joints[law.joints[0]]][law.effect.name] for law in session.task.laws]
    truth = session.task.base.combination @ np.concatenate([*bodies, drives])
    assert np.max(np.abs(found.value - truth) / found.std) < 3.5
    assert np.mean(np.abs(found.value - truth) / found.std < 1.96) > 0.85
