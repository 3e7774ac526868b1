"""Logs of a watch: read back by independent libraries, complete after Ctrl-C, also of a topic by a stub of rclpy."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_output_viewers import ROBOT, frame_errors, opened

import signid
from signid.cli import run
from signid.output.viewers.files import Links
from signid.regression.motion import Motion
from signid.robot import configuration
from signid.robot.dynamics import tip_jacobian
from signid.simulation.excite.families import rest_to_rest_motion

pytest.importorskip("mcap", reason="mcap is not installed (extra viewers)")

SIGNALS = {"/signid/predicted_torque", "/signid/external_torque", "/signid/threshold"}
FOUND = {"/signid/events", "/signid/log"}
PUSH, FORCE = (7.0, 7.6), np.array([0.0, 12.0, 9.0])  # [s] and [N] at the centre of mass of the last link


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model with viscous friction, and a stream with a contact."""
    place, stated = tmp_path_factory.mktemp("watched"), signid.load_model("3r")
    model = stated.with_laws(*(f"viscous_friction@{j}:coefficient=0.4" for j in (1, 2, 3)))
    model.save(place / "model.json")
    asked = rest_to_rest_motion(model.robot, 9.0, 0.002, 4)
    tau = model.inverse(Motion(model.robot, asked.t, asked.q, asked.v, asked.a))
    tau += 0.02 * np.random.default_rng(1).standard_normal(tau.shape)
    during = (asked.t > PUSH[0]) & (asked.t < PUSH[1])
    jacobian = tip_jacobian(model.robot, configuration(model.robot, asked.q[during]))
    tau[during] -= np.einsum("tij,i->tj", jacobian, FORCE)
    names = ["t", *(f"{signal}_{j}" for signal in ("q", "tau") for j in (1, 2, 3))]
    table = np.column_stack([asked.t, asked.q, tau])
    np.savetxt(place / "stream.csv", table, delimiter=",", header=",".join(names), comments="", fmt="%.8g")
    return place


@pytest.fixture(autouse=True)
def inside(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


def watched(*options: str, stream: str = "stream.csv") -> int:
    return run(["watch", "model.json", stream, "--quiet", "2", "--json", *options])


@pytest.mark.parametrize("kind", ["mcap", "rrd"])
def test_a_disk_that_fills_leaves_no_log(kind: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mcap" if kind == "mcap" else "rerun")
    resource, before = pytest.importorskip("resource"), set(folder.iterdir())
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, limits[1]))
    try:
        assert watched(f"--{kind}", f"full.{kind}") == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    output = capsys.readouterr().err
    assert f"full.{kind}: File too large" in output and len(output.splitlines()) == 1, output
    assert set(folder.iterdir()) == before


def test_mcap_holds_torque_events_and_the_moving_robot(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert watched("--mcap", "a.mcap") == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    found = opened((folder / "a.mcap").read_bytes())
    assert set(found) == {"/joint_states", *SIGNALS, *FOUND, *ROBOT}
    assert [json.loads(message.data) for _, message in found["/signid/events"]] == events
    assert_allclose(frame_errors(found, "/joint_states"), 0.0, atol=1e-12)
    times = np.array([stamp * 1e-9 for stamp, _ in found["/joint_states"]])
    assert 0.95 * 100 < (len(times) - 1) / (times[-1] - times[0]) <= 101
    effort = {name: np.array([x.effort for _, x in found[name]]) for name in (*SIGNALS, "/joint_states")}
    during = (times > PUSH[0] + 0.1) & (times < PUSH[1])
    external, threshold = effort["/signid/external_torque"], effort["/signid/threshold"]
    assert (np.abs(external[during]) > threshold[during]).any(axis=1).all(), "the push exceeds a threshold"
    assert np.isnan(threshold[0]).all(), "not known in the quiet stretch"
    rest = effort["/joint_states"] - effort["/signid/predicted_torque"]
    assert np.corrcoef(rest[during, 1], external[during, 1])[0, 1] > 0.8
    assert {message.level for _, message in found["/signid/log"]} == {20, 30}
    channels = pytest.importorskip("rosbags.rosbag2").Reader(folder / "a.mcap")
    with channels as bag:
        latched = {c.topic for c in bag.connections if any(q.durability.value == 1 for q in c.ext.offered_qos_profiles)}
    assert latched == {"/robot_description", "/tf_static"}


def test_rerun_holds_curves_events_and_links(folder: Path) -> None:
    chunks = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed (extra viewers)")
    assert watched("--rrd", "a.rrd") == 0
    reader, rows = chunks.RrdReader(folder / "a.rrd"), dict[str, int]()
    for chunk in reader.stream():
        rows[str(chunk.entity_path)] = rows.get(str(chunk.entity_path), 0) + chunk.to_record_batch().num_rows
    assert rows["/tf"] == 3 * rows["/signid/external_torque/effort"] == 3 * rows["/joint_states/position"] > 3 * 800
    assert rows["/signid/log"] >= 3 and reader.blueprints()


def test_links_are_one_tree() -> None:
    import pinocchio as pin

    robot = signid.load_robot("panda")
    links, q = Links(robot), np.linspace(0.1, 0.4, len(robot.joints))
    above = {pose.child: pose for pose in (*links.fixed, *links.poses(q))}
    bodies = [k for k, frame in enumerate(robot.model.frames) if frame.type == pin.FrameType.BODY]
    for k in bodies:
        name, chain = robot.model.frames[k].name, pin.SE3.Identity()
        while name != links.root:
            pose = above[name]
            name, chain = (
                pose.parent,
                pin.SE3(pin.Quaternion(np.array(pose.rotation)), np.array(pose.translation)) * chain,
            )
        assert chain.isApprox(links.data.oMf[k], 1e-9)


def test_a_robot_of_an_mjcf_has_curves_alone(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(
        "<mujoco><worldbody><body name='upper' pos='0 0 .2'><joint name='joint_1' axis='0 1 0'/>"
        "<geom size='.1' mass='1'/></body></worldbody></mujoco>"
    )
    t = np.arange(0, 4, 0.004)
    columns = {"t": t, "q_1": np.sin(t), "tau_1": np.sin(t)}
    found = opened(signid.viewer_log(tmp_path / "arm.xml", columns).mcap())
    assert set(found) == {"/measured", "/predicted", "/residual"}


class Ros(ModuleType):
    """Stub of rclpy that reads: the rows of a stream come as joint states; Ctrl-C shuts it down."""

    def __init__(self, rows: np.ndarray, interrupt: bool) -> None:
        super().__init__("rclpy")
        self.rows, self.interrupt, self.valid = iter(rows), interrupt, False
        self.callback: Callable[[Any], None] | None = None

    def init(self) -> None:
        self.valid = True

    def ok(self) -> bool:
        return self.valid

    def shutdown(self) -> None:
        assert self.valid, "failed to shutdown: rcl_shutdown already called on the given context"
        self.valid = False

    def create_node(self, name: str) -> Any:
        def create_subscription(kind: type, topic: str, callback: Callable[[Any], None], qos_profile: int) -> None:
            self.callback = callback

        assert self.valid
        return SimpleNamespace(create_subscription=create_subscription, destroy_node=lambda: None)

    def spin_once(self, node: Any, *, timeout_sec: float) -> None:
        assert self.callback is not None
        time.sleep(timeout_sec)
        for row in islice(self.rows, 250):
            whole, part = divmod(round(float(row[0]) * 1e9), 10**9)
            header = SimpleNamespace(stamp=SimpleNamespace(sec=whole, nanosec=part))
            signals = {
                "name": ["joint_1", "joint_2", "joint_3"],
                "position": row[1:4],
                "velocity": [],
                "effort": row[4:7],
            }
            self.callback(SimpleNamespace(header=header, **signals))
            if self.interrupt and row[0] > 8.8:
                self.valid = False
                raise KeyboardInterrupt


@pytest.mark.slow_cases("ends")
@pytest.mark.parametrize("interrupt", [False, True], ids=["ends", "Ctrl-C"])
def test_logs_of_a_topic_are_complete(
    interrupt: bool, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ros, states = Ros(np.loadtxt("stream.csv", delimiter=",", skiprows=1), interrupt), ModuleType("sensor_msgs.msg")
    states.JointState = SimpleNamespace  # type: ignore[attr-defined]
    for name, module in {"rclpy": ros, "sensor_msgs": ModuleType("sensor_msgs"), "sensor_msgs.msg": states}.items():
        monkeypatch.setitem(sys.modules, name, module)
    assert watched("--idle", "0.5", "--mcap", "b.mcap", stream="ros:/joint_states") == 0
    captured = capsys.readouterr()
    assert captured.err == "" and not ros.valid
    found = opened((folder / "b.mcap").read_bytes())
    events = [json.loads(message.data) for _, message in found["/signid/events"]]
    assert events == [json.loads(line) for line in captured.out.splitlines()] and len(events) >= 2
    assert len(found["/tf"]) == len(found["/signid/threshold"]) > 600


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--mcap", "a.csv"], "ends in .mcap"),
        (["--mcap", "stream.mcap"], "is read by this command"),
    ],
)
def test_bad_logs_end_with_a_sentence(
    options: list[str], words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "stream.mcap").write_bytes(b"")
    assert watched(*options, stream="stream.mcap" if "stream.mcap" in options else "stream.csv") == 2
    error = capsys.readouterr().err
    assert words in " ".join(error.split()) and "Traceback" not in error
