"""Bags of every kind give the columns that were published; topics are joined in time, and oddities are reported."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from bags import (
    JOINTS,
    KINDS,
    NEW,
    OLD,
    START,
    control,
    dynamic,
    plan,
    point,
    state,
    states,
    store,
    swung,
    write1,
    write2,
)
from test_recording import arm
from test_recording_formats import refusal, sentence

import signid
from signid.recording import read_recording
from signid.recording.formats import FORMATS
from signid.recording.formats.base import About
from signid.types import Table

NONE: tuple[float, ...] = ()


def opened(path: Path, *topics: str) -> tuple[Table, About]:
    table = FORMATS["rosbag"].select(path, topics)
    return table, About.of(table)


def column(table: Table, name: str) -> np.ndarray:
    return np.asarray(table.read((name,), 0, table.rows)[:, 0])


def notes(about: About) -> str:
    return "; ".join(about.notes)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_bag_gives_the_published_columns(kind: str, tmp_path: Path) -> None:
    known = store(first=kind == "ROS 1")
    path = KINDS[kind](tmp_path, known, states(known))
    assert [name for name in FORMATS.names if FORMATS[name].recognises(path)] == ["rosbag"]
    recording = read_recording(path, arm())
    t, q, dq, tau = swung()
    found = recording.read()
    np.testing.assert_array_equal(found.t, (t - t[0]) / 1e9)
    assert found.dq is not None and found.ddq is None and found.q_des is None
    for mine, theirs in ((found.q, q), (found.dq, dq), (found.tau, tau)):
        np.testing.assert_array_equal(mine, theirs)
    assert recording.notes == () and len(recording.sha256) == 64 and recording.path == str(path)
    (topic,) = opened(path)[1].topics
    assert topic.name == "/joint_states" and topic.messages == len(t) and topic.joints == JOINTS
    assert topic.rate == pytest.approx(100) and "header stamps, counted from 2023-11-14" in opened(path)[1].clock


def test_a_folder_has_a_digest_of_its_own(tmp_path: Path) -> None:
    known = store()
    first, other = (write2(tmp_path / name, known, states(known)) for name in "ab")
    digests = {read_recording(path, arm()).sha256 for path in (first, first, other)}
    (first / "note.txt").write_text("not of the bag")
    assert digests == {read_recording(first, arm()).sha256, read_recording(other, arm()).sha256}


def test_joints_in_other_orders_and_in_part(tmp_path: Path) -> None:
    """Messages name all joints, in turn from either end, and every tenth lacks the last."""
    known, (t, q, dq, _) = store(), swung()
    messages = []
    for k, stamp in enumerate(START + t):
        pick = [0, 1] if k % 10 == 9 else [0, 1, 2] if k % 2 else [2, 1, 0]
        names = [JOINTS[j] for j in pick]
        messages.append(("/joint_states", state(known, int(stamp), names, q[k, pick], dq[k, pick], NONE), int(stamp)))
    table, about = opened(write2(tmp_path / "a", known, messages))
    np.testing.assert_array_equal(column(table, "q_shoulder"), q[:-1, 0])
    wrist = column(table, "q_wrist")
    assert table.rows == len(t) - 1, "the last row is one that lacks the wrist"
    there = np.arange(len(wrist)) % 10 != 9
    np.testing.assert_array_equal(wrist[there], q[:-1, 2][there])
    np.testing.assert_allclose(wrist, q[:-1, 2], atol=5e-4 * 25 / 4)  # short holes are interpolated
    assert "no torque was recorded" in notes(about)


def test_another_publisher_on_the_same_topic(tmp_path: Path) -> None:
    """A slow gripper does not slow down the arm; a fast one is interpolated at the arm's times."""
    known, arm_states = store(), states(store(), rate=100.0)
    for rate, name in ((10.0, "q_slow"), (250.0, "q_fast")):
        t, q = swung(int(4 * rate), rate)[:2]
        gripper = [
            (
                "/joint_states",
                state(known, START + int(s), [name[2:]], q[k, :1], NONE, NONE),
                START + int(s) + 1_000_000,
            )
            for k, s in enumerate(t)
        ]
        messages = sorted([*arm_states, *gripper], key=lambda each: each[2])
        table, about = opened(write2(tmp_path / name, known, messages))
        assert (name in table.columns) == (name == "q_fast") and ("slower" in notes(about)) == (name == "q_slow")
        assert 395 <= table.rows <= 400
        if name == "q_fast":
            np.testing.assert_allclose(column(table, name), np.sin(2 * column(table, "t")), atol=4 / 8 * 0.004**2)


def test_topics_are_joined_in_time(tmp_path: Path) -> None:
    """Positions at 100 Hz, efforts at 500 Hz from 0.1 s on with a gap of 0.1 s, desired positions at 100 Hz."""
    known, (t, q, _, _) = store(), swung()
    fast, _, _, tau = swung(2000, 500.0)
    have = (fast > 0.1e9) & ~((fast > 1.0e9) & (fast < 1.1e9))
    messages = [("/q", state(known, START + int(s), JOINTS, q[k], NONE, NONE), START + int(s)) for k, s in enumerate(t)]
    messages += [
        ("/ft/effort", state(known, START + int(s) + 700_000, JOINTS, NONE, NONE, tau[k]), START + int(s) + 800_000)
        for k, s in enumerate(fast)
        if have[k]
    ]
    messages += [
        (
            "/control",
            control(known, START + int(s), JOINTS, point(known, 0, q[k] + 0.01), point(known, 0)),
            START + int(s),
        )
        for k, s in enumerate(t)
    ]
    path = write2(tmp_path / "a", known, sorted(messages, key=lambda each: each[2]), mcap=True)
    table, about = opened(path, "/q", "ft/effort", "/control")
    at = column(table, "t") + 0.11
    truth = 2 * np.sin(2 * at) + 0.6 * np.cos(2 * at) + 0.1
    torque = column(table, "tau_shoulder")
    gap = (at > 1.001) & (at < 1.1007)
    assert gap.sum() == 10 and np.isnan(torque[gap]).all() and np.isfinite(torque[~gap]).all()
    np.testing.assert_allclose((torque - np.interp(at, fast / 1e9 + 7e-4, tau[:, 0]))[~gap], 0, atol=1e-9)
    assert np.abs(torque - truth)[~gap].max() < 5e-3
    np.testing.assert_allclose(column(table, "q_shoulder"), np.sin(2 * at), atol=1e-9)
    np.testing.assert_allclose(column(table, "q_des_elbow"), np.sin(3 * at) + 0.01, atol=1e-9)
    sentence(notes(about), "interpolated", "not across gaps", "/q: 11 messages at the ends omitted")
    assert [topic.read for topic in about.topics] == [True] * 3
    samples = read_recording(path, arm(), topics=("/q", "/ft/effort", "/control")).read()
    np.testing.assert_array_equal(samples.tau[:, 0], torque)


def test_encoders_that_wrap_are_not_interpolated_across(tmp_path: Path) -> None:
    known, t = store(), swung()[0]
    turn = (t / 1e9 * 3.0 + np.pi) % (2 * np.pi) - np.pi
    slow = [
        ("/tau", state(known, START + int(s) + 3_000_000, ["elbow"], NONE, NONE, [1.0]), START + int(s)) for s in t[::2]
    ]
    fast = [
        ("/q", state(known, START + int(s), ["elbow"], [turn[k]], NONE, NONE), START + int(s)) for k, s in enumerate(t)
    ]
    path = write2(tmp_path / "a", known, sorted([*slow, *fast], key=lambda each: each[2]))
    found = column(opened(path, "/q", "/tau")[0], "q_elbow")
    step = np.diff(found)
    assert len(found) == 200 and np.all((np.abs(step - 0.06) < 0.04) | (np.abs(step + 2 * np.pi - 0.06) < 0.04))


def test_messages_out_of_order_and_repeated(tmp_path: Path) -> None:
    known = store()
    messages = states(known)
    messages[100], messages[101] = messages[101][:2] + messages[100][2:], messages[100][:2] + messages[101][2:]
    messages.insert(200, messages[200])
    table, about = opened(write2(tmp_path / "a", known, messages))
    np.testing.assert_array_equal(column(table, "q_elbow"), swung()[1][:, 1])
    assert "header" in about.clock
    sentence(notes(about), "1 message out of order: sorted", "1 message with the time of the previous one")


@pytest.mark.parametrize("case", ["unset", "standing still", "another clock", "simulated"])
def test_the_time_that_is_used_is_reported(case: str, tmp_path: Path) -> None:
    known, (t, q, dq, tau) = store(), swung()
    stamps = {"unset": 0 * t, "standing still": 0 * t + 5, "another clock": t + 10**12, "simulated": t}[case]
    messages = [
        ("/joint_states", state(known, int(s), JOINTS, q[k], dq[k], tau[k]), START + int(t[k]))
        for k, s in enumerate(stamps)
    ]
    if case == "another clock":
        messages += states(known, "/other", late=0)
    path = write2(tmp_path / "a", known, sorted(messages, key=lambda each: each[2]))
    topics = ("/joint_states", "/other") if case == "another clock" else ()
    words = {"unset": "not set", "standing still": "do not increase", "another clock": "apart", "simulated": "from 0 s"}
    table, about = opened(path, *topics)
    sentence(about.clock, words[case], "header stamps" if case == "simulated" else "time of receipt")
    np.testing.assert_array_equal(column(table, "t"), t / 1e9)


def test_fields_without_measurements_are_left_out(tmp_path: Path) -> None:
    known, (t, q, _, tau) = store(), swung()
    tau[:, 0], tau[:, 1] = np.nan, 0.0
    tau[7, 2] = np.nan
    messages = [
        ("/joint_states", state(known, START + int(s), JOINTS, q[k], [0.0] * 3, tau[k, : 3 - (k == 5)]), START + int(s))
        for k, s in enumerate(t)
    ]
    table, about = opened(write2(tmp_path / "a", known, messages))
    assert [name for name in table.columns if not name.startswith("q_")] == ["t", "tau_wrist"]
    assert np.flatnonzero(np.isnan(column(table, "tau_wrist"))).tolist() == [5, 7]
    sentence(
        notes(about),
        "effort of shoulder, elbow is NaN or zero",
        "velocity of",
        "another length than the names: 1",
    )


@pytest.mark.parametrize("parts", [OLD, NEW], ids=["desired", "reference"])
@pytest.mark.parametrize("first", [True, False], ids=["ROS 1", "ROS 2"])
def test_a_controllers_state_is_a_recording(parts: tuple[str, str], first: bool, tmp_path: Path) -> None:
    known, (t, q, dq, tau) = store(first, parts), swung()
    messages = []
    for k, stamp in enumerate(START + t):
        asked, done = point(known, 0, q[k] + 1), point(known, 0, q[k], dq[k], NONE, tau[k])
        messages.append(("/arm/state", control(known, int(stamp), JOINTS, asked, done), int(stamp)))
    path = write1(tmp_path / "a.bag", known, messages) if first else write2(tmp_path / "a", known, messages)
    table, about = opened(path)
    np.testing.assert_array_equal(column(table, "q_des_wrist"), q[:, 2] + 1)
    np.testing.assert_array_equal(column(table, "tau_wrist"), tau[:, 2])
    assert about.notes == ()


def test_trajectories_alone_and_beside_a_recording(tmp_path: Path) -> None:
    """The second of two overlapping plans replaces the rest of the first."""
    known, (t, q, _, tau) = store(), swung()
    halves = [(0, slice(0, 300)), (int(t[200]), slice(200, 400))]
    plans = []
    for start, rows in halves:
        points = [point(known, int(t[k]) - start, q[k], NONE, NONE, tau[k]) for k in range(400)[rows]]
        plans.append(("/plan", plan(known, START + start, JOINTS, points), START + start))
    table, about = opened(write2(tmp_path / "alone", known, plans))
    np.testing.assert_array_equal(column(table, "tau_elbow"), tau[:, 1])
    sentence(notes(about), "100 points are replaced", "commanded trajectory")
    both = sorted([*plans, *states(known)], key=lambda each: each[2])
    path = write2(tmp_path / "both", known, both)
    assert not any("q_des" in name for name in opened(path)[0].columns), "only what is asked for is joined"
    table, about = opened(path, "/joint_states", "/plan")
    np.testing.assert_array_equal(column(table, "q_des_elbow"), q[:, 1])
    np.testing.assert_array_equal(column(table, "tau_elbow"), tau[:, 1])
    assert "asked for" not in notes(about)


def test_a_bag_of_another_project(data: Path) -> None:
    folder = data / "ros2_bag_ur10"
    robot = signid.load_robot(folder / "ur10.urdf")
    recording = signid.read_recording(folder, robot)
    samples = recording.read()
    assert len(recording) == 3441 and recording.joints == robot.joints and samples.ddq is not None
    np.testing.assert_allclose(np.diff(samples.t), 0.008, atol=1e-12)
    assert samples.tau[0] == pytest.approx([1.9958075, 62.22419725, -10.99137239, -0.5728812, -2.42640376, -2.93645902])
    np.testing.assert_array_equal(signid.read_recording(folder / "ros2.db3", robot).read().q, samples.q)
    found = signid.check(robot, [recording])
    assert found.samplings[0].uniform and found.samplings[0].rows == 3441


@pytest.mark.parametrize("mcap", [False, True])
def test_dynamic_joint_states_give_a_column_for_each_interface_and_joint(mcap: bool, tmp_path: Path) -> None:
    """The wrist has no current; every fourth message, and the first, lack the current of the others as well."""
    known, (t, q, dq, tau) = store(), swung()
    messages = []
    for k, stamp in enumerate(START + t):
        values = {
            joint: {"position": q[k, j], "velocity": dq[k, j], "effort": tau[k, j], "temperature": 30.0 + j}
            for j, joint in enumerate(JOINTS)
        }
        for j, joint in enumerate(JOINTS[:2] if k % 4 else ()):
            values[joint]["current"] = 0.5 * tau[k, j]
        messages.append(("/dynamic_joint_states", dynamic(known, int(stamp), values), int(stamp)))
    table, about = opened(write2(tmp_path / "a", known, messages, mcap=mcap))
    assert set(table.columns) == {
        "t",
        *(f"{kind}_{joint}" for kind in ("q", "dq", "tau", "temp") for joint in JOINTS),
        "current_shoulder",
        "current_elbow",
    }
    for kind, wanted in (("q", q), ("dq", dq), ("tau", tau)):
        np.testing.assert_array_equal(column(table, f"{kind}_wrist"), wanted[:, 2])
    np.testing.assert_array_equal(column(table, "temp_elbow"), np.full(len(t), 31.0))
    there = np.arange(len(t)) % 4 > 0
    np.testing.assert_array_equal(column(table, "current_elbow"), np.where(there, 0.5 * tau[:, 1], np.nan))
    assert "current of wrist" in notes(about) and about.topics[0].kind == "control_msgs/msg/DynamicJointState"
    np.testing.assert_array_equal(read_recording(tmp_path / "a", arm()).read().tau, tau)


def test_joint_states_are_preferred_to_dynamic_ones(tmp_path: Path) -> None:
    known, (t, q, *_) = store(), swung()
    more = [
        ("/dynamic", dynamic(known, int(stamp), {joint: {"position": 0.0} for joint in JOINTS}), int(stamp))
        for stamp in START + t
    ]
    table, about = opened(write2(tmp_path / "a", known, sorted([*states(known), *more], key=lambda each: each[2])))
    np.testing.assert_array_equal(column(table, "q_elbow"), q[:, 1])
    assert [topic.read for topic in about.topics] == [True, False]


@pytest.mark.parametrize("kind", ["ROS 1", "a bare db3"])
def test_dynamic_joint_states_need_no_definition_in_the_bag(kind: str, tmp_path: Path) -> None:
    known = store(first=kind == "ROS 1")
    values = {"elbow": {"position": 1.0, "gripping": 2.0}}
    messages = [("/d", dynamic(known, START + k * 10**7, values), START + k * 10**7) for k in range(5)]
    path = KINDS[kind](tmp_path, known, messages)
    if kind != "ROS 1":
        with sqlite3.connect(path) as database:
            database.execute("DELETE FROM message_definitions")
    table, _ = opened(path)
    np.testing.assert_array_equal(column(table, "gripping_elbow"), np.full(5, 2.0))
    np.testing.assert_allclose(column(table, "t"), np.arange(5) / 100, atol=1e-12)


def test_interfaces_named_twice_or_without_end_are_refused(tmp_path: Path) -> None:
    known = store()
    many = {"elbow": {f"x{k}": 1.0 for k in range(1001)}}
    twice = dynamic(known, START, {"elbow": {"position": 1.0, "other": 2.0}})
    twice.interface_values[0].interface_names[1] = "position"
    longer = dynamic(known, START, {"elbow": {"position": 1.0}})
    longer.joint_names.append("wrist")
    cases = ((dynamic(known, START, many), "1000 kinds"), (twice, "interface of elbow twice"), (longer, "damaged"))
    for k, (message, culprit) in enumerate(cases):
        path = write2(tmp_path / str(k), known, [("/d", message, START)])
        with refusal(str(path), culprit):
            opened(path)
