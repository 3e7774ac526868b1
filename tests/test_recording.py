"""Columns are assigned to joints; a refused assignment gives its reason in one sentence."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from test_recording_formats import refusal, sentence

from signid.recording import read_recording, same_joints
from signid.robot import load_robot
from signid.types import Actuators, Recording, Robot

N = 30
T = np.arange(N) * 0.1
Q = np.sin(np.outer(T, [1.0, 2.0, 3.0]))
TAU = np.cos(np.outer(T, [2.0, 3.0, 1.0])) - 0.5


def arm(*names: str, constants: object = np.nan, numbers: tuple[int, ...] = ()) -> Robot:
    names = names or ("shoulder", "elbow", "wrist")
    n = len(names)
    unknown = np.full(n, np.nan)
    drives = Actuators(unknown, unknown, unknown, unknown, np.broadcast_to(np.array(constants, float), n))
    numbers = numbers or tuple(range(1, n + 1))
    wide = np.full(n, np.inf)
    limits = (-3 * np.ones(n), 3 * np.ones(n), wide, wide)
    still = np.zeros(n)
    model = pin.Model()
    for name in names:
        body = model.addJoint(model.njoints - 1, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0, 0, 0.3])), name)
        model.appendBodyToJoint(body, pin.Inertia(1.0, np.array([0.0, 0.1, 0.2]), 0.01 * np.eye(3)), pin.SE3.Identity())
    return Robot("arm", model, names, numbers, names, np.eye(n), still, still > 0, *limits, drives, "", "urdf", "", "")


def whole(**changes: Any) -> dict[str, Any]:
    """Columns of all three joints by number; changed, or taken away by None."""
    columns = {"t": T, **{f"q_{j + 1}": Q[:, j] for j in range(3)}, **{f"tau_{j + 1}": TAU[:, j] for j in range(3)}}
    return {name: column for name, column in {**columns, **changes}.items() if column is not None}


def torque(recording: Recording) -> np.ndarray:
    return recording.read().tau


def test_names_numbers_and_matrices_are_the_same() -> None:
    named = {f"{kind}_{name}": m[:, j] for kind, m in (("q", Q), ("tau", TAU)) for j, name in enumerate(arm().joints)}
    for source in (whole(), {"t": T, **named}, {"t": T, "q": Q, "tau": TAU}, {**whole(q_2=None), "q_elbow": Q[:, 1]}):
        recording = read_recording(source, arm())
        samples = recording.read()
        assert recording.joints == arm().joints and not recording.notes and len(recording.sha256) == 64
        np.testing.assert_array_equal(samples.q, Q)
        np.testing.assert_array_equal(samples.tau, TAU)
        assert samples.dq is None and samples.ddq is None and samples.q_des is None and recording.signed.all()


def test_a_file_and_its_digest(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **whole())
    recording = read_recording(tmp_path / "a.npz", arm())
    assert recording.path == str(tmp_path / "a.npz") and len(recording) == N
    assert recording.sha256 == read_recording(str(tmp_path / "a.npz"), arm()).sha256
    assert read_recording(whole(), arm()).sha256 != read_recording(whole(t=T + 1), arm()).sha256


def test_joints_without_positions_are_held() -> None:
    recording = read_recording(whole(q_2=None, dq_1=Q[:, 0], q_des_3=Q[:, 2]), arm())
    assert recording.joints == ("shoulder", "wrist")
    assert "elbow" in recording.notes[0] and "fixed" in recording.notes[0]
    samples = recording.read(3, 5)
    assert samples.dq is not None and samples.q_des is not None and samples.ddq is None
    np.testing.assert_array_equal(samples.dq, np.column_stack([Q[3:5, 0], [np.nan, np.nan]]))
    np.testing.assert_array_equal(samples.q_des, np.column_stack([[np.nan, np.nan], Q[3:5, 2]]))


def test_numbers_count_the_joints_of_the_whole_file() -> None:
    part = arm("elbow", "wrist", numbers=(2, 3))
    recording = read_recording(whole(), part)
    np.testing.assert_array_equal(recording.read().q, Q[:, 1:])
    assert not recording.notes  # joint 1 is held by the user


def test_a_joint_may_be_called_like_a_number() -> None:
    recording = read_recording({"t": T, "q_2": Q[:, 0], "tau_2": TAU[:, 0]}, arm("2", "1"))
    assert recording.joints == ("2",)


def test_currents_become_torques() -> None:
    source = whole(tau_2=None, current_2=TAU[:, 1], tau_3=None, abs_current_3=abs(TAU[:, 2]), current_1=T)
    recording = read_recording(source, arm(constants=[np.nan, -2.0, -3.0]))
    np.testing.assert_array_equal(torque(recording), np.column_stack([TAU[:, 0], -2 * TAU[:, 1], 3 * abs(TAU[:, 2])]))
    assert recording.signed.tolist() == [True, True, False]
    assert "tau is used instead of current" in recording.notes[0] and "shoulder" in recording.notes[0]


def test_unsigned_forgets_every_sign() -> None:
    recording = read_recording(whole(tau_3=None), arm(), unsigned=True)
    np.testing.assert_array_equal(torque(recording)[:, :2], abs(TAU[:, :2]))
    np.testing.assert_array_equal(recording.read().q, Q)
    assert recording.signed.tolist() == [False, False, True] and np.isnan(torque(recording)[:, 2]).all()


def test_column_maps(tmp_path: Path) -> None:
    source = {"time": T, "a": Q[:, 0], "b": Q[:, 1], "tau_1": TAU[:, 1], "m": TAU[:, 0]}
    table = {"t": "time", "q_shoulder": "a", "q_2": "b", "tau_2": "tau_1", "tau_1": "m"}
    (tmp_path / "map.toml").write_text("".join(f'{key} = "{value}"\n' for key, value in table.items()))
    for columns in (table, tmp_path / "map.toml", str(tmp_path / "map.toml")):
        samples = read_recording(source, arm(), columns=columns).read()
        np.testing.assert_array_equal(samples.q, Q[:, :2])
        np.testing.assert_array_equal(samples.tau, TAU[:, :2])
    swapped = read_recording(whole(), arm(), columns={"tau_1": "tau_2", "tau_2": "tau_1"})
    np.testing.assert_array_equal(torque(swapped), TAU[:, [1, 0, 2]])
    mapped = read_recording(whole(x=T), arm(), columns={"q_elbow": "x"})
    np.testing.assert_array_equal(mapped.read().q[:, 1], T)


def test_other_columns_are_left_alone() -> None:
    extra = dict.fromkeys(("q_motor_1", "tau_des_2", "current_bus", "q_ref_elbow", "temperature", "mode"), T)
    assert not read_recording(whole(**extra), arm()).notes
    (note,) = read_recording(whole(q_4=T, q_gripper=T), arm()).notes
    sentence(note, "q_4", "q_gripper", "ignored")


BAD: dict[str, tuple[Mapping[str, Any], dict[str, Any], tuple[str, ...]]] = {
    "no time": (whole(t=None), {}, ("'t'", "seconds")),
    "no position": ({"t": T, "tau_1": T}, {}, ("no position", "q_shoulder or q_1")),
    "no torque": ({"t": T, "q": Q}, {}, ("no torque", "tau_1")),
    "torque of another joint": ({"t": T, "q_1": T, "tau_2": T}, {}, ("no torque", "tau_1")),
    "misspelt": (whole(q_2=None, q_elbo=T), {}, ("q_elbo ", "elbow", "shoulder, elbow, wrist")),
    "misspelt torque": (whole(tau_3=None, tau_Wrist=T), {}, ("tau_Wrist", "wrist is meant")),
    "unknown": (whole(q_2=None, q_hip=T), {}, ("q_hip", "shoulder, elbow, wrist")),
    "number too high": (whole(q_3=None, q_7=T), {}, ("q_7", "1 to 3")),
    "number zero": (whole(q_3=None, q_0=T), {}, ("q_0", "1 to 3")),
    "name and number": (whole(q_elbow=T), {}, ("q_elbow", "q_2", "same")),
    "negative absolute": (whole(tau_1=None, abs_tau_1=TAU[:, 0] - 9), {}, ("abs_tau_1", "negative", "row 1")),
    "later negative": (whole(tau_1=None, abs_tau_1=4.5 - np.arange(N)), {}, ("abs_tau_1", "row 6")),
    "no samples": ({"t": [], "q_1": [], "tau_1": []}, {}, ("no samples",)),
    "unequal": (whole(tau_1=T[:-1]), {}, ("tau_1", "29", "30")),
    "words": (whole(q_1=["up"] * N), {}, ("q_1", "numbers")),
    "map to nowhere": (whole(), {"columns": {"q_1": "pos"}}, ("'pos'", "q_1")),
    "map of numbers": (whole(), {"columns": {"q_1": 3}}, ("q_1", "3")),
    "map of no signal": (whole(), {"columns": {"elbow": "q_1"}}, ("'elbow'", "q_")),
    "map of a stranger": (whole(), {"columns": {"q_elbo": "q_1"}}, ("q_elbo", "elbow is meant")),
    "map uses one twice": (whole(), {"columns": {"q_1": "q_3", "q_2": "q_3"}}, ("'q_3'", "q_1", "q_2")),
    "map by name and number": (whole(), {"columns": {"q_elbow": "tau_1", "q_2": "q_3"}}, ("q_elbow", "same")),
    "no map": (whole(), {"columns": "nothing.toml"}, ("nothing.toml", "read")),
}


@pytest.mark.parametrize("case", BAD)
def test_recordings_that_cannot_be_used(case: str) -> None:
    source, options, culprits = BAD[case]
    with refusal(*culprits):
        read_recording(source, arm(), **options)


@pytest.mark.parametrize(
    ("name", "content", "culprits"),
    [
        ("gone.csv", None, ("gone.csv", "does not exist")),
        ("folder.csv", "folder", ("folder.csv", "folder")),
        ("log.doc", "t,q_1,tau_1\n", ("log.doc", "format", ".csv", ".parquet", ".npz")),
        ("a.csv", "t,q_1,tau_1\n", ("a.csv", "no samples")),
        ("a.csv", "t,q_1,tau_1\n0,1,up\n", ("a.csv", "'tau_1'", "'up'", "row 1")),
        ("a.csv", "t,x1,tau1\n0,1,2\n", ("a.csv", "no position")),
    ],
)
def test_files_that_cannot_be_used(name: str, content: str | None, culprits: tuple[str, ...], tmp_path: Path) -> None:
    if content == "folder":
        (tmp_path / name).mkdir()
    elif content is not None:
        (tmp_path / name).write_text(content)
    with refusal(*culprits):
        read_recording(tmp_path / name, arm())


@pytest.mark.parametrize("text", ["q_1 =", "q_1 = 1", 'a.b = "x"', "[q_1]\n"])
def test_maps_that_cannot_be_used(text: str, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(text)
    with refusal("map.toml"):
        read_recording(whole(), arm(), columns=tmp_path / "map.toml")


def test_same_joints() -> None:
    one, two = read_recording(whole(), arm()), read_recording(whole(q_2=None), arm())
    assert same_joints([one, one]) == arm().joints
    with refusal("elbow"):
        same_joints([two, one])


def test_unused_columns_are_named_where_a_joint_has_no_position() -> None:
    robot, t = load_robot("3r"), np.linspace(0, 1, 50)
    columns = {"t": t, "base_yaw_position": t, "q_2": t, "q_3": t, "tau_2": t, "tau_3": t}
    (note,) = read_recording(columns, robot).notes
    assert note == "joint joint_1 (at 0) has no position column and is held fixed; unused columns: base_yaw_position"
