"""Coverage of confidence intervals on robots simulated in MuJoCo."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import polars as pl
import pytest

from benchmarks.arms import ARMS, Arm, load
from benchmarks.coverage import HELD, HELD_RATE, HELD_TARGET, NOISES, TARGET, evaluate, hold, identify, record
from benchmarks.plants.mujoco_ import STEP, Body, Track, draw_motion, log, simulate
from benchmarks.record_3r import BITS, CENTRE, DRIVES, NOISE, RATE, RECORDINGS, read_body, truth_lines
from signid.robot import load_robot
from signid.types import Robot

FOLDER = Path(__file__).parents[1] / "robots" / "3r"
ARM = ARMS[0]


@pytest.fixture(scope="module")
def arm() -> tuple[Robot, list[Track]]:
    """The 3R arm and its true tracks along 20 motions."""
    robot = load(ARM)
    return robot, record(ARM, robot)


@pytest.mark.parametrize("noise", NOISES)
def test_intervals_have_nominal_coverage(arm: tuple[Robot, list[Track]], noise: str) -> None:
    row = evaluate(ARM, *arm, noise, draws=5)
    assert row.recordings >= 100
    assert TARGET[0] <= row.coverage <= TARGET[1]
    assert TARGET[0] <= row.inertial <= TARGET[1]
    assert TARGET[0] <= row.drives <= TARGET[1]
    assert row.worst >= 85, row.worst_parameter


@pytest.mark.parametrize("noise", HELD)
def test_intervals_widen_with_two_milliseconds_of_torque_hold(noise: str) -> None:
    """UR10, 58 base parameters; intervals for noise alone cover only half to nine tenths."""
    slow = next(arm for arm in ARMS if arm.robot == "ur10")
    robot = load(slow)
    tracks = [hold(track) for track in record(replace(slow, rate=HELD_RATE), robot, 4)]
    assert np.array_equal(tracks[0].tau[1::2], tracks[0].tau[::2])
    row = evaluate(slow, robot, tracks, noise, 1)
    assert row.parameters == 58 and row.coverage >= HELD_TARGET and row.holds


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.robot)
def test_the_plant_obeys_the_equations_of_motion(arm: Arm) -> None:
    """Pinocchio's torque at central differences of the positions equals the plant's at every sample."""
    robot = load(arm)
    track = simulate(Body(robot.document, robot.joints), arm.drives, draw_motion(arm.centre, 7), 2.0, 1 / STEP)
    q, v, a = track.q[1:-1], (track.q[2:] - track.q[:-2]) / (2 * STEP), np.diff(track.q, 2, axis=0) / STEP**2
    model, drives = robot.model.copy(), arm.drives
    model.armature[: arm.joints] = drives.armature
    data, still = model.createData(), np.zeros(model.nv - arm.joints)
    friction = v * drives.viscous_friction + np.sign(v) * drives.coulomb_friction + drives.torque_offset
    for j in range(arm.joints):
        moving = np.flatnonzero(np.abs(v[:, j]) > 0.02)[::7]
        states = ([np.append(x[k], still) for x in (q, v, a)] for k in moving)
        rigid = np.array([pin.rnea(model, data, *state)[j] for state in states])
        wrong = track.tau[1:-1][moving, j] - rigid - friction[moving, j]
        assert np.sqrt(np.mean(wrong**2)) < 1e-3 * np.sqrt(np.mean(track.tau[:, j] ** 2))


@pytest.mark.parametrize("name", RECORDINGS)
def test_the_recording_is_reproducible(name: str) -> None:
    duration, seed = RECORDINGS[name]
    body = read_body(FOLDER / "robot.urdf")
    columns = log(simulate(body, DRIVES, draw_motion(CENTRE, seed), duration, RATE), seed, BITS, NOISE)
    kept = pl.read_parquet(FOLDER / f"{name}.parquet")
    assert kept.columns == list(columns)
    for key, values in columns.items():
        assert np.max(np.abs(kept[key].to_numpy() - values)) < (1e-4 if key.startswith("q") else 1e-3), key


def test_truth_toml_matches_the_plant() -> None:
    stored = tomllib.loads((FOLDER / "truth.toml").read_text())
    computed = tomllib.loads("\n".join(truth_lines(read_body(FOLDER / "robot.urdf"))))
    assert stored["joint"] == computed["joint"]
    for link, values in computed["link"].items():
        for key, value in values.items():
            np.testing.assert_allclose(stored["link"][link][key], value, atol=1e-8)


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
